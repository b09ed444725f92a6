//! The consistency check of images: whether a common mistake of their boxes or cameras explains them better (docs/method.md, section 20).
//!
//! A focal length or an image size that is wrong moves all boxes alike, and poses follow: an image alone looks nearly right, from a wrong
//! place.

use super::{LandmarkMap, LocateOptions, LocateStatus, Query, QueryBox, Relocalization};
use crate::diagnosis::{BoxFormat, Correction};
use crate::parallel::map_indices;

/// Images that are looked at, evenly spread: errors of this size are common to all.
const MAX_IMAGES: usize = 10;

/// Images with which all mistakes are tried, where something is wrong.
const FEW_IMAGES: usize = 4;

/// Factors that are tried in any case; steps of those that are tried where something is wrong, and their number each way, from 0.47 to 2.1.
const NEAR: f64 = 1.1;
const STEP: f64 = 1.21;
const STEPS: i32 = 4;

/// Usual factors between the sizes of images.
const SIZES: [f64; 6] = [0.5, 2.0 / 3.0, 0.75, 4.0 / 3.0, 1.5, 2.0];

/// Mistakes that poses hide where images have few boxes: they are tried then in any case, with few images.
const FREQUENT: [Correction; 3] =
    [Correction::ImageScale(0.5), Correction::ImageScale(2.0), Correction::Boxes(BoxFormat::SwappedAxes)];

/// Explained boxes of an image, below which its pose may hide a mistake.
const HIDING_BOXES: usize = 10;

/// Usual sides of letterboxed images, pixels.
const LETTERBOXES: [f64; 4] = [416.0, 512.0, 640.0, 1280.0];

/// Factors to the sides of the best one.
const FINER: [f64; 3] = [1.1, 1.05, 1.025];

/// Share of the images that are located where nothing is wrong; below it all mistakes are tried. A correction must locate as many.
const USUAL_SHARE: f64 = 0.75;

/// Share of the boxes that are explained where nothing is wrong; below it all mistakes are tried. A correction must explain as many.
const USUAL_MATCHES: f64 = 0.6;

/// Logarithm of the evidence of independent images by which a correction must be better, and the share of the evidence.
const CLEARLY: f64 = 10.0;
const CLEAR_SHARE: f64 = 0.1;

/// Share of that by which a step towards a correction is better where all are tried.
const SUSPICIOUS: f64 = 0.25;

/// An image as it was located.
#[derive(Debug, Clone)]
pub struct LocatedImage<'a> {
    /// The camera and the boxes.
    pub query: &'a Query,
    /// The options with which it was located.
    pub options: LocateOptions,
    /// What [`LandmarkMap::relocalize`] found.
    pub located: &'a Relocalization,
}

/// A mistake that explains all images clearly better once it is corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonMistake {
    /// What corrects it: [`Correction::FocalFactor`], [`Correction::ImageScale`], a letterbox or another format of boxes.
    pub correction: Correction,
    /// Sum of the evidence of the sampled images as they were given (nats).
    pub evidence: f64,
    /// The same after the correction.
    pub corrected_evidence: f64,
}

/// An image after a correction; boxes that are none then are left out.
fn corrected(query: &Query, correction: &Correction) -> Option<Query> {
    let size = query.image_size;
    let corrected_box = |b: &QueryBox| {
        let change = |of: &crate::geometry::BoundingBox| correction.bounding_box(of, &query.intrinsics, size);
        // Where a lens bends the image, both are moved alike: the border is near enough.
        let box_in_image = b.box_in_image.as_ref().and_then(change);
        Some(QueryBox { bounding_box: change(&b.bounding_box)?, box_in_image, category: b.category.clone() })
    };
    let intrinsics = correction.intrinsics(&query.intrinsics, size)?;
    Some(Query { intrinsics, image_size: size, boxes: query.boxes.iter().filter_map(corrected_box).collect() })
}

