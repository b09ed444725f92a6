//! Scales of the sources of cues: the scale of their depths and distances, the bias of their sizes, each a constant that
//! is added to logarithms, and the shift of depths (docs/method.md, section 19.3).
//!
//! The constants are unknowns shared by the objects; depths of a network that is right up to a scale in each image have one in each
//! frame. A step of Gauss and Newton eliminates the objects (Schur complement), so
//! that what boxes tell of an object counts as much as it is certain.

use crate::optimize::median::median;
use std::collections::BTreeMap;

use nalgebra::SVector;

use super::scale_system::{ScaleCovariance, ScaleSystem, Told};
use crate::optimize::normal_equations::PARAMETERS;
use crate::scene::{Cues, DepthScale, ObjectViews};
use crate::solve::estimate::Matrix9;
use crate::tuning::{DEPTH_SCALE_SD, DEPTH_SHIFT_SD, EXTENT_BIAS_SD, FRAME_SCALE_SD, SIZE_BIAS_SD};

/// Number of measurements from which a median is taken.
const ENOUGH_FOR_MEDIAN: usize = 5;

/// Largest change of a logarithm in one step.
const MAX_STEP: f64 = 0.3;

/// A constant of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Constant {
    /// Scale of depths, at the source's reference depth.
    Depth(Option<u32>),
    /// Shift of depths: with the reference depth D, the logarithm of 1 + shift / D, in lengths of the world.
    DepthShift(Option<u32>),
    /// Scale of the depths of one frame, beside that of the source.
    DepthOfFrame(Option<u32>, usize),
    /// Scale of distances of 3D boxes.
    Distance(Option<u32>),
    /// Scale of all extents of 3D boxes, of a category.
    Sizes(Option<u32>, Option<usize>),
    /// Scale of an extent (0 to 2) of 3D boxes, of a category, beside that of all.
    Size(Option<u32>, Option<usize>, usize),
}

impl Constant {
    /// Standard deviation before anything is known.
    fn prior_sd(self) -> f64 {
        match self {
            Self::Depth(_) | Self::Distance(_) => DEPTH_SCALE_SD.get(),
            Self::DepthShift(_) => DEPTH_SHIFT_SD.get(),
            Self::DepthOfFrame(..) => FRAME_SCALE_SD.get(),
            Self::Sizes(..) => SIZE_BIAS_SD.get(),
            Self::Size(..) => EXTENT_BIAS_SD.get(),
        }
    }

    /// The constant of all frames or extents that is added to that of one.
    pub(crate) fn of_all(self) -> Option<Self> {
        match self {
            Self::DepthOfFrame(source, _) => Some(Self::Depth(source)),
            Self::Size(source, category, _) => Some(Self::Sizes(source, category)),
            _ => None,
        }
    }
}

/// What an object says about one constant: sums over the whitened residuals that contain it.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    /// Weighted squares of the derivative by the constant.
    pub information: f64,
    /// The derivative times the residual.
    pub gradient: f64,
    /// The derivative times the derivatives by the object's parameters.
    pub coupling: SVector<f64, PARAMETERS>,
    /// The derivative times that by a constant of the source that the same residuals contain.
    pub with: Vec<(Constant, f64)>,
}

impl Default for Term {
    fn default() -> Self {
        Self { information: 0.0, gradient: 0.0, coupling: SVector::zeros(), with: Vec::new() }
    }
}

/// What an object says about the constants that its cues contain.
#[derive(Debug, Clone)]
pub(crate) struct ObjectTerms {
    pub terms: BTreeMap<Constant, Term>,
    /// Covariance of its parameters were the constants known.
    pub covariance: Matrix9,
    /// The step that its parameters are still from their minimum.
    pub step: SVector<f64, PARAMETERS>,
    /// Its cost.
    pub cost: f64,
}

/// Measured against predicted lengths, to start from.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ratios {
    /// Logarithms of measured over predicted lengths.
    pub logs: BTreeMap<Constant, Vec<f64>>,
    /// Predicted depths of each source, world units.
    pub depths: BTreeMap<Option<u32>, Vec<f64>>,
}

