//! Checks the unit of length against priors on sizes; boxes and poses alone do not determine it.

use super::cause::Cause;
use super::correction::Correction;
use super::misses::size;
use super::sample::Sample;
use super::verdict::Diagnosis;
use crate::optimize::median::median;
use crate::scene::{Detection, Scene};
use crate::solve::CategoryPriors;

/// Minimum number of objects with a prior.
const MIN_OBJECTS: usize = 3;

/// Sizes that differ by this factor from the prior are in another unit: no prior is that inaccurate.
const OTHER_UNIT: f64 = 2.5;

/// The factor must be significant: this many times the median deviation of the objects from it, in its logarithm.
const CLEAR: f64 = 3.0;

/// The factor by which the lengths of a scene have to be multiplied to match the size priors of its categories, if they
/// clearly disagree.
pub(crate) fn wrong_lengths(
    scene: &Scene,
    is_used: impl Fn(&Detection) -> bool,
    priors: &CategoryPriors,
) -> Option<Correction> {
    // The mean half extent of the category of each object, from the first detection that has one.
    let mut known = vec![None; scene.object_ids.len()];
    for detection in scene.detections.iter().filter(|d| is_used(d)) {
        let (Some(object), Some(category)) = (detection.object_index, detection.category_index) else { continue };
        let size = priors.of(&scene.categories[category as usize]).and_then(|prior| prior.size);
        let half_extent = size.map(|size| 0.5 * size.mean.iter().product::<f64>().cbrt());
        known[object as usize] = known[object as usize].or(half_extent);
    }
    if known.iter().flatten().count() < MIN_OBJECTS {
        return None;
    }
    let has_prior = |d: &Detection| is_used(d) && d.object_index.is_some_and(|object| known[object as usize].is_some());
    let sample = Sample::new(scene, has_prior);
    let factors = sample
        .objects
        .iter()
        .zip(&sample.object_indices)
        .filter_map(|(boxes, &object)| Some((known[object]? / size(&sample, boxes)?).ln()));
    let mut factors: Vec<f64> = factors.filter(|factor| factor.is_finite()).collect();
    if factors.len() < MIN_OBJECTS {
        return None;
    }
    let middle = median(&mut factors)?;
    let mut distances: Vec<f64> = factors.iter().map(|factor| (factor - middle).abs()).collect();
    let is_wrong = middle.abs() > OTHER_UNIT.ln().max(CLEAR * median(&mut distances)?);
    is_wrong.then(|| Correction::Lengths(middle.exp()))
}

impl Diagnosis {
    /// Compares the lengths of a scene with size priors of its categories, full extents in world units: a scene in
    /// millimeters contradicts priors in meters. Does nothing if they agree, if too few objects have a prior, or if the
    /// scene is inconsistent anyway.
    pub(crate) fn check_lengths(
        &mut self,
        scene: &Scene,
        is_used: impl Fn(&Detection) -> bool,
        priors: &CategoryPriors,
    ) {
        let Some(agreement) = self.agreement.filter(|_| self.consistent && !priors.by_category.is_empty()) else {
            return;
        };
        let Some(correction) = wrong_lengths(scene, is_used, priors) else { return };
        self.consistent = false;
        self.causes.insert(0, Cause::new(correction, agreement, agreement));
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CauseName, diagnose};
    use super::*;
    use crate::solve::{CategoryPrior, SizePrior};
    use crate::synthetic::{SyntheticOptions, Trajectory, generate};

    #[test]
    fn millimeters_do_not_agree_with_priors_in_meters() {
        let options = SyntheticOptions { objects: 8, views: 8, trajectory: Trajectory::Orbit, ..Default::default() };
        let synthetic = generate(&options).unwrap();
        let mut scene = synthetic.scene;
        scene.0.categories = vec!["thing".to_owned()];
        scene.0.detections.iter_mut().for_each(|d| d.category_index = Some(0));
        let extents: Vec<f64> = (synthetic.truth.iter())
            .map(|(_, body)| 2.0 * body.closest_ellipsoid().semi_axes.product().cbrt())
            .collect();
        let mean = extents.iter().sum::<f64>() / extents.len() as f64;
        let size = Some(SizePrior { mean: [mean; 3], sd: [0.3 * mean; 3] });
        let mut priors = CategoryPriors::default();
        priors.by_category.insert("thing".to_owned(), CategoryPrior { size, ..Default::default() });
        let check = |scene: &Scene| {
            let mut diagnosis = diagnose(scene, |_| true);
            diagnosis.check_lengths(scene, |_| true, &priors);
            diagnosis
        };
        assert!(check(&scene).consistent);
        for factor in [1000.0, 0.2] {
            let diagnosis = check(&Correction::Lengths(factor).apply(&scene));
            assert!(!diagnosis.consistent);
            assert_eq!(diagnosis.causes[0].name, CauseName::LengthUnit);
            let found = diagnosis.causes[0].value.unwrap() * factor;
            assert!((0.6..1.7).contains(&found), "{found}");
        }
    }
}
