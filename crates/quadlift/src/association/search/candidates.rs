//! Candidate boxes of an object in a frame, without evaluating all boxes.
//!
//! In a crowd an object's outline overlaps hundreds of boxes, and the gain of nearly all of them is far below zero. The
//! boxes of a frame are stored in a tree over their four edges. A bound on the gain (ours) decides about a whole node:
//! with `f` the distance of a box's edge from the body in pixels times depth, `f` is zero at the predicted edge and its
//! slope is at least `z - |B^T p|` (`z` the depth of the center, `B` the root of the shape, `p` the camera's third
//! row), so that an edge `d` pixels away has a residual of at least `(1 - q) d / sd`, `q = |B^T p| / z`. The standard
//! deviation that the body's own uncertainty gives to the prediction changes by at most `kappa d`. From residuals and
//! variances follow two lower bounds on the squared Mahalanobis distance `r^T S^-1 r`: `r_e^2 / S_ee` for any edge, and
//! `|r|^2 / (1 + tr(S - I))`. As only boxes with a positive gain are ever assigned, skipping those whose bound is not
//! positive is exact.

use nalgebra::SVector;

use crate::association::input::observations::{Camera, Observations};
use crate::association::score::log_likelihood_ratio::{
    HIDDEN_SHARE, LogLikelihoodRatio, LogLikelihoodRatios, derivatives, log_rate_odds,
};
use crate::association::score::object::{Object, Prediction, edge_plane};
use crate::association::score::range_tree::{Part, RangeTree};
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::statistics::{STUDENT_T_DOF, t_constant};

/// Fewer boxes than this are searched linearly: a tree does not pay off.
const MIN_INDEXED: usize = 64;

/// Maximum number of candidate boxes of an object per frame: those with the largest gains. In crowds, more have a
/// positive one.
const MAX_CANDIDATES_PER_FRAME: usize = 16;

/// Bounds are loosened by this factor against rounding.
const SLACK: f64 = 1.0 + 1e-6;

/// Possible numbers of visible edges of a box, with their constants.
const SEEN: [usize; 3] = [4, 3, 2];

/// A candidate box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub index: u32,
    pub gain: LogLikelihoodRatio,
}

/// Assignable boxes of one frame.
#[derive(Debug)]
pub(crate) struct Candidates {
    /// Boxes that are always evaluated if they overlap the prediction, ascending: all of them if there are few,
    /// otherwise those cut off by the image border.
    listed: Vec<u32>,
    indexed: Vec<Indexed>,
    tree: RangeTree,
    /// For each part of the tree.
    bounds: Vec<Bounds>,
}

/// A box in the tree.
#[derive(Debug, Clone, Copy)]
struct Indexed {
    index: u32,
    edges: [f64; 4],
    /// Variance of an edge, squared pixels.
    variance: f64,
    /// A factor on the bound of `1 + square / STUDENT_T_DOF`, in the order of [`SEEN`].
    limits: [f64; 3],
}

/// Bounds on the boxes of a part of the tree.
#[derive(Debug)]
struct Bounds {
    /// Largest variance of an edge, squared pixels.
    variance: f64,
    /// Largest limits, in the order of [`SEEN`].
    limits: [f64; 3],
}

impl Candidates {
    /// Of some boxes of a frame (ascending).
    pub(crate) fn new(observations: &Observations, statistics: &SceneStatistics, boxes: &[u32]) -> Self {
        let (mut listed, mut indexed) = (Vec::new(), Vec::new());
        let constants = SEEN.map(t_constant);
        for &index in boxes {
            let observation = &observations.boxes[index as usize];
            if boxes.len() < MIN_INDEXED || observation.cut.contains(&true) {
                listed.push(index);
                continue;
            }
            let sd = statistics.sd(observation);
            // The category of the object is not known here; its own is worth the most.
            let category = observation.category;
            let gain = observations.category_log_odds(category, category) - 4.0 * statistics.log_clutter(observation);
            let limit = |k: usize| limit(k, constants[k] - SEEN[k] as f64 * sd.ln() + gain);
            let limits = std::array::from_fn(limit);
            indexed.push(Indexed { index, edges: observation.edges, variance: sd * sd, limits });
        }
        let tree = RangeTree::new(&indexed.iter().map(|b| b.edges).collect::<Vec<_>>());
        let bounds = |part: &Part| {
            let mut bounds = Bounds { variance: 0.0, limits: [0.0; 3] };
            for item in tree.points_of(part).iter().map(|&place| &indexed[place as usize]) {
                bounds.variance = bounds.variance.max(item.variance);
                bounds.limits = std::array::from_fn(|k| bounds.limits[k].max(item.limits[k]));
            }
            bounds
        };
        let bounds = tree.parts.iter().map(bounds).collect();
        Self { listed, indexed, tree, bounds }
    }

