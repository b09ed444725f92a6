//! Log likelihood ratio of a box: detection of an object against clutter (docs/method.md, section 15.2).

use nalgebra::{SMatrix, Vector3};

use super::object::{Object, Prediction, edge_planes};
use super::scene_statistics::SceneStatistics;
use crate::association::input::observations::Observations;
use crate::association::statistics::{STUDENT_T_DOF, t_constant};

/// Probability that an edge of a detection is hidden by another object.
pub(crate) const HIDDEN_SHARE: f64 = 0.05;

/// Edges that lie inside the prediction by more than this many standard deviations may be hidden.
const HIDDEN_BEYOND: f64 = -2.0;

/// Maximum number of occluded edges of a box.
const MAX_HIDDEN: usize = 2;

/// The gain of taking a box for a detection of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LogLikelihoodRatio {
    /// Logarithm of the ratio of the likelihoods, without the evidence of ids.
    pub value: f64,
    /// Its occluded edges.
    pub hidden: [bool; 4],
}

/// Calculates gains.
#[derive(Debug)]
pub(crate) struct LogLikelihoodRatios<'a> {
    pub observations: &'a Observations,
    pub statistics: &'a SceneStatistics,
    /// Constants of the t distribution in 0 to 4 dimensions.
    constants: [f64; 5],
}

impl<'a> LogLikelihoodRatios<'a> {
    pub(crate) fn new(observations: &'a Observations, statistics: &'a SceneStatistics) -> Self {
        Self { observations, statistics, constants: std::array::from_fn(t_constant) }
    }

    /// The gain of a box (by index) for an object that is predicted in the box's frame ([`Self::gain`]); `None` also where it is not
    /// wholly in front of the camera.
    pub(crate) fn predicted_gain(&self, object: &Object, index: usize) -> Option<LogLikelihoodRatio> {
        let camera = &self.observations.cameras[self.observations.boxes[index].frame];
        self.gain(object, &object.predict(camera)?, index)
    }

    /// The gain of a box (by index) for an object whose outline in the box's frame is predicted; `None` if they do not
    /// overlap or too few edges are informative.
    pub(crate) fn gain(&self, object: &Object, prediction: &Prediction, index: usize) -> Option<LogLikelihoodRatio> {
        let observation = &self.observations.boxes[index];
        let (own, other) = (&prediction.edges, &observation.edges);
        if own[0] > other[2] || own[2] < other[0] || own[1] > other[3] || own[3] < other[1] {
            return None;
        }
        let (residuals, covariance, edges, count) = self.residuals(object, prediction, index);
        let log_clutter = self.statistics.log_clutter(observation);
        let log_sd = self.statistics.sd(observation).ln();
        let predicted = prediction.size();
        let mut hidden = [false; 4];
        let mut best: Option<LogLikelihoodRatio> = None;
        for attempt in 0..=MAX_HIDDEN {
            if attempt > 0 {
                // One more edge is treated as hidden: the one farthest inside the prediction.
                let deviation = |a: usize| residuals[a] / covariance[(a, a)].sqrt();
                let worst = (0..count)
                    .filter(|&a| !hidden[edges[a]] && deviation(a) < HIDDEN_BEYOND)
                    .min_by(|&a, &b| deviation(a).total_cmp(&deviation(b)));
                match worst {
                    Some(worst) => hidden[edges[worst]] = true,
                    None => break,
                }
            }
            let kept: Vec4 = (0..count).filter(|&a| !hidden[edges[a]]).collect();
            if kept.len < 2 {
                break;
            }
            let Some((log_det, square)) = whiten(&residuals, &covariance, &kept) else { break };
            let m = kept.len;
            let mut value =
                self.constants[m] - 0.5 * (STUDENT_T_DOF + m as f64) * (square / STUDENT_T_DOF).ln_1p() - 0.5 * log_det;
            for a in 0..count {
                let edge = edges[a];
                let density = if hidden[edge] { HIDDEN_SHARE.ln() - predicted[edge % 2].ln() } else { -log_sd };
                value += density - log_clutter;
            }
            if best.is_none_or(|b| value > b.value) {
                best = Some(LogLikelihoodRatio { value, hidden });
            }
        }
        let mut gain = best?;
        gain.value += log_rate_odds(object);
        gain.value += self.observations.category_log_odds(object.category, observation.category);
        Some(gain)
    }

