//! Minimization over the nine parameters of a body.

use nalgebra::SVector;

use super::levenberg_marquardt::{self, Damping, Minimum, Problem, Quadratic};
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

/// Largest change of a parameter in one step (object sizes, radians, logarithms).
const MAX_STEP: f64 = 1.5;

/// A step in the local coordinates of a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BodyStep {
    /// Change of the parameters, each of at most [`MAX_STEP`].
    pub change: SVector<f64, 9>,
    /// The decrease of the cost that the quadratic model promises of the whole step.
    pub promised: f64,
}

impl Quadratic for NormalEquations {
    type Step = BodyStep;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn step(&self, damping: f64) -> Option<BodyStep> {
        let (hessian, gradient) = (self.hessian(), self.gradient());
        let mut damped = hessian;
        for i in 0..9 {
            damped[(i, i)] += damping * (hessian[(i, i)] + 1e-9);
        }
        let mut change = solve_spd(&damped, &-gradient)?;
        let promised = -change.dot(&gradient) * 2.0 - (change.transpose() * hessian * change)[0];
        let length = change.amax();
        if length > MAX_STEP {
            change *= MAX_STEP / length;
        }
        Some(BodyStep { change, promised })
    }
}

/// An objective of nine parameters. Calls through pointers cost nothing beside an evaluation, and leave one loop per type of state.
struct Objective<'a, State> {
    min_predicted_decrease: f64,
    linearize: &'a dyn Fn(&State) -> Option<NormalEquations>,
    retract: &'a dyn Fn(&State, &SVector<f64, 9>) -> Option<State>,
}

impl<State> Problem for Objective<'_, State> {
    type State = State;
    type Equations = NormalEquations;
    const DAMPING: Damping = Damping { first: 1e-3, taken: 0.1, failed: 8.0, max: 1e6 };

    fn linearize(&self, state: &State) -> Option<NormalEquations> {
        (self.linearize)(state)
    }

    fn retract(&self, state: &State, step: &BodyStep) -> Option<State> {
        (self.retract)(state, &step.change)
    }

    fn is_negligible(&self, step: &BodyStep, damping: f64) -> bool {
        step.promised < self.min_predicted_decrease && damping < 1.0
    }
}

/// Where a minimization ended.
pub(crate) type BodyMinimum<State> = Minimum<State, NormalEquations>;

/// Minimizes from `start`; returns the best state and the objective there, `None` when it cannot be evaluated at the
/// start.
///
/// `linearize` gives cost and derivatives at a state, `None` where the state is not allowed; `retract` moves a state by
/// a step in its local coordinates.
pub(crate) fn minimize<State>(
    start: State,
    stop: Stop,
    linearize: impl Fn(&State) -> Option<NormalEquations>,
    retract: impl Fn(&State, &SVector<f64, 9>) -> Option<State>,
) -> Option<(State, NormalEquations)> {
    minimum(start, stop, linearize, retract).map(|found| (found.state, found.equations))
}

/// The same as [`minimize`], with the reason why the iteration stopped.
pub(crate) fn minimum<State>(
    start: State,
    stop: Stop,
    linearize: impl Fn(&State) -> Option<NormalEquations>,
    retract: impl Fn(&State, &SVector<f64, 9>) -> Option<State>,
) -> Option<BodyMinimum<State>> {
    let Stop { evaluations, min_predicted_decrease } = stop;
    let objective = Objective { min_predicted_decrease, linearize: &linearize, retract: &retract };
    // The start is evaluated, too.
    levenberg_marquardt::minimize(&objective, start, evaluations.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimize::levenberg_marquardt::End;

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
        let End::UsedUp(BodyStep { promised, .. }) = early.end else { panic!("{:?}", early.end) };
        // Of a cost of x^4 the undamped step promises all.
        assert!((promised / early.state.powi(4) - 1.0).abs() < 0.01, "{promised} {}", early.state);
    }

    #[test]
    fn a_start_that_is_not_allowed_is_refused() {
        let stop = Stop { evaluations: 5, min_predicted_decrease: 0.0 };
        assert!(minimize(0.0, stop, |_| None, |x, _| Some(*x)).is_none());
    }
}