    /// The boxes with the greatest positive gains for an object whose outline in the frame is predicted, [`MAX_CANDIDATES_PER_FRAME`] at
    /// most, ascending by index. `bonus` is added to the gain of a box, and is `largest_bonus` at most.
    pub(crate) fn best(
        &self,
        gains: &LogLikelihoodRatios,
        object: &Object,
        (camera, prediction): (&Camera, &Prediction),
        bonus: impl Fn(u32) -> f64,
        largest_bonus: f64,
    ) -> Vec<Candidate> {
        let mut found = Best::default();
        let mut ask = |index: u32| {
            if let Some(mut gain) = gains.gain(object, prediction, index as usize) {
                gain.value += bonus(index);
                found.offer(Candidate { index, gain });
            }
            found.least
        };
        let mut least = 0.0;
        for &index in &self.listed {
            least = ask(index);
        }
        if !self.indexed.is_empty() {
            let mut query = Query::new(camera, object, prediction, largest_bonus);
            let promise = |query: &Query, place: usize| {
                let (part, bounds) = (&self.tree.parts[place], &self.bounds[place]);
                query.promise(&part.low, &part.high, bounds.variance, &bounds.limits)
            };
            let mut open = Vec::with_capacity(32);
            open.push((promise(&query, 0), 0));
            while let Some((promised, place)) = open.pop() {
                if promised <= 1.0 {
                    continue;
                }
                query.demand(least);
                if let Some([a, b]) = self.tree.parts[place].halves {
                    let (a, b) = ((promise(&query, a), a), (promise(&query, b), b));
                    // The more promising half is visited first.
                    open.extend(if a.0 > b.0 { [b, a] } else { [a, b] });
                    continue;
                }
                for &item in self.tree.points_of(&self.tree.parts[place]) {
                    let item = &self.indexed[item as usize];
                    if query.promise(&item.edges, &item.edges, item.variance, &item.limits) > 1.0 {
                        least = ask(item.index);
                    }
                }
            }
        }
        found.candidates.sort_unstable_by_key(|candidate| candidate.index);
        found.candidates
    }
}

/// The best candidates so far.
#[derive(Default)]
struct Best {
    candidates: Vec<Candidate>,
    /// Smaller gains are ignored.
    least: f64,
}

impl Best {
    fn offer(&mut self, candidate: Candidate) {
        if candidate.gain.value.is_nan() || candidate.gain.value <= self.least {
            return;
        }
        self.candidates.push(candidate);
        if self.candidates.len() > MAX_CANDIDATES_PER_FRAME {
            let worse =
                |a: &&Candidate, b: &&Candidate| a.gain.value.total_cmp(&b.gain.value).then(b.index.cmp(&a.index));
            if let Some(worst) = self.candidates.iter().min_by(worse).map(|worst| worst.index) {
                self.candidates.retain(|candidate| candidate.index != worst);
            }
            self.least = self.candidates.iter().map(|c| c.gain.value).fold(f64::INFINITY, f64::min);
        }
    }
}

/// The outline of an object in a frame, and the bounds of its gains.
struct Query {
    predicted: [f64; 4],
    /// The minimum slope of a residual over the distance of the edge.
    slope: f64,
    /// Standard deviations of the predicted edges, pixels, and how much they grow per pixel of distance at most.
    sds: [f64; 4],
    growth: f64,
    /// Factors on the limits of the boxes, in the order of [`SEEN`]: for a positive gain, and for the demanded one.
    limits: [f64; 3],
    demanded: f64,
    demanded_limits: [f64; 3],
}

