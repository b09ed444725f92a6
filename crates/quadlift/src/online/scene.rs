//! The map as a scene, for the estimators, reports and files.

use std::collections::BTreeMap;

use super::memory::Memory;
use super::tracked::Presence;
use super::views::KeptView;
use crate::geometry::BoundingBox;
use crate::scene::{Detection, Scene, SceneParts};
use crate::sorting::StableSort;

/// The scene, and the view of each of its detections.
pub(super) fn scene_and_views<'a>(
    memory: &'a Memory,
    edges_of: &dyn Fn(&KeptView, [f64; 4]) -> [f64; 4],
) -> (Scene, Vec<&'a KeptView>) {
    let mut parts = SceneParts { name: "object map".to_owned(), ..Default::default() };
    let objects: Vec<_> = memory.objects.tracked().filter(|t| t.presence != Presence::Tentative).collect();
    let mut frames: BTreeMap<u32, u32> = BTreeMap::new();
    for view in objects.iter().flat_map(|t| &t.views) {
        frames.insert(view.keyframe, 0);
    }
    for (index, (&key, place)) in frames.iter_mut().enumerate() {
        *place = index as u32;
        if let Some(keyframe) = memory.keyframes.get(key) {
            parts.frames.push(keyframe.frame.to_scene());
        }
    }
    // A detection without a category has none in the scene.
    let mut category_index = vec![None; memory.categories.names().len()];
    for (index, name) in memory.categories.names().iter().enumerate() {
        if let Some(name) = name {
            category_index[index] = Some(parts.categories.len() as u32);
            parts.categories.push(name.clone());
        }
    }
    let bounds = |view: &KeptView, edges: [f32; 4]| {
        let own = edges.map(f64::from);
        BoundingBox::new(edges_of(view, own)).or_else(|_| BoundingBox::new(own)).ok()
    };
    parts.cue_sources.clone_from(&memory.cue_sources);
    parts.scaled_by_frame.clone_from(&memory.scaled_by_frame);
    let mut found: Vec<(Detection, &KeptView)> = Vec::new();
    for (index, tracked) in objects.iter().enumerate() {
        parts.object_ids.push(tracked.id.to_string());
        for view in &tracked.views {
            let mut detection = Detection {
                frame_index: frames[&view.keyframe],
                object_index: Some(index as u32),
                category_index: category_index[usize::from(view.category)],
                score: view.score.map(f64::from),
                bounding_box: bounds(view, view.edges),
                // A mean error is as large in both images, up to the local scale of the lens.
                box_in_image: view.in_image.as_ref().and_then(|edges| bounds(view, **edges)),
                cues: view.cues.clone(),
                ..Default::default()
            };
            if let (Some(shape), Some(frame)) = (&view.shape, parts.frames.get(detection.frame_index as usize)) {
                shape.add_to(&mut detection, frame);
            }
            found.push((detection, view));
        }
    }
    found.stable_sort_by_key(|(d, _)| (d.frame_index, d.object_index));
    let (detections, views) = found.into_iter().unzip();
    (Scene(SceneParts { detections, ..parts }), views)
}
