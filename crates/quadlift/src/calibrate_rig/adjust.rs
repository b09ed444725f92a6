//! All unknowns together: Levenberg-Marquardt, with the places of the bodies eliminated (Schur complement).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Matrix3xX, Vector3};

use super::predicted::across;
use super::problem::{Problem, Row, SHARED, STUDENT_T, State, Unknown};
use crate::optimize::levenberg_marquardt::{self, Damping, Quadratic};
use crate::parallel::map_indices;

/// Decrease of the cost, relative and absolute, below which the search has ended.
const SMALL_DECREASE: f64 = 1e-7;

/// Where the unknowns that sites share are in one vector: free cameras, the vertical, shapes.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    cameras: Vec<Option<usize>>,
    up: Option<usize>,
    shapes: usize,
    pub len: usize,
}

impl Layout {
    pub(super) fn new(problem: &Problem) -> Self {
        let mut len = 0;
        let mut take = |count: usize| {
            len += count;
            len - count
        };
        let cameras = problem.free.iter().map(|&free| free.then(|| take(6))).collect();
        let up = problem.up_free.then(|| take(2));
        let shapes = take(3 * problem.shapes.len());
        Self { cameras, up, shapes, len }
    }

    /// First of the six numbers of a camera.
    pub(super) fn camera(&self, camera: usize) -> Option<usize> {
        self.cameras[camera]
    }

    pub(super) fn up(&self) -> Option<usize> {
        self.up
    }

    /// Place of an unknown; `None` where it is not sought.
    pub(super) fn unknown(&self, unknown: Unknown) -> Option<usize> {
        match unknown {
            Unknown::Camera(camera, k) => self.cameras[camera].map(|first| first + k),
            Unknown::Shape(shape, k) => Some(self.shapes + 3 * shape + k),
        }
    }

    /// Places of the shared unknowns of a row.
    fn of_row(&self, camera: Option<usize>, shape: usize) -> [Option<usize>; SHARED] {
        let first = camera.and_then(|camera| self.cameras[camera]);
        std::array::from_fn(|k| match k {
            0..6 => first.map(|first| first + k),
            6 | 7 => self.up.map(|first| first + k - 6),
            _ => Some(self.shapes + 3 * shape + k - 8),
        })
    }
}

/// What a site adds: its own equations, and how they depend on shared unknowns.
#[derive(Debug, Clone)]
struct SiteEquations {
    hessian: Matrix3<f64>,
    gradient: Vector3<f64>,
    /// Shared unknowns, and the mixed derivatives (a column for each).
    indices: Vec<usize>,
    mixed: Matrix3xX<f64>,
    cost: f64,
}

/// Gauss-Newton equations at a state.
#[derive(Debug, Clone)]
struct Equations {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    sites: Vec<SiteEquations>,
    cost: f64,
}

fn site_equations(problem: &Problem, layout: &Layout, site: usize, rows: &[Row]) -> SiteEquations {
    let shape = problem.sites[site].shape;
    let mut indices: Vec<usize> = rows.iter().flat_map(|row| layout.of_row(row.camera, shape)).flatten().collect();
    indices.sort_unstable();
    indices.dedup();
    let mut all = SiteEquations {
        hessian: Matrix3::zeros(),
        gradient: Vector3::zeros(),
        mixed: Matrix3xX::zeros(indices.len()),
        indices,
        cost: 0.0,
    };
    for row in rows {
        let squared = row.residual * row.residual;
        let weight = STUDENT_T.weight(squared);
        all.cost += STUDENT_T.cost_of_one(squared);
        all.hessian += row.place * row.place.transpose() * weight;
        all.gradient += row.place * (weight * row.residual);
        for (index, derivative) in layout.of_row(row.camera, shape).into_iter().zip(row.shared) {
            let Some(index) = index.filter(|_| derivative != 0.0) else { continue };
            let column = all.indices.partition_point(|&known| known < index);
            let mut column = all.mixed.column_mut(column);
            column += row.place * (weight * derivative);
        }
    }
    all
}

