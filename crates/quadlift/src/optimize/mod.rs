//! Minimisation and what it needs: Levenberg-Marquardt over nine parameters, normal equations, sums of squares of different
//! numbers of residuals, pairs of two sets with the largest sum.

pub(crate) mod chi_square;
pub(crate) mod levenberg_marquardt;
pub(crate) mod matching;
pub(crate) mod normal_equations;
