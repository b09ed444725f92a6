//! A solution: the problem of the cameras that hang together, solved.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::adjust::{Adjusted, Uncertainty, adjust, uncertainty};
use super::assemble::{Bodies, Group, Tree, groups, place};
use super::pairs::DEPTH_SD;
use super::predicted::Shape;
use super::prepared::{Prepared, Thing};
use super::problem::{DistanceRow, Levels, Observation, Problem, ShapePrior, Site, State};
use super::{CalibrateOptions, RigScale};
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::rigid::Pose;
use crate::sorting::StableSort;

/// First levels of the noise of boxes: of bodies with a vertical, and of others, whose widths and heights change as they turn.
const FIRST_LEVELS: [f64; 2] = [0.05, 0.05];
const FIRST_LEVELS_BALL: [f64; 2] = [0.05, 0.15];

/// Residuals that the first levels are worth when levels are estimated.
const PRIOR_RESIDUALS: f64 = 10.0;

/// Levels stay between these.
const MIN_LEVEL: f64 = 0.002;
const MAX_LEVEL: f64 = 1.0;

/// Of the heights at which bodies walk, relative to their half height: the first level, and its range.
const FIRST_STEP_LEVEL: f64 = 0.3;
const USUAL_STEP_LEVEL: f64 = 0.05;
const MIN_STEP_LEVEL: f64 = 0.02;
const MAX_STEP_LEVEL: f64 = 1.0;

/// Bodies at time steps that are used at most, evenly spread.
const MAX_SITES: usize = 2000;

/// Bodies at time steps from which an object has a shape of its own, and how many objects have one.
const OWN_SHAPE: usize = 8;
const MAX_SHAPES: usize = 40;

/// Relative depths from sizes once the vertical is known.
const REFINED_DEPTH_SD: f64 = 0.06;

/// Steps of an adjustment: of a start, and of a final one.
const FIRST_STEPS: usize = 10;
const STEPS: usize = 40;

/// Rounds of noise levels.
const ROUNDS: usize = 5;

/// Standard deviation of a distance that is known, relative.
const DISTANCE_SD: f64 = 1e-3;

/// Standard deviation of the logarithm of a height that sets an arbitrary unit: none.
pub(super) const ARBITRARY_SD: f64 = 1e-4;

/// Exponents of support functions that are tried besides 2, that of ellipsoids.
const EXPONENTS: [f64; 2] = [1.5, 1.1];

/// Decrease of the cost from which a body has another exponent.
const MIN_EXPONENT_GAIN: f64 = 6.0;

/// A solution.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub problem: Problem,
    pub state: State,
    pub cost: f64,
    /// Cameras that have a place.
    pub placed: Vec<bool>,
    /// What the unit of the world comes from.
    pub scale: RigScale,
}

/// The final adjustment: noise levels and unknowns in turn; boxes without ids are grouped again.
pub(super) fn refine(prepared: &Prepared, solution: &mut Solution) {
    for round in 0..ROUNDS {
        let Some(of_round) = uncertainty(&solution.problem, &solution.state) else { break };
        update_levels(prepared, &mut solution.problem, &of_round);
        if round == 0 && prepared.boxes.iter().any(|b| !b.has_id()) {
            regroup(prepared, solution);
        }
        let Some(better) = adjust(&solution.problem, solution.state.clone(), STEPS) else { break };
        (solution.state, solution.cost) = (better.state, better.cost);
    }
}

/// Chooses, for each category with a vertical, between ellipsoids and bodies with edges, such as cylinders, and cuboids that turn. Returns
/// whether any is another one.
pub(super) fn choose_exponents(solution: &mut Solution) -> bool {
    let categories: BTreeSet<usize> =
        solution.problem.shapes.iter().filter(|shape| shape.upright).map(|shape| shape.category).collect();
    let mut changed = false;
    for category in categories {
        for exponent in EXPONENTS {
            let mut state = solution.state.clone();
            let of_category = |(_, prior): &(&mut Shape, &ShapePrior)| prior.category == category;
            let shapes = state.shapes.iter_mut().zip(&solution.problem.shapes).filter(of_category);
            shapes.for_each(|(shape, _)| shape.exponent = exponent);
            // The noise is that of the bodies before, so that costs can be compared.
            let found = adjust(&solution.problem, state, STEPS);
            if let Some(better) = found.filter(|found| found.cost < solution.cost - MIN_EXPONENT_GAIN) {
                (solution.state, solution.cost, changed) = (better.state, better.cost, true);
            }
        }
    }
    changed
}

/// What a solution says about the bodies.
pub(super) fn bodies(prepared: &Prepared, solution: &Solution) -> Bodies {
    let shapes = (0..prepared.shapes.len()).map(|category| {
        let of_category = solution.problem.shapes.iter().position(|shape| shape.category == category);
        of_category.map_or(prepared.shapes[category].usual(), |k| solution.state.shapes[k])
    });
    Bodies { up: Some(solution.state.up), shapes: shapes.collect(), depth_sd: REFINED_DEPTH_SD }
}

