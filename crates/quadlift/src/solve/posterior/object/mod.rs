//! One object: its problem (`problem`, `prior`, `objective`), from its starts (`starts`, `first_fit`, `outliers`) to a fit
//! and an estimate (`fit`, `few_views`, `agreement`, `covariance`, `alternatives`).

pub(crate) mod agreement;
pub(crate) mod consensus;
pub(crate) mod covariance;
mod cue_starts;
pub(crate) mod model;
pub(crate) mod size_site;
pub(crate) mod prior;
pub(crate) mod objective;
pub(crate) mod spread_rotations;
pub(crate) mod starts;
pub(crate) mod outliers;
pub(crate) mod problem;
pub(crate) mod first_fit;
pub(crate) mod fit;
pub(crate) mod alternatives;
pub(crate) mod few_views;
pub(crate) mod learned_size;
mod scale_terms;

#[cfg(test)]
mod cue_tests;
#[cfg(test)]
pub(crate) mod fit_tests;
#[cfg(test)]
pub(crate) mod jacobian_tests;
#[cfg(test)]
pub(crate) mod residual_tests;
#[cfg(test)]
mod scale_tests;
