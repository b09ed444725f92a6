//! Corrects and associates a part of a scene under each hypothesis, where detections carry no object ids.

use nalgebra::Vector2;

use super::agreement::Agreement;
use super::correction::Correction;
use super::hypotheses::Family;
use super::misses::misses;
use super::sample::Sample;
use super::search;
use super::some_frames::NOTHING;
use super::verdict::of_search;
use crate::association::{AssociateError, AssociateOptions, Association, associate};
use crate::parallel::map_indices;
use crate::scene::{Detection, Scene};
use crate::sorting::StableSort;

/// Maximum number of frames of the part that is associated again.
const MAX_FRAMES: usize = 20;

/// Maximum stride of frames of a longer scene: views that are far apart do not show the same objects.
const MAX_STRIDE: usize = 3;

/// Maximum number of boxes of that part: the largest ones of each frame.
const MAX_BOXES: usize = 200;

/// How often the distance between two numbers of a family is halved.
const HALVINGS: usize = 3;

/// A part of a scene that is associated under each hypothesis.
pub(crate) struct Tried<'a> {
    scene: &'a Scene,
    /// The selected frames.
    pub(crate) frames: Vec<bool>,
    boxes_in_frame: usize,
    source: Option<u32>,
    options: AssociateOptions,
}

/// A part of a scene, corrected and associated.
pub(crate) struct Trial {
    correction: Correction,
    /// Evidence for each detection, nats.
    pub evidence: f64,
    pub agreement: Agreement,
    /// The part with the associated objects.
    pub named: Scene,
    /// The places of its detections in the whole scene, corrected.
    pub detections: Vec<usize>,
}

impl<'a> Tried<'a> {
    pub(crate) fn new(scene: &'a Scene, is_used: &impl Fn(&Detection) -> bool, options: &AssociateOptions) -> Self {
        let mut counts = vec![0usize; scene.frames.len()];
        let used = scene.detections.iter().filter(|d| is_used(d));
        used.for_each(|d| counts[d.frame_index as usize] += 1);
        let with_boxes: Vec<usize> = (0..counts.len()).filter(|&k| counts[k] > 0).collect();
        let stride = with_boxes.len().div_ceil(MAX_FRAMES).clamp(1, MAX_STRIDE);
        let strided: Vec<usize> = with_boxes.into_iter().step_by(stride).collect();
        // The part of the trajectory with most boxes.
        let in_window = |start: usize| strided[start..].iter().take(MAX_FRAMES).map(|&k| counts[k]).sum::<usize>();
        let starts = 0..strided.len().saturating_sub(MAX_FRAMES) + 1;
        let start = starts.rev().max_by_key(|&start| in_window(start)).unwrap_or(0);
        let mut frames = vec![false; scene.frames.len()];
        let window = &strided[start..strided.len().min(start + MAX_FRAMES)];
        window.iter().for_each(|&frame| frames[frame] = true);
        Self {
            scene,
            frames,
            boxes_in_frame: MAX_BOXES.div_ceil(window.len().max(1)),
            source: scene.source_index(options.source.as_deref()).unwrap_or_default(),
            options: AssociateOptions { thorough: false, ..options.clone() },
        }
    }

    /// The part as it is, associated.
    pub(crate) fn given(&self) -> Result<Trial, AssociateError> {
        self.associated(self.scene.clone(), NOTHING)
    }

    pub(crate) fn with(&self, correction: Correction) -> Option<Trial> {
        let corrected = correction.apply(self.scene);
        boxes_fit(&corrected).then(|| self.associated(corrected, correction).ok()).flatten()
    }

    /// The best correction of a family: from the best one of its grid, by halving the distance to its neighbors.
    pub(crate) fn narrowed(&self, family: &Family) -> Option<Trial> {
        let grid = family.grid;
        let trials = map_indices(grid.len(), |k| self.with((family.make)(grid[k])));
        let best = (0..grid.len()).max_by(|&a, &b| evidence_of(&trials[a]).total_cmp(&evidence_of(&trials[b])))?;
        let (low, high) = (grid[best.saturating_sub(1)], grid[(best + 1).min(grid.len() - 1)]);
        let mut found = trials.into_iter().nth(best)?;
        let (mut center, mut sides) = (grid[best], [low, high]);
        for _ in 0..HALVINGS {
            for side in &mut sides {
                *side = family.between(center, *side, 0.5);
            }
            let trials = map_indices(2, |k| self.with((family.make)(sides[k])));
            for (trial, side) in trials.into_iter().zip(sides) {
                if evidence_of(&trial) > evidence_of(&found) {
                    (found, center) = (trial, side);
                }
            }
        }
        found
    }

