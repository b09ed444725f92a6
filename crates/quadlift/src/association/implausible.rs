//! Marks objects that are unlikely to be one static object (docs/method.md, section 15.8).

use super::input::context::AssociationContext;
use super::options::Part;
use super::score::evidence::{evidence, score_log_odds};
use super::score::object::Object;
use super::search::state::State;
use super::warning::AssociationWarning;
use crate::optimize::median::quantile;

/// Ratio of the longest to the shortest semi-axis above which an object is uncertain if its category has no statistics.
const MAX_ASPECT: f64 = 8.0;

/// Combined deviation from the typical values, in standard deviations, above which an object is uncertain.
const MAX_DEVIATION: f64 = 3.0;

/// Minimum number of objects to estimate the typical values.
const MIN_INFORMATIVE_OBJECTS: usize = 6;

/// Lower bounds of the standard deviations of the log radius and the log aspect of a category.
const MIN_SIZE_SD: f64 = 0.12;
const MIN_ASPECT_SD: f64 = 0.3;

/// Standard deviation of the logarithm of the evidence per view.
const LOG_EVIDENCE_SD: f64 = 0.35;

/// Log odds by the scores of its boxes below which an object is uncertain: a probability of one in four.
const MIN_SCORE_LOG_ODDS: f64 = -1.1;

/// For each object, why it is uncertain, if it is.
pub(crate) fn doubts(context: &AssociationContext, state: &State) -> Vec<Option<AssociationWarning>> {
    let objects = &state.objects;
    let per_view: Vec<f64> = objects
        .iter()
        .map(|o| evidence(&context.rate, &state.observations, &state.statistics, o) / o.boxes.len().max(1) as f64)
        .collect();
    let usual_evidence = quantile(&mut per_view.clone(), 0.5).unwrap_or(0.0);
    let of_category = |category: usize, feature: fn(&Object) -> f64, least_sd: f64| {
        let members = objects.iter().filter(|o| o.category == category);
        usual(members.map(feature).collect(), least_sd)
    };
    let usual_of: Vec<_> = (0..state.observations.categories.len())
        .map(|c| (of_category(c, log_radius, MIN_SIZE_SD), of_category(c, log_aspect, MIN_ASPECT_SD)))
        .collect();
    let looks_at = |reason| f64::from(u8::from(context.options.uses(Part::Warning(reason))));
    let doubt = |(object, own): (&Object, &f64)| {
        let (usual_radius, usual_aspect) = usual_of[object.category];
        let deviation = |value: f64, usual: Option<(f64, f64)>| usual.map_or(0.0, |(middle, sd)| (value - middle) / sd);
        let size = looks_at(AssociationWarning::UnusualSize) * deviation(log_radius(object), usual_radius).abs();
        // Only too long and too weak are odd.
        let length = looks_at(AssociationWarning::Elongated) * deviation(log_aspect(object), usual_aspect).max(0.0);
        let weakness = looks_at(AssociationWarning::WeakEvidence) * (usual_evidence / own.max(0.1)).ln().max(0.0)
            / LOG_EVIDENCE_SD;
        if usual_aspect.is_none()
            && looks_at(AssociationWarning::Elongated) > 0.0
            && log_aspect(object) > MAX_ASPECT.ln()
        {
            return Some(AssociationWarning::Elongated);
        }
        if size.hypot(length).hypot(weakness) <= MAX_DEVIATION {
            let low = score_log_odds(&state.observations, object) < MIN_SCORE_LOG_ODDS;
            return (low && context.options.uses(Part::Warning(AssociationWarning::LowScores)))
                .then_some(AssociationWarning::LowScores);
        }
        Some(if length >= size.max(weakness) {
            AssociationWarning::Elongated
        } else if size >= weakness {
            AssociationWarning::UnusualSize
        } else {
            AssociationWarning::WeakEvidence
        })
    };
    objects.iter().zip(&per_view).map(doubt).collect()
}

fn log_radius(object: &Object) -> f64 {
    object.radius.ln()
}

/// Logarithm of the ratio of the longest to the shortest semi-axis.
fn log_aspect(object: &Object) -> f64 {
    let axes: [f64; 3] = std::array::from_fn(|i| object.root.column(i).norm());
    let (shortest, longest) = axes.iter().fold((f64::MAX, 0.0f64), |(low, high), &x| (low.min(x), high.max(x)));
    (longest / shortest).ln()
}

