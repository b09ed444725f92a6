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
    pub min_predicted_decrease: f64,
}

/// Why an iteration stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum End {
    /// A step promises less than was asked for.
    Converged,
    /// No step is short enough to lower the cost, as at a kink.
    NoLowerStep,
    /// The evaluations are used up; a step still promises to lower the cost by so much.
    UsedUp {
        /// The decrease.
        promised: f64,
    },
}

/// Where an iteration ended.
#[derive(Debug, Clone)]
pub(crate) struct Minimum<State> {
    /// The best state.
    pub state: State,
    /// The objective there.
    pub equations: NormalEquations,
    /// Why it ended.
    pub end: End,
}

/// With this damping the steps are too short to be worth taking.
const MAX_DAMPING: f64 = 1e6;

/// Largest change of a parameter in one step (object sizes, radians, logarithms).
const MAX_STEP: f64 = 1.5;

/// Minimizes from `start`; returns the best state and the objective there, `None` when it cannot be evaluated at the
/// start.
///
/// `linearize` gives cost and derivatives at a state, `None` where the state is not allowed; `retract` moves a state by
/// a step in its local coordinates.
pub(crate) fn minimize<State: Clone>(
    start: State,
    stop: Stop,
    linearize: impl Fn(&State) -> Option<NormalEquations>,
    retract: impl Fn(&State, &SVector<f64, 9>) -> Option<State>,
) -> Option<(State, NormalEquations)> {
    minimum(start, stop, linearize, retract).map(|found| (found.state, found.equations))
}

/// The same as [`minimize`], with the reason why the iteration stopped.
pub(crate) fn minimum<State: Clone>(
    start: State,
    stop: Stop,
    linearize: impl Fn(&State) -> Option<NormalEquations>,
    retract: impl Fn(&State, &SVector<f64, 9>) -> Option<State>,
) -> Option<Minimum<State>> {
    let mut state = start;
    let mut here = linearize(&state).filter(|n| n.cost.is_finite())?;
    let mut damping = 1e-3;
    let mut evaluations = 1;
    let end = loop {
        let (hessian, gradient) = (here.hessian(), here.gradient());
        let mut damped = hessian;
        for i in 0..9 {
            damped[(i, i)] += damping * (hessian[(i, i)] + 1e-9);
        }
        let Some(mut step) = solve_spd(&damped, &-gradient) else {
            damping *= 10.0;
            if damping > MAX_DAMPING {
                break End::NoLowerStep;
            }
            continue;
        };
        // The decrease that the quadratic model promises.
        let promised = -step.dot(&gradient) * 2.0 - (step.transpose() * hessian * step)[0];
        if promised < stop.min_predicted_decrease && damping < 1.0 {
            break End::Converged;
        }
        if evaluations >= stop.evaluations {
            break End::UsedUp { promised };
        }
        let length = step.amax();
        if length > MAX_STEP {
            step *= MAX_STEP / length;
        }
        evaluations += 1;
        let candidate = retract(&state, &step).and_then(|s| Some((linearize(&s)?, s)));
        match candidate {
            Some((there, next)) if there.cost < here.cost => {
                (state, here) = (next, there);
                damping = (damping * 0.1).max(1e-12);
            }
            _ => {
                damping *= 8.0;
                if damping > MAX_DAMPING {
                    break End::NoLowerStep;
                }
            }
        }
    };
    Some(Minimum { state, equations: here, end })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curved_valley_is_followed_to_its_bottom() {
        // Rosenbrock's function in the first two parameters, a quadratic in the others.
        let linearize = |x: &SVector<f64, 9>| {
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
        let stop = Stop { evaluations: 200, min_predicted_decrease: 1e-20 };
        let (x, end) = minimize(start, stop, linearize, |x, d| Some(x + d)).unwrap();
        assert!(end.cost < 1e-15, "{x} {}", end.cost);
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[8] - 8.0).abs() < 1e-6);
    }

    #[test]
    fn the_reason_for_the_end_is_told() {
        // A quartic: steps that Gauss and Newton take shorten the way by a third each.
        let quartic = |x: &f64| {
            let mut n = NormalEquations::zero();
            let mut row = [0.0; 9];
            row[0] = 2.0 * x;
            n.add_quadratic(x * x, &row);
            Some(n)
        };
        // |x|, as a residual whose derivative jumps: from 0 no step lowers it.
        let kink = |x: &f64| {
            let mut n = NormalEquations::zero();
            let mut row = [0.0; 9];
            row[0] = if *x < 0.0 { -1.0 } else { 1.0 };
            n.add_quadratic(1.0 + x.abs(), &row);
            Some(n)
        };
        let retract = |x: &f64, d: &SVector<f64, 9>| Some(x + d[0]);
        let stop = |evaluations| Stop { evaluations, min_predicted_decrease: 1e-12 };
        assert_eq!(minimum(1.0, stop(60), quartic, retract).unwrap().end, End::Converged);
        assert_eq!(minimum(0.0, stop(60), kink, retract).unwrap().end, End::NoLowerStep);
        let early = minimum(1.0, stop(2), quartic, retract).unwrap();
        let End::UsedUp { promised } = early.end else { panic!("{:?}", early.end) };
        // Of a cost of x^4 the undamped step promises all.
        assert!((promised / early.state.powi(4) - 1.0).abs() < 0.01, "{promised} {}", early.state);
    }

    #[test]
    fn a_start_that_is_not_allowed_is_refused() {
        let stop = Stop { evaluations: 5, min_predicted_decrease: 0.0 };
        assert!(minimize(0.0, stop, |_| None, |x, _| Some(*x)).is_none());
    }
}
