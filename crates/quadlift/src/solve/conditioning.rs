//! The object frame: every estimator except `pfd` and `reg` works there, so that results are equivariant to changes of
//! the world frame.
//!
//! The origin is triangulated from the centers of the detections, the unit is their size at that depth, and the axes follow from how
//! the views see the object. World coordinates enter only through differences that are formed here, once.

use nalgebra::{Matrix3, Matrix3x4, Point3, Vector2, Vector3};

use super::triangulate::{object_radius, triangulate};
use crate::geometry::{Ellipse, Projection};
use crate::scene::View;

/// A mean of unit vectors shorter than this has no direction: the views surround the object.
const MIN_MEAN: f64 = 1e-3;

/// Weight of the logarithm of a view's angular size. Typical sizes differ by a third, which makes these means about as long as the
/// others.
const SIZE_WEIGHT: f64 = 3.0;

/// A frame in which the object sits near the origin and has about unit size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ObjectFrame {
    /// Origin in the world.
    pub origin: Point3<f64>,
    /// Length of the frame's unit in world units.
    pub unit: f64,
    /// Rotation from the frame to the world.
    pub axes: Matrix3<f64>,
}

impl ObjectFrame {
    /// The frame of an object from its views; `None` when the views do not fix a point in space.
    pub(crate) fn from_views(views: &[View]) -> Option<Self> {
        let observations: Vec<(Projection, Ellipse)> =
            views.iter().filter_map(|view| Some((view.projection, view.ellipse_or_inscribed()?))).collect();
        let centers: Vec<_> = observations.iter().map(|(projection, ellipse)| (*projection, ellipse.center)).collect();
        let origin = triangulate(&centers)?;
        let unit = object_radius(&observations, &origin)?;
        Some(Self { origin, unit, axes: axes_of(views) })
    }

    /// The projection of points in this frame, scaled so that its third row gives the depth in units of the frame.
    pub(crate) fn local_projection(&self, projection: &Projection) -> Matrix3x4<f64> {
        let p = projection.matrix();
        let m = p.fixed_columns::<3>(0);
        let last = m * self.origin.coords + p.column(3);
        let scale = m.row(2).norm();
        let mut local = Matrix3x4::zeros();
        local.fixed_columns_mut::<3>(0).copy_from(&(m * self.axes / scale));
        local.set_column(3, &(last / (scale * self.unit)));
        local
    }

    /// A point of this frame in the world.
    pub(crate) fn point_in_world(&self, local: &Vector3<f64>) -> Point3<f64> {
        self.origin + self.axes * local * self.unit
    }

    /// A point of the world in this frame.
    pub(crate) fn point_from_world(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.axes.tr_mul(&(point - self.origin)) / self.unit
    }

    /// A direction of the world in this frame.
    pub(crate) fn direction_from_world(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.axes.tr_mul(direction)
    }
}

/// How one view sees the object, as unit vectors in the world.
struct Seen {
    /// Towards the object; down and to the right in the image, across that.
    directions: [Vector3<f64>; 3],
    /// Logarithm of the angular size.
    log_size: f64,
}

impl Seen {
    fn of(view: &View) -> Option<Self> {
        let axes = view.projection.world_from_cam_rotation()?;
        let ellipse = view.ellipse_or_inscribed();
        let center: Option<Vector2<f64>> = ellipse.map(|ellipse| ellipse.center);
        let of_box3d = || Some((axes * view.cues.box3d?.center?.coords).normalize());
        let ray = center.and_then(|center| view.projection.ray_in_world(&center)).or_else(of_box3d)?;
        let across = |axis: usize| {
            let axis = axes.column(axis).into_owned();
            (axis - ray * ray.dot(&axis)).try_normalize(0.0)
        };
        let size = ellipse.map_or(1.0, |ellipse| ellipse.semi_axes.product().sqrt() / view.projection.focal_length());
        Some(Self { directions: [ray, across(1)?, across(0)?], log_size: size.ln() })
    }
}

/// Axes that turn with the world: mean directions of the views, towards the object first, so that images that are turned upside down
/// change them only where all views look the same way. Weights by size break the symmetry of a full orbit.
pub(super) fn axes_of(views: &[View]) -> Matrix3<f64> {
    let seen: Vec<Seen> = views.iter().filter_map(Seen::of).collect();
    let count = seen.len() as f64;
    let mean_size = seen.iter().map(|seen| seen.log_size).sum::<f64>() / count;
    let mean = |direction: usize, weight: &dyn Fn(&Seen) -> f64| {
        seen.iter().map(|seen| seen.directions[direction] * weight(seen)).sum::<Vector3<f64>>() / count
    };
    let candidates = (0..3).flat_map(|direction| {
        [mean(direction, &|_| 1.0), mean(direction, &|seen| SIZE_WEIGHT * (seen.log_size - mean_size))]
    });
    let (mut first, mut second) = (None, None);
    for candidate in candidates {
        match first {
            None => first = direction_of(candidate),
            Some(first) if second.is_none() => second = direction_of(candidate - first * first.dot(&candidate)),
            _ => {}
        }
    }
    match (first, second) {
        (Some(first), Some(second)) => Matrix3::from_columns(&[first, second, first.cross(&second)]),
        _ => Matrix3::identity(),
    }
}

/// `None` where the mean is too short to have one.
fn direction_of(mean: Vector3<f64>) -> Option<Vector3<f64>> {
    mean.try_normalize(MIN_MEAN).filter(|direction| direction.iter().all(|x| x.is_finite()))
}
