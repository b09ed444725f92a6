//! Poses to try: from three boxes that may show three objects; with gravity from two as well.

use nalgebra::{Matrix3, Vector3};

use super::prepared::{Candidate, PreparedQuery};
use super::refine::{Match, Predicted, refine};
use super::score::gain;
use super::{LandmarkMap, Query, QueryBox};
use crate::geometry::rigid::Pose;
use crate::geometry::rotation::{between, nearest_turn};
use crate::optimize::bits::{after, count, ones};
use crate::sorting::StableSort;

/// Groups of candidates of a round, about: the search may end after one that finds a pose that explains most of the image.
const GROUPS_OF_ROUND: usize = 20_000;

/// Rounds at most, which bounds the time to about a second.
const MAX_ROUNDS: usize = 100;

/// Comparisons of boxes with landmarks for all poses, about, which bounds the time in large maps to seconds.
const MAX_COMPARISONS: usize = 50_000_000;

/// Groups of a round that are refined at most: those with the most support, of these the nearest to their boxes.
const REFINED_OF_ROUND: usize = 100;

/// By how much edges may be off before a group is refined, relative to the half size of the box.
const MAX_OFF: f64 = 1.0;

/// Steps to the depths of three candidates. Standard deviation of a depth, relative to its range, and of the distance of two landmarks,
/// relative to it: what errors of boxes do, about. The largest sum of squares.
const DEPTH_STEPS: usize = 3;
const DEPTH_SD: f64 = 0.25;
const DISTANCE_SD: f64 = 0.06;
const MAX_TRIANGLE_COST: f64 = 20.0;

/// Candidates that hypotheses are made of, about: of more, those of the boxes that may show the fewest landmarks.
const MAX_CANDIDATES: usize = 800;

/// Cost of the edges of a hypothesis' own boxes, for each, beyond which it is wrong: Student's t cost at 3.5 standard deviations.
const MAX_COST: f64 = 8.6;

/// Steps by which a hypothesis follows its own boxes.
const STEPS: usize = 4;

/// Poses that are refined with all boxes.
const STARTS: usize = 24;

/// By how much an edge may be off where a box is compared quickly, relative to the half size: beyond, nothing is gained.
const QUICK_REACH: f64 = 1.5;

/// How often a pose is compared with all boxes while it is refined, about: it is matched and refined in several rounds.
pub(super) const MATCHED: usize = 10;

/// Factor on the noise of boxes while a pose follows only some of them.
const WIDEN: f64 = 3.0;

/// How many poses may still be compared with all boxes.
pub(super) struct Budget(usize);

impl Budget {
    /// As many as take about a second.
    pub(super) fn new(map: &LandmarkMap, query: &Query) -> Self {
        let alike = |b: &QueryBox| map.landmarks().iter().filter(|known| known.may_be(b.category.as_deref())).count();
        Self(MAX_COMPARISONS / query.boxes.iter().map(alike).sum::<usize>().max(1))
    }

    /// Whether not even one round can be examined.
    pub(super) fn is_small(&self) -> bool {
        self.0 < STARTS * MATCHED
    }

    pub(super) fn spend(&mut self, poses: usize) {
        self.0 = self.0.saturating_sub(poses);
    }

    pub(super) fn is_spent(&self) -> bool {
        self.0 == 0
    }
}

/// The groups of candidates that may give a pose: triples, and pairs where gravity is known.
pub(super) struct Groups {
    graph: Compatible,
    with_pairs: bool,
    /// Pairs of candidates, with the number of groups that begin with them or with pairs before.
    ends: Vec<([u16; 2], usize)>,
}

impl Groups {
    pub(super) fn new(query: &PreparedQuery) -> Self {
        let graph = Compatible::new(query);
        let with_pairs = query.gravity.is_some();
        let mut all = 0;
        let mut ends = Vec::new();
        for pair in graph.pairs() {
            all += usize::from(with_pairs) + count(graph.thirds(pair));
            ends.push((pair, all));
        }
        Self { graph, with_pairs, ends }
    }

    /// One group of so many belongs to a round.
    fn step(&self) -> usize {
        self.ends.last().map_or(0, |(_, all)| all.div_ceil(GROUPS_OF_ROUND)).max(1)
    }

    /// Number of rounds.
    pub(super) fn rounds(&self) -> usize {
        self.step().min(MAX_ROUNDS)
    }

