//! Levenberg-Marquardt: one loop for all problems of the library.
//!
//! Contract of [`minimize`] with a [`Problem`]:
//! 1. `linearize` gives the equations at a state, with a finite cost; `None` where the state is not allowed.
//! 2. `step` solves equations whose diagonal is damped; `None` where they are singular, which counts as a step that fails.
//! 3. `retract` moves a state by a step; `None` where that leads out of the allowed states.
//! 4. A step that does not raise the cost is taken, and damping falls; any other step fails, and damping grows.
//! 5. The loop ends before a step that `is_negligible`, after one that `is_last`, with too much damping, or when the steps are used up.
//! 6. The result is the best state with its equations; `None` where the start is not allowed.

use nalgebra::{SMatrix, SVector};

use crate::geometry::linalg::solve_spd;

/// How damping changes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Damping {
    /// That of the first step.
    pub first: f64,
    /// Its factor after a step that was taken, below 1.
    pub taken: f64,
    /// Its factor after a step that failed, above 1.
    pub failed: f64,
    /// With more, steps are too short to be worth taking.
    pub max: f64,
}

/// Damping below this does not change a step.
const MIN_DAMPING: f64 = 1e-12;

/// Cost and derivatives at a state.
pub(crate) trait Quadratic {
    /// A change of a state.
    type Step;
    /// The cost.
    fn cost(&self) -> f64;
    /// The step that minimizes the damped quadratic model.
    fn step(&self, damping: f64) -> Option<Self::Step>;
}

/// A change of a problem's states.
type StepOf<P> = <<P as Problem>::Equations as Quadratic>::Step;

/// What is minimized; the module has the contract.
pub(crate) trait Problem {
    /// The unknowns.
    type State;
    /// Cost and derivatives at a state.
    type Equations: Quadratic;
    /// How damping changes: for few parameters that start near their minimum.
    const DAMPING: Damping = Damping { first: 1e-4, taken: 0.125, failed: 64.0, max: 1e30 };

    /// The equations at a state.
    fn linearize(&self, state: &Self::State) -> Option<Self::Equations>;
    /// The state after a step.
    fn retract(&self, state: &Self::State, step: &StepOf<Self>) -> Option<Self::State>;
    /// Whether a step is not worth an evaluation.
    fn is_negligible(&self, _step: &StepOf<Self>, _damping: f64) -> bool {
        false
    }
    /// Whether no further step is needed after one that was taken: the state that it led to, the cost before, and the cost now.
    fn is_last(&self, _step: &StepOf<Self>, _state: &Self::State, _cost_before: f64, _cost: f64) -> bool {
        false
    }
}

/// Why the loop ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum End<Step> {
    /// A step was negligible, or the last one needed.
    Converged,
    /// No step is short enough not to raise the cost, as at a kink.
    NoLowerStep,
    /// The steps are used up; this would have been the next one.
    UsedUp(Step),
}

/// Where the loop ended.
#[derive(Debug, Clone)]
pub(crate) struct Minimum<State, Equations: Quadratic> {
    /// The best state.
    pub state: State,
    /// The equations there.
    pub equations: Equations,
    /// Why it ended.
    pub end: End<Equations::Step>,
}

/// Minimizes the cost from a start, with at most so many steps.
pub(crate) fn minimize<P: Problem>(
    problem: &P,
    start: P::State,
    steps: usize,
) -> Option<Minimum<P::State, P::Equations>> {
    let mut state = start;
    let mut equations = problem.linearize(&state).filter(|equations| equations.cost().is_finite())?;
    let mut damping = P::DAMPING.first;
    let mut evaluated = 0;
    let end = loop {
        if damping > P::DAMPING.max {
            break End::NoLowerStep;
        }
        let Some(step) = equations.step(damping) else {
            damping *= P::DAMPING.failed;
            continue;
        };
        if problem.is_negligible(&step, damping) {
            break End::Converged;
        }
        if evaluated == steps {
            break End::UsedUp(step);
        }
        evaluated += 1;
        let cost = equations.cost();
        let candidate = problem.retract(&state, &step).and_then(|next| Some((problem.linearize(&next)?, next)));
        match candidate.filter(|(there, _)| there.cost() <= cost) {
            Some((there, next)) => {
                (state, equations) = (next, there);
                damping = (damping * P::DAMPING.taken).max(MIN_DAMPING);
                if problem.is_last(&step, &state, cost, equations.cost()) {
                    break End::Converged;
                }
            }
            None => damping *= P::DAMPING.failed,
        }
    };
    Some(Minimum { state, equations, end })
}