impl Solution {
    /// The same bodies from other poses.
    pub(super) fn restart(&mut self, prepared: &Prepared, poses: Vec<Pose>, up: Vector3<f64>) {
        let placed: Vec<Option<Pose>> =
            poses.iter().zip(&self.placed).map(|(pose, &placed)| placed.then_some(*pose)).collect();
        self.state.poses = poses;
        self.state.up = up;
        let bodies = bodies(prepared, self);
        for (site, at) in self.problem.sites.iter().zip(&mut self.state.places) {
            let boxes: Vec<usize> = site.observations.iter().map(|observation| observation.box_index).collect();
            if let Some(place) = place(prepared, &placed, &boxes, &bodies) {
                *at = place;
            }
        }
        self.state = with_up(&self.problem, &self.state, up);
        if let Some(better) = adjust(&self.problem, self.state.clone(), STEPS) {
            (self.state, self.cost) = (better.state, better.cost);
        }
    }
}

/// What groups of boxes show: things at places, of shapes that several of them share.
struct Sites {
    shapes: Vec<ShapePrior>,
    /// For each shape the number of its sites.
    sizes: Vec<usize>,
    sites: Vec<Site>,
}

impl Sites {
    /// One shape for each of the objects that are seen most often, and one for the rest of each category.
    fn of(prepared: &Prepared, used: &[&Group]) -> Self {
        let mut counts: BTreeMap<(usize, Thing), usize> = BTreeMap::new();
        used.iter().for_each(|group| *counts.entry((group.category, group.thing)).or_default() += 1);
        let mut own: Vec<(usize, Thing, usize)> = counts
            .iter()
            .filter(|&(&(_, thing), &count)| matches!(thing, Thing::Object(_)) && count >= OWN_SHAPE)
            .map(|(&(category, thing), &count)| (count, thing, category))
            .collect();
        own.stable_sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        own.truncate(MAX_SHAPES);
        let mut shape_of: BTreeMap<(usize, Option<Thing>), usize> = BTreeMap::new();
        let mut shapes: Vec<ShapePrior> = Vec::new();
        let mut sites = Vec::new();
        let mut sizes: Vec<usize> = Vec::new();
        for group in used {
            let alone = own.iter().any(|&(_, thing, category)| (thing, category) == (group.thing, group.category));
            let key = (group.category, alone.then_some(group.thing));
            let shape = *shape_of.entry(key).or_insert_with(|| {
                shapes.push(prepared.shapes[group.category]);
                sizes.push(0);
                shapes.len() - 1
            });
            sizes[shape] += 1;
            let observation = |&index: &usize| {
                let of_box = &prepared.boxes[index];
                Observation { camera: of_box.camera, box_index: index, measured: of_box.measured.clone() }
            };
            sites.push(Site {
                shape,
                walks: prepared.shapes[group.category].upright && group.time_step.is_some(),
                observations: group.boxes.iter().map(observation).collect(),
            });
        }
        Self { shapes, sizes, sites }
    }
}

