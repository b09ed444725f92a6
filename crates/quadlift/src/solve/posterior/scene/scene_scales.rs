//! The scales of cues and the objects of a scene, one step at a time (docs/method.md, section 19.3).

use crate::parallel::map_indices;
use crate::solve::estimate::Estimate;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::object::fit::Fit;
use crate::solve::posterior::shared::cue_scales::CueScales;

/// Steps that are tried, each half as long as the one before.
const TRIALS: usize = 6;

/// One step of the scales together with the objects, under these noise levels. It is halved until the cost of all falls: in the
/// direction of a scale that all sources share the cost is nearly flat, and whole steps of Gauss and Newton need not converge.
///
/// Returns whether there are scales: not without cues, nor where noise levels are given, so that an object depends on its own
/// views only.
pub(super) fn step_scales(
    fits: &mut [Result<Fit, Box<Estimate>>],
    scales: &mut CueScales,
    noise: &NoiseLevels,
    context: &PosteriorContext,
) -> bool {
    if context.options.noise_model.is_some() || !context.has_cues {
        return false;
    }
    let terms = map_indices(fits.len(), |k| fits[k].as_ref().ok()?.scale_terms(scales, noise));
    let known = terms.iter().flatten();
    if known.clone().next().is_none() {
        return false;
    }
    let Some(change) = scales.step(known.clone()) else { return true };
    let cost = scales.cost() + known.map(|object| object.cost).sum::<f64>();
    let lower = |share: f64| {
        let (change, mut cost_there) = (change.part(share), 0.0);
        let moved = map_indices(fits.len(), |k| {
            let (fit, terms) = (fits[k].as_ref().ok()?, terms[k].as_ref()?);
            Some(fit.moved_with(&change, share, terms, noise))
        });
        for moved in moved.iter().flatten() {
            cost_there += moved.as_ref()?.equations.cost;
        }
        let changed = scales.changed(&change);
        (changed.cost() + cost_there < cost).then_some((changed, moved))
    };
    if let Some((changed, moved)) = (0..TRIALS).find_map(|halvings| lower(0.5f64.powi(halvings as i32))) {
        *scales = changed;
        for (fit, moved) in fits.iter_mut().zip(moved) {
            if let Some(moved) = moved.flatten() {
                *fit = Ok(moved);
            }
        }
    }
    true
}