/// The constants of all sources with their covariance.
#[derive(Debug, Clone, Default)]
pub(crate) struct CueScales {
    values: BTreeMap<Constant, f64>,
    /// For each source of depths whose shift is estimated, the depth whose measurement a change of the shift leaves as it is.
    references: BTreeMap<Option<u32>, f64>,
    /// In the order of the constants; empty before the first step.
    covariance: ScaleCovariance,
}

impl CueScales {
    /// The medians of logarithms of measured over predicted lengths, of constants with enough of them: a start that a wrong
    /// unit does not mislead. Sources with enough depths have a shift, which starts at 0.
    pub(crate) fn of_medians(Ratios { logs, depths }: Ratios) -> Self {
        let of_many = |mut all: Vec<f64>| {
            all.retain(|x| x.is_finite());
            if all.len() < ENOUGH_FOR_MEDIAN { None } else { median(&mut all) }
        };
        let medians: BTreeMap<_, _> = logs.into_iter().map(|(constant, all)| (constant, of_many(all))).collect();
        let start = |(constant, median): (&Constant, &Option<f64>)| {
            let of_all = constant.of_all().and_then(|all| *medians.get(&all)?).unwrap_or(0.0);
            (*constant, median.map_or(0.0, |median| median - of_all))
        };
        Self {
            values: medians.iter().map(start).collect(),
            references: depths.into_iter().filter_map(|(source, all)| Some((source, of_many(all)?))).collect(),
            covariance: ScaleCovariance::default(),
        }
    }

    /// The depth whose measurement a change of the shift of a source leaves as it is; `None` where no shift is estimated.
    pub(crate) fn reference(&self, source: Option<u32>) -> Option<f64> {
        self.references.get(&source).copied()
    }

    /// The constants.
    pub(super) fn constants(&self) -> impl Iterator<Item = Constant> {
        self.values.keys().copied()
    }

    /// The value of a constant; 0 for one that is not estimated.
    pub(crate) fn value(&self, constant: Constant) -> f64 {
        self.values.get(&constant).copied().unwrap_or(0.0)
    }

    /// The covariance of two constants; 0 before there is one.
    pub(super) fn covariance_of(&self, a: Constant, b: Constant) -> f64 {
        let position = |constant: Constant| self.values.keys().position(|key| *key == constant);
        position(a).zip(position(b)).map_or(0.0, |(k, l)| self.covariance.entry(k, l))
    }