/// Normal equations of a few parameters: `J^T J`, `J^T r`, and the cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Equations<const N: usize> {
    pub hessian: SMatrix<f64, N, N>,
    pub gradient: SVector<f64, N>,
    pub cost: f64,
}

impl<const N: usize> Equations<N> {
    /// Without residuals.
    pub(crate) fn zero() -> Self {
        Self { hessian: SMatrix::zeros(), gradient: SVector::zeros(), cost: 0.0 }
    }
}

impl<const N: usize> Quadratic for Equations<N> {
    type Step = SVector<f64, N>;

    fn cost(&self) -> f64 {
        self.cost
    }

    /// With the diagonal of the Hessian increased by a share of itself.
    fn step(&self, damping: f64) -> Option<SVector<f64, N>> {
        let mut damped = self.hessian;
        (0..N).for_each(|k| damped[(k, k)] *= 1.0 + damping);
        solve_spd(&damped, &-self.gradient)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};

    /// Rosenbrock's function, with which steps count and which states are allowed.
    struct Valley {
        smallest: f64,
        left: f64,
    }

    impl Problem for Valley {
        type State = Vector2<f64>;
        type Equations = Equations<2>;

        fn linearize(&self, x: &Vector2<f64>) -> Option<Equations<2>> {
            let rows = [(10.0 * (x[1] - x[0] * x[0]), Vector2::new(-20.0 * x[0], 10.0)), (1.0 - x[0], -Vector2::x())];
            let mut equations = Equations::zero();
            for (residual, row) in rows {
                equations.cost += residual * residual;
                equations.gradient += row * residual;
                equations.hessian += row * row.transpose();
            }
            Some(equations)
        }

        fn retract(&self, x: &Vector2<f64>, step: &Vector2<f64>) -> Option<Vector2<f64>> {
            Some(x + step).filter(|x| x[0] > self.left)
        }

        fn is_last(&self, step: &Vector2<f64>, _: &Vector2<f64>, before: f64, cost: f64) -> bool {
            assert!(cost <= before);
            step.norm() < self.smallest
        }
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_bottom() {
        let found = minimize(&Valley { smallest: 1e-9, left: -9.0 }, Vector2::new(-1.2, 1.0), 200).unwrap();
        assert_eq!(found.end, End::Converged);
        assert!((found.state - Vector2::repeat(1.0)).norm() < 1e-8, "{}", found.state);
        assert_eq!(found.equations.cost, found.equations.cost());
    }

    #[test]
    fn states_that_are_not_allowed_are_avoided() {
        // The minimum is outside: steps become shorter and shorter.
        let found = minimize(&Valley { smallest: 1e-9, left: 1.5 }, Vector2::new(2.0, 4.0), 1000).unwrap();
        assert_eq!(found.end, End::Converged);
        assert!(found.state[0] > 1.5 && found.state[0] < 1.6, "{}", found.state);
    }

    #[test]
    fn steps_are_used_up() {
        let start = Vector2::new(-1.2, 1.0);
        let found = minimize(&Valley { smallest: 1e-9, left: -9.0 }, start, 0).unwrap();
        assert_eq!(found.state, start);
        let End::UsedUp(next) = found.end else { panic!("{:?}", found.end) };
        // Into the valley, where the first residual vanishes; damping shortens the way along it.
        assert!((-4.4 + 24.0 * next[0] + 10.0 * next[1]).abs() < 0.01, "{next}");
        assert!(next[0] > 1.0 && next[0] < 2.2, "{next}");
    }

    #[test]
    fn singular_equations_end_the_loop() {
        /// A parameter on which nothing depends.
        struct Open;
        impl Problem for Open {
            type State = Vector3<f64>;
            type Equations = Equations<3>;
            fn linearize(&self, _: &Vector3<f64>) -> Option<Equations<3>> {
                Some(Equations { cost: 1.0, ..Equations::zero() })
            }
            fn retract(&self, x: &Vector3<f64>, step: &Vector3<f64>) -> Option<Vector3<f64>> {
                Some(x + step)
            }
        }
        assert_eq!(minimize(&Open, Vector3::zeros(), 100).unwrap().end, End::NoLowerStep);
    }
}
