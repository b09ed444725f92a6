//! One object: its problem (`problem`, `prior`, `objective`), from its starts (`starts`, `first_fit`, `outliers`) to a fit
//! and an estimate (`fit`, `few_views`, `agreement`, `covariance`, `alternatives`).

pub(crate) mod agreement;
pub(crate) mod alternatives;
pub(crate) mod consensus;
pub(crate) mod covariance;
mod cue_starts;
#[cfg(test)]
mod cue_tests;
pub(crate) mod few_views;
pub(crate) mod first_fit;
pub(crate) mod fit;
#[cfg(test)]
pub(crate) mod fit_tests;
#[cfg(test)]
pub(crate) mod jacobian_tests;
pub(crate) mod learnt_size;
pub(crate) mod model;
pub(crate) mod objective;
pub(crate) mod outliers;
pub(crate) mod prior;
pub(crate) mod problem;
#[cfg(test)]
pub(crate) mod residual_tests;
mod scale_terms;
#[cfg(test)]
mod scale_tests;
pub(crate) mod size_site;
pub(crate) mod spread_rotations;
pub(crate) mod starts;
