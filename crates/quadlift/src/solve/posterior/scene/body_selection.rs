//! Objects of unknown kind: which kind of body each is, from what its boxes fit best and what the other objects are (docs/method.md,
//! section 9).
//!
//! One object seldom determines its kind ([`super::body_evidence`]). How often each kind occurs is therefore estimated from all objects, in each
//! category from those of the category as well, and an object takes the kind that is most probable given both. Where all
//! objects are of one kind they agree on it; where they are not, each goes its own way as far as its views tell.

use std::collections::BTreeMap;

use super::body_evidence::{BodyEvidence, CUBOID, CYLINDER, ELLIPSOID, EXPONENTS, KINDS, kind_of};
use crate::geometry::BodyKind;
use crate::optimize::chi_square::per_dof;
use crate::parallel::map_indices;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::object::agreement::weighted_median;
use crate::solve::posterior::object::fit::Fit;

/// How often objects are none of the kinds but ellipsoids, before anything is known: the share of the others together.
const OTHERS: f64 = 0.01;

/// Weight of what is known beforehand, and of what is known of the scene against the category, in objects.
const WEIGHT_OF_PRIOR: f64 = 1.0;

/// Kinds that are at least this share as probable as the most probable one count as equally probable: the roundest of them is taken.
/// With 1 (`quadlift-bench kinds`) IoU is .002 larger on average, but of exact objects in three views, some of them with a false box, 6
/// instead of 4 % are inconsistent.
const MIN_PROBABILITY_RATIO: f64 = 0.5;

/// Rounds in which shares and probabilities are adjusted to each other.
const ROUNDS: usize = 50;

/// The kinds of bodies of a scene's objects.
#[derive(Debug, Clone)]
pub(crate) struct BodyKinds {
    of_each: Vec<BodyKind>,
    /// What the kind of another object is found from, with the noise; `None` where it is given, or nothing can be told.
    found: Option<(NoiseLevels, Pooled)>,
}

impl BodyKinds {
    /// So many objects of one kind.
    pub(crate) fn given(kind: BodyKind, count: usize) -> Self {
        Self { of_each: vec![kind; count.max(1)], found: None }
    }

    /// The kind of each object, where each was fitted as one of its `first` kind.
    ///
    /// `noise` takes the views as independent: a body of the wrong kind errs alike in neighboring views, so that what looks
    /// like correlation is what is looked for.
    pub(crate) fn among(
        fits: &[Option<&Fit>],
        first: Vec<BodyKind>,
        noise: NoiseLevels,
        context: &PosteriorContext,
    ) -> Self {
        let first_kinds = Self { of_each: first, found: None };
        let told: Vec<(usize, &Fit)> = fits.iter().enumerate().filter_map(|(k, fit)| Some((k, (*fit)?))).collect();
        let evidence = map_indices(told.len(), |k| BodyEvidence::of(told[k].1, &noise, context));
        let (told, evidence): (Vec<_>, Vec<_>) =
            told.into_iter().zip(evidence).filter_map(|(told, evidence)| Some((told, evidence?))).unzip();
        let Some((pooled, probabilities)) = Pooled::among(&evidence) else { return first_kinds };
        let mut of_each = first_kinds.of_each;
        for ((object, _), probabilities) in told.iter().zip(&probabilities) {
            of_each[*object] = kind_of(most_probable(probabilities));
        }
        Self { of_each, found: Some((noise, pooled)) }
    }

    /// The kind of each object.
    pub(crate) fn of_each(&self) -> &[BodyKind] {
        &self.of_each
    }

    /// The kind that all objects are of, where they are of one.
    pub(crate) fn of_all(&self) -> Option<BodyKind> {
        let first = *self.of_each.first()?;
        self.of_each.iter().all(|kind| *kind == first).then_some(first)
    }

    /// The kind of another object of the scene, fitted as one of its first kind.
    pub(crate) fn of_other(&self, fit: &Fit, context: &PosteriorContext) -> BodyKind {
        let kind = fit.problem.kind;
        let Some((noise, pooled)) = &self.found else { return kind };
        let evidence = BodyEvidence::of(fit, noise, context);
        evidence.map_or(kind, |evidence| kind_of(most_probable(&pooled.of_another(&evidence))))
    }
}

/// A number for each kind.
type OfEach = [f64; KINDS];

/// Probabilities of the kinds before anything is known, of what the size is known: lengths, widths and heights are those of boxes.
const MOSTLY_CUBOIDS: fn(usize) -> f64 = |kind| match kind {
    CUBOID => 1.0 - OTHERS,
    _ => OTHERS / (KINDS - 1) as f64,
};
/// The same of everything else.
const MOSTLY_ELLIPSOIDS: fn(usize) -> f64 = |kind| match kind {
    ELLIPSOID => 1.0 - OTHERS,
    CUBOID | CYLINDER => OTHERS / 3.0,
    _ => OTHERS / 3.0 / EXPONENTS.len() as f64,
};

