//! The result for all frames from that of one frame for each place.

use std::collections::HashMap;

use super::Localization;
use crate::association::places::Places;
use crate::scene::Scene;
use crate::solve::{RefinedPose, ScaledQuantity, ViewReport};

/// Gives the copies of a view what is known of the view, and frames their indices in the scene.
pub(super) fn spread(places: &Places, scene: &Scene, found: &mut Localization) {
    let frame_of = |detection: usize| scene.detections[detection].frame_index as usize;
    let mut copies: HashMap<(usize, usize), Vec<usize>> = HashMap::new();
    for (thing, of_thing) in places.scene.detections.iter().zip(&places.copies) {
        if let Some(object) = thing.object_index {
            let frames = of_thing.iter().map(|&detection| frame_of(detection)).collect();
            copies.insert((object as usize, thing.frame_index as usize), frames);
        }
    }
    let first =
        |object: usize, place: usize| copies.get(&(object, place)).map_or(places.frames[place][0], |all| all[0]);
    for estimate in &mut found.estimates {
        let object = estimate.object_index;
        let of_view = |view: &ViewReport| {
            let view = *view;
            let frames = copies.get(&(object, view.frame_index)).cloned();
            let frames = frames.unwrap_or_else(|| vec![places.frames[view.frame_index][0]]);
            frames.into_iter().map(move |frame_index| ViewReport { frame_index, ..view })
        };
        estimate.views = estimate.views.iter().flat_map(of_view).collect();
        estimate.views.sort_by_key(|view| view.frame_index);
    }
    let of_pose = |pose: &RefinedPose| {
        let pose = pose.clone();
        places.frames[pose.frame_index].iter().map(move |&frame_index| RefinedPose { frame_index, ..pose.clone() })
    };
    found.refined_poses = found.refined_poses.iter().flat_map(of_pose).collect();
    found.refined_poses.sort_by_key(|pose| pose.frame_index);
    for of_object in &mut found.cross_validation.objects {
        let object = found.estimates[of_object.estimate_index].object_index;
        let odd = of_object.suspect_view().map(|odd| first(object, odd.frame_index));
        of_object.predictions.iter_mut().for_each(|one| one.frame_index = first(object, one.frame_index));
        of_object.predictions.sort_by_key(|one| one.frame_index);
        of_object.odd = odd.and_then(|odd| of_object.predictions.iter().position(|one| one.frame_index == odd));
    }
    for scale in &mut found.cue_scales {
        if let ScaledQuantity::DepthOfFrame { frame } = &mut scale.quantity {
            *frame = places.frames[*frame][0];
        }
    }
}