    fn associated(&self, mut scene: Scene, correction: Correction) -> Result<Trial, AssociateError> {
        let area = |d: &Detection| d.measured_box().map_or(0.0, |b| b.size().product());
        let mut by_frame: Vec<Vec<(f64, usize)>> = vec![Vec::new(); scene.frames.len()];
        for (index, d) in scene.detections.iter().enumerate() {
            if self.frames[d.frame_index as usize] && (self.source.is_none() || d.source_index == self.source) {
                by_frame[d.frame_index as usize].push((area(d), index));
            }
        }
        let mut kept = vec![false; scene.detections.len()];
        for boxes in &mut by_frame {
            boxes.stable_sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            boxes.iter().take(self.boxes_in_frame).for_each(|&(_, index)| kept[index] = true);
        }
        let detections: Vec<usize> = (0..kept.len()).filter(|&index| kept[index]).collect();
        let mut kept = kept.into_iter();
        scene.0.detections.retain(|_| kept.next().unwrap_or_default());
        let association = associate(&scene, &self.options)?;
        let boxes = scene.detections.len().max(1) as f64;
        let named = association.applied_to(&scene, self.source);
        let assigned = association.objects.iter().map(|o| o.views as f64).sum::<f64>() / boxes;
        let agreement = diagnose_agreement(&named, assigned);
        Ok(Trial {
            correction,
            evidence: evidence(&association) / association.boxes.max(1) as f64,
            agreement,
            named,
            detections,
        })
    }
}

impl Trial {
    /// Its correction, with a parameter refined on the associated objects.
    pub(crate) fn refined(&self, is_used: &impl Fn(&Detection) -> bool) -> Correction {
        let correction = self.correction;
        let sample = Sample::new(&self.named, is_used);
        let found = search::search(&sample).map(|search| of_search(&search, &sample)).unwrap_or_default();
        let better = found.causes.first().and_then(|cause| cause.correction);
        match (correction, better) {
            (Correction::ImageScale(a), Some(Correction::ImageScale(b))) => Correction::ImageScale(a * b),
            (Correction::FocalFactor(a), Some(Correction::FocalFactor(b))) => Correction::FocalFactor(a * b),
            _ => correction,
        }
    }
}

/// Agreement of the objects of an association; unassigned boxes count as disagreeing.
fn diagnose_agreement(named: &Scene, assigned: f64) -> Agreement {
    let found = misses(&Sample::new(named, |_| true), None, None);
    let Some(found) = found.map(|misses| misses.agreement()) else {
        return Agreement { miss: 3.0, share: 0.0, boxes: named.detections.len() };
    };
    Agreement { share: found.share * assigned, boxes: named.detections.len(), ..found }
}

/// Whether nearly all boxes lie in their images, but for a margin.
fn boxes_fit(scene: &Scene) -> bool {
    let outside = scene.detections.iter().filter(|d| {
        let size: Option<Vector2<f64>> = scene.frames[d.frame_index as usize].image_size;
        let (Some(b), Some(size)) = (d.bounding_box, size) else { return false };
        let center = b.center();
        center.x < 0.0 || center.y < 0.0 || center.x > size.x || center.y > size.y
    });
    outside.count() * 20 <= scene.detections.len()
}

pub(crate) fn evidence_of(trial: &Option<Trial>) -> f64 {
    trial.as_ref().map_or(f64::NEG_INFINITY, |trial| trial.evidence)
}

/// The evidence of all objects, in nats.
pub(crate) fn evidence(association: &Association) -> f64 {
    association.objects.iter().filter_map(|object| object.evidence).sum()
}
