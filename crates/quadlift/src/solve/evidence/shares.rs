//! How frequent families, upright objects and round corners are in a scene, and the choice among hypotheses by them.

use super::conditions::{Conditions, FIRST_CUBOID_SHARE};
use super::object::{HYPOTHESES, Hypothesis, Object};
use super::solid::Family;

/// Frequencies of the families before the scene has been looked at; they count as one object.
const FIRST_FAMILIES: [f64; 4] = [0.99, 0.01 / 3.0, 0.01 / 3.0, 0.01 / 3.0];

/// Upright objects before the scene has been looked at: one of two.
const UPRIGHT_OBJECTS: f64 = 1.0;
const PRIOR_OBJECTS: f64 = 2.0;

/// Rounds of expectation and maximization, and the change of a probability at which they end.
const MAX_ROUNDS: usize = 20;
const MIN_CHANGE: f64 = 1e-3;

/// A rounder family is chosen if it is at least this probable against the best.
const MIN_ROUNDER: f64 = 0.5;

/// Variance that the prior of the cuboid's share has in a scene of equally rounded bodies.
const MIN_SHARE_VARIANCE: f64 = 0.0016;

/// Logarithms of frequencies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shares {
    pub families: [f64; 4],
    /// Share of upright objects.
    pub upright: f64,
}

impl Shares {
    /// Before the scene has been looked at. Where the family is given all are equal.
    pub(super) fn first(family: Option<Family>) -> Self {
        let families = if family.is_some() { [0.0; 4] } else { FIRST_FAMILIES.map(f64::ln) };
        Self { families, upright: UPRIGHT_OBJECTS / PRIOR_OBJECTS }
    }

    /// Of the chosen hypotheses: with these as given shares the choice is the same, though an object counts among them.
    pub(super) fn of_chosen(objects: &[Object], family: Option<Family>) -> Self {
        let count = objects.len() as f64;
        let chosen = |is: &dyn Fn(Hypothesis) -> bool| {
            objects.iter().filter(|object| is(object.hypotheses.chosen)).count() as f64
        };
        let of = |k: usize| (chosen(&|h| h.family() == Family::ALL[k]) + FIRST_FAMILIES[k]) / (count + 1.0);
        let families = std::array::from_fn(|k| if family.is_some() { 0.0 } else { of(k).ln() });
        let upright = (chosen(&|h| h.is_upright()) + UPRIGHT_OBJECTS) / (count + PRIOR_OBJECTS);
        Self { families, upright }
    }

    /// Logarithms of the prior probabilities of an object's hypotheses.
    pub(super) fn log_priors(&self, upright_share: Option<f64>) -> [f64; HYPOTHESES] {
        log_priors(&self.families, upright_share.unwrap_or(self.upright))
    }
}

fn log_priors(families: &[f64; 4], upright: f64) -> [f64; HYPOTHESES] {
    std::array::from_fn(|h| {
        let h = Hypothesis(h);
        let share = if h.is_upright() { upright } else { 1.0 - upright };
        families[h.family() as usize] + share.max(1e-6).ln()
    })
}

/// Probabilities of the hypotheses of an object.
type Posterior = [f64; HYPOTHESES];

fn upright_part(posterior: &Posterior) -> f64 {
    posterior[Family::ALL.len()..].iter().sum()
}

fn family_part(posterior: &Posterior, family: usize) -> f64 {
    posterior[family] + posterior[family + Family::ALL.len()]
}

/// The posterior of an object's hypotheses under prior probabilities.
fn posterior(object: &Object, log_priors: &[f64; HYPOTHESES]) -> Posterior {
    let logs: [f64; HYPOTHESES] = std::array::from_fn(|h| match object.fit_of(Hypothesis(h)) {
        Some(_) => object.hypotheses.log_evidence[h] + log_priors[h],
        None => f64::NEG_INFINITY,
    });
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !most.is_finite() {
        return std::array::from_fn(|h| f64::from(Hypothesis(h) == object.hypotheses.chosen));
    }
    let odds = logs.map(|log| (log - most).exp());
    let sum: f64 = odds.iter().sum();
    odds.map(|x| x / sum)
}

