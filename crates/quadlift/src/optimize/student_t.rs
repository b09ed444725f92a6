//! Student's t distribution as the likelihood of whitened residuals: a Gaussian near zero, with heavy tails.

/// The distribution with so many degrees of freedom and the scale one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StudentT {
    dof: f64,
}

/// Squared residuals below this can be multiplied with those of a whole view without overflow.
const SMALL_ENOUGH: f64 = 1e20;

/// The cost of several residuals: the logarithm is taken of the product of their tails.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CostSum {
    student_t: StudentT,
    tails: f64,
    wild: f64,
}

impl CostSum {
    /// Adds a residual, squared.
    #[inline]
    pub(crate) fn add(&mut self, squared: f64) {
        if squared < SMALL_ENOUGH {
            self.tails *= self.student_t.tail(squared);
        } else {
            self.wild += self.student_t.cost_of_one(squared);
        }
    }

    /// Twice the negative log likelihood of the residuals, up to a constant.
    #[inline]
    pub(crate) fn total(self) -> f64 {
        self.wild + if self.tails > 1.0 { self.student_t.cost(self.tails) } else { 0.0 }
    }
}

impl StudentT {
    pub(crate) const fn new(dof: f64) -> Self {
        Self { dof }
    }

    /// The cost of no residuals yet.
    #[inline]
    pub(crate) fn no_cost(self) -> CostSum {
        CostSum { student_t: self, tails: 1.0, wild: 0.0 }
    }

    /// What a residual, squared, multiplies the argument of the logarithm in the cost by. The cost of several residuals is
    /// [`Self::cost`] of the product of theirs: one logarithm for all of them.
    #[inline]
    pub(crate) fn tail(self, squared: f64) -> f64 {
        1.0 + squared / self.dof
    }

    /// Twice the negative log likelihood, up to a constant, from a product of [`Self::tail`].
    #[inline]
    pub(crate) fn cost(self, tails: f64) -> f64 {
        (self.dof + 1.0) * tails.ln()
    }

    /// The same of one residual, squared, of any size.
    #[inline]
    pub(crate) fn cost_of_one(self, squared: f64) -> f64 {
        (self.dof + 1.0) * (squared / self.dof).ln_1p()
    }

    /// The weight of a residual, squared, in iteratively reweighted least squares: half the derivative of the cost by the square.
    #[inline]
    pub(crate) fn weight(self, squared: f64) -> f64 {
        (self.dof + 1.0) / (self.dof + squared)
    }

    /// The same from [`Self::tail`], where that is at hand.
    #[inline]
    pub(crate) fn weight_of_tail(self, tail: f64) -> f64 {
        (self.dof + 1.0) / self.dof / tail
    }

    /// Twice the negative log likelihood of `count` residuals that are wild together (multivariate), from the sum of their squares.
    pub(crate) fn cost_of(self, squares: f64, count: usize) -> f64 {
        (self.dof + count as f64) * (squares / self.dof).ln_1p()
    }

    /// The weight of each of them.
    pub(crate) fn weight_of(self, squares: f64, count: usize) -> f64 {
        (self.dof + count as f64) / (self.dof + squares)
    }

    /// Derivative of the weighted residual by the residual, relative to the weight: below one in the tails.
    #[inline]
    pub(crate) fn relative_slope(self, squared: f64) -> f64 {
        (self.dof - squared) / (self.dof + squared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_and_slopes_are_derivatives_of_the_cost() {
        let t = StudentT::new(5.0);
        let step = 1e-5;
        for residual in [0.0, 0.3, 1.0, 4.0, 30.0f64] {
            let squared = residual * residual;
            assert!((t.cost(t.tail(squared)) - t.cost_of_one(squared)).abs() < 1e-12);
            let by_square = (t.cost_of_one(squared + step) - t.cost_of_one(squared - step)) / (2.0 * step);
            assert!((by_square - t.weight(squared)).abs() < 1e-8 || squared == 0.0, "{residual}");
            assert!((t.weight_of_tail(t.tail(squared)) - t.weight(squared)).abs() < 1e-12);
            let weighted = |r: f64| r * t.weight(r * r);
            let slope = (weighted(residual + step) - weighted(residual - step)) / (2.0 * step);
            assert!((slope / t.weight(squared) - t.relative_slope(squared)).abs() < 1e-8, "{residual}");
        }
        let both = t.cost(t.tail(1.0) * t.tail(4.0));
        assert!((both - t.cost_of_one(1.0) - t.cost_of_one(4.0)).abs() < 1e-12);
    }
}
