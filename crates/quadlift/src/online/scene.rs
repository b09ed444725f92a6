//! The map as a scene, for the estimators, reports and files.

use std::collections::BTreeMap;

use super::map::ObjectMap;
use super::tracked::Presence;
use super::views::KeptView;
use crate::geometry::BoundingBox;
use crate::localize::{Localization, LocalizeError, LocalizeOptions, localize};
use crate::scene::{Detection, Scene, SceneParts};

impl ObjectMap {
    /// The kept views as a scene. Its object ids are those of the map, in their order; tentative objects are left out.
    pub fn to_scene(&self) -> Scene {
        self.scene_of(&|_, edges| edges)
    }

    /// The scene from which [`ObjectMap::localize`] estimates: that of [`ObjectMap::to_scene`], where each box is the mean of those
    /// of the forgotten views that it stands for and its own.
    pub fn to_averaged_scene(&self) -> Scene {
        self.scene_of(&|view, edges| view.averaged(edges))
    }

    fn scene_of(&self, edges_of: &dyn Fn(&KeptView, [f64; 4]) -> [f64; 4]) -> Scene {
        let mut parts = SceneParts { name: "object map".to_owned(), ..Default::default() };
        let objects: Vec<_> = self.tracked().filter(|t| t.presence != Presence::Tentative).collect();
        let mut frames: BTreeMap<u32, u32> = BTreeMap::new();
        for view in objects.iter().flat_map(|t| &t.views) {
            frames.insert(view.keyframe, 0);
        }
        for (index, (&key, place)) in frames.iter_mut().enumerate() {
            *place = index as u32;
            if let Some(keyframe) = self.keyframes.get(key) {
                parts.frames.push(keyframe.frame.to_scene());
            }
        }
        // A detection without a category has none in the scene.
        let mut category_index = vec![None; self.categories.names().len()];
        for (index, name) in self.categories.names().iter().enumerate() {
            if let Some(name) = name {
                category_index[index] = Some(parts.categories.len() as u32);
                parts.categories.push(name.clone());
            }
        }
        let bounds = |view: &KeptView, edges: [f32; 4]| {
            let own = edges.map(f64::from);
            BoundingBox::new(edges_of(view, own)).or_else(|_| BoundingBox::new(own)).ok()
        };
        parts.cue_sources.clone_from(&self.cue_sources);
        for (index, tracked) in objects.iter().enumerate() {
            parts.object_ids.push(tracked.id.to_string());
            for view in &tracked.views {
                parts.detections.push(Detection {
                    frame_index: frames[&view.keyframe],
                    object_index: Some(index as u32),
                    category_index: category_index[usize::from(view.category)],
                    score: view.score.map(f64::from),
                    bounding_box: bounds(view, view.edges),
                    // A mean error is as large in both images, up to the local scale of the lens.
                    box_in_image: view.in_image.as_ref().and_then(|edges| bounds(view, **edges)),
                    cues: view.cues.as_ref().map(|cues| Box::new(cues.to_cues())),
                    ..Default::default()
                });
            }
        }
        parts.detections.sort_by_key(|d| (d.frame_index, d.object_index));
        Scene(parts)
    }

    /// Estimates of all objects of the map with covariances, in the order of their ids, from their kept views and the means
    /// of those that they stand for.
    ///
    /// # Errors
    /// As [`localize()`].
    pub fn localize(&self, options: &LocalizeOptions) -> Result<Localization, LocalizeError> {
        localize(&self.to_averaged_scene(), options)
    }
}