fn equations(problem: &Problem, layout: &Layout, state: &State) -> Option<Equations> {
    let of_site = |site: usize| {
        let rows = problem.rows(state, site)?;
        let own = site_equations(problem, layout, site, &rows);
        Some((rows, own))
    };
    let found: Option<Vec<(Vec<Row>, SiteEquations)>> = map_indices(problem.sites.len(), of_site).into_iter().collect();
    let (mut hessian, mut gradient) = (DMatrix::zeros(layout.len, layout.len), DVector::zeros(layout.len));
    let mut cost = 0.0;
    let mut sites = Vec::with_capacity(problem.sites.len());
    for (site, (rows, own)) in found?.into_iter().enumerate() {
        for row in &rows {
            let weight = STUDENT_T.weight(row.residual * row.residual);
            let places = layout.of_row(row.camera, problem.sites[site].shape);
            for i in 0..SHARED {
                let Some(at) = places[i].filter(|_| row.shared[i] != 0.0) else { continue };
                gradient[at] += weight * row.residual * row.shared[i];
                for j in 0..SHARED {
                    if let Some(other) = places[j] {
                        hessian[(at, other)] += weight * row.shared[i] * row.shared[j];
                    }
                }
            }
        }
        cost += own.cost;
        sites.push(own);
    }
    problem.prior_rows(state, |residual, derivatives| {
        cost += residual * residual;
        for &(unknown, derivative) in derivatives {
            let Some(at) = layout.unknown(unknown) else { continue };
            gradient[at] += residual * derivative;
            for &(other, by_other) in derivatives {
                if let Some(other) = layout.unknown(other) {
                    hessian[(at, other)] += derivative * by_other;
                }
            }
        }
    });
    // Unknowns that nothing depends on (the height of what does not walk, the radius of a ball, the vertical of balls) stay.
    for k in 0..layout.len {
        if hessian[(k, k)] == 0.0 {
            hessian[(k, k)] = 1.0;
        }
    }
    cost.is_finite().then_some(Equations { hessian, gradient, sites, cost })
}

/// Cholesky factor and right side of the shared unknowns, and the inverses of the sites' own equations.
type Reduced = (Cholesky<f64, Dyn>, DVector<f64>, Vec<Matrix3<f64>>);

/// The shared unknowns alone.
fn reduced(equations: &Equations, damping: f64) -> Option<Reduced> {
    let (mut hessian, mut gradient) = (equations.hessian.clone(), equations.gradient.clone());
    (0..hessian.nrows()).for_each(|k| hessian[(k, k)] *= 1.0 + damping);
    let mut inverses = Vec::with_capacity(equations.sites.len());
    for site in &equations.sites {
        let mut own = site.hessian;
        (0..3).for_each(|k| own[(k, k)] *= 1.0 + damping);
        let inverse = own.cholesky()?.inverse();
        let by_site = inverse * &site.mixed;
        let right = by_site.tr_mul(&site.gradient);
        let minus = site.mixed.tr_mul(&by_site);
        for (i, &at) in site.indices.iter().enumerate() {
            gradient[at] -= right[i];
            for (j, &other) in site.indices.iter().enumerate() {
                hessian[(at, other)] -= minus[(i, j)];
            }
        }
        inverses.push(inverse);
    }
    Some((hessian.cholesky()?, gradient, inverses))
}

fn moved(problem: &Problem, layout: &Layout, state: &State, step: &DVector<f64>, places: &[Vector3<f64>]) -> State {
    let mut next = state.clone();
    for (camera, pose) in next.poses.iter_mut().enumerate() {
        if let Some(first) = layout.cameras[camera] {
            let part = |k: usize| step.fixed_rows::<3>(first + k).into_owned();
            *pose = pose.moved(&part(0), &part(3));
        }
    }
    if let Some(first) = layout.up {
        next.up = (state.up + across(&state.up) * step.fixed_rows::<2>(first)).normalize();
    }
    for (k, shape) in next.shapes.iter_mut().enumerate() {
        let first = layout.shapes + 3 * k;
        shape.log_height += step[first + 1].clamp(-1.0, 1.0);
        shape.log_radius =
            if problem.shapes[k].upright { shape.log_radius + step[first].clamp(-1.0, 1.0) } else { shape.log_height };
        next.heights[k] += step[first + 2];
    }
    next.places.iter_mut().zip(places).for_each(|(place, by)| *place += by);
    next
}

/// A state at which the boxes agree best, near a start.
#[derive(Debug, Clone)]
pub(super) struct Adjusted {
    pub state: State,
    pub cost: f64,
}

/// Changes of the shared unknowns, and of the places of the bodies.
type Moves = (DVector<f64>, Vec<Vector3<f64>>);

impl Quadratic for Equations {
    type Step = Moves;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn step(&self, damping: f64) -> Option<Moves> {
        let (cholesky, right, inverses) = reduced(self, damping)?;
        let step = -cholesky.solve(&right);
        let of_site = |(site, inverse): (&SiteEquations, &Matrix3<f64>)| {
            let shared = DVector::from_iterator(site.indices.len(), site.indices.iter().map(|&k| step[k]));
            -(inverse * (site.gradient + &site.mixed * shared))
        };
        let places = self.sites.iter().zip(&inverses).map(of_site).collect();
        Some((step, places))
    }
}

/// A problem with the places of its unknowns.
struct LaidOut<'a> {
    problem: &'a Problem,
    layout: Layout,
}

