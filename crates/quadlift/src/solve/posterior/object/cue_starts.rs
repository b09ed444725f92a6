//! Where cues say that an object is: the frame of objects that boxes alone do not locate, and starts.

use crate::optimize::median::median;
use nalgebra::{Matrix3, Point3, Vector3};

use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::geometry::{BodyKind, Ellipse, Projection};
use crate::scene::View;
use crate::solve::conditioning::{ObjectFrame, axes_of};
use crate::solve::options::CategoryPrior;
use crate::solve::triangulate::object_radius;

/// Views whose 3D boxes are starts, evenly spread.
const STARTS: usize = 3;

/// The point where a view's cues have the center of the object: that of its 3D box, or on the ray of its box at its depth.
fn center_of(view: &View) -> Option<Point3<f64>> {
    let camera = view.projection.center_in_world()?;
    if let Some(center) = view.cues.box3d.and_then(|measured| measured.center) {
        let world_from_cam = view.projection.world_from_cam_rotation()?;
        return Some(camera + world_from_cam * center.coords);
    }
    let depth = view.cues.depth?.median - view.depth_shift;
    at_depth(view, &camera, depth).filter(|_| depth > 0.0)
}

/// The point of the ray through the middle of a view's box at this depth along the optical axis.
fn at_depth(view: &View, camera: &Point3<f64>, depth: f64) -> Option<Point3<f64>> {
    let ray = view.projection.ray_in_world(&view.measured_box()?.center())?;
    let along = view.projection.depth(&(camera + ray));
    Some(camera + ray * (depth / along)).filter(|point| along > 0.0 && point.iter().all(|x| x.is_finite()))
}

fn outlines(views: &[View]) -> Vec<(Projection, Ellipse)> {
    views.iter().filter_map(|view| Some((view.projection, view.ellipse_or_inscribed()?))).collect()
}

/// The median of each coordinate, between these axes, of the centers that the cues measure.
fn median_center(views: &[View], axes: &Matrix3<f64>) -> Option<Point3<f64>> {
    let centers: Vec<Vector3<f64>> =
        views.iter().filter_map(center_of).map(|center| axes.tr_mul(&center.coords)).collect();
    let middle = |k: usize| median(&mut centers.iter().map(|center| center[k]).collect::<Vec<f64>>());
    Some(Point3::from(axes * Vector3::new(middle(0)?, middle(1)?, middle(2)?)))
}

/// The frame of an object from its cues alone; `None` where they do not tell how far it is.
pub(crate) fn frame_from_cues(views: &[View]) -> Option<ObjectFrame> {
    let axes = axes_of(views);
    let origin = median_center(views, &axes)?;
    let unit = object_radius(&outlines(views), &origin).or_else(|| median_size(views))?;
    Some(ObjectFrame { origin, unit, axes })
}

/// The median of the mean half extents of 3D boxes.
fn median_size(views: &[View]) -> Option<f64> {
    let sizes = views.iter().filter_map(|view| Some(view.cues.box3d?.half_extents?.product().cbrt()));
    median(&mut sizes.collect::<Vec<f64>>())
}

/// The frame of an object from the size of its category: at the depth that the height of its tallest box suggests.
pub(crate) fn frame_from_size(views: &[View], category: &CategoryPrior) -> Option<ObjectFrame> {
    let height = |view: &View| view.measured_box().map_or(0.0, |b| b.size().y);
    let view = views.iter().max_by(|a, b| height(a).total_cmp(&height(b)))?;
    let depth = view.projection.focal_length() * category.size?.mean[2] / height(view);
    let origin = at_depth(view, &view.projection.center_in_world()?, depth)?;
    Some(ObjectFrame { origin, unit: object_radius(&outlines(views), &origin)?, axes: axes_of(views) })
}

/// A 3D box in an object's frame: its axes, and half its extents if it has them.
fn boxes(views: &[View], frame: &ObjectFrame) -> Vec<(Matrix3<f64>, Option<Vector3<f64>>)> {
    let of_view = |view: &View| {
        let measured = view.cues.box3d?;
        let world_from_cam = view.projection.world_from_cam_rotation()?;
        Some((
            frame.axes.tr_mul(&world_from_cam) * measured.rotation?.matrix(),
            measured.half_extents.map(|half| half / frame.unit),
        ))
    };
    let all: Vec<_> = views.iter().filter_map(of_view).collect();
    let stride = all.len().div_ceil(STARTS).max(1);
    all.into_iter().step_by(stride).collect()
}

/// Ellipsoids where the cues have the object; none without cues that tell how far it is.
pub(crate) fn ellipsoids_from_cues(views: &[View], frame: &ObjectFrame) -> Vec<EllipsoidModel> {
    if views.iter().all(|view| view.cues.is_empty()) {
        return Vec::new();
    }
    let Some(found) = frame_from_cues(views) else { return Vec::new() };
    let center = frame.point_from_world(&found.origin);
    let radius = found.unit / frame.unit;
    let sphere = EllipsoidModel::from_axes(center, Matrix3::identity(), Vector3::repeat(radius));
    let of_box =
        |(axes, half): (Matrix3<f64>, Option<Vector3<f64>>)| Some(EllipsoidModel::from_axes(center, axes, half?));
    std::iter::once(sphere).chain(boxes(views, frame).into_iter().filter_map(of_box)).collect()
}

/// Bodies of a kind, where an ellipsoid was fitted, turned as the 3D boxes are.
pub(crate) fn oriented_from_cues(
    views: &[View],
    frame: &ObjectFrame,
    ellipsoid: &EllipsoidModel,
    kind: BodyKind,
) -> Vec<OrientedModel> {
    if views.iter().all(|view| view.cues.box3d.is_none()) {
        return Vec::new();
    }
    let round = Vector3::repeat(ellipsoid.semi_axes().product().cbrt() * kind.relative_size());
    boxes(views, frame)
        .into_iter()
        .map(|(axes, half)| OrientedModel::new(*ellipsoid.center(), axes, half.unwrap_or(round), kind))
        .collect()
}
