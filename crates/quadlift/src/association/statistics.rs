//! Log densities.

use crate::geometry::gamma::ln_gamma;
use crate::optimize::student_t::StudentT;

/// Degrees of freedom of Student's t distribution, the likelihood of an edge. Heavier tails than those of the
/// estimators (9), because wrong boxes are still included here. Not swept.
pub(crate) const STUDENT_T_DOF: f64 = 5.0;

/// The likelihood of an edge.
pub(crate) const EDGE_LIKELIHOOD: StudentT = StudentT::new(STUDENT_T_DOF);

/// `ln 2 pi`.
pub(crate) const LN_2PI: f64 = 1.8378770664093453;

/// `ln B(k + 1, n - k + 1)`: the probability of `k` given detections of `n` for a uniform prior on the detection rate.
#[derive(Debug, Clone)]
pub(crate) struct DetectionRate {
    ln_factorial: Vec<f64>,
}

impl DetectionRate {
    /// Fast for up to `most` views.
    pub(crate) fn new(most: usize) -> Self {
        let mut ln_factorial = vec![0.0];
        for n in 1..=most + 2 {
            ln_factorial.push(ln_factorial[n - 1] + (n as f64).ln());
        }
        Self { ln_factorial }
    }

    /// For `detected` of `visible` views (at least as many).
    pub(crate) fn log_probability(&self, detected: usize, visible: usize) -> f64 {
        let visible = visible.max(detected);
        if visible + 1 >= self.ln_factorial.len() {
            let ln_factorial = |n: usize| ln_gamma(n as f64 + 1.0);
            return ln_factorial(detected) + ln_factorial(visible - detected) - ln_factorial(visible + 1);
        }
        self.ln_factorial[detected] + self.ln_factorial[visible - detected] - self.ln_factorial[visible + 1]
    }
}

/// An infinite number is written as null, which JSON has and infinity is not.
#[cfg(feature = "serde")]
pub(crate) mod infinite_as_null {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

/// Logarithm of the constant of the multivariate t distribution in `dimensions` dimensions.
pub(crate) fn t_constant(dimensions: usize) -> f64 {
    let d = dimensions as f64;
    ln_gamma(0.5 * (STUDENT_T_DOF + d))
        - ln_gamma(0.5 * STUDENT_T_DOF)
        - 0.5 * d * (STUDENT_T_DOF * std::f64::consts::PI).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_and_constants() {
        let rate = DetectionRate::new(10);
        // B(3, 2) = 2! 1! / 4!
        assert!((rate.log_probability(2, 3) - (2.0f64 / 24.0).ln()).abs() < 1e-12);
        // The t density with 5 degrees of freedom at zero.
        assert!((t_constant(1).exp() - 0.3796066898224944).abs() < 1e-9);
        // The integral over the plane of the bivariate density: 2 pi times the radial one.
        let radial =
            |r: f64| (t_constant(2) - 0.5 * (STUDENT_T_DOF + 2.0) * (1.0 + r * r / STUDENT_T_DOF).ln()).exp() * r;
        let integral: f64 = (0..400_000).map(|i| radial((i as f64 + 0.5) * 1e-3) * 1e-3).sum();
        assert!((integral * std::f64::consts::TAU - 1.0).abs() < 1e-5, "{integral}");
    }
}
