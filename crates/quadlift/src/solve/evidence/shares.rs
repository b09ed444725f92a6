//! How frequent families and upright objects are in a scene.

use super::hypothesis::{HYPOTHESES, Hypothesis};
use super::solid::Family;

/// Frequencies of the families before the scene has been looked at; they count as one object.
pub(super) const FIRST_FAMILIES: [f64; 4] = [0.99, 0.01 / 3.0, 0.01 / 3.0, 0.01 / 3.0];

/// Upright objects before the scene has been looked at: one of two.
pub(super) const UPRIGHT_OBJECTS: f64 = 1.0;
pub(super) const PRIOR_OBJECTS: f64 = 2.0;

/// Logarithms of frequencies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shares {
    pub families: [f64; 4],
    /// Share of upright objects.
    pub upright: f64,
}

impl Shares {
    /// Before the scene has been looked at. Where the family is given all are equal.
    pub(super) fn first(family: Option<Family>) -> Self {
        let families = if family.is_some() { [0.0; 4] } else { FIRST_FAMILIES.map(f64::ln) };
        Self { families, upright: UPRIGHT_OBJECTS / PRIOR_OBJECTS }
    }

    /// Logarithms of the prior probabilities of an object's hypotheses.
    pub(super) fn log_priors(&self, upright_share: Option<f64>) -> [f64; HYPOTHESES] {
        log_priors(&self.families, upright_share.unwrap_or(self.upright))
    }
}

pub(super) fn log_priors(families: &[f64; 4], upright: f64) -> [f64; HYPOTHESES] {
    std::array::from_fn(|h| {
        let h = Hypothesis(h);
        let share = if h.is_upright() { upright } else { 1.0 - upright };
        families[h.family() as usize] + share.max(1e-6).ln()
    })
}