    /// Whether the rounds have all groups.
    pub(super) fn are_complete(&self) -> bool {
        self.graph.all && self.step() <= MAX_ROUNDS
    }

    /// The groups of a round, evenly spread, as places of candidates.
    fn of_round(&self, round: usize) -> Vec<Vec<usize>> {
        let step = self.step();
        let (mut before, mut groups) = (0, Vec::new());
        for &(pair, end) in &self.ends {
            let first = (before + step - 1 - round) / step * step + round;
            if first < end {
                let [i, j] = pair.map(usize::from);
                let pair_alone = self.with_pairs.then(|| vec![i, j]);
                let triples = ones(self.graph.thirds(pair)).map(|k| vec![i, j, k]);
                groups.extend(pair_alone.into_iter().chain(triples).skip(first - before).step_by(step));
            }
            before = end;
        }
        groups
    }
}

/// Poses of the groups of one round that explain many boxes, the best first.
pub(super) fn starts(query: &PreparedQuery, groups: &Groups, round: usize, budget: &mut Budget) -> Vec<Pose> {
    let graph = &groups.graph;
    let begun = |group: Vec<usize>| {
        let members: Vec<&Candidate> = group.iter().map(|&place| &query.candidates[graph.places[place]]).collect();
        let largest = |start: &Pose| members.iter().map(|member| off(query, start, member)).fold(0.0, f64::max);
        let starts = of_group(query, &members).into_iter().map(|start| (largest(&start), start));
        let near: Vec<(f64, Pose)> = starts.filter(|(off, _)| *off < MAX_OFF).collect();
        let support = if near.is_empty() { 0 } else { graph.support(&group) };
        near.into_iter().map(move |(off, start)| (support, off, group.clone(), start))
    };
    let mut begun: Vec<(usize, f64, Vec<usize>, Pose)> = groups.of_round(round).into_iter().flat_map(begun).collect();
    begun.stable_sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
    begun.truncate(REFINED_OF_ROUND);
    let mut scored: Vec<(f64, Pose)> = begun
        .into_iter()
        .filter_map(|(_, _, group, start)| {
            if budget.is_spent() {
                return None;
            }
            let matches = group.iter().map(|&place| &query.candidates[graph.places[place]]);
            let matches: Vec<Match> = matches.map(|c| Match::new(query, c.query_box, c.landmark)).collect();
            let refined = refine(query, start, &matches, STEPS)?;
            (refined.edge_cost < MAX_COST * 4.0 * matches.len() as f64).then(|| {
                budget.spend(1);
                (quick_score(query, &refined.pose), refined.pose)
            })
        })
        .collect();
    scored.stable_sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<Pose> = Vec::new();
    for (_, pose) in scored {
        if !chosen.iter().any(|other| query.same_pose(&pose, other)) {
            chosen.push(pose);
        }
        if chosen.len() == STARTS {
            break;
        }
    }
    chosen
}

/// How far the edges of a landmark are from those of its box, at most, in half sizes of the box; infinite where it has none.
fn off(query: &PreparedQuery, pose: &Pose, candidate: &Candidate) -> f64 {
    let predicted = Predicted::new(pose, &query.map.landmarks()[candidate.landmark].body);
    predicted.map_or(f64::INFINITY, |predicted| predicted.off(&query.boxes[candidate.query_box]))
}

/// The sum of the best gain of each box.
fn quick_score(query: &PreparedQuery, pose: &Pose) -> f64 {
    // Bodies are near enough, and several times as quick as corrected ones.
    let of_body = |landmark| Predicted::of_body(query, pose, landmark);
    let predicted: Vec<Option<Predicted>> = (0..query.map.landmarks().len()).map(of_body).collect();
    let best = |(index, alike): (usize, &Vec<usize>)| {
        let gains = alike.iter().filter_map(|&landmark| {
            let prediction = predicted[landmark].as_ref()?;
            let is_near = prediction.off(&query.boxes[index]) < QUICK_REACH;
            is_near.then(|| gain(query, prediction, &Match::new(query, index, landmark), WIDEN))
        });
        gains.fold(0.0, f64::max)
    };
    query.alike.iter().enumerate().map(best).sum()
}

/// Which candidates can be true together, as rows of bits.
struct Compatible {
    /// Which candidate each row is; those of a box follow each other.
    places: Vec<usize>,
    /// Number of the box of each row.
    boxes: Vec<usize>,
    words: usize,
    bits: Vec<u64>,
    /// Whether all candidates are among them.
    all: bool,
}

