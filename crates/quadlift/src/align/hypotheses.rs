//! Transforms to try: from groups of objects whose distances agree in both maps.
//!
//! Pairs of objects that may be the same are the nodes of a graph; two go together if the distance of the objects is the same in both maps
//! at a scale, and their difference of height where the vertical is known. Many nodes that all go together are hardly chance.

use nalgebra::{Matrix3, Unit, Vector3};

use super::prepared::{Candidate, PreparedMaps, SIZE_SLACK};
use super::score::quick_score;
use super::{AlignStatus, Ambiguity, MapTransform};
use crate::geometry::Similarity;
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::rotation::{between, nearest_rotation, nearest_turn};
use crate::optimize::bits::ones;
use crate::sorting::StableSort;

/// Comparisons of pairs with pairs, for all scales together, about: bounds the time.
const MAX_COMPARISONS: usize = 60_000_000;

/// Comparisons of objects of the two maps for all groups, about.
const MAX_SCORES: usize = 10_000_000;

/// Groups of one scale at most, and at least.
const MAX_GROUPS: usize = 100;
const MIN_GROUPS: usize = 4;

/// Transforms that are refined with all objects, and fewer where the maps are large: as many as [`MAX_SCORES`] comparisons allow.
const MAX_STARTS: usize = 40;
const MIN_STARTS: usize = 6;

/// Half the difference of the logarithms of neighboring scales, which is also the tolerance at each.
const HALF_STEP: f64 = 0.04;

/// Standard deviations by which distances and heights may differ.
const DEVIATIONS: f64 = 3.0;

/// Scales that are tried at most; more than are needed for maps whose objects differ a thousandfold in size.
const MAX_SCALES: usize = 400;

/// Transforms to try, and the pairs that they were searched among.
pub(super) struct Starts {
    /// Relative to the middles of the maps, the best first.
    pub transforms: Vec<Similarity>,
    /// Whether each candidate was examined at any scale.
    is_examined: Vec<bool>,
    /// Whether all were, at all scales that are possible for them.
    all: bool,
}

impl Starts {
    /// The answer where nothing was found: that there is nothing only if all pairs were examined.
    pub(super) fn none_found(&self) -> AlignStatus {
        if self.all { AlignStatus::NoAlignment } else { AlignStatus::Ambiguous(Ambiguity::NotSearched) }
    }

    /// How many matches are among the pairs that were examined; any number where all were.
    pub(super) fn examined(&self, maps: &PreparedMaps, matches: &[(usize, usize)]) -> usize {
        if self.all {
            return usize::MAX;
        }
        let place = |pair: &(usize, usize)| maps.candidates.binary_search_by_key(pair, |c| (c.a, c.b)).ok();
        matches.iter().filter_map(place).filter(|&k| self.is_examined[k]).count()
    }
}

/// Transforms of the largest groups of all scales.
pub(super) fn starts(maps: &PreparedMaps) -> Starts {
    let (log_scales, tolerance) = scales(maps);
    let mut found = Starts { transforms: Vec::new(), is_examined: vec![false; maps.candidates.len()], all: maps.all };
    let each = (2 * MAX_COMPARISONS / log_scales.len().max(1)).isqrt().max(64);
    let groups = MAX_SCORES / (log_scales.len() * maps.candidates.len()).max(1);
    let groups = groups.clamp(MIN_GROUPS, MAX_GROUPS);
    let mut scored: Vec<(f64, Similarity)> = Vec::new();
    for log_scale in log_scales {
        let (nodes, all) = nodes(maps, log_scale, each);
        nodes.iter().for_each(|&k| found.is_examined[k] = true);
        found.all &= all;
        let graph = Graph::new(maps, nodes, log_scale, tolerance);
        for group in graph.groups(maps.needed(), groups) {
            let members: Vec<Candidate> = group.iter().map(|&k| maps.candidates[k]).collect();
            if let Some(transform) = fitted(maps, &members, log_scale) {
                scored.push((quick_score(maps, &transform), transform));
            }
        }
    }
    let starts = (MAX_SCORES / maps.candidates.len().max(1)).clamp(MIN_STARTS, MAX_STARTS);
    scored.retain(|(score, _)| *score > 0.0);
    scored.stable_sort_by(|a, b| b.0.total_cmp(&a.0));
    for (_, transform) in scored {
        if found.transforms.len() == starts {
            break;
        }
        if !found.transforms.iter().any(|other| maps.same_transform(other, &transform)) {
            found.transforms.push(transform);
        }
    }
    found
}