    /// A step, from all objects: the change of the constants, if the objects follow ([`Self::step_of`]). The covariance is updated.
    pub(crate) fn step<'a>(&mut self, objects: impl Iterator<Item = &'a ObjectTerms> + Clone) -> Option<Self> {
        for object in objects.clone() {
            object.terms.keys().for_each(|constant| _ = self.values.entry(*constant).or_insert(0.0));
        }
        let index: BTreeMap<Constant, usize> = self.values.keys().enumerate().map(|(k, c)| (*c, k)).collect();
        let of_frames = self.values.keys().map(|constant| matches!(constant, Constant::DepthOfFrame(..))).collect();
        let mut system = ScaleSystem::new(of_frames);
        for (k, constant) in self.constants().enumerate() {
            system.add_prior(k, self.prior_precision(constant), self.prior_gradient(constant));
        }
        for ObjectTerms { terms, covariance, step, .. } in objects {
            let told = terms.iter().map(|(constant, term)| Told {
                index: index[constant],
                information: term.information,
                gradient: term.gradient + term.coupling.dot(step),
                coupling: term.coupling,
                with: term.with.iter().map(|(other, information)| (index[other], *information)).collect(),
            });
            system.add_object(told.collect(), *covariance);
        }
        let (step, covariance) = system.solve()?;
        self.covariance = covariance;
        // As a whole, so that it stays a descent.
        let factor = (MAX_STEP / step.amax()).min(1.0);
        let values = self.values.keys().zip(step.iter()).map(|(constant, step)| (*constant, -step * factor)).collect();
        Some(Self { values, references: self.references.clone(), covariance: ScaleCovariance::default() })
    }

    /// Weight of the prior. Factors are usually about 1, but a source may have any: its tails are heavy.
    fn prior_precision(&self, constant: Constant) -> f64 {
        1.0 / (constant.prior_sd().powi(2) + self.value(constant).powi(2))
    }

    /// Half the derivative of [`Self::cost`].
    pub(crate) fn prior_gradient(&self, constant: Constant) -> f64 {
        self.prior_precision(constant) * self.value(constant)
    }

    /// The constants after a change of them.
    pub(crate) fn changed(&self, change: &Self) -> Self {
        let mut changed = self.clone();
        change.values.iter().for_each(|(constant, step)| *changed.values.entry(*constant).or_insert(0.0) += step);
        changed
    }

    /// A share of a change.
    pub(crate) fn part(&self, share: f64) -> Self {
        let values = self.values.iter().map(|(constant, value)| (*constant, value * share)).collect();
        Self { values, ..self.clone() }
    }

    /// Twice the negative log prior of the constants, up to a constant.
    pub(crate) fn cost(&self) -> f64 {
        self.values.iter().map(|(constant, value)| (value / constant.prior_sd()).powi(2).ln_1p()).sum()
    }

    /// The step of an object's parameters that follows from this change of the constants, of which the object's own step towards its
    /// minimum is this share.
    pub(crate) fn step_of(&self, object: &ObjectTerms, share: f64) -> SVector<f64, PARAMETERS> {
        let changed = |(constant, term): (&Constant, &Term)| Some(term.coupling * *self.values.get(constant)?);
        let pull = object.terms.iter().filter_map(changed).fold(SVector::zeros(), |sum, pull| sum + pull);
        object.step * share - object.covariance * pull
    }

    /// What the uncertainty of the constants adds to the covariance of an object.
    pub(crate) fn added_covariance(&self, ObjectTerms { terms, covariance, .. }: &ObjectTerms) -> Matrix9 {
        let index: BTreeMap<Constant, usize> = self.values.keys().enumerate().map(|(k, c)| (*c, k)).collect();
        let gains: Vec<(usize, SVector<f64, PARAMETERS>)> = terms
            .iter()
            .filter_map(|(constant, term)| Some((*index.get(constant)?, covariance * term.coupling)))
            .collect();
        self.covariance.between(&gains)
    }

    /// Takes the constants out of the measurements of an object.
    pub(crate) fn apply(&self, views: &mut ObjectViews) {
        if self.values.is_empty() {
            return;
        }
        let category = views.category_index;
        let factor = |constant: Constant| self.values.get(&constant).map_or(1.0, |value| (-value).exp());
        for view in &mut views.views {
            let (frame, scale, shift) = (view.frame_index, view.depth_scale, &mut view.depth_shift);
            let Cues { depth, box3d } = &mut view.cues;
            if let Some(depth) = depth.as_mut().filter(|_| scale != DepthScale::Known) {
                let mut factor_of_depth = factor(Constant::Depth(depth.source));
                if scale == DepthScale::Frame {
                    factor_of_depth *= factor(Constant::DepthOfFrame(depth.source, frame));
                }
                if let Some(reference) = self.reference(depth.source) {
                    // Changes of the logarithm of 1 + shift / reference add up; measurements of the reference stay as they are.
                    let change = 1.0 / factor(Constant::DepthShift(depth.source));
                    *shift = (*shift + reference) * change - reference;
                    factor_of_depth *= change;
                }
                depth.median *= factor_of_depth;
                depth.sd = depth.sd.map(|sd| sd * factor_of_depth);
            }
            let Some(box3d) = box3d else { continue };
            if let Some(center) = &mut box3d.center {
                *center *= factor(Constant::Distance(box3d.source));
            }
            if let Some(half_extents) = &mut box3d.half_extents {
                let of_all = factor(Constant::Sizes(box3d.source, category));
                (0..3).for_each(|k| half_extents[k] *= of_all * factor(Constant::Size(box3d.source, category, k)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Objects that say by so much that the constant is larger, as certain as `information`, each with one parameter that takes
    /// a share of it.
    fn objects(count: usize, information: f64, error: f64, share: f64) -> Vec<ObjectTerms> {
        let mut coupling = SVector::zeros();
        coupling[0] = (information * share).sqrt();
        let term = Term { information, gradient: -information * (1.0 - share) * error, coupling, ..Default::default() };
        let terms = BTreeMap::from([(Constant::Depth(None), term)]);
        vec![ObjectTerms { terms, covariance: Matrix9::identity(), step: SVector::zeros(), cost: 0.0 }; count]
    }

    #[test]
    fn many_objects_tell_the_scale_and_a_few_uncertain_ones_do_not() {
        let value = |objects: &[ObjectTerms]| {
            let mut scales = CueScales::default();
            let step = scales.step(objects.iter()).unwrap();
            scales = scales.changed(&step);
            let found = scales.found().next().unwrap();
            (found.log_factor, found.log_sd)
        };
        let (many, sd) = value(&objects(100, 100.0, 0.2, 0.5));
        assert!((many - 0.2).abs() < 0.02 && sd < 0.02, "{many} {sd}");
        let (few, sd) = value(&objects(1, 100.0, 0.2, 0.999));
        assert!(few.abs() < 1e-3 && sd > 0.05, "{few} {sd}");
        // The parameters of the object that take most of it make the scale less certain.
        assert!(value(&objects(10, 100.0, 0.2, 0.9)).1 > 2.0 * value(&objects(10, 100.0, 0.2, 0.1)).1);
    }

    #[test]
    fn extents_share_a_bias() {
        // Three extents of one source and category that are all too large by the same: what they share takes most of it.
        let category = Some(0);
        let with = vec![(Constant::Sizes(None, category), 50.0)];
        let term = |gradient: f64| Term {
            information: 50.0,
            gradient: -50.0 * gradient,
            with: with.clone(),
            ..Default::default()
        };
        let all = Term { information: 150.0, gradient: -150.0 * 0.1, ..Default::default() };
        let mut terms: BTreeMap<Constant, Term> =
            (0..3).map(|axis| (Constant::Size(None, category, axis), term(0.1))).collect();
        terms.insert(Constant::Sizes(None, category), all);
        let object = ObjectTerms { terms, covariance: Matrix9::identity(), step: SVector::zeros(), cost: 0.0 };
        let mut scales = CueScales::default();
        let step = scales.step(std::iter::once(&object)).unwrap();
        scales = scales.changed(&step);
        let found: BTreeMap<Constant, f64> = scales.found().map(|found| (found.constant, found.log_factor)).collect();
        let shared = found[&Constant::Sizes(None, category)];
        for axis in 0..3 {
            let total = found[&Constant::Size(None, category, axis)];
            assert!((0.07..0.1).contains(&total) && (0.75..1.0).contains(&(shared / total)), "{total} {shared}");
        }
        // Reported are the extents.
        assert_eq!(scales.found().filter_map(|found| found.report()).count(), 3);
    }

    #[test]
    fn long_steps_are_shortened_as_a_whole() {
        // Two sources whose lengths are too long by these logarithms.
        let steps = |errors: [f64; 2]| {
            let constants = [Constant::Depth(None), Constant::Distance(None)];
            let term = |error: f64| Term { information: 50.0, gradient: -50.0 * error, ..Default::default() };
            let terms = constants.into_iter().zip(errors.map(term)).collect();
            let object = ObjectTerms { terms, covariance: Matrix9::identity(), step: SVector::zeros(), cost: 0.0 };
            let step = CueScales::default().step(std::iter::once(&object)).unwrap();
            constants.map(|constant| step.value(constant))
        };
        let share = 50.0 / (50.0 + DEPTH_SCALE_SD.get().powi(-2));
        for (errors, expected) in
            [([0.2, -0.1], [0.2 * share, -0.1 * share]), ([2.0, 0.5], [0.3, 0.075]), ([-0.5, 1.0], [-0.15, 0.3])]
        {
            let found = steps(errors);
            assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-9), "{found:?} {expected:?}");
        }
    }

    #[test]
    fn a_median_is_a_start_and_an_unsure_scale_makes_objects_unsure() {
        let ratios = BTreeMap::from([
            (Constant::Depth(Some(1)), vec![6.9, 7.0, 6.8, f64::NAN, -3.0, 6.9, 7.1]),
            (Constant::Distance(None), vec![1.0]),
        ]);
        let mut scales = CueScales::of_medians(Ratios { logs: ratios, ..Default::default() });
        assert_eq!(scales.found().map(|found| found.log_factor).collect::<Vec<_>>(), [6.9, 0.0]);
        let few = objects(1, 1.0, 0.0, 0.9);
        scales.step(few.iter()).unwrap();
        let added = scales.added_covariance(&few[0])[(0, 0)];
        assert!(added > 0.0, "{added}");
    }
}
