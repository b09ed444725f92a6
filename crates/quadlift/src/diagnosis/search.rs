//! Searches for the mistake that explains a scene whose objects are known.

use super::agreement::Improvement;
use super::correction::Correction;
use super::hypotheses::{FAMILIES, Family, discrete};
use super::misses::{ReprojectionErrors, misses};
use super::sample::Sample;
use crate::parallel::map_indices;
use crate::sorting::StableSort;

/// Steps of the golden-section search of a family; the last interval is 2 % of the first.
const NARROWING: usize = 8;

/// Share of the way in a section (golden).
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// Agreement after a correction within this factor of the best one's (the logarithm of misses) is equally good: the
/// first such correction in the list is reported.
const AS_GOOD: f64 = 0.03;

/// A correction with its effect.
#[derive(Debug, Clone)]
pub(crate) struct Explanation {
    pub correction: Correction,
    pub gain: Improvement,
}

/// The agreement of a sample as it is, and corrections that improve it, the best first.
#[derive(Debug, Clone)]
pub(crate) struct Search {
    /// The sample as it is.
    pub given: ReprojectionErrors,
    pub explanations: Vec<Explanation>,
}

/// Tries all corrections; `None` if the sample is empty.
pub(crate) fn search(sample: &Sample) -> Option<Search> {
    let given = misses(sample, None, None)?;
    let discrete = discrete(&sample.frame_ids);
    let image_size = sample.frames.iter().find_map(|frame| frame.image_size);
    let try_one = |correction: Correction| {
        let after = misses(sample, Some(correction), Some(&given))?;
        let mut gain = given.gain_of(&after);
        // Errors of the poses are angles: enlarging the boxes makes them relatively smaller, which explains nothing.
        gain.gain -= correction.angular_growth(image_size).ln().max(0.0);
        Some(Explanation { correction, gain })
    };
    let mut found: Vec<Explanation> =
        map_indices(discrete.len(), |k| try_one(discrete[k])).into_iter().flatten().collect();
    let narrowed = map_indices(FAMILIES.len(), |k| narrowed(&FAMILIES[k], &try_one));
    found.extend(narrowed.into_iter().flatten());
    found.retain(|e| e.gain.gain > 0.0);
    // The first of those that are equally good as the best.
    let best = found.iter().map(|e| e.gain.gain).fold(0.0, f64::max);
    found.stable_sort_by(|a, b| {
        let close = |e: &Explanation| e.gain.gain >= best - AS_GOOD;
        close(b).cmp(&close(a)).then(if close(a) && close(b) {
            std::cmp::Ordering::Equal
        } else {
            b.gain.gain.total_cmp(&a.gain.gain)
        })
    });
    Some(Search { given, explanations: found })
}

/// The best correction of a family, if one of its grid improves the agreement, refined by golden-section search.
fn narrowed(family: &Family, try_one: &impl Fn(Correction) -> Option<Explanation>) -> Option<Explanation> {
    let try_value = |value: f64| try_one((family.make)(value));
    let gain = |e: &Option<Explanation>| e.as_ref().map_or(f64::NEG_INFINITY, |e| e.gain.gain);
    let tried: Vec<Option<Explanation>> = family.grid.iter().map(|&value| try_value(value)).collect();
    let best = (0..tried.len()).max_by(|&a, &b| gain(&tried[a]).total_cmp(&gain(&tried[b])))?;
    let mut best_found = tried[best].clone().filter(|found| found.gain.gain > 0.0)?;
    let mut low = family.grid[best.saturating_sub(1)];
    let mut high = family.grid[(best + 1).min(family.grid.len() - 1)];
    for _ in 0..NARROWING {
        let [left, right] = [GOLDEN, 1.0 - GOLDEN].map(|share| family.between(low, high, share));
        let [at_left, at_right] = [left, right].map(try_value);
        if gain(&at_left) > gain(&at_right) {
            high = right
        } else {
            low = left
        }
        for found in [at_left, at_right].into_iter().flatten() {
            if found.gain.gain > best_found.gain.gain {
                best_found = found;
            }
        }
    }
    Some(best_found)
}
