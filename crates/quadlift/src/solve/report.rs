//! Common parts of every estimate besides its body: residuals in pixels, the enclosing ellipsoid, and warnings about weak
//! geometry.

use nalgebra::{Point3, Vector3};

use super::enclosing::enclosing;
use super::estimate::{Estimate, Rejection, Status, ViewReport, Warning};
use crate::geometry::{Body, ConvexBody, project_bounding_box};
use crate::optimize::median::quantile;
use crate::scene::View;

/// Below this largest angle between viewing rays the depth is called uncertain (radians; 5 degrees).
const NARROW_BASELINE: f64 = 0.087;

/// A body whose outline is this many times larger or smaller than measured is none.
const RUN_AWAY: f64 = 10.0;

/// An estimate with a body, its residuals and warnings. `inlier` marks the used views.
pub(super) fn describe(
    mut estimate: Estimate,
    body: Body,
    views: &[View],
    inlier: impl Fn(usize) -> bool,
    with_enclosing: bool,
) -> Estimate {
    if body.center().iter().any(|x| !x.is_finite()) {
        estimate.status = Status::Diverged;
        return estimate;
    }
    estimate.center = Some(body.center());
    estimate.views = views
        .iter()
        .enumerate()
        .map(|(index, view)| ViewReport {
            frame_index: view.frame_index,
            residual_px: view_residual(view, &body),
            normalized_residual: None,
            inlier: inlier(index),
            rejection_reason: (!inlier(index)).then(|| match project_bounding_box(&view.projection, &body) {
                Ok(_) => Rejection::Residual,
                Err(_) => Rejection::BehindCamera,
            }),
        })
        .collect();
    let used: Vec<View> = views.iter().enumerate().filter(|(index, _)| inlier(*index)).map(|(_, view)| *view).collect();
    estimate.enclosing = if with_enclosing { enclosing(&used, &body) } else { None };
    // What is said of the views that count needs some that do.
    estimate.warnings = if used.len() < 2.min(views.len()) { Vec::new() } else { warnings(&used, &body) };
    estimate.body = Some(body);
    estimate
}

/// An estimate of a quadric that is not an ellipsoid: only its center and the views.
pub(super) fn describe_center(mut estimate: Estimate, center: Point3<f64>, views: &[View]) -> Estimate {
    estimate.center = Some(center);
    estimate.views = views.iter().map(|view| ViewReport::without_body(view.frame_index)).collect();
    if let Some(largest_angle) = largest_viewing_angle(views, &center).filter(|a| *a < NARROW_BASELINE) {
        estimate.warnings.push(Warning::NarrowBaseline { largest_angle });
    }
    estimate
}

