//! The conditioned closed form: *3D Object Localization from Multi-view Image Detections* (LfD, TPAMI 2017).
//!
//! The same equations as in [`super::pfd`], in well-scaled coordinates: the center of each ellipse becomes the image
//! origin and `sqrt(l1^2 + l2^2)` its unit, and the world's origin moves to the object.
//!
//! LfD solves in the world frame first and moves the origin to that estimate. Here the first pass already has an
//! object frame (ours): the origin at the triangulated center and the mean depth as the unit, so that the result
//! does not depend on the frame in which the cameras are given. In our measurements (the published noises, box noise 0.1,
//! narrow arcs, 4 to 20 views) units between a third of the object's radius and the depth agree to three digits;
//! on real boxes, units below the radius are worse, and the depth, which makes the betas about one, is far from that.

use nalgebra::{Matrix3, Matrix3x4, Point3, SVector};

use super::arrowhead::{Arrowhead, CONDITIONED_ROUNDING};
use super::pfd::{ClosedFormError, MIN_VIEWS};
use crate::geometry::{DualQuadric, Ellipse, Ellipsoid, EllipsoidError, Projection, vech3};
use crate::solve::triangulate::triangulate;

/// Passes: the second one has its origin at the center that the first one found.
const PASSES: usize = 2;

/// A quadric by its center and shape. Far from the world's origin these keep the digits that `Q*` loses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConditionedSolution {
    /// The center in the world.
    pub center: Point3<f64>,
    /// The shape matrix `A` (3x3, squared world units); it need not be positive definite.
    pub shape: Matrix3<f64>,
}

impl ConditionedSolution {
    /// The ellipsoid, if the quadric is one; nothing is repaired.
    ///
    /// # Errors
    /// [`EllipsoidError::NotAnEllipsoid`] carries the center.
    pub fn to_ellipsoid(&self) -> Result<Ellipsoid, EllipsoidError> {
        Ellipsoid::from_shape(self.center, &self.shape)
    }
}

/// The closed form with the conditioning of LfD, in a frame that belongs to the object; O(F).
///
/// Projections map world points to pixels, ellipses are in pixels. At least three views are needed. Moving, turning
/// or scaling the world moves, turns and scales the result.
///
/// # Errors
/// [`ClosedFormError`].
pub fn lfd(observations: &[(Projection, Ellipse)]) -> Result<ConditionedSolution, ClosedFormError> {
    if observations.len() < MIN_VIEWS {
        return Err(ClosedFormError::TooFewViews { found: observations.len(), needed: MIN_VIEWS });
    }
    let centers: Vec<_> = observations.iter().map(|(projection, ellipse)| (*projection, ellipse.center)).collect();
    let start = triangulate(&centers).ok_or(ClosedFormError::Degenerate)?;
    let depth = observations.iter().map(|(p, _)| p.depth(&start).abs()).sum::<f64>() / observations.len() as f64;
    if !(depth.is_finite() && depth > 0.0) {
        return Err(ClosedFormError::Degenerate);
    }
    let mut solution = ConditionedSolution { center: start, shape: Matrix3::zeros() };
    for _ in 0..PASSES {
        solution = one_pass(observations, &solution.center, depth)?;
    }
    Ok(solution)
}

/// The minimizer in the frame with the given origin and unit.
fn one_pass(
    observations: &[(Projection, Ellipse)],
    origin: &Point3<f64>,
    unit: f64,
) -> Result<ConditionedSolution, ClosedFormError> {
    let system = Arrowhead::new(observations.iter().map(|(projection, ellipse)| {
        let size = ellipse.semi_axes.norm();
        let unit_ellipse = Ellipse { center: Default::default(), semi_axes: ellipse.semi_axes / size, ..*ellipse };
        (conditioned(projection, ellipse, size, origin, unit), vech3(&unit_ellipse.dual_conic()).into())
    }));
    if system.is_degenerate(CONDITIONED_ROUNDING) {
        return Err(ClosedFormError::Degenerate);
    }
    let minimizer = system.minimize_unit_w().ok_or(ClosedFormError::Degenerate)?;
    let quadric = DualQuadric::from_vech(&SVector::from(minimizer.v));
    let (center, shape) = quadric.center_and_shape().ok_or(ClosedFormError::Degenerate)?;
    Ok(ConditionedSolution { center: origin + center.coords * unit, shape: shape * (unit * unit) })
}

/// The projection from the frame with the given origin and unit to the image in which the ellipse is centered and of
/// size one. The scale is such that depths are in units of `unit`, whatever the scale of the given matrix.
fn conditioned(
    projection: &Projection,
    ellipse: &Ellipse,
    size: f64,
    origin: &Point3<f64>,
    unit: f64,
) -> Matrix3x4<f64> {
    let mut p = *projection.matrix();
    let moved = p * origin.to_homogeneous();
    p.set_column(3, &(moved / unit));
    let third = p.row(2).into_owned();
    for i in 0..2 {
        let row = (p.row(i) - third * ellipse.center[i]) / size;
        p.set_row(i, &row);
    }
    p / third.fixed_columns::<3>(0).norm()
}