impl Compatible {
    fn new(query: &PreparedQuery) -> Self {
        let places = distinctive(query);
        let words = places.len().div_ceil(64);
        let mut bits = vec![0; words * places.len()];
        for (i, a) in places.iter().map(|&k| &query.candidates[k]).enumerate() {
            for (j, b) in places.iter().map(|&k| &query.candidates[k]).enumerate().skip(i + 1) {
                if a.query_box == b.query_box || a.landmark == b.landmark {
                    continue;
                }
                let distance = (query.map.center(a.landmark) - query.map.center(b.landmark)).norm();
                let [least, most] = distances(a, b);
                if least <= distance && distance <= most {
                    bits[i * words + j / 64] |= 1 << (j % 64);
                    bits[j * words + i / 64] |= 1 << (i % 64);
                }
            }
        }
        let all = places.len() == query.candidates.len();
        let boxes = places.iter().map(|&k| query.candidates[k].query_box).collect();
        Self { places, boxes, words, bits, all }
    }

    /// The candidates that go with one.
    fn row(&self, index: usize) -> &[u64] {
        &self.bits[index * self.words..(index + 1) * self.words]
    }

    /// How many boxes have a candidate that goes with all of a group: of a true one nearly all, of others by chance.
    fn support(&self, group: &[usize]) -> usize {
        let common = (0..self.words).map(|word| group.iter().fold(u64::MAX, |all, &place| all & self.row(place)[word]));
        let mut last = None;
        ones(common).filter(|&place| last.replace(self.boxes[place]) != Some(self.boxes[place])).count()
    }

    fn pairs(&self) -> impl Iterator<Item = [u16; 2]> {
        let of_first = |i: usize| ones(after(i, self.row(i).iter().copied())).map(move |j| [i as u16, j as u16]);
        (0..self.places.len()).flat_map(of_first)
    }

    /// The third ones of triples, as bits.
    fn thirds(&self, pair: [u16; 2]) -> impl Iterator<Item = u64> {
        let [a, b] = pair.map(|place| self.row(place.into()));
        after(pair[1].into(), a.iter().zip(b).map(|(a, b)| a & b))
    }
}

/// The candidates of the boxes that may show the fewest landmarks: all, or as many boxes as [`MAX_CANDIDATES`] allows, at least three; of a
/// box with more candidates, evenly spread ones.
fn distinctive(query: &PreparedQuery) -> Vec<usize> {
    let mut boxes: Vec<Vec<usize>> = vec![Vec::new(); query.boxes.len()];
    query.candidates.iter().enumerate().for_each(|(k, candidate)| boxes[candidate.query_box].push(k));
    boxes.retain(|of_box| !of_box.is_empty());
    boxes.stable_sort_by_key(Vec::len);
    let mut chosen: Vec<usize> = Vec::new();
    for (k, of_box) in boxes.iter().enumerate() {
        if k >= 3 && chosen.len() + of_box.len() > MAX_CANDIDATES {
            break;
        }
        chosen.extend(of_box.iter().step_by(of_box.len().div_ceil(MAX_CANDIDATES)));
    }
    chosen
}

/// Smallest and largest distance between points on two rays, within the ranges of their depths.
fn distances(a: &Candidate, b: &Candidate) -> [f64; 2] {
    let distance = |x: f64, y: f64| (a.ray * x - b.ray * y).norm();
    let ([a0, _, a1], [b0, _, b1]) = (a.depths, b.depths);
    let most = [(a0, b0), (a0, b1), (a1, b0), (a1, b1)].map(|(x, y)| distance(x, y)).into_iter().fold(0.0, f64::max);
    // The squared distance is convex: by turns the best depth of each ray, within its range.
    let product = a.ray.dot(&b.ray);
    let (mut x, mut y) = (a.depths[1], b.depths[1]);
    for _ in 0..6 {
        x = (product * y / a.ray.norm_squared()).clamp(a0, a1);
        y = (product * x / b.ray.norm_squared()).clamp(b0, b1);
    }
    [distance(x, y) * (1.0 - 1e-3), most]
}