/// Root mean square distance of measured and predicted edges, over those used by the fit: an edge that is cut off is
/// used only if the body does not reach it.
fn view_residual(view: &View, body: &Body) -> Option<f64> {
    let measured = view.measured_box()?;
    let predicted = project_bounding_box(&view.projection, body).ok()?;
    let squares: Vec<f64> = (0..4)
        .filter_map(|edge| {
            let outside = measured.edges()[edge] - predicted.edges()[edge];
            let beyond = if edge < 2 { -outside } else { outside };
            (!view.cut_off[edge] || beyond > 0.0).then_some(outside * outside)
        })
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Whether a body is plausible: it is visible in some view, and its size matches the measured one to within a factor of
/// ten in the median view. A fit that diverged to a point or to infinity is not (ours). If the image border cuts the
/// box, it only bounds the size from below.
pub(super) fn is_a_body(body: &Body, views: &[View]) -> bool {
    let ratio = |view: &View| {
        let measured = view.measured_box()?;
        let predicted = project_bounding_box(&view.projection, body).ok()?;
        let ratio = predicted.mean_half_size() / measured.mean_half_size();
        Some(if view.cut_off.contains(&true) { ratio.min(1.0) } else { ratio })
    };
    if views.iter().all(|view| view.measured_box().is_none()) {
        // 3D boxes alone.
        return body.half_extents.iter().all(|x| x.is_finite() && *x > 0.0);
    }
    let mut ratios: Vec<f64> = views.iter().filter_map(ratio).collect();
    quantile(&mut ratios, 0.5).is_some_and(|median| (1.0 / RUN_AWAY..=RUN_AWAY).contains(&median))
}

fn warnings(views: &[View], body: &Body) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let center = body.center();
    // One view, or a cue, says in another way how sure the distance is.
    let tells_distance = views.len() == 1 || views.iter().any(|view| view.cues.tell_distance());
    if views.len() == 1 {
        warnings.push(Warning::OneView);
    }
    if views.len() == 2 {
        warnings.push(Warning::TwoViews);
    }
    if let Some(largest_angle) =
        largest_viewing_angle(views, &center).filter(|a| *a < NARROW_BASELINE && !tells_distance)
    {
        warnings.push(Warning::NarrowBaseline { largest_angle });
    }
    // 3D boxes alone are cut off nowhere.
    let mut seen = [views.iter().all(|view| view.measured_box().is_none()); 4];
    for view in views {
        match (&view.bounding_box, &view.ellipse) {
            (None, Some(_)) => seen = [true; 4],
            (Some(_), _) => (0..4).for_each(|edge| seen[edge] |= !view.cut_off[edge]),
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
    use nalgebra::{Matrix3x4, Rotation3};

    use super::*;
    use crate::geometry::{BoundingBox, Ellipsoid, Projection};

    /// A camera at the origin that looks along z, with focal length 100 and an image of 200 x 200.
    fn view(bounding_box: [f64; 4]) -> View {
        let matrix = Matrix3x4::new(100.0, 0.0, 100.0, 0.0, 0.0, 100.0, 100.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let bounding_box = BoundingBox::new(bounding_box).unwrap();
        View::from_box(Projection::from_matrix(matrix).unwrap(), bounding_box)
            .with_image_size(200.0, 200.0)
            .with_cut_off_edges(5.0)
    }

    fn ball(x: f64, radius: f64) -> Body {
        let center = Point3::new(x, 0.0, 100.0);
        let semi_axes = Vector3::repeat(radius);
        Body::from(Ellipsoid { center, semi_axes, rotation: Rotation3::identity() })
    }

    #[test]
    fn an_edge_at_the_border_counts_only_where_the_body_does_not_reach_it() {
        // The ball's box is about 80, 80, 120, 120.
        let inside = view([80.0, 80.0, 120.0, 120.0]);
        assert!(view_residual(&inside, &ball(0.0, 20.0)).unwrap() < 1.0);
        // Cut off on the right at 197, where the body reaches 240: nothing is wrong.
        let cut = view([160.0, 80.0, 197.0, 120.0]);
        assert_eq!(cut.cut_off, [false, false, true, false]);
        assert!(view_residual(&cut, &ball(80.0, 20.0)).unwrap() < 2.5);
        // A body that ends at 157 does not reach it: 40 px on the right, 40 px on the left.
        let short = view_residual(&cut, &ball(40.0, 20.0)).unwrap();
        assert!((short - (2.0f64 * 40.0 * 40.0 / 4.0).sqrt()).abs() < 3.0, "{short}");
        // Left out of account by a tolerance of 2 px, the same edge is one like the others.
        assert_eq!(cut.with_cut_off_edges(2.0).cut_off, [false; 4]);
    }

    #[test]
    fn a_point_and_a_giant_are_no_bodies() {
        let views = [view([80.0, 80.0, 120.0, 120.0]); 2];
        assert!(is_a_body(&ball(0.0, 20.0), &views) && is_a_body(&ball(0.0, 3.0), &views));
        assert!(!is_a_body(&ball(0.0, 1e-12), &views));
        assert!(!is_a_body(&ball(0.0, 1.0), &views));
        assert!(!is_a_body(&ball(0.0, 99.9), &views), "its outline reaches 20 times as far as measured");
        assert!(!is_a_body(&ball(0.0, 200.0), &views), "it has no outline: the camera is in it");
        // Where the border cuts the box the body may be any larger.
        let cut = [view([1.0, 1.0, 199.0, 199.0]); 2];
        assert!(is_a_body(&ball(0.0, 99.9), &cut) && !is_a_body(&ball(0.0, 1.0), &cut));
    }
}
