//! From masks to the tangent lines of detections, for `posterior` and `planes`.

use std::collections::BTreeMap;
use std::path::Path;

use quadlift::Observer;
use quadlift::scene::Scene;
use quadlift_segment::FrameMasks;

use super::mask_check::{FEW, mask_contradiction};
use super::records::SceneFile;
use crate::error::{EntryError, ReadError};

/// Which masks gave no tangent lines; all others did.
#[derive(Debug, Default)]
pub(crate) struct MasksRead {
    /// What could not be read, with the index of the detection.
    pub unread: Vec<(usize, ReadError)>,
    /// What was left out because it does not meet the boxes, in words.
    pub left_out: Option<String>,
    /// Whether the others are used.
    pub are_used: bool,
}

impl SceneFile {
    /// Reads the masks of the detections of one source (of all without one) and gives the scene's detections their
    /// tangent lines ([`FrameMasks::tangent_lines`]). The scene must be that of this file ([`Self::to_scene`]), and
    /// `path` is the file's. Unreliable masks of `quadlift segment` (`fallback`) are skipped. `progress` is called
    /// with the number of frames done and their total.
    ///
    /// Masks that do not meet the boxes of their detections are left out; all of them, if these are more than a few.
    ///
    /// # Errors
    /// As [`Self::to_images`].
    pub(crate) fn add_support_lines(
        &self,
        path: &Path,
        scene: &mut Scene,
        source_index: Option<u32>,
        observer: &dyn Observer,
    ) -> Result<MasksRead, EntryError> {
        let images = self.to_images(path)?;
        let fallback = |index: usize| {
            self.detections[index].segmentation.as_ref().is_some_and(|segmentation| segmentation.fallback())
        };
        let found_in_box = |index: usize| {
            self.detections[index].segmentation.as_ref().is_some_and(|segmentation| segmentation.found_in_box())
        };
        let mut frames: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (index, detection) in scene.detections.iter().enumerate() {
            let chosen = source_index.is_none() || detection.source_index == source_index;
            if chosen && self.detections[index].mask.is_some() && !fallback(index) {
                frames.entry(detection.frame_index).or_default().push(index);
            }
        }
        let (mut problems, mut elsewhere) = (Vec::new(), BTreeMap::new());
        for (done, (&frame, detections)) in frames.iter().enumerate() {
            if observer.progress(done, frames.len()).is_break() {
                break;
            }
            let mut masks = Vec::with_capacity(detections.len());
            for (&index, mask) in detections.iter().zip(images.read_masks(scene, detections)) {
                match mask {
                    Ok(mask) => masks.extend(mask.map(|mask| (index, mask))),
                    Err(error) => problems.push((index, error)),
                }
            }
            let all = FrameMasks::new(masks.iter().map(|(_, mask)| mask));
            let frame = scene.frames[frame as usize].clone();
            for (index, mask) in &masks {
                if let Some(reason) = mask_contradiction(mask, *index, detections, (scene, &images)) {
                    *elsewhere.entry(reason).or_insert(0) += 1;
                    continue;
                }
                let lines = all.tangent_lines(mask, frame.image_size, frame.lens.as_ref());
                // Masks that were found in a box know its edges from the box.
                let box_of = |index: usize| scene.detections[index].bounding_box.filter(|_| found_in_box(index));
                let lines = match box_of(*index) {
                    Some(around) => lines.map(|lines| lines.beside_box(&around)),
                    None => lines,
                };
                scene.set_support_lines(*index, lines);
            }
        }
        let _ = observer.progress(frames.len(), frames.len());
        let (all, wrong) = (frames.values().map(Vec::len).sum::<usize>(), elsewhere.values().sum::<usize>());
        let are_used = wrong as f64 <= FEW * all as f64;
        let most = elsewhere.into_iter().max_by_key(|(_, count)| *count);
        let words = most.map(|(reason, _)| {
            let rest = if are_used { "" } else { "; boxes are used instead of all masks" };
            format!(
                "{wrong} of {all} masks do not meet the boxes of their detections and are left out, as of most: {reason}{rest}"
            )
        });
        if !are_used {
            frames.values().flatten().for_each(|&index| scene.set_support_lines(index, None));
        }
        Ok(MasksRead { unread: problems, left_out: words, are_used })
    }
}