/// The scales to try, as logarithms, and the tolerance at each.
fn scales(maps: &PreparedMaps) -> (Vec<f64>, f64) {
    if let Some(scale) = maps.options.scale {
        return (vec![scale.ln()], 0.0);
    }
    let ratios = maps.candidates.iter().map(|candidate| candidate.log_ratio);
    let (low, high) = ratios.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let (low, high) = (low - SIZE_SLACK, high + SIZE_SLACK);
    if !(high - low).is_finite() || high < low {
        return (Vec::new(), 0.0);
    }
    let count = ((high - low) / (2.0 * HALF_STEP)).ceil().clamp(1.0, MAX_SCALES as f64);
    let half = 0.5 * (high - low) / count;
    // Neighboring ranges overlap by half, so that a group lies in one of them.
    ((0..2 * count as usize - 1).map(|k| low + half * (k as f64 + 1.0)).collect(), half)
}

/// The candidates whose sizes allow a scale: all of them, or about `most`, those of which few are alike first, and of the others those of
/// evenly spread objects of A.
fn nodes(maps: &PreparedMaps, log_scale: f64, most: usize) -> (Vec<usize>, bool) {
    let mut possible: Vec<usize> =
        (0..maps.candidates.len()).filter(|&k| (maps.candidates[k].log_ratio - log_scale).abs() < SIZE_SLACK).collect();
    if possible.len() <= most {
        return (possible, true);
    }
    possible.stable_sort_by_key(|&k| maps.candidates[k].alike);
    let alike = maps.candidates[possible[most]].alike;
    let fewer = possible.partition_point(|&k| maps.candidates[k].alike < alike);
    let as_many = possible.partition_point(|&k| maps.candidates[k].alike <= alike);
    let mut objects: Vec<usize> = possible[fewer..as_many].iter().map(|&k| maps.candidates[k].a).collect();
    objects.dedup();
    let step = (as_many - fewer).div_ceil((most - fewer).max(1));
    let chosen: Vec<usize> = objects.into_iter().step_by(step).collect();
    let is_chosen = |k: &usize| chosen.binary_search(&maps.candidates[*k].a).is_ok();
    let mut nodes = possible[..fewer].to_vec();
    nodes.extend(possible[fewer..as_many].iter().copied().filter(is_chosen).take(most));
    (nodes, false)
}

/// Which candidates go together at one scale, as rows of bits.
struct Graph {
    /// The candidate of each row.
    nodes: Vec<usize>,
    words: usize,
    bits: Vec<u64>,
}

impl Graph {
    fn new(maps: &PreparedMaps, nodes: Vec<usize>, log_scale: f64, tolerance: f64) -> Self {
        let words = nodes.len().div_ceil(64);
        let mut bits = vec![0u64; words * nodes.len()];
        let scale = log_scale.exp();
        let squared = scale * scale;
        let heights = maps.options.up.map(|up| {
            let a: Vec<f64> = maps.a.objects.iter().map(|object| object.center.dot(&up.up_in_a)).collect();
            let b: Vec<f64> = maps.b.objects.iter().map(|object| object.center.dot(&up.up_in_b) * scale).collect();
            (a, b, up.sd * std::f64::consts::SQRT_2)
        });
        for (row, p) in nodes.iter().map(|&k| &maps.candidates[k]).enumerate() {
            let (pa, pb) = (&maps.a.objects[p.a], &maps.b.objects[p.b]);
            for (column, q) in nodes.iter().map(|&k| &maps.candidates[k]).enumerate().skip(row + 1) {
                if p.a == q.a || p.b == q.b {
                    continue;
                }
                let (qa, qb) = (&maps.a.objects[q.a], &maps.b.objects[q.b]);
                let in_a = (pa.center - qa.center).norm();
                let in_b = (pb.center - qb.center).norm() * scale;
                let variance =
                    pa.largest_variance + qa.largest_variance + squared * (pb.largest_variance + qb.largest_variance);
                let off = (in_a - in_b).abs() - tolerance * in_a.max(in_b);
                let may_differ = DEVIATIONS * variance.sqrt();
                // Objects that are nearer to each other than their errors say nothing.
                if off > may_differ || in_a.max(in_b) < may_differ {
                    continue;
                }
                if let Some((a, b, sd)) = &heights {
                    let off = (a[p.a] - a[q.a] - b[p.b] + b[q.b]).abs();
                    if off > may_differ + (DEVIATIONS * sd + tolerance) * in_a.max(in_b) {
                        continue;
                    }
                }
                bits[row * words + column / 64] |= 1 << (column % 64);
                bits[column * words + row / 64] |= 1 << (row % 64);
            }
        }
        Self { nodes, words, bits }
    }

    fn row(&self, index: usize) -> &[u64] {
        &self.bits[index * self.words..(index + 1) * self.words]
    }

    fn common(&self, set: &[u64], index: usize) -> u32 {
        set.iter().zip(self.row(index)).map(|(a, b)| (a & b).count_ones()).sum()
    }

