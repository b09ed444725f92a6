//! Optimization: Levenberg-Marquardt, minimization over the nine parameters of a body, normal equations, chi-square sums of different sizes,
//! Student's t distribution, the assignment problem.

pub(crate) mod bits;
pub(crate) mod chi_square;
pub(crate) mod matching;
pub(crate) mod median;
pub(crate) mod levenberg_marquardt;
pub(crate) mod normal_equations;
pub(crate) mod minimize;
pub(crate) mod student_t;
