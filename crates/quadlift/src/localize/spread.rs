//! The result for a scene from that of its places: all frames and objects, in the order of the file.

use std::collections::HashMap;

use super::Localization;
use crate::scene::Scene;
use crate::scene::places::{MIN_OVERLAP, Places};
use crate::solve::{RefinedPose, Rejection, ScaledQuantity, Status, ViewReport};
use crate::sorting::StableSort;

/// Views that are enough for any method, from different places.
const MIN_VIEWS: usize = 3;

/// Gives the copies of a view what is known of the view, and frames their indices in the scene.
pub(super) fn spread(places: &Places, scene: &Scene, found: &mut Localization) {
    // The frames of the copies of each view, and whether the copy is where the others are.
    let mut copies: HashMap<(usize, usize), Vec<(usize, bool)>> = HashMap::new();
    for (thing, of_thing) in places.scene.detections.iter().zip(&places.copies) {
        let of_copy = |&detection: &usize| {
            let copy = &scene.detections[detection];
            let both = copy.bounding_box.zip(thing.bounding_box);
            (copy.frame_index as usize, both.is_none_or(|(own, usual)| own.iou(&usual) >= MIN_OVERLAP))
        };
        if let Some(object) = thing.object_index {
            copies.insert((object as usize, thing.frame_index as usize), of_thing.iter().map(of_copy).collect());
        }
    }
    let first =
        |object: usize, place: usize| copies.get(&(object, place)).map_or(places.frames[place][0], |all| all[0].0);
    for estimate in &mut found.estimates {
        let object = estimate.object_index;
        let of_places = estimate.views.len();
        let of_view = |view: &ViewReport| {
            let view = *view;
            let known = copies.get(&(object, view.frame_index)).cloned();
            let known = known.unwrap_or_else(|| vec![(places.frames[view.frame_index][0], true)]);
            known.into_iter().map(move |(frame_index, agrees)| match agrees {
                true => ViewReport { frame_index, ..view },
                false => {
                    ViewReport { rejection_reason: Some(Rejection::Residual), ..ViewReport::not_used(frame_index) }
                }
            })
        };
        estimate.views = estimate.views.iter().flat_map(of_view).collect();
        estimate.views.stable_sort_by_key(|view| view.frame_index);
        // There are views, but from too few places.
        if estimate.status == Status::TooFewViews && estimate.views.len() > of_places.max(MIN_VIEWS) {
            estimate.status = Status::Degenerate;
        }
    }
    let of_pose = |pose: &RefinedPose| {
        let pose = pose.clone();
        places.frames[pose.frame_index].iter().map(move |&frame_index| RefinedPose { frame_index, ..pose.clone() })
    };
    found.refined_poses = found.refined_poses.iter().flat_map(of_pose).collect();
    found.refined_poses.stable_sort_by_key(|pose| pose.frame_index);
    let objects: Vec<usize> = found.estimates.iter().map(|estimate| estimate.object_index).collect();
    renumber_predictions(found, |estimate, place| first(objects[estimate], place));
    for scale in &mut found.cue_scales {
        if let ScaledQuantity::DepthOfFrame { frame } = &mut scale.quantity {
            *frame = places.frames[*frame][0];
        }
    }
}

/// Gives the predictions other frames, from their estimates (indices) and frames, and puts them in the order of these.
fn renumber_predictions(found: &mut Localization, new: impl Fn(usize, usize) -> usize) {
    for object in &mut found.cross_validation.objects {
        let estimate = object.estimate_index;
        let odd = object.suspect_view().map(|odd| new(estimate, odd.frame_index));
        object.predictions.iter_mut().for_each(|one| one.frame_index = new(estimate, one.frame_index));
        object.predictions.stable_sort_by_key(|one| one.frame_index);
        object.odd = odd.and_then(|odd| object.predictions.iter().position(|one| one.frame_index == odd));
    }
}

/// Puts the objects in the order of the scene.
pub(super) fn sort_objects(found: &mut Localization) {
    let objects: Vec<usize> = found.estimates.iter().map(|estimate| estimate.object_index).collect();
    found.estimates.stable_sort_by_key(|estimate| estimate.object_index);
    let estimates = &found.solution.estimates;
    for object in &mut found.cross_validation.objects {
        object.estimate_index = estimates.partition_point(|one| one.object_index < objects[object.estimate_index]);
    }
    found.cross_validation.objects.stable_sort_by_key(|object| object.estimate_index);
}