    /// Groups of candidates that all go together, grown from the pairs with which most others go, at least so large; pairs that are in one
    /// group start no other.
    fn groups(&self, needed: usize, most: usize) -> Vec<Vec<usize>> {
        let mut edges: Vec<(u32, u32, u32)> = Vec::new();
        for i in 0..self.nodes.len() {
            for j in ones(self.row(i).iter().copied()).filter(|&j| j > i) {
                let common = self.common(self.row(i), j);
                if common as usize + 2 >= needed {
                    edges.push((u32::MAX - common, i as u32, j as u32));
                }
            }
        }
        edges.sort_unstable();
        let mut found: Vec<(Vec<usize>, Vec<u64>)> = Vec::new();
        for (_, i, j) in edges {
            if found.len() == most {
                break;
            }
            let (i, j) = (i as usize, j as usize);
            let has = |set: &[u64], k: usize| set[k / 64] >> (k % 64) & 1 == 1;
            if found.iter().any(|(_, set)| has(set, i) && has(set, j)) {
                continue;
            }
            let members = self.grown(i, j);
            if members.len() >= needed {
                let mut set = vec![0u64; self.words];
                members.iter().for_each(|&k| set[k / 64] |= 1 << (k % 64));
                found.push((members, set));
            }
        }
        found.into_iter().map(|(members, _)| members.into_iter().map(|k| self.nodes[k]).collect()).collect()
    }

    /// A group that contains a pair: by turns the candidate that goes with most of those that go with all members.
    fn grown(&self, i: usize, j: usize) -> Vec<usize> {
        let mut members = vec![i, j];
        let mut set: Vec<u64> = self.row(i).iter().zip(self.row(j)).map(|(a, b)| a & b).collect();
        loop {
            let next = ones(set.iter().copied()).map(|k| (self.common(&set, k), std::cmp::Reverse(k))).max();
            let Some((_, std::cmp::Reverse(k))) = next else { return members };
            members.push(k);
            set.iter_mut().zip(self.row(k)).for_each(|(a, b)| *a &= b);
        }
    }
}

/// The transform that brings the centers of a group together (Umeyama's method, weighted; the scale is the ratio of the spreads); turned
/// about the vertical where that is known.
fn fitted(maps: &PreparedMaps, members: &[Candidate], log_scale: f64) -> Option<Similarity> {
    let squared = (2.0 * log_scale).exp();
    let points: Vec<(Vector3<f64>, Vector3<f64>, f64)> = members
        .iter()
        .map(|c| {
            let (a, b) = (&maps.a.objects[c.a], &maps.b.objects[c.b]);
            (a.center, b.center, 1.0 / (a.largest_variance + squared * b.largest_variance))
        })
        .collect();
    let total: f64 = points.iter().map(|p| p.2).sum();
    let middle_a = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.0 * (p.2 / total));
    let middle_b = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.1 * (p.2 / total));
    let moment = points.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, p| {
        sum + (p.0 - middle_a) * (p.1 - middle_b).transpose() * (p.2 / total)
    });
    let spread_a: f64 = points.iter().map(|p| (p.0 - middle_a).norm_squared() * p.2).sum();
    let spread_b: f64 = points.iter().map(|p| (p.1 - middle_b).norm_squared() * p.2).sum();
    let scale = maps.options.scale.unwrap_or((spread_a / spread_b).sqrt());
    let rotation = match &maps.options.up {
        None => nalgebra::Rotation3::from_matrix_unchecked(nearest_rotation(&moment)?.0),
        Some(up) => {
            let upright = between(&up.up_in_b, &up.up_in_a);
            nearest_turn(&(moment * upright.matrix().transpose()), &up.up_in_a) * upright
        }
    };
    let transform = Similarity { scale, rotation, translation: middle_a - rotation * middle_b * scale };
    transform.is_valid().then_some(transform)
}

/// A transform turned about the middle of its objects: objects in one row, or in a plane, may agree as well then.
pub(super) fn turned(maps: &PreparedMaps, best: &MapTransform) -> Vec<Similarity> {
    let about = |axis: Unit<Vector3<f64>>, parts: u32| {
        (1..parts).map(move |k| {
            let turn =
                nalgebra::Rotation3::from_axis_angle(&axis, std::f64::consts::TAU * f64::from(k) / f64::from(parts));
            let pivot = best.pivot.coords;
            let by = Similarity { scale: 1.0, rotation: turn, translation: pivot - turn * pivot };
            by.after(&best.a_from_b)
        })
    };
    if let Some(up) = &maps.options.up {
        return about(up.up_in_a, 12).collect();
    }
    let moment = best.matches.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, pair| {
        let off = maps.a.objects[pair.0].center - best.pivot.coords;
        sum + off * off.transpose()
    });
    let Some((_, axes)) = symmetric_eigen3(&moment) else { return Vec::new() };
    let axis = |k: usize| Unit::new_normalize(axes.column(k).into_owned());
    about(axis(0), 12).chain(about(axis(1), 4)).chain(about(axis(2), 4)).collect()
}
