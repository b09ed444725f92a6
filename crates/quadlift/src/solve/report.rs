//! What every estimate carries besides its body, whatever the method: residuals in pixels, how much larger the real
//! object is, and what makes the geometry weak.

use nalgebra::{Matrix3x4, Point3, Vector3};

use super::conditioning::ObjectFrame;
use super::estimate::{Estimate, Status, ViewReport, Warning};
use super::planes::{BORDER_TOLERANCE_PX, edge_plane, edges_at_border, support_plane};
use crate::geometry::{Body, BoundingBox, ConvexBody, SUPPORT_DIRECTIONS, SupportLines, project_bounding_box};
use crate::scene::View;

/// Below this largest angle between viewing rays the depth is called uncertain (radians; 5 degrees).
const NARROW_BASELINE: f64 = 0.087;

/// An estimate with a body, its residuals and warnings. `inlier` tells which views were used.
pub(super) fn describe(
    mut estimate: Estimate,
    body: Body,
    views: &[View],
    inlier: impl Fn(usize) -> bool,
    enclosing_quantile: f64,
) -> Estimate {
    estimate.center = Some(body.center());
    estimate.views = views
        .iter()
        .enumerate()
        .map(|(index, view)| ViewReport {
            frame_index: view.frame_index,
            residual_px: view_residual(view, &body),
            inlier: inlier(index),
        })
        .collect();
    let used: Vec<View> = views.iter().enumerate().filter(|(index, _)| inlier(*index)).map(|(_, view)| *view).collect();
    estimate.enclosing_scale = enclosing_scale(&used, &body, enclosing_quantile);
    estimate.warnings = warnings(&used, &body);
    estimate.body = Some(body);
    if body.center().iter().any(|x| !x.is_finite()) {
        estimate.status = Status::Diverged;
    }
    estimate
}

/// An estimate of a quadric that is no ellipsoid: its centre and the views, nothing else.
pub(super) fn describe_center(mut estimate: Estimate, center: Point3<f64>, views: &[View]) -> Estimate {
    estimate.center = Some(center);
    estimate.views =
        views.iter().map(|v| ViewReport { frame_index: v.frame_index, residual_px: None, inlier: true }).collect();
    if let Some(largest_angle) = largest_viewing_angle(views, &center).filter(|a| *a < NARROW_BASELINE) {
        estimate.warnings.push(Warning::NarrowBaseline { largest_angle });
    }
    estimate
}

/// The box that stands for a measurement: the box itself, or the one around the ellipse.
pub(super) fn measured_box(view: &View) -> Option<BoundingBox> {
    view.bounding_box.or_else(|| view.ellipse.as_ref().map(|ellipse| ellipse.bounding_box()))
}

fn view_residual(view: &View, body: &Body) -> Option<f64> {
    let measured = measured_box(view)?;
    let cut = edges_at_border(&view.in_image(&measured), view.image_size, BORDER_TOLERANCE_PX);
    let predicted = project_bounding_box(&view.projection, body).ok()?;
    let squares: Vec<f64> = (0..4)
        .filter(|&edge| !cut[edge])
        .map(|edge| (measured.edges()[edge] - predicted.edges()[edge]).powi(2))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// The factor by which the body must grow to hold the real object: a high quantile of (distance of the measured tangent
/// plane) / (reach of the body) (E5, "Tangent or enclosing").
pub(super) fn enclosing_scale(views: &[View], body: &Body, quantile: f64) -> Option<f64> {
    // Planes in a frame about the body's centre: there the distance is simply the last coefficient.
    let frame = ObjectFrame { origin: body.center(), unit: 1.0 };
    let mut ratios = Vec::with_capacity(4 * views.len());
    let mut push = |n: Vector3<f64>, d: f64| {
        let ratio = d / body.support(&n);
        if ratio.is_finite() {
            ratios.push(ratio);
        }
    };
    for view in views {
        let p: Matrix3x4<f64> = frame.local_projection(&view.projection);
        let ellipse = view.ellipse.filter(|_| view.bounding_box.is_none());
        if let Some(lines) = ellipse.as_ref().map(SupportLines::of_ellipse).or(view.support_lines) {
            for k in (0..SUPPORT_DIRECTIONS).filter(|&k| !lines.cut_off[k]) {
                let plane = support_plane(&p, &lines, k);
                push(plane.xyz(), plane.w);
            }
        } else if let Some(bounding_box) = &view.bounding_box {
            let cut = edges_at_border(&view.in_image(bounding_box), view.image_size, BORDER_TOLERANCE_PX);
            for edge in (0..4).filter(|&edge| !cut[edge]) {
                let plane = edge_plane(&p, bounding_box, edge);
                push(plane.xyz(), plane.w);
            }
        }
    }
    quantile_of(&mut ratios, quantile).filter(|scale| *scale > 0.0)
}

/// The quantile of a list, interpolated linearly between neighbours; `None` for an empty list.
fn quantile_of(values: &mut [f64], quantile: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let position = quantile.clamp(0.0, 1.0) * values.len().checked_sub(1)? as f64;
    let (low, high) = (position.floor() as usize, position.ceil() as usize);
    Some(values[low] + (values[high] - values[low]) * (position - position.floor()))
}

fn warnings(views: &[View], body: &Body) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let center = body.center();
    if views.len() == 2 {
        warnings.push(Warning::TwoViews);
    }
    if let Some(largest_angle) = largest_viewing_angle(views, &center).filter(|a| *a < NARROW_BASELINE) {
        warnings.push(Warning::NarrowBaseline { largest_angle });
    }
    let mut seen = [false; 4];
    for view in views {
        match (&view.bounding_box, &view.ellipse) {
            (None, Some(_)) => seen = [true; 4],
            (Some(b), _) => {
                let cut = edges_at_border(&view.in_image(b), view.image_size, BORDER_TOLERANCE_PX);
                (0..4).for_each(|edge| seen[edge] |= !cut[edge]);
            }
            (None, None) => {}
        }
    }
    if !views.is_empty() && seen.contains(&false) {
        warnings.push(Warning::AllEdgesCutOff);
    }
    let behind = views.iter().filter(|view| project_bounding_box(&view.projection, body).is_err()).count();
    if behind > 0 {
        warnings.push(Warning::BehindCamera { views: behind });
    }
    warnings
}

/// About the largest angle between two viewing rays to a point, in radians: the farthest ray from the first one, and
/// the farthest from that (exact when the cameras lie along a path).
pub(super) fn largest_viewing_angle(views: &[View], center: &Point3<f64>) -> Option<f64> {
    let rays: Vec<Vector3<f64>> = views
        .iter()
        .filter_map(|view| (center - view.projection.center_in_world()?).try_normalize(0.0))
        .filter(|ray| ray.iter().all(|x| x.is_finite()))
        .collect();
    let farthest =
        |from: &Vector3<f64>| rays.iter().map(|ray| (from.angle(ray), *ray)).max_by(|a, b| a.0.total_cmp(&b.0));
    let (_, extreme) = farthest(rays.first()?)?;
    farthest(&extreme).map(|(angle, _)| angle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let mut values = [4.0, 1.0, 2.0, 3.0];
        assert_eq!(quantile_of(&mut values, 0.5), Some(2.5));
        assert_eq!(quantile_of(&mut values, 1.0), Some(4.0));
        assert_eq!(quantile_of(&mut [], 0.5), None);
    }
}