    /// Residuals of the informative edges, in standard deviations of an edge; their covariance `I + J H^-1 J^T`; which
    /// edges they are; how many.
    fn residuals(
        &self,
        object: &Object,
        prediction: &Prediction,
        index: usize,
    ) -> ([f64; 4], SMatrix<f64, 4, 4>, [usize; 4], usize) {
        let observation = &self.observations.boxes[index];
        let scale = 1.0 / (self.statistics.sd(observation) * prediction.depth);
        let mut jacobian = SMatrix::<f64, 4, 9>::zeros();
        let (mut residuals, mut edges, mut count) = ([0.0; 4], [0; 4], 0);
        let planes = edge_planes(&self.observations.cameras[observation.frame], observation);
        for (edge, (normal, offset)) in planes.iter().enumerate() {
            let h = object.root.tr_mul(normal).norm();
            let residual = (normal.dot(&object.center) + offset - h) * scale;
            if observation.cut[edge] && residual < 0.0 {
                continue;
            }
            for (k, value) in derivatives(object, normal, scale).into_iter().enumerate() {
                jacobian[(count, k)] = value;
            }
            residuals[count] = residual;
            edges[count] = edge;
            count += 1;
        }
        let mut covariance = jacobian * object.covariance * jacobian.transpose();
        for i in 0..4 {
            covariance[(i, i)] += 1.0;
        }
        (residuals, covariance, edges, count)
    }
}

/// Log odds of one detection more of an object: of how often it has been detected to how often it has been missed.
pub(crate) fn log_rate_odds(object: &Object) -> f64 {
    let missed = object.visible.saturating_sub(object.views());
    ((object.views() + 1) as f64 / (missed + 1) as f64).ln()
}

/// Derivatives of the distance of a plane (with normal `n`) from the body, times a scale, by the parameters in the
/// order of [`Object::covariance`].
pub(crate) fn derivatives(object: &Object, normal: &Vector3<f64>, scale: f64) -> [f64; 9] {
    let u = object.root.tr_mul(normal);
    let slope = -scale / (2.0 * u.norm());
    [
        normal.x * scale * object.radius,
        normal.y * scale * object.radius,
        normal.z * scale * object.radius,
        slope * u.x * u.x,
        2.0 * slope * u.x * u.y,
        2.0 * slope * u.x * u.z,
        slope * u.y * u.y,
        2.0 * slope * u.y * u.z,
        slope * u.z * u.z,
    ]
}

/// Up to four small indices.
#[derive(Debug, Clone, Copy, Default)]
struct Vec4 {
    items: [usize; 4],
    len: usize,
}

impl FromIterator<usize> for Vec4 {
    fn from_iter<I: IntoIterator<Item = usize>>(items: I) -> Self {
        let mut all = Self::default();
        for (place, item) in all.items.iter_mut().zip(items) {
            *place = item;
            all.len += 1;
        }
        all
    }
}

/// `ln det S` and `r^T S^-1 r` of the kept rows, by a Cholesky decomposition; `None` when S is not positive definite.
fn whiten(residuals: &[f64; 4], covariance: &SMatrix<f64, 4, 4>, kept: &Vec4) -> Option<(f64, f64)> {
    let (mut lower, mut white) = ([[0.0; 4]; 4], [0.0; 4]);
    let (mut log_det, mut square) = (0.0, 0.0);
    for a in 0..kept.len {
        let mut residual = residuals[kept.items[a]];
        for c in 0..=a {
            let mut x = covariance[(kept.items[a], kept.items[c])];
            for e in 0..c {
                x -= lower[a][e] * lower[c][e];
            }
            if c < a {
                lower[a][c] = x / lower[c][c];
                residual -= lower[a][c] * white[c];
            } else {
                if x.is_nan() || x <= 0.0 {
                    return None;
                }
                lower[a][a] = x.sqrt();
                log_det += x.ln();
            }
        }
        white[a] = residual / lower[a][a];
        square += white[a] * white[a];
    }
    Some((log_det, square))
}

