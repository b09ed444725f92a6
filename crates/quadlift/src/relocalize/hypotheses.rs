//! Poses to try: from three boxes (two with gravity) that may show three objects.

use nalgebra::{Matrix3, Vector3};

use super::prepared::{Candidate, PreparedQuery};
use super::refine::{Match, refine};
use super::score::{gain, predictions};
use crate::geometry::rigid::Pose;
use crate::geometry::rotation::{between, nearest_rotation, nearest_turn};
use crate::optimize::bits::{after, count, ones};

/// Groups of candidates whose support is counted at most; of more, that of evenly spread ones.
const MAX_GROUPS: usize = 200_000;

/// Hypotheses that are examined at most: those with the most support.
const MAX_HYPOTHESES: usize = 16_000;

/// Comparisons of boxes with landmarks for all hypotheses, about, which bounds the time in large maps; a round is examined in any case.
const MAX_COMPARISONS: usize = 30_000_000;

/// Hypotheses of a round: the search may end after one that explains most of the image.
const HYPOTHESES_OF_ROUND: usize = 100;

/// Candidates that hypotheses are made of, about: of more, those of the boxes that may show the fewest landmarks.
const MAX_CANDIDATES: usize = 800;

/// Cost of the edges of a hypothesis' own boxes, for each, beyond which it is wrong: Student's t cost at 3.5 standard deviations.
const MAX_COST: f64 = 8.6;

/// Steps by which a hypothesis follows its own boxes.
const STEPS: usize = 4;

/// Poses that are refined with all boxes.
const STARTS: usize = 24;

/// Factor on the noise of boxes while a pose follows only some of them.
const WIDEN: f64 = 3.0;

/// Groups of candidates that may give a pose.
pub(super) struct Groups {
    members: Vec<Vec<usize>>,
    /// Whether these are all of them.
    pub all: bool,
}

impl Groups {
    /// Triples of candidates, or pairs where gravity is known.
    pub(super) fn new(query: &PreparedQuery) -> Self {
        let comparisons = query.alike.iter().map(Vec::len).sum::<usize>().max(1);
        let most = (MAX_COMPARISONS / comparisons).clamp(HYPOTHESES_OF_ROUND, MAX_HYPOTHESES);
        let graph = Compatible::new(query);
        let mut members = if query.gravity.is_some() { graph.pairs() } else { graph.triples() };
        let all = graph.all && members.len() < most.min(MAX_GROUPS);
        members.sort_by_cached_key(|group| std::cmp::Reverse(graph.support(group)));
        members.truncate(most);
        let named = |group: Vec<usize>| group.into_iter().map(|place| graph.places[place]).collect();
        Self { all, members: members.into_iter().map(named).collect() }
    }

    /// Number of rounds; the first one has the groups with the most support.
    pub(super) fn rounds(&self) -> usize {
        self.members.len().div_ceil(HYPOTHESES_OF_ROUND)
    }
}