/// What the objects of a scene tell about the kinds together.
#[derive(Debug, Clone)]
struct Pooled {
    /// Expected numbers of objects of each kind: of all objects, and of each category.
    counts: OfEach,
    counts_of_category: BTreeMap<Option<usize>, OfEach>,
    /// Squared residual per degree of freedom of the median object.
    variance: f64,
}

impl Pooled {
    /// With the probabilities of the kinds of each object, given the others; `None` where the objects tell nothing.
    fn among(told: &[BodyEvidence]) -> Option<(Self, Vec<OfEach>)> {
        let best: Vec<_> = told.iter().map(BodyEvidence::best).collect();
        // The median: one object that no kind fits would drown the noise of the others.
        let told_by = best.iter().filter(|(_, _, dof)| *dof > 0.0);
        let mut variances: Vec<_> = told_by.map(|(_, variance, dof)| (variance / per_dof(*dof, 0.0), *dof)).collect();
        let variance = weighted_median(&mut variances)?;
        let (counts, counts_of_category) = ([0.0; KINDS], BTreeMap::new());
        let mut pooled = Self { counts, counts_of_category, variance };
        let log_odds: Vec<OfEach> = told.iter().map(|evidence| evidence.log_odds(variance)).collect();
        let mut probabilities: Vec<OfEach> = log_odds.iter().map(|odds| posterior(odds, &[1.0; KINDS])).collect();
        for (evidence, probabilities) in told.iter().zip(&probabilities) {
            pooled.count(evidence, probabilities, 1.0);
        }
        for _ in 0..ROUNDS {
            for (k, evidence) in told.iter().enumerate() {
                // By what the others are.
                pooled.count(evidence, &probabilities[k], -1.0);
                probabilities[k] = posterior(&log_odds[k], &pooled.shares(evidence));
                pooled.count(evidence, &probabilities[k], 1.0);
            }
        }
        Some((pooled, probabilities))
    }

    /// Objects of known size tell the kinds of their category alone.
    fn count(&mut self, evidence: &BodyEvidence, probabilities: &OfEach, sign: f64) {
        let of_category = self.counts_of_category.entry(evidence.category).or_insert([0.0; KINDS]);
        for k in 0..KINDS {
            of_category[k] += sign * probabilities[k];
            self.counts[k] += if evidence.sized { 0.0 } else { sign * probabilities[k] };
        }
    }

    /// How often each kind occurs among what is like this object.
    fn shares(&self, evidence: &BodyEvidence) -> OfEach {
        let pooled = |counts: &OfEach, prior: &OfEach| {
            let total = counts.iter().sum::<f64>().max(0.0) + WEIGHT_OF_PRIOR;
            std::array::from_fn(|k| (counts[k].max(0.0) + WEIGHT_OF_PRIOR * prior[k]) / total)
        };
        let scene = match evidence.sized {
            true => std::array::from_fn(MOSTLY_CUBOIDS),
            false => pooled(&self.counts, &std::array::from_fn(MOSTLY_ELLIPSOIDS)),
        };
        self.counts_of_category.get(&evidence.category).map_or(scene, |counts| pooled(counts, &scene))
    }

    /// Probabilities of the kinds of an object that was not counted.
    fn of_another(&self, evidence: &BodyEvidence) -> OfEach {
        posterior(&evidence.log_odds(self.variance), &self.shares(evidence))
    }
}

/// Probabilities from logarithms of odds and what is probable beforehand.
fn posterior(log_odds: &OfEach, prior: &OfEach) -> OfEach {
    let logs: OfEach = std::array::from_fn(|k| log_odds[k] + prior[k].ln());
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let odds = logs.map(|log| (log - largest).exp());
    let sum: f64 = odds.iter().sum();
    odds.map(|odds| odds / sum)
}

/// The most probable kind; of those that are about as probable the roundest.
fn most_probable(probabilities: &OfEach) -> usize {
    let best = (0..KINDS).rev().max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b])).unwrap_or(ELLIPSOID);
    let as_probable = |k: &usize| probabilities[*k] >= MIN_PROBABILITY_RATIO * probabilities[best];
    // A cylinder is no rounder than a cuboid, nor less round.
    if best == CYLINDER { best } else { (0..best).find(as_probable).unwrap_or(best) }
}

#[cfg(test)]
mod tests {
    use super::super::body_evidence::KindFit;
    use super::*;

    /// An object of a category with these costs of an ellipsoid and a cuboid, all else equal.
    fn object(category: usize, ellipsoid: f64, cuboid: f64) -> BodyEvidence {
        let fit = |cost: f64| Some(KindFit::of_views(vec![vec![cost / 40.0; 4]; 10], 10.0));
        let mut fits = std::array::from_fn(|_| None);
        fits[ELLIPSOID] = fit(ellipsoid);
        fits[CUBOID] = fit(cuboid);
        BodyEvidence { category: Some(category), sized: false, log_wrong: -3.0, heavy_tails: false, fits }
    }

    fn body_kinds(told: &[BodyEvidence]) -> Vec<BodyKind> {
        let (_, probabilities) = Pooled::among(told).unwrap();
        probabilities.iter().map(|probabilities| kind_of(most_probable(probabilities))).collect()
    }

