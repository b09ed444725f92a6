//! The search for the mistake that explains a scene whose objects are known.

use super::agreement::{Agreement, Misses, misses};
use super::correction::Correction;
use super::hypotheses::{FAMILIES, Family, discrete};
use super::sample::Sample;
use crate::parallel::map_indices;

/// Steps in which the number of a family is narrowed down; the last interval is 2 % of the first.
const NARROWING: usize = 8;

/// Share of the way in a section (golden).
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// Agreement after a correction within this factor of the best one's (the logarithm of misses) is as good: the
/// correction that comes first in the list is named.
const AS_GOOD: f64 = 0.03;

/// A correction with what it does.
#[derive(Debug, Clone)]
pub(super) struct Explanation {
    pub correction: Correction,
    pub after: Agreement,
    /// Mean decrease of the logarithm of the boxes' misses.
    pub gain: f64,
    /// Its standard deviation, from the differences between objects.
    pub gain_sd: f64,
}

/// How well a sample agrees as it is, and corrections that make it agree better, the best ones first.
#[derive(Debug, Clone)]
pub(super) struct Search {
    pub before: Agreement,
    pub explanations: Vec<Explanation>,
}

/// Tries all corrections; `None` where there is nothing to look at.
pub(super) fn search(sample: &Sample) -> Option<Search> {
    let given = misses(sample, &[], f64::INFINITY)?;
    let ids: Vec<&str> = sample.frame_ids.iter().map(String::as_str).collect();
    // More than this and a correction is out of the question.
    let limit = given.mean_log() + 0.1;
    let discrete = discrete(&ids);
    let try_one = |correction: Correction| {
        let after = misses(sample, &[correction], limit)?;
        let (gain, gain_sd) = given.gain_of(&after);
        Some(Explanation { correction, after: after.agreement(), gain, gain_sd })
    };
    let mut found: Vec<Explanation> =
        map_indices(discrete.len(), |k| try_one(discrete[k])).into_iter().flatten().collect();
    let narrowed = map_indices(FAMILIES.len(), |k| narrowed(&FAMILIES[k], &try_one));
    found.extend(narrowed.into_iter().flatten());
    found.retain(|e| e.gain > 0.0);
    // The first of those that are as good as the best.
    let best = found.iter().map(|e| e.gain).fold(0.0, f64::max);
    found.sort_by(|a, b| {
        let close = |e: &Explanation| e.gain >= best - AS_GOOD;
        close(b).cmp(&close(a)).then(if close(a) && close(b) {
            std::cmp::Ordering::Equal
        } else {
            b.gain.total_cmp(&a.gain)
        })
    });
    Some(Search { before: given.agreement(), explanations: found })
}

/// The best correction of a family: from the best one of its grid, by golden sections.
fn narrowed(family: &Family, try_one: &impl Fn(Correction) -> Option<Explanation>) -> Option<Explanation> {
    let try_value = |value: f64| try_one((family.make)(value));
    let gain = |e: &Option<Explanation>| e.as_ref().map_or(f64::NEG_INFINITY, |e| e.gain);
    let tried: Vec<Option<Explanation>> = family.grid.iter().map(|&value| try_value(value)).collect();
    let best = (0..tried.len()).max_by(|&a, &b| gain(&tried[a]).total_cmp(&gain(&tried[b])))?;
    let mut best_found = tried[best].clone()?;
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
            if found.gain > best_found.gain {
                best_found = found;
            }
        }
    }
    Some(best_found)
}

impl Misses {
    /// Mean decrease of the logarithm of the boxes' misses from these to others, with its standard deviation from the
    /// differences between objects (as clusters: the boxes of an object err together).
    fn gain_of(&self, after: &Self) -> (f64, f64) {
        let total: f64 = self.objects.iter().map(|o| o.boxes as f64).sum();
        let gain = self.mean_log() - after.mean_log();
        let objects = self.objects.len() as f64;
        let squares: f64 = (self.objects.iter().zip(&after.objects))
            .map(|(a, b)| (a.sum_log - b.sum_log - gain * a.boxes as f64).powi(2))
            .sum();
        // One object tells nothing of the differences: as if each box were apart.
        let sd =
            if objects > 1.0 { (squares * objects / (objects - 1.0)).sqrt() / total } else { total.sqrt().recip() };
        (gain, sd)
    }
}