impl Query {
    fn new(camera: &Camera, object: &Object, prediction: &Prediction, bonus: f64) -> Self {
        let third = camera.matrix.fixed_view::<1, 3>(2, 0).transpose();
        let depth = prediction.depth;
        let thickness = object.root.tr_mul(&third).norm() / depth;
        let sds = std::array::from_fn(|edge| {
            let (normal, _) = edge_plane(camera, edge, prediction.edges[edge]);
            let row = SVector::from(derivatives(object, &normal, 1.0 / depth));
            (object.covariance * row).dot(&row).max(0.0).sqrt()
        });
        // The derivatives by the center turn with the plane's normal, those by the shape by 3 / sqrt(2) of that at most.
        let turn = object.radius / depth + 1.5 * std::f64::consts::SQRT_2 * thickness;
        let gain = log_rate_odds(object) + bonus;
        let [w, h] = prediction.size();
        let hidden = HIDDEN_SHARE.ln() - w.min(h).ln();
        let limits = std::array::from_fn(|k| SLACK * limit(k, gain + k as f64 * hidden));
        Self {
            predicted: prediction.edges,
            slope: (1.0 - thickness).max(0.0),
            sds,
            growth: object.covariance.norm().sqrt() * turn,
            limits,
            demanded: 0.0,
            demanded_limits: limits,
        }
    }

    /// From now on boxes must gain more than this.
    fn demand(&mut self, least: f64) {
        if least != self.demanded {
            self.demanded = least;
            self.demanded_limits = std::array::from_fn(|k| self.limits[k] * limit(k, -least));
        }
    }

    /// Above one if a box with edges in the given ranges can reach the required gain; it increases with the possible
    /// gain.
    fn promise(&self, low: &[f64; 4], high: &[f64; 4], variance: f64, limits: &[f64; 3]) -> f64 {
        let own = &self.predicted;
        if own[0] > high[2] || own[2] < low[0] || own[1] > high[3] || own[3] < low[1] {
            return 0.0;
        }
        // Squared Mahalanobis distances of single edges, and squared residuals in pixels; separately for edges that lie
        // inside the prediction and may be hidden, the largest first.
        let (mut alone, mut hideable_alone) = (0.0f64, [0.0f64; 3]);
        let (mut sum, mut hideable_sum) = (0.0f64, [0.0f64; 2]);
        let (mut total_variance, mut hideable) = (variance, 0);
        for e in 0..4 {
            let distance = (low[e] - own[e]).max(own[e] - high[e]).max(0.0);
            let farthest = (high[e] - own[e]).max(own[e] - low[e]);
            let residual = (distance * self.slope).powi(2);
            let square = residual / (variance + (self.sds[e] + self.growth * distance).powi(2));
            total_variance += (self.sds[e] + self.growth * farthest).powi(2);
            sum += residual;
            if if e < 2 { high[e] > own[e] } else { low[e] < own[e] } {
                hideable += 1;
                insert(&mut hideable_alone, square);
                insert(&mut hideable_sum, residual);
            } else {
                alone = alone.max(square);
            }
        }
        let mut promise = 0.0f64;
        for k in 0..=hideable.min(2) {
            let square = alone.max(hideable_alone[k]).max(sum / total_variance);
            promise = promise.max(limits[k] * self.demanded_limits[k] / (1.0 + square / STUDENT_T_DOF));
            if k < 2 {
                sum -= hideable_sum[k];
            }
        }
        promise
    }
}

/// Upper bound of `1 + square / STUDENT_T_DOF` for a positive gain, with all other terms of the gain given; `k` counts
/// in [`SEEN`].
fn limit(k: usize, gain: f64) -> f64 {
    (2.0 / (STUDENT_T_DOF + SEEN[k] as f64) * gain).exp()
}