/// The problem of placed cameras and groups, with the state to start from.
fn problem(
    prepared: &Prepared,
    poses: &[Option<Pose>],
    reference: Option<usize>,
    found: &[Group],
    bodies: &Bodies,
    scale: f64,
    options: &CalibrateOptions,
) -> Option<(Problem, State, RigScale)> {
    let rig = prepared.rig;
    let step = found.len().div_ceil(MAX_SITES).max(1);
    let used: Vec<&Group> = found.iter().step_by(step).collect();
    let Sites { mut shapes, sizes, sites } = Sites::of(prepared, &used);
    if sites.is_empty() {
        return None;
    }
    let given = rig.cameras.iter().filter(|camera| camera.cam_from_world.is_some()).count();
    let is_placed = |camera: usize| poses.get(camera).is_some_and(Option::is_some);
    let baselines: Vec<DistanceRow> = options
        .baselines
        .iter()
        .filter(|known| known.cameras.iter().all(|&camera| is_placed(camera)) && known.cameras[0] != known.cameras[1])
        .map(|known| DistanceRow { cameras: known.cameras, length: known.length, sd: DISTANCE_SD * known.length })
        .collect();
    let has_sizes = shapes.iter().any(|shape| shape.log_height.is_some());
    let of_scale = match (given, baselines.is_empty(), has_sizes) {
        (2.., ..) => RigScale::GivenPoses,
        (_, false, _) => RigScale::Baselines,
        (_, true, true) => RigScale::Sizes,
        (_, true, false) => RigScale::Arbitrary,
    };
    let mut start_scale = scale;
    if let (RigScale::Baselines, Some(known)) = (of_scale, baselines.first()) {
        let [a, b] = known.cameras.map(|camera| poses[camera].unwrap_or(Pose::identity()).center());
        start_scale = scale * known.length / (a - b).norm().max(1e-9);
    }
    if of_scale == RigScale::Arbitrary
        && let Some(most) = (0..sizes.len()).max_by_key(|&k| (sizes[k], std::cmp::Reverse(k)))
    {
        shapes[most].log_height = Some([shapes[most].usual().log_height + scale.ln(), ARBITRARY_SD]);
    }
    let by = start_scale / scale;
    let fixed = |camera: usize| rig.cameras[camera].cam_from_world.is_some() || Some(camera) == reference;
    let origin = poses.iter().flatten().next().map(Pose::center).unwrap_or_default();
    let stretched = |place: Vector3<f64>| origin + (place - origin) * by;
    let pose = |(camera, pose): (usize, &Option<Pose>)| {
        let pose = pose.unwrap_or(Pose::identity());
        if fixed(camera) {
            return pose;
        }
        Pose { translation: -(pose.rotation * stretched(pose.center())), ..pose }
    };
    let state_shapes: Vec<Shape> = shapes
        .iter()
        .map(|prior| {
            let of_category = bodies.shapes[prior.category];
            of_category.scaled(by)
        })
        .collect();
    let levels = |k: usize| Levels(if prepared.shapes[k].upright { FIRST_LEVELS } else { FIRST_LEVELS_BALL });
    let up_known = rig.up.filter(|_| given > 0);
    let any_upright = shapes.iter().any(|shape| shape.upright);
    let state = State {
        poses: poses.iter().enumerate().map(pose).collect(),
        up: up_known.map_or(Vector3::z(), |up| up.into_inner()),
        heights: vec![0.0; shapes.len()],
        shapes: state_shapes,
        places: used.iter().map(|group| stretched(group.place)).collect(),
    };
    let problem = Problem {
        free: (0..rig.cameras.len()).map(|camera| is_placed(camera) && !fixed(camera)).collect(),
        up_free: up_known.is_none() && any_upright,
        shapes,
        sites,
        levels: (0..prepared.categories.len()).map(levels).collect(),
        noise_ratios: vec![1.0; rig.cameras.len()],
        step_level: FIRST_STEP_LEVEL,
        baselines,
    };
    Some((problem, state, of_scale))
}

/// The state with a vertical, and the mean heights at which bodies walk along it.
fn with_up(problem: &Problem, state: &State, up: Vector3<f64>) -> State {
    let mut next = State { up, ..state.clone() };
    let mut sums = vec![(0.0, 0.0); problem.shapes.len()];
    for (site, place) in problem.sites.iter().zip(&state.places).filter(|(site, _)| site.walks) {
        sums[site.shape].0 += up.dot(place);
        sums[site.shape].1 += 1.0;
    }
    for (height, (sum, count)) in next.heights.iter_mut().zip(sums) {
        if count > 0.0 {
            *height = sum / count;
        }
    }
    next
}

/// Directions that may be the vertical: that of the images, across the plane on which bodies walk, and the axes of a camera that is turned.
fn verticals(problem: &Problem, state: &State, placed: &[Option<Pose>]) -> Vec<Vector3<f64>> {
    let cameras = || placed.iter().flatten();
    let mut found: Vec<Vector3<f64>> = Vec::new();
    let mean: Vector3<f64> = cameras().map(|pose| -pose.rotation.row(1).transpose()).sum();
    found.extend(mean.try_normalize(0.1));
    let middle = state.places.iter().sum::<Vector3<f64>>() / problem.sites.len().max(1) as f64;
    let spread: Matrix3<f64> = state.places.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
    found.extend(symmetric_eigen3(&spread).map(|(_, axes)| axes.column(2).into_owned()));
    if let Some(first) = cameras().next() {
        found.extend((0..3).map(|k| first.rotation.row(k).transpose()));
    }
    found
}

/// The first solution from the places of cameras.
pub(super) fn solution(
    prepared: &Prepared,
    tree: &Tree,
    poses: &[Option<Pose>],
    options: &CalibrateOptions,
) -> Option<Solution> {
    if poses.iter().flatten().count() < 2 {
        return None;
    }
    let shapes = prepared.shapes.iter().map(|prior| prior.usual().scaled(tree.scale));
    let bodies = Bodies { up: None, shapes: shapes.collect(), depth_sd: DEPTH_SD };
    let found = groups(prepared, poses, &bodies);
    let (problem, state, scale) = problem(prepared, poses, tree.reference, &found, &bodies, tree.scale, options)?;
    let best = best_start(&problem, &state, poses)?;
    let placed = poses.iter().map(Option::is_some).collect();
    Some(Solution { problem, state: best.state, cost: best.cost, placed, scale })
}

