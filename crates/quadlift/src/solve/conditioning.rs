//! The object frame: every estimator except `pfd` and `reg` works there, so that results are equivariant to changes of
//! the world frame.
//!
//! The origin is triangulated from the centres of the detections, the unit is their size at that depth. World
//! coordinates enter only through differences that are formed here, once.

use nalgebra::{Matrix3x4, Point3, Vector3};

use super::triangulate::{object_radius, triangulate};
use crate::geometry::{Ellipse, Projection};
use crate::scene::View;

/// A frame in which the object sits near the origin and has about unit size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectFrame {
    /// Origin in the world.
    pub origin: Point3<f64>,
    /// Length of the frame's unit in world units.
    pub unit: f64,
}

impl ObjectFrame {
    /// The frame of an object from its views; `None` when the views do not fix a point in space.
    pub fn from_views(views: &[View]) -> Option<Self> {
        let observations: Vec<(Projection, Ellipse)> =
            views.iter().filter_map(|view| Some((view.projection, view.ellipse_or_inscribed()?))).collect();
        Self::from_observations(&observations)
    }

    /// The same from projections and ellipses.
    pub fn from_observations(observations: &[(Projection, Ellipse)]) -> Option<Self> {
        let centers: Vec<_> = observations.iter().map(|(projection, ellipse)| (*projection, ellipse.center)).collect();
        let origin = triangulate(&centers)?;
        let unit = object_radius(observations, &origin)?;
        Some(Self { origin, unit })
    }

    /// The projection of points in this frame, scaled so that its third row gives the depth in units of the frame.
    pub fn local_projection(&self, projection: &Projection) -> Matrix3x4<f64> {
        let p = projection.matrix();
        let m = p.fixed_columns::<3>(0);
        let last = m * self.origin.coords + p.column(3);
        let scale = m.row(2).norm();
        let mut local = Matrix3x4::zeros();
        local.fixed_columns_mut::<3>(0).copy_from(&(m / scale));
        local.set_column(3, &(last / (scale * self.unit)));
        local
    }

    /// A point of this frame in the world.
    pub fn point_in_world(&self, local: &Vector3<f64>) -> Point3<f64> {
        self.origin + local * self.unit
    }
}