/// Inserts a value into a list in descending order.
fn insert<const N: usize>(sorted: &mut [f64; N], mut value: f64) {
    for place in sorted.iter_mut() {
        if value > *place {
            std::mem::swap(place, &mut value);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use nalgebra::Vector3;

    use super::*;
    use crate::association::score::fit::{Start, fit};
    use crate::association::test_scenes::{ellipsoid, of_frames};
    use crate::geometry::Ellipsoid;

    /// Bodies in a crowd: each overlaps most of the others in every image.
    fn crowd(count: usize) -> Vec<Ellipsoid> {
        let body = |k: usize| {
            let wave = |a: f64| (a * k as f64).sin();
            let moved = Vector3::new(3.0 * wave(1.3), 3.0 * wave(2.1), 2.0 * wave(3.7));
            let size = Vector3::new(1.0 + 0.4 * wave(5.1), 1.0 + 0.4 * wave(0.7), 1.0 + 0.4 * wave(1.9));
            Ellipsoid {
                center: ellipsoid().center + moved,
                semi_axes: ellipsoid().semi_axes.component_mul(&size),
                ..ellipsoid()
            }
        };
        (0..count).map(body).collect()
    }

    /// Compares the candidates with those of a look at all boxes, for objects of so many views and with a bonus; how many
    /// boxes were asked, of how many that overlap, and how many gains were positive.
    fn compare(views: u32, bonus: f64) -> [usize; 3] {
        let bodies = crowd(200);
        let (_, observations, mut statistics) = of_frames(8, |_| bodies.iter().map(|b| (*b, None)).collect());
        statistics.edge_noise = 0.03;
        let gains = LogLikelihoodRatios::new(&observations, &statistics);
        let own_bonus = |index: u32| if index.is_multiple_of(3) { bonus } else { 0.0 };
        let mut totals = [0; 3];
        for body in bodies.iter().step_by(10) {
            let shows = |frame: usize| {
                let of = |k: &&usize| observations.boxes[**k].detection % 200;
                let all: Vec<usize> = observations.cameras[frame].boxes.clone().collect();
                let place = bodies.iter().position(|other| other.center == body.center)?;
                all.iter().find(|k| of(k) == place).map(|k| *k as u32)
            };
            let boxes: Vec<u32> = (0..views as usize).filter_map(shows).collect();
            let start = Start::sphere(body.center.coords - observations.origin, 2.0);
            let object = fit(&observations, &statistics, boxes, &[start]).unwrap();
            for (frame, camera) in observations.cameras.iter().enumerate().skip(views as usize) {
                let Some(prediction) = object.predict(camera) else { continue };
                let all: Vec<u32> = camera.boxes.clone().map(|i| i as u32).collect();
                let mut expected: Vec<(u32, f64)> = all
                    .iter()
                    .filter_map(|&i| {
                        let gain = gains.gain(&object, &prediction, i as usize)?;
                        totals[1] += 1;
                        Some((i, gain.value + own_bonus(i))).filter(|(_, value)| *value > 0.0)
                    })
                    .collect();
                totals[2] += expected.len();
                expected.sort_by(|a, b| b.1.total_cmp(&a.1));
                expected.truncate(MAX_CANDIDATES_PER_FRAME);
                expected.sort_by_key(|(index, _)| *index);
                let asked = Cell::new(0);
                let counted = |index: u32| {
                    asked.set(asked.get() + 1);
                    own_bonus(index)
                };
                let candidates = Candidates::new(&observations, &statistics, &all);
                let found = candidates.best(&gains, &object, (camera, &prediction), counted, bonus);
                let found: Vec<(u32, f64)> = found.iter().map(|c| (c.index, c.gain.value)).collect();
                assert_eq!(found, expected, "frame {frame}");
                totals[0] += asked.get();
            }
        }
        totals
    }

    #[test]
    fn no_box_that_gains_is_left_out_and_most_others_are_not_asked() {
        let [asked, overlapping, positive] = compare(6, 0.0);
        assert!(positive > 40 && overlapping > 5000 && asked < overlapping / 5, "{asked} {overlapping} {positive}");
        // Objects of two views are uncertain, and ids speak for some boxes.
        let [asked, overlapping, positive] = compare(2, 3.0);
        assert!(positive > 1000 && asked < overlapping * 9 / 10, "{asked} {overlapping} {positive}");
    }
}