#[cfg(test)]
mod tests {
    use super::super::fit::{Start, fit};
    use super::*;
    use crate::association::test_scenes::{ellipsoid, of_frames, seen_by};
    use crate::geometry::gamma::ln_gamma;

    /// An object fitted to all boxes but the first, its certainty beyond doubt, and the gain of the first box moved by
    /// some pixels at each edge.
    fn gain_of_first(
        moved: [f64; 4],
        view: impl Fn(&LogLikelihoodRatios, &Object, &Prediction, Option<LogLikelihoodRatio>),
    ) {
        let (mut observations, statistics) = seen_by(10, &ellipsoid());
        let center = ellipsoid().center.coords - observations.origin;
        let mut object = fit(&observations, &statistics, (1..10).collect(), &[Start::sphere(center, 2.0)]).unwrap();
        object.covariance *= 1e-12;
        for (edge, by) in observations.boxes[0].edges.iter_mut().zip(moved) {
            *edge += by;
        }
        let gains = LogLikelihoodRatios::new(&observations, &statistics);
        let prediction = object.predict(&observations.cameras[0]).unwrap();
        let gain = gains.gain(&object, &prediction, 0);
        view(&gains, &object, &prediction, gain);
    }

    #[test]
    fn a_certain_object_gains_by_the_t_density_of_its_residuals() {
        gain_of_first([1.0, -2.0, 0.5, 1.0], |gains, object, prediction, gain| {
            let observation = &gains.observations.boxes[0];
            let sd = gains.statistics.sd(observation);
            let square: f64 = (0..4).map(|e| ((prediction.edges[e] - observation.edges[e]) / sd).powi(2)).sum();
            let constant = ln_gamma(4.5) - ln_gamma(2.5) - 2.0 * (5.0 * std::f64::consts::PI).ln();
            let clutter = gains.statistics.log_clutter(observation);
            let rate = (object.boxes.len() as f64 + 1.0).ln();
            let expected = constant - 4.5 * (1.0 + square / 5.0).ln() - 4.0 * (sd.ln() + clutter) + rate;
            let gain = gain.unwrap();
            // Residuals are distances of planes from the body, which approximate those of edges.
            assert!((gain.value - expected).abs() < 0.02, "{} {expected}", gain.value);
            assert_eq!(gain.hidden, [false; 4]);
        });
    }

    #[test]
    fn an_edge_far_inside_is_taken_for_hidden_and_one_far_outside_is_not() {
        gain_of_first([15.0, 0.0, 0.0, 0.0], |_, _, _, gain| {
            assert_eq!(gain.unwrap().hidden, [true, false, false, false]);
        });
        gain_of_first([-15.0, 0.0, 0.0, 0.0], |_, _, _, gain| {
            assert!(gain.is_none_or(|g| g.hidden == [false; 4]));
        });
        gain_of_first([900.0, 0.0, 900.0, 0.0], |_, _, _, gain| assert_eq!(gain, None));
    }