/// Poses of the groups of one round that explain many boxes, the best first.
pub(super) fn starts(query: &PreparedQuery, groups: &Groups, round: usize) -> Vec<Pose> {
    let members = groups.members.chunks(HYPOTHESES_OF_ROUND).nth(round).unwrap_or_default();
    let mut scored: Vec<(f64, Pose)> = members
        .iter()
        .filter_map(|group| {
            let members: Vec<&Candidate> = group.iter().map(|&k| &query.candidates[k]).collect();
            let matches: Vec<Match> = members.iter().map(|c| Match::new(query, c.query_box, c.landmark)).collect();
            let refined = refine(query, aligned(query, &members)?, &matches, STEPS)?;
            (refined.cost < MAX_COST * 4.0 * members.len() as f64)
                .then(|| (quick_score(query, &refined.pose), refined.pose))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
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

/// The sum of the best gain of each box.
fn quick_score(query: &PreparedQuery, pose: &Pose) -> f64 {
    let predicted = predictions(query, pose);
    let best = |(index, alike): (usize, &Vec<usize>)| {
        let gains = alike.iter().filter_map(|&landmark| {
            let prediction = predicted[landmark].as_ref()?;
            let measured = &query.boxes[index];
            let near = (prediction.edges[0] - measured.edges[0]).abs() < 2.0 * (measured.edges[2] - measured.edges[0]);
            near.then(|| gain(query, pose, prediction, &Match::new(query, index, landmark), WIDEN))
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

    /// The candidates that go with all of these.
    fn common(&self, group: &[usize]) -> impl Iterator<Item = u64> {
        (0..self.words).map(|word| group.iter().fold(u64::MAX, |all, &place| all & self.row(place)[word]))
    }

    /// How many boxes have a candidate that goes with all of a group: of a true one nearly all, of others by chance.
    fn support(&self, group: &[usize]) -> usize {
        let mut last = None;
        ones(self.common(group)).filter(|&place| last.replace(self.boxes[place]) != Some(self.boxes[place])).count()
    }

    fn all_pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.places.len()).flat_map(|i| ones(after(i, self.row(i).iter().copied())).map(move |j| [i, j]))
    }

    /// The third ones of triples, as bits.
    fn thirds(&self, pair: &[usize; 2]) -> impl Iterator<Item = u64> {
        after(pair[1], self.common(pair))
    }

    fn pairs(&self) -> Vec<Vec<usize>> {
        let count = self.all_pairs().count();
        let chosen = self.all_pairs().enumerate().filter(|(k, _)| is_chosen(*k, count, MAX_GROUPS));
        chosen.map(|(_, pair)| pair.to_vec()).collect()
    }

    fn triples(&self) -> Vec<Vec<usize>> {
        let all = self.all_pairs().map(|pair| count(self.thirds(&pair))).sum();
        let mut before = 0;
        let mut chosen = Vec::new();
        for pair in self.all_pairs() {
            let end = before + count(self.thirds(&pair));
            if first_chosen(before, all, MAX_GROUPS) < end {
                let thirds = ones(self.thirds(&pair)).enumerate();
                let of_pair = thirds.filter(|(k, _)| is_chosen(before + k, all, MAX_GROUPS));
                chosen.extend(of_pair.map(|(_, k)| vec![pair[0], pair[1], k]));
            }
            before = end;
        }
        chosen
    }
}

/// Whether the item with this index is one of at most so many of `count`, evenly spread.
fn is_chosen(index: usize, count: usize, most: usize) -> bool {
    first_chosen(index, count, most) == index
}

/// The first such item from an index on.
fn first_chosen(index: usize, count: usize, most: usize) -> usize {
    let step = count.div_ceil(most).max(1);
    index.div_ceil(step) * step
}

/// The candidates of the boxes that may show the fewest landmarks: all, or as many boxes as [`MAX_CANDIDATES`] allows, at least three; of a
/// box with more candidates, evenly spread ones.
fn distinctive(query: &PreparedQuery) -> Vec<usize> {
    let mut boxes: Vec<Vec<usize>> = vec![Vec::new(); query.boxes.len()];
    query.candidates.iter().enumerate().for_each(|(k, candidate)| boxes[candidate.query_box].push(k));
    boxes.retain(|of_box| !of_box.is_empty());
    boxes.sort_by_key(Vec::len);
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

/// The pose that brings landmarks nearest to the points where sizes place them; about gravity where that is known.
fn aligned(query: &PreparedQuery, members: &[&Candidate]) -> Option<Pose> {
    struct Point {
        camera: Vector3<f64>,
        world: Vector3<f64>,
        weight: f64,
    }
    let point = |c: &&Candidate| {
        let depth = c.depths[1];
        Point { camera: c.ray * depth, world: query.map.center(c.landmark), weight: 1.0 / (depth * depth) }
    };
    let points: Vec<Point> = members.iter().map(point).collect();
    let total: f64 = points.iter().map(|point| point.weight).sum();
    let mean = |of: fn(&Point) -> Vector3<f64>| {
        points.iter().fold(Vector3::zeros(), |sum, point| sum + of(point) * point.weight) / total
    };
    let (camera, world) = (mean(|p| p.camera), mean(|p| p.world));
    let spread = |turn: &Matrix3<f64>| {
        points.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, p| {
            sum + turn * (p.camera - camera) * (p.world - world).transpose() * p.weight
        })
    };
    let rotation = match &query.gravity {
        None => nearest_rotation(&spread(&Matrix3::identity()))?,
        Some(gravity) => {
            // The camera turned upright, then a turn about the vertical.
            let up = gravity.up_in_world;
            let upright = between(&gravity.up_in_camera, &up);
            let turn = nearest_turn(&spread(upright.matrix()), &up);
            upright.matrix().transpose() * turn.matrix()
        }
    };
    let translation = camera - rotation * world;
    translation.iter().all(|x| x.is_finite()).then_some(Pose { rotation, translation })
}
