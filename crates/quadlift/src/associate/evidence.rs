//! How much better the boxes of an object are explained by the object than by clutter: one currency for births, merges
//! and deaths.

use super::fit::SHAPE_SD;
use super::gain::HIDDEN_SHARE;
use super::model::Model;
use super::object::Object;
use super::observations::Observations;
use super::problem::Problem;
use super::statistics::{LN_2PI, t_constant};

/// Objects with less evidence (nats) are given up.
pub(super) const LEAST_EVIDENCE: f64 = 5.0;

/// Range of the logarithm of an unknown size, over which it is uniform.
const LOG_SIZE_RANGE: f64 = 6.0;

/// The log Bayes factor of an object against all its boxes being clutter, by Laplace's method.
///
/// The term of the detection rate is the Beta-binomial one: whether walls hide the object or the detector is weak, the
/// rate of its detection is its own.
pub(super) fn evidence(problem: &Problem, observations: &Observations, model: &Model, object: &Object) -> f64 {
    let edge_constant = t_constant(1);
    let mut sum = -object.cost - (observations.categories.len().max(1) as f64).ln();
    for &index in &object.boxes {
        let index = index as usize;
        let sighting = &observations.boxes[index];
        let log_clutter = model.log_clutter(&problem.clutter, index);
        let (log_sd, size) = (model.sd(sighting).ln(), sighting.size());
        for edge in 0..4 {
            if sighting.cut[edge] {
                continue;
            }
            sum -= log_clutter;
            sum += if model.hidden[index][edge] {
                HIDDEN_SHARE.ln() - size[edge % 2].ln()
            } else {
                edge_constant - log_sd
            };
        }
        sum += observations.category_log_odds(object.category, sighting.category);
    }
    // Densities of the prior: the centre uniform in the scene's volume and measured in radii, five numbers of shape (the
    // entries of D are twice logarithms of axes), one of size.
    let place = 3.0 * object.radius.ln() - model.volume.ln();
    let shape = -5.0 * SHAPE_SD.ln() - 2.5 * LN_2PI + 6.0 * 0.5f64.ln();
    let size = match model.log_sizes[object.category] {
        Some(size) => -size.sd.ln() - 0.5 * LN_2PI,
        None => -LOG_SIZE_RANGE.ln(),
    };
    let occam = 4.5 * LN_2PI - 0.5 * object.log_det_hessian;
    let rate = problem.rate.log_probability(object.boxes.len(), object.visible);
    sum + place + shape + size + occam + rate + model.objects.max(1.0).ln()
}