    #[test]
    fn an_uncertain_object_bears_what_its_covariance_lets_its_edges_move() {
        // The covariance of the residuals, from differences of predicted edges instead of derivatives of planes.
        let (observations, statistics) = seen_by(10, &ellipsoid());
        let center = ellipsoid().center.coords - observations.origin;
        let object = fit(&observations, &statistics, (1..4).collect(), &[Start::sphere(center, 2.0)]).unwrap();
        let gains = LogLikelihoodRatios::new(&observations, &statistics);
        let prediction = object.predict(&observations.cameras[0]).unwrap();
        let (_, covariance, ..) = gains.residuals(&object, &prediction, 0);
        let sd = statistics.sd(&observations.boxes[0]);
        let edges = |k: usize, step: f64| {
            let mut moved = object.clone();
            if k < 3 {
                moved.center[k] += step * object.radius;
            } else {
                // A <- B exp(D) B^T.
                let (i, j) = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)][k - 3];
                let mut half = nalgebra::Matrix3::zeros();
                half[(i, j)] += 0.5 * step;
                half[(j, i)] = half[(i, j)];
                moved.root = object.root * half.exp();
            }
            moved.predict(&observations.cameras[0]).unwrap().edges
        };
        let jacobian = SMatrix::<f64, 4, 9>::from_fn(|edge, k| {
            let sign = if edge < 2 { 1.0 } else { -1.0 };
            sign * (edges(k, 1e-5)[edge] - edges(k, -1e-5)[edge]) / (2e-5 * sd)
        });
        let expected = SMatrix::<f64, 4, 4>::identity() + jacobian * object.covariance * jacobian.transpose();
        assert!(expected.diagonal().min() > 1.1, "{expected}");
        assert!((covariance - expected).amax() < 0.03 * expected.amax(), "{covariance} {expected}");
    }

    #[test]
    fn an_edge_that_the_border_cuts_off_does_not_hold_the_object_back() {
        let gain = |cut: bool, by: f64| {
            let (mut observations, statistics) = seen_by(10, &ellipsoid());
            let center = ellipsoid().center.coords - observations.origin;
            let object = fit(&observations, &statistics, (1..10).collect(), &[Start::sphere(center, 2.0)]).unwrap();
            observations.boxes[0].cut[2] = cut;
            observations.boxes[0].edges[2] += by;
            let gains = LogLikelihoodRatios::new(&observations, &statistics);
            let prediction = object.predict(&observations.cameras[0]).unwrap();
            gains.gain(&object, &prediction, 0).unwrap()
        };
        // However much of the object lies outside of the image, its box agrees, and nothing hides it.
        let (a_little, much) = (gain(true, -2.0), gain(true, -12.0));
        assert!((a_little.value - much.value).abs() < 1e-9 && much.hidden == [false; 4], "{a_little:?} {much:?}");
        assert!(gain(false, -12.0).value < gain(false, -2.0).value - 1.0);
        // A box that extends beyond the object contradicts it, cut off or not.
        assert!((gain(true, 12.0).value - gain(false, 12.0).value).abs() < 1e-9);
    }

    #[test]
    fn a_category_is_worth_what_its_share_and_that_of_wrong_ones_say() {
        // Seven cups and three plates.
        let category = |frame: usize| if frame < 7 { "cup" } else { "plate" };
        let (_, mut observations, statistics) = of_frames(10, |frame| vec![(ellipsoid(), Some(category(frame)))]);
        let center = ellipsoid().center.coords - observations.origin;
        let object = fit(&observations, &statistics, (0..7).collect(), &[Start::sphere(center, 2.0)]).unwrap();
        let cup = observations.boxes[0].category;
        let plate = observations.boxes[9].category;
        assert_eq!(object.category, cup);
        let mut gain = |category: usize| {
            observations.boxes[8].category = category;
            let prediction = object.predict(&observations.cameras[8]).unwrap();
            LogLikelihoodRatios::new(&observations, &statistics).gain(&object, &prediction, 8).unwrap().value
        };
        // Of detections of cups 97 % are cups and 3 % plates; of clutter 70 % and 30 %.
        let expected = (0.97f64 / 0.7).ln() - (0.03f64 / 0.3).ln();
        let found = gain(cup) - gain(plate);
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }

    #[test]
    fn whitening_agrees_with_a_dense_inverse() {
        let mut covariance = SMatrix::<f64, 4, 4>::from_fn(|i, j| 0.3 * ((i * j + i + j) as f64).cos());
        covariance = covariance * covariance.transpose() + SMatrix::identity();
        let residuals = [1.0, -2.0, 0.5, 3.0];
        let kept: Vec4 = [0, 2, 3].into_iter().collect();
        let (log_det, square) = whiten(&residuals, &covariance, &kept).unwrap();
        let part = nalgebra::Matrix3::from_fn(|i, j| covariance[(kept.items[i], kept.items[j])]);
        let r = nalgebra::Vector3::from_fn(|i, _| residuals[kept.items[i]]);
        assert!((log_det - part.determinant().ln()).abs() < 1e-12);
        assert!((square - (r.transpose() * part.try_inverse().unwrap() * r)[0]).abs() < 1e-12);
    }
}
