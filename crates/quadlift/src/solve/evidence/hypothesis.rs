//! Hypotheses about an object.

use super::solid::Family;

/// Families with any rotation, then the same upright.
pub(super) const HYPOTHESES: usize = 8;

/// A hypothesis: a family, upright or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Hypothesis(pub usize);

impl Hypothesis {
    pub(super) const ELLIPSOID: Self = Self(0);

    pub(super) fn all() -> impl Iterator<Item = Self> {
        (0..HYPOTHESES).map(Self)
    }

    pub(super) fn of(family: Family, upright: bool) -> Self {
        Self(family as usize + if upright { Family::ALL.len() } else { 0 })
    }

    pub(super) fn family(self) -> Family {
        Family::ALL[self.0 % Family::ALL.len()]
    }

    pub(super) fn is_upright(self) -> bool {
        self.0 >= Family::ALL.len()
    }
}
