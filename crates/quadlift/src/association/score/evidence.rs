//! Log Bayes factor of an object against clutter: decides about births and removals (docs/method.md, section 15.3).

use super::fit::SHAPE_SD;
use super::log_likelihood_ratio::HIDDEN_SHARE;
use super::object::Object;
use super::scene_statistics::SceneStatistics;
use crate::association::input::observations::Observations;
use crate::association::statistics::{DetectionRate, LN_2PI, t_constant};
use crate::optimize::median::quantile;

/// Range of the logarithm of an unknown size, over which it is uniform.
const LOG_SIZE_RANGE: f64 = 6.0;

/// The log Bayes factor of an object against all its boxes being clutter, by Laplace's method.
///
/// The term of the detection rate is the Beta-binomial one: whether walls hide the object or the detector is weak, the
/// rate of its detection is its own.
pub(crate) fn evidence(
    rate: &DetectionRate,
    observations: &Observations,
    statistics: &SceneStatistics,
    object: &Object,
) -> f64 {
    let edge_constant = t_constant(1);
    let mut sum = -object.cost - (observations.categories.len().max(1) as f64).ln();
    for &index in &object.boxes {
        let index = index as usize;
        let observation = &observations.boxes[index];
        let log_clutter = statistics.log_clutter(observation);
        let (log_sd, size) = (statistics.sd(observation).ln(), observation.size());
        for edge in 0..4 {
            if observation.cut[edge] {
                continue;
            }
            sum -= log_clutter;
            sum += if statistics.hidden[index][edge] {
                HIDDEN_SHARE.ln() - size[edge % 2].ln()
            } else {
                edge_constant - log_sd
            };
        }
        sum += observations.category_log_odds(object.category, observation.category);
    }
    // Densities of the prior: the center uniform in the scene's volume and measured in radii, five numbers of shape (the
    // entries of D are twice logarithms of axes), one of size.
    let place = 3.0 * object.radius.ln() - statistics.volume.ln();
    let shape = -5.0 * SHAPE_SD.ln() - 2.5 * LN_2PI + 6.0 * 0.5f64.ln();
    let size = match statistics.log_sizes[object.category] {
        Some(size) => -size.sd.ln() - 0.5 * LN_2PI,
        None => -LOG_SIZE_RANGE.ln(),
    };
    let occam = 4.5 * LN_2PI - 0.5 * object.log_det_hessian;
    let detected = rate.log_probability(object.boxes.len(), object.visible_beside_boxes());
    sum + place
        + shape
        + size
        + occam
        + detected
        + statistics.objects.max(1.0).ln()
        + score_log_odds(observations, object)
}

/// What the detector says against the object: the median of its boxes' log odds, once. Its boxes show the same thing, so that
/// their scores are one opinion.
pub(crate) fn score_log_odds(observations: &Observations, object: &Object) -> f64 {
    let odds = object.boxes.iter().map(|&index| observations.boxes[index as usize].score_log_odds);
    quantile(&mut odds.collect::<Vec<f64>>(), 0.5).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::fit::{Start, fit};
    use super::*;
    use crate::association::test_scenes::{ellipsoid, seen_by};

    fn of_views(views: u32, shift: f64) -> f64 {
        let (mut observations, mut statistics) = seen_by(10, &ellipsoid());
        statistics.volume = 1e5;
        observations.move_boxes(0, &nalgebra::Vector2::new(shift, 0.0));
        let center = ellipsoid().center.coords - observations.origin;
        let object = fit(&observations, &statistics, (0..views).collect(), &[Start::sphere(center, 2.0)]).unwrap();
        evidence(&DetectionRate::new(10), &observations, &statistics, &object)
    }

    #[test]
    fn every_view_that_agrees_adds_evidence_and_one_that_does_not_takes_some() {
        let by_views: Vec<f64> = (3..=10).map(|views| of_views(views, 0.0)).collect();
        assert!(by_views.windows(2).all(|w| w[1] > w[0] + 2.0), "{by_views:?}");
        assert!(of_views(10, 25.0) < of_views(10, 0.0) - 5.0);
    }

    #[test]
    fn an_edge_that_is_cut_off_says_nothing_and_one_that_is_hidden_little() {
        let (mut observations, mut statistics) = seen_by(10, &ellipsoid());
        statistics.volume = 1e5;
        let center = ellipsoid().center.coords - observations.origin;
        let object = fit(&observations, &statistics, (0..10).collect(), &[Start::sphere(center, 2.0)]).unwrap();
        let seen = evidence(&DetectionRate::new(10), &observations, &statistics, &object);
        let observation = &observations.boxes[3];
        // The t density with 5 degrees of freedom at zero over that of clutter.
        let of_edge =
            0.3796066898224944f64.ln() - statistics.sd(observation).ln() - statistics.log_clutter(observation);
        // One in twenty edges is hidden, anywhere in the object.
        let of_hidden = (0.05 / observation.size().y).ln() - statistics.log_clutter(observation);
        statistics.hidden[3][1] = true;
        let hidden = evidence(&DetectionRate::new(10), &observations, &statistics, &object);
        assert!((seen - hidden - (of_edge - of_hidden)).abs() < 1e-9, "{seen} {hidden}");
        statistics.hidden[3][1] = false;
        observations.boxes[3].cut[1] = true;
        let cut = evidence(&DetectionRate::new(10), &observations, &statistics, &object);
        assert!((seen - cut - of_edge).abs() < 1e-9, "{seen} {cut}");
    }

    #[test]
    fn low_scores_count_once_against_an_object() {
        let (mut observations, mut statistics) = seen_by(10, &ellipsoid());
        statistics.volume = 1e5;
        let center = ellipsoid().center.coords - observations.origin;
        let object = fit(&observations, &statistics, (0..10).collect(), &[Start::sphere(center, 2.0)]).unwrap();
        let without = evidence(&DetectionRate::new(10), &observations, &statistics, &object);
        for (observation, score) in
            observations.boxes.iter_mut().zip([0.9, 0.04, 0.05, 0.04, 0.04, 0.04, 0.01, 0.04, 0.2, 0.04])
        {
            observation.score_log_odds = if score < 0.5 { f64::ln(score / (1.0 - score)) } else { 0.0 };
        }
        let low = evidence(&DetectionRate::new(10), &observations, &statistics, &object);
        assert!((without - low - 24.0_f64.ln()).abs() < 1e-9, "{without} {low}");
    }
}