    /// The odds of an object that is little better fitted by a cuboid are 2 to 1.
    #[test]
    fn an_object_that_tells_little_is_what_the_others_are() {
        let unclear = object(0, 30.0, 29.0);
        assert_eq!(body_kinds(std::slice::from_ref(&unclear)), [BodyKind::Ellipsoid]);
        let mut told = vec![object(0, 90.0, 30.0); 6];
        told.push(unclear);
        assert_eq!(body_kinds(&told), [BodyKind::Cuboid; 7]);
    }

    #[test]
    fn categories_have_kinds_of_their_own() {
        let mut told = vec![object(0, 90.0, 30.0); 6];
        told.extend(vec![object(1, 30.0, 90.0); 6]);
        told.extend([object(0, 30.0, 29.5), object(1, 29.5, 30.0)]);
        let found = body_kinds(&told);
        assert_eq!(found[..6], [BodyKind::Cuboid; 6]);
        assert_eq!(found[6..12], [BodyKind::Ellipsoid; 6]);
        assert_eq!(found[12..], [BodyKind::Cuboid, BodyKind::Ellipsoid]);
    }

    #[test]
    fn another_object_is_judged_like_those_that_were_counted() {
        let told = vec![object(0, 90.0, 30.0); 6];
        let (pooled, probabilities) = Pooled::among(&told).unwrap();
        let another = pooled.of_another(&told[0]);
        assert!((another[CUBOID] - probabilities[0][CUBOID]).abs() < 1e-3, "{another:?}");
        // Of the six that were counted and the one known beforehand.
        let share = pooled.shares(&told[0])[CUBOID];
        assert!((0.95..1.0).contains(&share), "{share}");
    }

    #[test]
    fn of_kinds_about_as_probable_the_roundest_is_taken() {
        let mut probabilities = [0.0; KINDS];
        (probabilities[CUBOID], probabilities[CUBOID - 1]) = (0.6, 0.4);
        assert_eq!(most_probable(&probabilities), CUBOID - 1);
        (probabilities[CUBOID], probabilities[CUBOID - 1]) = (0.7, 0.3);
        assert_eq!(most_probable(&probabilities), CUBOID);
        (probabilities[CYLINDER], probabilities[CUBOID], probabilities[CUBOID - 1]) = (0.5, 0.5, 0.0);
        assert_eq!(most_probable(&probabilities), CUBOID);
    }

    /// Noise of the scene counts as eight residuals, of 40 less nine parameters: (31 + 8) / 2 ln((90 + 8) / (30 + 8)).
    #[test]
    fn the_noise_of_an_object_is_integrated_out() {
        let odds = object(0, 90.0, 30.0).log_odds(1.0)[CUBOID];
        assert!((odds - 19.5 * (98.0_f64 / 38.0).ln()).abs() < 1e-2, "{odds}");
    }

    /// The probability of one object, and of two that know of each other, against the equations of the shares.
    #[test]
    fn probabilities_are_those_of_the_shares_of_the_others() {
        // Of a cuboid, a third of one in a hundred is known beforehand; what the shares count for is one object.
        let before = 0.01 / 3.0;
        for cuboid in [20.0, 24.0, 28.0] {
            let told = [object(0, 30.0, cuboid)];
            let (pooled, one) = Pooled::among(&told).unwrap();
            let odds = told[0].log_odds(pooled.variance)[CUBOID].exp();
            let expected = odds * before / (odds * before + 0.99);
            assert!((one[0][CUBOID] - expected).abs() < 1e-9, "{} {expected}", one[0][CUBOID]);
            let told = [object(0, 30.0, cuboid), object(0, 30.0, cuboid)];
            let (_, two) = Pooled::among(&told).unwrap();
            let mut expected = 1.0;
            for _ in 0..1000 {
                let share = |known: f64, prior: f64| (known + (known + prior) / 2.0) / 2.0;
                let cuboids = odds * share(expected, before);
                expected = cuboids / (cuboids + share(1.0 - expected, 0.99));
            }
            assert!((two[1][CUBOID] - expected).abs() < 1e-6, "{} {expected}", two[1][CUBOID]);
        }
    }

    /// Of two that tell as little, what the size of one is known of.
    #[test]
    fn what_the_size_is_known_of_is_a_cuboid_unless_its_boxes_say_otherwise() {
        let sized = |ellipsoid, cuboid| BodyEvidence { sized: true, ..object(1, ellipsoid, cuboid) };
        assert_eq!(body_kinds(&[object(0, 30.0, 30.0), sized(30.0, 30.0)]), [BodyKind::Ellipsoid, BodyKind::Cuboid]);
        assert_eq!(body_kinds(&[sized(30.0, 90.0)]), [BodyKind::Ellipsoid]);
        // Nor do they tell what others are.
        let mut told = vec![object(0, 30.0, 29.0)];
        told.extend(vec![sized(90.0, 30.0); 6]);
        assert_eq!(body_kinds(&told)[0], BodyKind::Ellipsoid);
    }
}