/// Poses of a camera that sees the landmarks of a group.
fn of_group(query: &PreparedQuery, members: &[&Candidate]) -> Vec<Pose> {
    let depths = match members {
        [a, b, c] => of_triangle(query, [a, b, c]),
        _ => vec![members.iter().map(|member| member.depths[1]).collect()],
    };
    let world: Vec<Vector3<f64>> = members.iter().map(|member| query.map.center(member.landmark)).collect();
    let pose = |depths: Vec<f64>| {
        let camera: Vec<Vector3<f64>> =
            members.iter().zip(&depths).map(|(member, depth)| member.ray * *depth).collect();
        let weights: Vec<f64> = depths.iter().map(|depth| 1.0 / (depth * depth)).collect();
        let total: f64 = weights.iter().sum();
        let mean =
            |points: &[Vector3<f64>]| points.iter().zip(&weights).map(|(p, w)| p * *w).sum::<Vector3<f64>>() / total;
        let (middle, world_middle) = (mean(&camera), mean(&world));
        let rotation = match &query.gravity {
            None => axes(&camera)? * axes(&world)?.transpose(),
            Some(gravity) => {
                // The camera turned upright, then a turn about the vertical.
                let upright = between(&gravity.up_in_camera, &gravity.up_in_world);
                let mut spread = Matrix3::zeros();
                for k in 0..members.len() {
                    let off = upright * (camera[k] - middle);
                    spread.ger(weights[k], &off, &(world[k] - world_middle), 1.0);
                }
                upright.matrix().transpose() * nearest_turn(&spread, &gravity.up_in_world).matrix()
            }
        };
        let translation = middle - rotation * world_middle;
        translation.iter().chain(&rotation).all(|x| x.is_finite()).then_some(Pose { rotation, translation })
    };
    depths.into_iter().filter_map(pose).collect()
}

/// Axes of a triangle; `None` of a pair.
fn axes(points: &[Vector3<f64>]) -> Option<Matrix3<f64>> {
    let [a, b, c] = points else { return None };
    let x = (b - a).normalize();
    let z = x.cross(&(c - a)).normalize();
    Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

/// The depths of three landmarks that sizes and the distances of the landmarks ask for; none where these contradict each other. A triangle
/// that leans the other way looks nearly the same: both are tried.
fn of_triangle(query: &PreparedQuery, members: [&Candidate; 3]) -> Vec<Vec<f64>> {
    let from = |start: Vector3<f64>| depths_of_triangle(query, members, start);
    let Some((first, cost)) = from(Vector3::from(members.map(|member| member.depths[1]))) else { return Vec::new() };
    let other = from(first.map(|depth| 2.0 * first.mean() - depth));
    let agree = |(depths, cost): &(Vector3<f64>, f64)| depths.min() > 0.0 && *cost < MAX_TRIANGLE_COST;
    let all = [Some((first, cost)), other].into_iter().flatten().filter(agree);
    all.map(|(depths, _)| depths.iter().copied().collect()).collect()
}

/// Depths near a start, and the sum of squares.
fn depths_of_triangle(
    query: &PreparedQuery,
    members: [&Candidate; 3],
    start: Vector3<f64>,
) -> Option<(Vector3<f64>, f64)> {
    let world = members.map(|c| query.map.center(c.landmark));
    let sides = [[0, 1], [0, 2], [1, 2]].map(|[i, j]| (i, j, (world[i] - world[j]).norm()));
    let sizes = Vector3::from(members.map(|c| c.depths[1]));
    let sds = Vector3::from(members.map(|c| DEPTH_SD * (c.depths[2] - c.depths[0])));
    let (mut depths, mut cost) = (start, 0.0);
    for _ in 0..DEPTH_STEPS {
        let off = (depths - sizes).component_div(&sds);
        let mut hessian = Matrix3::from_diagonal(&sds.map(|sd| 1.0 / (sd * sd)));
        let mut gradient = off.component_div(&sds);
        cost = off.norm_squared();
        for (i, j, known) in sides {
            let side = members[i].ray * depths[i] - members[j].ray * depths[j];
            let (length, sd) = (side.norm().max(f64::MIN_POSITIVE), DISTANCE_SD * known);
            let mut slope = Vector3::zeros();
            slope[i] = side.dot(&members[i].ray) / (length * sd);
            slope[j] = -side.dot(&members[j].ray) / (length * sd);
            let off = (length - known) / sd;
            hessian += slope * slope.transpose();
            gradient += slope * off;
            cost += off * off;
        }
        depths -= hessian.cholesky()?.solve(&gradient);
    }
    Some((depths, cost))
}
