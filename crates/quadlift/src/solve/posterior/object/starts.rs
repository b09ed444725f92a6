//! Where the refinement starts: one sphere, the linear solution, and for oriented bodies several rotations.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::prior::ObjectPrior;
use super::spread_rotations::spread_rotations;
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::rotation::horizontal_basis;
use crate::geometry::{BodyKind, DualQuadric};
use crate::scene::{BORDER_TOLERANCE_PX, ObjectViews, View, edges_at_border};
use crate::solve::conditioning::ObjectFrame;

/// Minimum ratio of the shortest to the longest semi-axis of a start.
const MIN_START_AXIS_RATIO: f64 = 0.2;

/// A start farther than this (object sizes) from the triangulated center is rejected.
const MAX_START: f64 = 20.0;

/// Semi-axes of an upright start whose size is not known, relative to their mean.
const UPRIGHT_START_ASPECT: Vector3<f64> = Vector3::new(1.3, 0.8, 0.96);

/// A sphere of unit radius, in the object's frame.
pub(crate) fn unit_sphere(center: Vector3<f64>) -> EllipsoidModel {
    EllipsoidModel::from_axes(center, Matrix3::identity(), Vector3::repeat(1.0))
}

/// A start ellipsoid near a quadric that may not be an ellipsoid: only a start, not a result.
pub(crate) fn ellipsoid_from_quadric(quadric: &DualQuadric) -> Option<EllipsoidModel> {
    let (center, shape) = quadric.center_and_shape()?;
    if center.coords.norm() > MAX_START {
        return None;
    }
    let (values, axes) = symmetric_eigen3(&shape)?;
    let largest = values.amax();
    let clamped = values.map(|v| v.abs().max(MIN_START_AXIS_RATIO * MIN_START_AXIS_RATIO * largest).sqrt());
    (largest > 1e-6 && largest < 1e6).then(|| EllipsoidModel::from_axes(center.coords, axes, clamped))
}

/// Starts of a body of a kind, from a fitted ellipsoid.
///
/// With a category size they are upright boxes of that size in four directions at `centers`; otherwise the ellipsoid's
/// own axes, those turned by 45 degrees ([`turned_axes`]) and rotations spread evenly, or its own axes set upright where `up` is known
/// and asked for.
pub(crate) fn oriented_starts(
    ellipsoid: &EllipsoidModel,
    kind: BodyKind,
    prior: &ObjectPrior,
    centers: &[Vector3<f64>],
    round: usize,
) -> Vec<OrientedModel> {
    let semi_axes = ellipsoid.semi_axes() * kind.relative_size();
    let upright = prior.up.filter(|_| prior.upright_weight > 0.0);
    let mut starts = Vec::new();
    match (upright, prior.log_size) {
        (Some(up), None) => {
            let Some((axes, sizes)) = set_upright(ellipsoid, &up) else { return starts };
            let sizes = sizes * kind.relative_size();
            starts.push(OrientedModel::new(*ellipsoid.center(), axes, sizes, kind));
        }
        (Some(up), Some(size)) => {
            let semi_axes = Vector3::from(size.map(|(mean, _)| mean.exp()));
            let mut all = vec![*ellipsoid.center()];
            all.extend_from_slice(centers);
            for center in all {
                for axes in upright_axes(&up) {
                    starts.push(OrientedModel::new(center, right_handed(axes), semi_axes, kind));
                }
            }
        }
        (None, Some(size)) => {
            let sizes = Vector3::from(size.map(|(mean, _)| mean.exp()));
            let own = right_handed(*ellipsoid.axes());
            for rotation in std::iter::once(own).chain(spread_rotations(round)) {
                starts.push(OrientedModel::new(*ellipsoid.center(), rotation, sizes, kind));
            }
        }
        (None, None) => {
            let mean = Vector3::repeat(semi_axes.product().cbrt());
            for (axes, semi_axes) in turned_axes(ellipsoid, prior) {
                let semi_axes = semi_axes * kind.relative_size();
                starts.push(OrientedModel::new(*ellipsoid.center(), axes, semi_axes, kind));
            }
            for rotation in spread_rotations(round) {
                starts.push(OrientedModel::new(*ellipsoid.center(), rotation, mean, kind));
            }
        }
    }
    if kind.has_axis() && prior.log_size.is_none() { starts.iter().flat_map(along_each_axis).collect() } else { starts }
}

/// A start of a cylinder with its axis along each of the three axes.
pub(crate) fn along_each_axis(start: &OrientedModel) -> [OrientedModel; 3] {
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|order| {
        let axes = Matrix3::from_columns(&order.map(|k| start.axes().column(k).into_owned()));
        let sizes = Vector3::from(order.map(|k| start.semi_axes()[k]));
        OrientedModel::new(*start.center(), axes, sizes, start.kind())
    })
}

/// The axes of an ellipsoid set upright and its semi-axes along them, the vertical one last: its shape matrix without the
/// entries between `up` and the horizontal.
pub(crate) fn set_upright(ellipsoid: &EllipsoidModel, up: &Vector3<f64>) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    let [first, second] = horizontal_basis(up);
    let basis = Matrix3::from_columns(&[first, second, *up]);
    let root = basis.transpose() * ellipsoid.root();
    let mut shape = root * root.transpose();
    let height = shape[(2, 2)].sqrt();
    // Zero is below both horizontal eigenvalues, so that the vertical one comes last.
    shape.fill_row(2, 0.0);
    shape.fill_column(2, 0.0);
    let (values, axes) = symmetric_eigen3(&shape)?;
    let sizes = Vector3::new(values[0].sqrt(), values[1].sqrt(), height);
    let mut axes = basis * axes;
    axes.set_column(2, up);
    (sizes.min() > 0.0 && sizes.iter().all(|x| x.is_finite())).then(|| (right_handed(axes), sizes))
}