/// How well images are explained.
#[derive(Debug, Clone, Copy, Default)]
struct Explained {
    evidence: f64,
    located: usize,
    /// Boxes that the poses explain.
    matches: usize,
}

fn evenly<'a>(images: &[LocatedImage<'a>], most: usize) -> Vec<LocatedImage<'a>> {
    images.iter().step_by(images.len().div_ceil(most).max(1)).cloned().collect()
}

/// The number of images that tell as much as one that is independent of the others (Kish's design effect): errors that the images of an
/// object have in common are seen in each of them.
fn design_effect(images: &[LocatedImage]) -> f64 {
    let poses = images.iter().filter_map(|image| image.located.poses.first());
    let mut landmarks: Vec<usize> = poses.flat_map(|pose| pose.matches.iter().map(|(_, landmark)| *landmark)).collect();
    let matches = landmarks.len() as f64;
    landmarks.sort_unstable();
    landmarks.dedup();
    let views = matches / (landmarks.len() as f64).max(1.0);
    let share = images.iter().map(|image| image.options.common_share).fold(0.0, f64::max);
    1.0 + (views - 1.0).max(0.0) * share
}

impl LandmarkMap {
    /// A mistake that all images have in common, if correcting it explains them clearly better; with images from one camera, or from
    /// cameras that are wrong in the same way. It takes about four times as long as to locate ten images, and longer where they cannot be
    /// located. The same input gives the same answer.
    pub fn common_mistake(&self, images: &[LocatedImage]) -> Option<CommonMistake> {
        let sample = evenly(images, MAX_IMAGES);
        let few = evenly(&sample, FEW_IMAGES);
        let [given, given_few] = [&sample, &few].map(|images| self.explained(images, None));
        let is_usual = |found: &Explained| found.located as f64 >= USUAL_SHARE * sample.len() as f64;
        let is_known = |b: &&QueryBox| self.landmarks.iter().any(|landmark| landmark.may_be(b.category.as_deref()));
        let boxes: usize = sample.iter().map(|image| image.query.boxes.iter().filter(is_known).count()).sum();
        let explains = |found: &Explained| found.matches as f64 >= USUAL_MATCHES * boxes as f64;
        let least = (CLEARLY * design_effect(&sample)).max(CLEAR_SHARE * given.evidence);
        let gains = |found: &Explained, share: f64| found.evidence > given.evidence + share * least;
        let both = |factor: f64| [Correction::ImageScale(factor), Correction::FocalFactor(factor)];
        let near: Vec<Correction> = [1.0 / NEAR, NEAR].into_iter().flat_map(both).collect();
        let mut best = self.best_of(&near, &sample)?;
        let of_frequent = || {
            let hidden = given_few.matches < HIDING_BOXES * given_few.located;
            hidden.then(|| self.best_of(&FREQUENT, &few)).flatten().map_or(0.0, |(_, found)| found.evidence)
        };
        let seems_better = gains(&best.1, SUSPICIOUS) || of_frequent() > given_few.evidence + SUSPICIOUS * least;
        if !seems_better && is_usual(&given) && explains(&given) {
            return None;
        }
        let factors = (1..=STEPS).flat_map(|k| [STEP.powi(-k), STEP.powi(k)]);
        let mut others: Vec<Correction> = factors.flat_map(both).collect();
        others.extend(SIZES.map(Correction::ImageScale));
        let formats = [BoxFormat::CenterReadAsCorner, BoxFormat::CornersReadAsSize, BoxFormat::SwappedAxes];
        others.extend(formats.map(Correction::Boxes));
        let turned = |orientation| Correction::TurnedPictures { orientation, fractions: false };
        others.extend([2, 3, 4, 6, 7, 8].map(turned));
        others.push(Correction::NormalizedLetterbox);
        others.extend(LETTERBOXES.map(Correction::Letterbox));
        if let Some((other, found)) = self.best_of(&others, &few)
            && found.evidence > given_few.evidence
        {
            let found = self.explained(&sample, Some(&other));
            best = if found.evidence > best.1.evidence { (other, found) } else { best };
        }
        for side in FINER {
            let sides = |of: fn(f64) -> Correction, factor: f64| [of(factor / side), of(factor * side)];
            let finer = match best.0 {
                Correction::ImageScale(factor) => sides(Correction::ImageScale, factor),
                Correction::FocalFactor(factor) => sides(Correction::FocalFactor, factor),
                _ => break,
            };
            best = self.best_of(&finer, &sample).filter(|other| other.1.evidence > best.1.evidence).unwrap_or(best);
        }
        let (correction, Explained { evidence, .. }) = best;
        (gains(&best.1, 1.0) && is_usual(&best.1) && explains(&best.1)).then_some(CommonMistake {
            correction,
            evidence: given.evidence,
            corrected_evidence: evidence,
        })
    }

