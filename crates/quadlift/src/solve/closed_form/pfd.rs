//! The closed form of *3D Pose from Detections* (Rubino et al., ICCV 2015, section 3), exactly and in O(F).
//!
//! Minimizes `|M w|` over `w = (v, beta_1 .. beta_F)`: view f says `G_f v = beta_f vech C*_f`, with conics scaled to
//! `C*_33 = -1`, raw pixel coordinates and unscaled projections, as the paper does. The paper computes the last
//! singular vector of M (6F x (10 + F)) with a dense decomposition in O(F^3); [`pfd`] finds the same vector by
//! eliminating the betas (see the module `arrowhead`; docs/method.md, section 4.2).

use nalgebra::SVector;

use super::arrowhead::{Arrowhead, Minimizer, PIXEL_ROUNDING};
use crate::geometry::{DualQuadric, Ellipse, Projection, vech3};

/// Minimum number of views for a unique solution.
pub(crate) const MIN_VIEWS: usize = 3;

/// Why a closed form has no solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ClosedFormError {
    /// Fewer views than the method needs.
    #[error("{found} views, but at least {needed} are needed")]
    TooFewViews {
        /// Views given.
        found: usize,
        /// Views needed.
        needed: usize,
    },
    /// The equations do not determine the quadric (for example, all views from one point), or contain non-finite
    /// numbers.
    #[error("the views do not determine the object")]
    Degenerate,
}

/// A solution of the closed form.
#[derive(Debug, Clone, PartialEq)]
pub struct PfdSolution {
    /// The dual quadric, with `Q*_44 <= 0`; it need not be an ellipsoid. Its scale is that of the constraint.
    pub dual_quadric: DualQuadric,
    /// `beta_f` of every view, in the order of the views.
    pub betas: Vec<f64>,
    /// `|M w|` at the solution: the smallest singular value of the system.
    pub residual: f64,
    /// Newton steps that the constraint `|w| = 1` took.
    pub iterations: usize,
}

/// The paper's closed form: the minimizer of `|M w|` with `|w| = 1` (PfD section 3), in O(F) time and memory.
///
/// Projections map world points to pixels, ellipses are in pixels. At least three views are needed.
///
/// # Errors
/// [`ClosedFormError`].
pub fn pfd(observations: &[(Projection, Ellipse)]) -> Result<PfdSolution, ClosedFormError> {
    if observations.len() < MIN_VIEWS {
        return Err(ClosedFormError::TooFewViews { found: observations.len(), needed: MIN_VIEWS });
    }
    let system = pixel_system(observations);
    if system.is_degenerate(PIXEL_ROUNDING) {
        return Err(ClosedFormError::Degenerate);
    }
    let Minimizer { v, mut betas, residual, iterations } =
        system.minimize_unit_w().ok_or(ClosedFormError::Degenerate)?;
    let mut v = SVector::from(v);
    if !v.iter().chain(&betas).all(|x| x.is_finite()) {
        return Err(ClosedFormError::Degenerate);
    }
    if v[9] > 0.0 {
        v.neg_mut();
        betas.iter_mut().for_each(|beta| *beta = -*beta);
    }
    Ok(PfdSolution { dual_quadric: DualQuadric::from_vech(&v), betas, residual, iterations })
}

/// The equations of all views in pixel coordinates.
pub(crate) fn pixel_system(observations: &[(Projection, Ellipse)]) -> Arrowhead {
    Arrowhead::new(observations.iter().map(|(p, ellipse)| (*p.matrix(), vech3(&ellipse.dual_conic()).into())))
}
