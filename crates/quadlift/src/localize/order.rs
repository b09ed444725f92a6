//! The order in which frames and objects are taken: their own, not that of the file.
//!
//! Neighbors in time have common errors, and sums depend on their order in the last digits.

use super::Localization;
use crate::diagnosis::natural_places;
use crate::scene::{Frame, Scene, SceneError};
use crate::solve::ScaledQuantity;
use crate::sorting::StableSort;

/// Frames in the order of their times and cameras, others in that of their names, in which numbers count as numbers.
pub(super) struct FrameOrder {
    /// Index in the file of each frame of the order.
    old: Vec<usize>,
}

impl FrameOrder {
    /// The order of the frames of a scene; `None` if they are in it.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let ids: Vec<&str> = scene.frames.iter().map(|frame| frame.id.as_str()).collect();
        let places = natural_places(&ids);
        let time = |frame: &Frame| frame.rig.map(|rig| (rig.time_step, rig.camera));
        let mut old: Vec<usize> = (0..ids.len()).collect();
        old.stable_sort_by_key(|&index| (time(&scene.frames[index]), places[index]));
        (!old.is_sorted()).then_some(Self { old })
    }

    /// The scene with its frames in this order.
    pub(super) fn apply(&self, scene: &Scene) -> Result<Scene, SceneError> {
        let mut new = vec![0; self.old.len()];
        for (place, &index) in self.old.iter().enumerate() {
            new[index] = place as u32;
        }
        let mut parts = scene.clone().into_parts();
        parts.frames = self.old.iter().map(|&index| scene.frames[index].clone()).collect();
        for detection in &mut parts.detections {
            detection.frame_index = new[detection.frame_index as usize];
        }
        for observation in parts.points.iter_mut().flat_map(|point| &mut point.observations) {
            observation.frame_index = new[observation.frame_index as usize];
        }
        Scene::from_parts(parts)
    }

    /// The result with the indices and the order of the file.
    pub(super) fn undo(&self, found: &mut Localization) {
        for estimate in &mut found.estimates {
            estimate.views.iter_mut().for_each(|view| view.frame_index = self.old[view.frame_index]);
            estimate.views.stable_sort_by_key(|view| view.frame_index);
        }
        found.refined_poses.iter_mut().for_each(|pose| pose.frame_index = self.old[pose.frame_index]);
        found.refined_poses.stable_sort_by_key(|pose| pose.frame_index);
        renumber_predictions(found, |_, frame| self.old[frame]);
        for scale in &mut found.cue_scales {
            if let ScaledQuantity::DepthOfFrame { frame } = &mut scale.quantity {
                *frame = self.old[*frame];
            }
        }
    }
}

/// Gives the predictions other frames, from their estimates (indices) and frames, and puts them in the order of these.
pub(super) fn renumber_predictions(found: &mut Localization, new: impl Fn(usize, usize) -> usize) {
    for object in &mut found.cross_validation.objects {
        let estimate = object.estimate_index;
        let odd = object.suspect_view().map(|odd| new(estimate, odd.frame_index));
        object.predictions.iter_mut().for_each(|one| one.frame_index = new(estimate, one.frame_index));
        object.predictions.stable_sort_by_key(|one| one.frame_index);
        object.odd = odd.and_then(|odd| object.predictions.iter().position(|one| one.frame_index == odd));
    }
}

/// Places of the listed objects (indices into the scene's ids) in the order of their ids.
pub(super) fn order_of_objects(scene: &Scene, objects: &[usize]) -> Vec<usize> {
    let ids: Vec<&str> = objects.iter().map(|&object| scene.object_ids[object].as_str()).collect();
    let places = natural_places(&ids);
    let mut order = vec![0; places.len()];
    places.into_iter().enumerate().for_each(|(index, place)| order[place] = index);
    order
}
