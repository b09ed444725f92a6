//! A small Levenberg-Marquardt for nine parameters on a manifold.

use nalgebra::SVector;

use super::normal_equations::NormalEquations;
use crate::geometry::linalg::solve_spd;

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    /// Evaluations of the objective, at most.
    pub evaluations: usize,
    /// Stop when a step promises to lower the cost by less than this. The cost is a sum of whitened squares, so that
    /// a decrease well below one does not matter statistically.
    pub promised_decrease: f64,
}

/// With this damping the steps are too short to be worth taking.
const LARGEST_DAMPING: f64 = 1e6;

/// Largest change of a parameter in one step (object sizes, radians, logarithms).
const LONGEST_STEP: f64 = 1.5;

/// Minimises from `start`; returns the best state and the objective there, `None` when it cannot be evaluated at the
/// start.
///
/// `linearise` gives cost and derivatives at a state, `None` where the state is not allowed; `retract` moves a state by
/// a step in its local coordinates.
pub(crate) fn minimise<State: Clone>(
    start: State,
    stop: Stop,
    linearise: impl Fn(&State) -> Option<NormalEquations>,
    retract: impl Fn(&State, &SVector<f64, 9>) -> Option<State>,
) -> Option<(State, NormalEquations)> {
    let mut state = start;
    let mut here = linearise(&state).filter(|n| n.cost.is_finite())?;
    let mut damping = 1e-3;
    let mut evaluations = 1;
    while evaluations < stop.evaluations {
        let (hessian, gradient) = (here.hessian(), here.gradient());
        let mut damped = hessian;
        for i in 0..9 {
            damped[(i, i)] += damping * (hessian[(i, i)] + 1e-9);
        }
        let Some(mut step) = solve_spd(&damped, &-gradient) else {
            damping *= 10.0;
            if damping > LARGEST_DAMPING {
                break;
            }
            continue;
        };
        // The decrease that the quadratic model promises.
        let promised = -step.dot(&gradient) * 2.0 - (step.transpose() * hessian * step)[0];
        if promised < stop.promised_decrease && damping < 1.0 {
            break;
        }
        let length = step.amax();
        if length > LONGEST_STEP {
            step *= LONGEST_STEP / length;
        }
        evaluations += 1;
        let candidate = retract(&state, &step).and_then(|s| Some((linearise(&s)?, s)));
        match candidate {
            Some((there, next)) if there.cost < here.cost => {
                (state, here) = (next, there);
                damping = (damping * 0.1).max(1e-12);
            }
            _ => {
                damping *= 8.0;
                if damping > LARGEST_DAMPING {
                    break;
                }
            }
        }
    }
    Some((state, here))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curved_valley_is_followed_to_its_bottom() {
        // Rosenbrock's function in the first two parameters, a quadratic in the others.
        let linearise = |x: &SVector<f64, 9>| {
            let mut n = NormalEquations::zero();
            let mut row = [0.0; 9];
            (row[0], row[1]) = (-20.0 * x[0], 10.0);
            n.add_quadratic(10.0 * (x[1] - x[0] * x[0]), &row);
            row = [0.0; 9];
            row[0] = -1.0;
            n.add_quadratic(1.0 - x[0], &row);
            for i in 2..9 {
                let mut row = [0.0; 9];
                row[i] = 1.0;
                n.add_quadratic(x[i] - i as f64, &row);
            }
            Some(n)
        };
        let mut start = SVector::<f64, 9>::zeros();
        start[0] = -1.2;
        let stop = Stop { evaluations: 200, promised_decrease: 1e-20 };
        let (x, end) = minimise(start, stop, linearise, |x, d| Some(x + d)).unwrap();
        assert!(end.cost < 1e-15, "{x} {}", end.cost);
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[8] - 8.0).abs() < 1e-6);
    }

    #[test]
    fn a_start_that_is_not_allowed_is_refused() {
        let stop = Stop { evaluations: 5, promised_decrease: 0.0 };
        assert!(minimise(0.0, stop, |_| None, |x, _| Some(*x)).is_none());
    }
}