/// Chooses a hypothesis for each object, by its evidence and the frequencies among the others (expectation and maximization); returns
/// the frequencies and sets the prior of the cuboid's share in `conditions`.
pub(super) fn choose(objects: &mut [Object], family: Option<Family>, conditions: &mut Conditions) -> Shares {
    let count = objects.len() as f64;
    let any_family = family.is_none();
    let first: Posterior = std::array::from_fn(|h| 0.5 * FIRST_FAMILIES[h % Family::ALL.len()]);
    let mut posteriors = vec![first; objects.len()];
    for round in 0..MAX_ROUNDS {
        let total = sum(&posteriors);
        let mut change = 0.0f64;
        for (object, own) in objects.iter().zip(&mut posteriors) {
            let families: [f64; 4] = std::array::from_fn(|k| {
                let others = family_part(&total, k) - family_part(own, k);
                if any_family { ((others + FIRST_FAMILIES[k]) / count).max(1e-12).ln() } else { 0.0 }
            });
            let others = upright_part(&total) - upright_part(own);
            let upright = object.upright_share.unwrap_or((others + UPRIGHT_OBJECTS) / (count + PRIOR_OBJECTS - 1.0));
            let new = posterior(object, &log_priors(&families, upright));
            change = (0..HYPOTHESES).map(|h| (new[h] - own[h]).abs()).fold(change, f64::max);
            *own = new;
        }
        if round > 1 && change < MIN_CHANGE {
            break;
        }
    }
    for (object, own) in objects.iter_mut().zip(&posteriors) {
        choose_one(object, own);
    }
    conditions.cuboid_share = cuboid_share(objects, &posteriors);
    let total = sum(&posteriors);
    let families = std::array::from_fn(|k| {
        if any_family { ((family_part(&total, k) + FIRST_FAMILIES[k]) / (count + 1.0)).ln() } else { 0.0 }
    });
    Shares { families, upright: (upright_part(&total) + UPRIGHT_OBJECTS) / (count + PRIOR_OBJECTS) }
}

fn sum(posteriors: &[Posterior]) -> Posterior {
    std::array::from_fn(|h| posteriors.iter().map(|own| own[h]).sum())
}

/// The family by the sum over upright and not, the rounder one of two that are nearly as probable.
fn choose_one(object: &mut Object, posterior: &Posterior) {
    let families: [f64; 4] = std::array::from_fn(|k| family_part(posterior, k));
    let best = (0..4).max_by(|&a, &b| families[a].total_cmp(&families[b])).unwrap_or(0);
    let is_round = |k: usize| Family::ALL[k] == Family::Ellipsoid || Family::ALL[k] == Family::Rounded;
    let rounder = (0..4).find(|&k| families[k] >= MIN_ROUNDER * families[best] && (k == best || is_round(k)));
    let family = rounder.unwrap_or(best);
    let upright = posterior[family + Family::ALL.len()] > posterior[family];
    let h = Hypothesis::of(Family::ALL[family], upright);
    if object.fit_of(h).is_some() {
        object.hypotheses.chosen = h;
    }
}

/// Mean and precision of the cuboid's share among rounded bodies, with one object of the first prior.
fn cuboid_share(objects: &[Object], posteriors: &[Posterior]) -> [f64; 2] {
    let [first_mean, first_precision] = FIRST_CUBOID_SHARE;
    let rounded: Vec<(f64, f64)> = (objects.iter().zip(posteriors))
        .flat_map(|(object, own)| {
            [false, true].into_iter().filter_map(|upright| {
                let h = Hypothesis::of(Family::Rounded, upright);
                Some((own[h.0], object.fit_of(h)?.body.cuboid_share))
            })
        })
        .collect();
    let count = 1.0 + rounded.iter().map(|(weight, _)| weight).sum::<f64>();
    let mean = (first_mean + rounded.iter().map(|(weight, share)| weight * share).sum::<f64>()) / count;
    let squares: f64 = rounded.iter().map(|(weight, share)| weight * (share - mean).powi(2)).sum();
    [mean, count / (1.0 / first_precision + squares + count * MIN_SHARE_VARIANCE)]
}