    /// The correction with the largest evidence, the first one of equal ones.
    fn best_of(&self, corrections: &[Correction], images: &[LocatedImage]) -> Option<(Correction, Explained)> {
        let found = corrections.iter().map(|correction| (*correction, self.explained(images, Some(correction))));
        found.reduce(|best, other| if other.1.evidence > best.1.evidence { other } else { best })
    }

    /// How well images are explained after a correction, or as they were located.
    fn explained(&self, images: &[LocatedImage], correction: Option<&Correction>) -> Explained {
        let of_image = |k: usize| {
            let LocatedImage { query, options, located } = &images[k];
            let again = match correction {
                Some(correction) => Some(self.relocalize(&corrected(query, correction)?, options)),
                None => None,
            };
            let found = again.as_ref().unwrap_or(located);
            let best = found.poses.first().filter(|_| found.status != LocateStatus::NoPose)?;
            // The density of a box is that in given pixels; that of false boxes, per area of the image and of the box, has half of it.
            let map = correction.and_then(|correction| correction.pixel_map(query.image_size));
            let log_scale = map.map_or(0.0, |map| map.scale().ln());
            let matches = best.matches.len();
            Some((best.evidence + 2.0 * log_scale * matches as f64, matches)).filter(|(evidence, _)| *evidence > 0.0)
        };
        let all = map_indices(images.len(), of_image);
        Explained {
            evidence: all.iter().flatten().map(|(evidence, _)| evidence).sum(),
            located: all.iter().flatten().count(),
            matches: all.iter().flatten().map(|(_, matches)| matches).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{CamFromWorld, Intrinsics};
    use crate::relocalize::LocatedPose;
    use nalgebra::{Matrix3x4, Matrix6};

    #[test]
    fn images_of_the_same_objects_count_by_what_they_have_of_their_own() {
        let query =
            Query { intrinsics: Intrinsics::new(1.0, 1.0, 0.0, 0.0).unwrap(), image_size: None, boxes: Vec::new() };
        let pose = |landmarks: [usize; 3]| LocatedPose {
            cam_from_world: CamFromWorld::new(Matrix3x4::identity()).unwrap(),
            covariance: Matrix6::identity(),
            matches: landmarks.into_iter().enumerate().collect(),
            evidence: 0.0,
        };
        let effect = |all: &[[usize; 3]], common_share: f64| {
            let located =
                |landmarks: &[usize; 3]| Relocalization { status: LocateStatus::Ok, poses: vec![pose(*landmarks)] };
            let located: Vec<Relocalization> = all.iter().map(located).collect();
            let options = LocateOptions { common_share, ..Default::default() };
            let image = |located| LocatedImage { query: &query, options: options.clone(), located };
            design_effect(&located.iter().map(image).collect::<Vec<_>>())
        };
        assert_eq!(effect(&[[0, 1, 2]; 5], 0.0), 1.0);
        assert_eq!(effect(&[[0, 1, 2]; 5], 0.5), 3.0);
        assert_eq!(effect(&[[0, 1, 2], [3, 4, 5]], 0.5), 1.0);
        assert_eq!(effect(&[], 0.5), 1.0);
    }
}