/// The best of the adjustments with different verticals.
pub(super) fn best_start(problem: &Problem, state: &State, poses: &[Option<Pose>]) -> Option<Adjusted> {
    let verticals = if problem.up_free { verticals(problem, state, poses) } else { vec![state.up] };
    let starts = verticals.into_iter().filter_map(|up| adjust(problem, with_up(problem, state, up), FIRST_STEPS));
    let best = starts.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    adjust(problem, best.state, STEPS)
}

/// Groups boxes without ids again, now that the vertical and the sizes are known.
fn regroup(prepared: &Prepared, solution: &mut Solution) {
    let bodies = bodies(prepared, solution);
    let poses: Vec<Option<Pose>> =
        solution.placed.iter().zip(&solution.state.poses).map(|(&placed, pose)| placed.then_some(*pose)).collect();
    let found = groups(prepared, &poses, &bodies);
    let step = found.len().div_ceil(MAX_SITES).max(1);
    let mut sites = Vec::new();
    let mut places = Vec::new();
    for group in found.iter().step_by(step).filter(|group| matches!(group.thing, Thing::Category(_))) {
        let shared = |shape: &ShapePrior| shape.category == group.category;
        let of_category = |site: &&Site| {
            shared(&solution.problem.shapes[site.shape]) && !prepared.boxes[site.observations[0].box_index].has_id()
        };
        let Some(example) = solution.problem.sites.iter().find(of_category) else { continue };
        let observation = |&index: &usize| {
            let of_box = &prepared.boxes[index];
            Observation { camera: of_box.camera, box_index: index, measured: of_box.measured.clone() }
        };
        sites.push(Site {
            shape: example.shape,
            walks: example.walks,
            observations: group.boxes.iter().map(observation).collect(),
        });
        places.push(group.place);
    }
    let with_ids = solution.problem.sites.iter().zip(&solution.state.places);
    for (site, place) in with_ids.filter(|(site, _)| prepared.boxes[site.observations[0].box_index].has_id()) {
        sites.push(site.clone());
        places.push(*place);
    }
    (solution.problem.sites, solution.state.places) = (sites, places);
}

/// Noise levels from residuals: the weighted sum of squares of a level over what the fit leaves of its residuals.
fn update_levels(prepared: &Prepared, problem: &mut Problem, of_round: &Uncertainty) {
    let mut sums: BTreeMap<(usize, usize), (f64, f64)> = BTreeMap::new();
    let mut steps = (0.0, 0.0);
    let mut of_cameras = vec![(0.0, 0.0); problem.noise_ratios.len()];
    for (row, weight, leverage) in of_round.rows.iter().flatten() {
        if let (Some(_), Some(camera)) = (row.level, row.camera) {
            of_cameras[camera].0 += weight * row.residual * row.residual / GAUSSIAN;
            of_cameras[camera].1 += (1.0 - leverage).max(0.0);
        }
        let sum = match (row.level, row.camera) {
            (Some(level), _) => sums.entry(level).or_default(),
            (None, None) => &mut steps,
            (None, Some(_)) => continue,
        };
        sum.0 += weight * row.residual * row.residual;
        sum.1 += (1.0 - leverage).max(0.0);
    }
    let first = |category: usize| if prepared.shapes[category].upright { FIRST_LEVELS } else { FIRST_LEVELS_BALL };
    let better = |level: f64, first: f64, (squares, free): (f64, f64)| {
        let squares = squares / GAUSSIAN * level * level + PRIOR_RESIDUALS * first * first;
        (squares / (free + PRIOR_RESIDUALS)).sqrt()
    };
    for ((category, level), sum) in sums {
        let of_category = &mut problem.levels[category].0[level];
        *of_category = better(*of_category, first(category)[level], sum).clamp(MIN_LEVEL, MAX_LEVEL);
    }
    let all = of_cameras.iter().fold((0.0, 0.0), |sum, other| (sum.0 + other.0, sum.1 + other.1));
    for (ratio, (squares, free)) in problem.noise_ratios.iter_mut().zip(of_cameras) {
        *ratio *= ((squares * all.1 / all.0 + PRIOR_RESIDUALS) / (free + PRIOR_RESIDUALS)).sqrt();
    }
    problem.step_level = better(problem.step_level, USUAL_STEP_LEVEL, steps).clamp(MIN_STEP_LEVEL, MAX_STEP_LEVEL);
}

/// Mean of the weighted square of a Gaussian residual: the weights of the Student t distribution take a little off.
const GAUSSIAN: f64 = 0.862;

/// A block of a covariance.
pub(super) fn block<const N: usize>(covariance: &DMatrix<f64>, first: usize) -> nalgebra::SMatrix<f64, N, N> {
    covariance.fixed_view::<N, N>(first, first).into_owned()
}