impl levenberg_marquardt::Problem for LaidOut<'_> {
    type State = State;
    type Equations = Equations;
    const DAMPING: Damping = Damping { first: 1e-4, taken: 0.2, failed: 25.0, max: 1e8 };

    fn linearize(&self, state: &State) -> Option<Equations> {
        equations(self.problem, &self.layout, state)
    }

    fn retract(&self, state: &State, (step, places): &Moves) -> Option<State> {
        Some(moved(self.problem, &self.layout, state, step, places))
    }

    fn is_last(&self, _: &Moves, _: &State, before: f64, cost: f64) -> bool {
        before - cost < SMALL_DECREASE * (1.0 + cost)
    }
}

/// Minimizes the cost; `None` where it cannot be evaluated at the start.
pub(super) fn adjust(problem: &Problem, start: State, steps: usize) -> Option<Adjusted> {
    let found = levenberg_marquardt::minimize(&LaidOut { problem, layout: Layout::new(problem) }, start, steps)?;
    Some(Adjusted { state: found.state, cost: found.equations.cost })
}

/// The covariance of the shared unknowns, and what each row of each site tells: weight and leverage.
#[derive(Debug, Clone)]
pub(super) struct Uncertainty {
    pub layout: Layout,
    pub covariance: DMatrix<f64>,
    /// By site: rows with their weight and leverage (the share of the residual that the fit takes).
    pub rows: Vec<Vec<(Row, f64, f64)>>,
}

/// `None` where the unknowns are not determined.
pub(super) fn uncertainty(problem: &Problem, state: &State) -> Option<Uncertainty> {
    let layout = Layout::new(problem);
    let all = equations(problem, &layout, state)?;
    let (cholesky, _, inverses) = reduced(&all, 0.0)?;
    let covariance = cholesky.inverse();
    let of_site = |site: usize| {
        let own = &all.sites[site];
        let size = own.indices.len();
        let local = DMatrix::from_fn(size, size, |i, j| covariance[(own.indices[i], own.indices[j])]);
        let by_place = inverses[site] * &own.mixed;
        let with_leverage = |row: Row| {
            let mut effective = -by_place.tr_mul(&row.place);
            let places = layout.of_row(row.camera, problem.sites[site].shape);
            for (index, derivative) in places.into_iter().zip(row.shared) {
                if let Some(index) = index {
                    effective[own.indices.partition_point(|&known| known < index)] += derivative;
                }
            }
            let weight = STUDENT_T.weight(row.residual * row.residual);
            let spread = row.place.dot(&(inverses[site] * row.place)) + effective.dot(&(&local * &effective));
            (row, weight, weight * spread)
        };
        Some(problem.rows(state, site)?.into_iter().map(with_leverage).collect())
    };
    let rows = map_indices(problem.sites.len(), of_site).into_iter().collect::<Option<_>>()?;
    Some(Uncertainty { layout, covariance, rows })
}

/// By how much the focal length of a camera is too short, as a logarithm, with its standard deviation: what one more unknown would be, to
/// first order.
pub(super) fn log_focal(problem: &Problem, state: &State) -> Option<Vec<[f64; 2]>> {
    let layout = Layout::new(problem);
    let all = equations(problem, &layout, state)?;
    let (cholesky, _, inverses) = reduced(&all, 0.0)?;
    let of_camera = |camera: usize| {
        let (mut own, mut gradient) = (0.0, 0.0);
        let mut mixed = DVector::zeros(layout.len);
        for (site, equations) in all.sites.iter().enumerate() {
            if problem.sites[site].observations.iter().all(|o| o.camera != camera) {
                continue;
            }
            let mut by_place = Vector3::zeros();
            for row in problem.rows(state, site)?.iter().filter(|row| row.camera == Some(camera)) {
                let weight = STUDENT_T.weight(row.residual * row.residual);
                own += weight * row.by_focal * row.by_focal;
                gradient += weight * row.by_focal * row.residual;
                by_place += row.place * (weight * row.by_focal);
                for (at, derivative) in layout.of_row(row.camera, problem.sites[site].shape).into_iter().zip(row.shared)
                {
                    if let Some(at) = at {
                        mixed[at] += weight * row.by_focal * derivative;
                    }
                }
            }
            let through = inverses[site] * by_place;
            own -= by_place.dot(&through);
            gradient -= equations.gradient.dot(&through);
            for (&at, by) in equations.indices.iter().zip(equations.mixed.tr_mul(&through).iter()) {
                mixed[at] -= by;
            }
        }
        let information = own - mixed.dot(&cholesky.solve(&mixed));
        Some([-gradient / information, information.sqrt().recip()])
    };
    (0..state.poses.len()).map(of_camera).collect()
}