/// Median and robust standard deviation, if there are enough values.
fn usual(mut values: Vec<f64>, least_sd: f64) -> Option<(f64, f64)> {
    if values.len() < MIN_INFORMATIVE_OBJECTS {
        return None;
    }
    let middle = quantile(&mut values, 0.5)?;
    let mut deviations: Vec<f64> = values.iter().map(|x| (x - middle).abs()).collect();
    Some((middle, (1.4826 * quantile(&mut deviations, 0.5)?).max(least_sd)))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::super::options::AssociateOptions;
    use super::super::score::fit::{Start, fit};
    use super::super::test_scenes::{ellipsoid, seen_by};
    use super::*;
    use crate::scene::Scene;

    /// The doubt about the last of some objects: all but this one are alike, up to the noise of sizes and shapes.
    fn doubt_about(count: usize, change: impl Fn(&mut Object)) -> Option<AssociationWarning> {
        let (observations, mut statistics) = seen_by(10, &ellipsoid());
        statistics.volume = 1e5;
        let start = Start::sphere(ellipsoid().center.coords - observations.origin, 2.0);
        let object = fit(&observations, &statistics, (0..10).collect(), &[start]).unwrap();
        let object = Object { visible: 10, ..object };
        let mut objects = vec![object; count];
        for (index, object) in objects.iter_mut().enumerate() {
            // Sizes differ by 5 %, aspects by 10 %.
            let wave = (2.0 * index as f64).sin();
            stretched(object, 1.0 + 0.05 * wave, 1.0 + 0.1 * wave);
        }
        let last = objects.last_mut().unwrap();
        stretched(last, 1.0 / (last.radius / objects_radius(&observations, &statistics)), 1.0);
        change(last);
        let options = AssociateOptions::default();
        let context = AssociationContext::new(&Scene::default(), &observations, &options);
        let all = doubts(&context, &State { observations: observations.clone(), statistics, objects });
        assert!(all[..count - 1].iter().all(Option::is_none), "{all:?}");
        all[count - 1]
    }

    /// Radius of the unchanged object.
    fn objects_radius(
        observations: &super::super::input::observations::Observations,
        statistics: &super::super::score::scene_statistics::SceneStatistics,
    ) -> f64 {
        let start = Start::sphere(ellipsoid().center.coords - observations.origin, 2.0);
        fit(observations, statistics, (0..10).collect(), &[start]).unwrap().radius
    }

    /// Makes a body larger, and its longest axis longer against the others at the same volume.
    fn stretched(object: &mut Object, size: f64, aspect: f64) {
        let axes: [f64; 3] = std::array::from_fn(|i| object.root.column(i).norm());
        let longest = Vector3::from(axes).imax();
        let mut factors = Vector3::repeat(size * aspect.powf(-1.0 / 3.0));
        factors[longest] *= aspect;
        object.root *= Matrix3::from_diagonal(&factors);
        object.radius *= size;
    }

    #[test]
    fn an_object_is_uncertain_for_its_length_its_size_or_its_evidence() {
        assert_eq!(doubt_about(8, |_| ()), None);
        assert_eq!(doubt_about(8, |o| stretched(o, 1.0, 4.0)), Some(AssociationWarning::Elongated));
        assert_eq!(doubt_about(8, |o| stretched(o, 1.8, 1.0)), Some(AssociationWarning::UnusualSize));
        assert_eq!(doubt_about(8, |o| stretched(o, 0.5, 1.0)), Some(AssociationWarning::UnusualSize));
        assert_eq!(doubt_about(8, |o| o.cost += 75.0), Some(AssociationWarning::WeakEvidence));
        // Round, and better explained than others, is not odd.
        assert_eq!(doubt_about(8, |o| stretched(o, 1.0, 0.5)), None);
        assert_eq!(doubt_about(8, |o| o.cost -= 1500.0), None);
        let larger_and_rounder = |o: &mut Object| stretched(o, 1.4, 0.6);
        assert_eq!(doubt_about(8, larger_and_rounder), None);
    }

    #[test]
    fn several_small_deviations_count_together() {
        let longer = |o: &mut Object| stretched(o, 1.0, 2.0);
        let larger = |o: &mut Object| stretched(o, 1.3, 1.0);
        assert_eq!((doubt_about(8, longer), doubt_about(8, larger)), (None, None));
        let both = |o: &mut Object| {
            longer(o);
            larger(o);
        };
        assert!(doubt_about(8, both).is_some());
    }

    #[test]
    fn where_few_objects_tell_what_is_usual_only_a_very_long_body_is_odd() {
        assert_eq!(doubt_about(3, |o| stretched(o, 1.0, 3.0)), None);
        assert_eq!(doubt_about(3, |o| stretched(o, 1.8, 1.0)), None);
        assert_eq!(doubt_about(3, |o| stretched(o, 1.0, 6.0)), Some(AssociationWarning::Elongated));
    }
}