/// Upright ellipsoids in four directions, where it is known that the object stands upright: in few views the direction
/// has several minima. About the center of `ellipsoid` and at `centers`.
pub(crate) fn upright_ellipsoids(
    ellipsoid: &EllipsoidModel,
    prior: &ObjectPrior,
    centers: &[Vector3<f64>],
) -> Vec<EllipsoidModel> {
    let Some(up) = prior.up.filter(|_| prior.upright_weight > 0.0) else { return Vec::new() };
    let size = ellipsoid.semi_axes().product().cbrt();
    let semi_axes =
        prior.log_size.map_or(UPRIGHT_START_ASPECT * size, |s| Vector3::from(s.map(|(mean, _)| mean.exp())));
    let at = std::iter::once(ellipsoid.center()).chain(centers);
    at.flat_map(|center| {
        upright_axes(&up).map(|axes| EllipsoidModel::from_axes(*center, right_handed(axes), semi_axes))
    })
    .collect()
}

/// Rotations of an oriented body that has the shape of a fitted ellipsoid: the ellipsoid's axes, and turned by 45 degrees
/// about each of them, because an ellipsoid of nearly equal axes does not tell where edges are. With the semi-axes along
/// them, in the order of the category's size where there is one.
pub(crate) fn turned_axes(ellipsoid: &EllipsoidModel, prior: &ObjectPrior) -> Vec<(Matrix3<f64>, Vector3<f64>)> {
    let (mut axes, mut semi_axes) = (*ellipsoid.axes(), ellipsoid.semi_axes());
    if prior.log_size.is_some() {
        for (axis, name) in prior.named_axes(ellipsoid).into_iter().enumerate() {
            axes.set_column(name, &ellipsoid.axes().column(axis));
            semi_axes[name] = ellipsoid.semi_axes()[axis];
        }
    }
    let axes = right_handed(axes);
    let turns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * std::f64::consts::FRAC_PI_4);
    std::iter::once(Vector3::zeros())
        .chain(turns)
        .map(|turn| {
            let turned = axes * Rotation3::new(turn).matrix();
            // The axes that turn into each other are compromises.
            let mean = |i: usize, j: usize| (semi_axes[i] * semi_axes[j]).sqrt();
            let sizes = match turn.iamax() {
                _ if turn == Vector3::zeros() => semi_axes,
                0 => Vector3::new(semi_axes.x, mean(1, 2), mean(1, 2)),
                1 => Vector3::new(mean(0, 2), semi_axes.y, mean(0, 2)),
                _ => Vector3::new(mean(0, 1), mean(0, 1), semi_axes.z),
            };
            (turned, sizes)
        })
        .collect()
}

/// Axes in four directions: length, width, `up`.
fn upright_axes(up: &Vector3<f64>) -> [Matrix3<f64>; 4] {
    let [first, second] = horizontal_basis(up);
    std::array::from_fn(|k| {
        let (sin, cos) = (k as f64 * std::f64::consts::FRAC_PI_4).sin_cos();
        Matrix3::from_columns(&[first * cos + second * sin, second * cos - first * sin, *up])
    })
}

fn right_handed(mut axes: Matrix3<f64>) -> Matrix3<f64> {
    if axes.determinant() < 0.0 {
        axes.column_mut(1).neg_mut();
    }
    *Rotation3::from_matrix_unchecked(axes).matrix()
}

/// Centers to start from where the category's size is known: on the ray of the tallest box that is not cut off, at the
/// depth that its height suggests, times .85, 1 and 1.2 (section 6.2). In the object's frame.
pub(crate) fn centers_from_size(views: &ObjectViews, frame: &ObjectFrame, prior: &ObjectPrior) -> Vec<Vector3<f64>> {
    let Some([_, _, (log_half_height, _)]) = prior.log_size else { return Vec::new() };
    let whole = |view: &&View| {
        let b = view.bounding_box;
        b.is_some_and(|b| !edges_at_border(&view.in_image(&b), view.image_size, BORDER_TOLERANCE_PX).contains(&true))
    };
    let height = |view: &View| view.bounding_box.map_or(0.0, |b| b.size().y);
    let tallest = views.views.iter().filter(whole).max_by(|a, b| height(a).total_cmp(&height(b)));
    let Some(view) = tallest else { return Vec::new() };
    let (Some(bounding_box), Some(camera)) = (view.bounding_box, view.projection.center_in_world()) else {
        return Vec::new();
    };
    let Some(ray) = view.projection.ray_in_world(&bounding_box.center()) else { return Vec::new() };
    let depth = view.projection.focal_length() * 2.0 * log_half_height.exp() * frame.unit / bounding_box.size().y;
    let along = view.projection.depth(&(camera + ray));
    [0.85, 1.0, 1.2]
        .into_iter()
        .map(|factor| frame.point_from_world(&(camera + ray * (depth * factor / along))))
        .collect()
}
