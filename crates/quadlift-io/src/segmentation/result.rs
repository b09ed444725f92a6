//! Writes a segmentation: the scene with its masks and ellipses, and label images of the masks.

use std::collections::BTreeMap;
use std::path::Path;

use quadlift::scene::Scene;
use quadlift_segment::{LabelImage, Mask, Rle, RleError, reach};

use super::{Found, Method, Segmentation, image_size};
use crate::error::WriteError;
use crate::file_names::file_names;
use crate::images::write_label_image;
use crate::scene_file::{
    DetectionRecord, MaskRecord, RleCounts, RleRecord, SceneFile, SegmentationRecord, way_to_file,
};

/// Label images with more pixels than this are not written.
const MAX_PIXELS: u64 = 1 << 28;

/// Writes the results into the detections of a scene file; those without a result get a status. With a folder, masks
/// are written there as label images, otherwise into the scene file as COCO RLE.
///
/// `folders` are that of the scene file as it was read and that of the one that will be written: the paths of images
/// and masks are relative to it.
///
/// # Errors
/// [`WriteError`] when a label image cannot be written or one of these folders does not exist.
pub fn add_to_scene(
    file: &mut SceneFile,
    scene: &Scene,
    segmentation: &Segmentation,
    method: Method,
    folders: [&Path; 2],
    out_masks: Option<&Path>,
) -> Result<(), WriteError> {
    file.move_paths(folders)?;
    for (index, record) in file.detections.iter_mut().enumerate() {
        if let Some(found) = &segmentation.found[index] {
            describe(record, found, method);
        } else if let Some(problem) = segmentation.problem_of(index) {
            record.segmentation = Some(Box::new(SegmentationRecord {
                method: method.name().to_owned(),
                status: "failed".to_owned(),
                reason: Some(problem.message.clone()),
                ..Default::default()
            }));
        }
    }
    // In the order of the detections, whatever the order of the objects.
    let mut frames: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, detection) in scene.detections.iter().enumerate() {
        if segmentation.found[index].is_some() {
            frames.entry(detection.frame_index as usize).or_default().push(index);
        }
    }
    let names = file_names(frames.keys().map(|&frame| scene.frames[frame].id.as_str()));
    for ((&frame, detections), name) in frames.iter().zip(&names) {
        let size = image_size(scene, frame, detections, segmentation);
        let size = size.unwrap_or_else(|| {
            reach(detections.iter().filter_map(|&index| Some(&segmentation.found[index].as_ref()?.mask)))
        });
        let masks = detections.iter().filter_map(|&index| Some((index, &segmentation.found[index].as_ref()?.mask)));
        let masks: Vec<(usize, &Mask)> = masks.collect();
        match out_masks {
            Some(folder) => write_masks(file, &masks, size, folder, name, folders[1])?,
            // Given masks are not changed.
            None if method == Method::Masks => {}
            None => {
                for (index, mask) in masks {
                    let runs = in_runs(mask, size).map_err(|error| WriteError::new(folders[1], error))?;
                    file.detections[index].mask = runs;
                }
            }
        }
    }
    Ok(())
}

/// The ellipse of a detection and how it was found.
fn describe(record: &mut DetectionRecord, found: &Found, method: Method) {
    let status = if found.fallback.is_some() { "fallback" } else { "ok" };
    record.ellipse = Some(Box::new(found.ellipse.into()));
    let share = |share: f64| (share > 0.0).then_some(share);
    record.segmentation = Some(Box::new(SegmentationRecord {
        method: method.name().to_owned(),
        status: status.to_owned(),
        reason: found.fallback.map(|failure| failure.name().to_owned()),
        confidence: found.confidence,
        truncated_by_border: share(found.contacts.border),
        touches_other_masks: share(found.contacts.others),
        ..Default::default()
    }));
}

/// A mask as COCO RLE; none if it is empty.
fn in_runs(mask: &Mask, [width, height]: [u32; 2]) -> Result<Option<Box<MaskRecord>>, RleError> {
    if mask.count() == 0 {
        return Ok(None);
    }
    let rle = Rle::of_mask(mask, height, width)?;
    let rle = RleRecord { size: rle.size(), counts: RleCounts::Compressed(rle.to_compressed()), ..Default::default() };
    Ok(Some(Box::new(MaskRecord { rle: Some(rle), ..Default::default() })))
}

/// Writes the masks of a frame as label images and notes them in the detections. Masks that overlap go to different
/// images, so that none loses a pixel.
fn write_masks(
    file: &mut SceneFile,
    masks: &[(usize, &Mask)],
    [width, height]: [u32; 2],
    folder: &Path,
    name: &str,
    scene_folder: &Path,
) -> Result<(), WriteError> {
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        let problem = format!("an image of {width} x {height} pixels is too large");
        return Err(WriteError::new(&folder.join(layer_name(name, 0)), problem));
    }
    let mut layers: Vec<Vec<u16>> = Vec::new();
    let mut counts: Vec<u16> = Vec::new();
    for (index, mask) in masks {
        if mask.count() == 0 {
            file.detections[*index].mask = None;
            continue;
        }
        let places: Vec<usize> = mask.pixels().map(|[x, y]| y as usize * width as usize + x as usize).collect();
        let free =
            |(layer, count): (&Vec<u16>, &u16)| *count < u16::MAX && places.iter().all(|&place| layer[place] == 0);
        let layer = layers.iter().zip(&counts).position(free).unwrap_or_else(|| {
            layers.push(vec![0; width as usize * height as usize]);
            counts.push(0);
            layers.len() - 1
        });
        counts[layer] += 1;
        places.iter().for_each(|&place| layers[layer][place] = counts[layer]);
        file.detections[*index].mask = Some(Box::new(MaskRecord {
            path: Some(way_to_file(scene_folder, &folder.join(layer_name(name, layer)))?),
            value: Some(counts[layer].into()),
            ..Default::default()
        }));
    }
    for (layer, values) in layers.into_iter().enumerate() {
        let path = folder.join(layer_name(name, layer));
        let labels = LabelImage::new(width, height, values).map_err(|error| WriteError::new(&path, error))?;
        write_label_image(&path, &labels)?;
    }
    Ok(())
}

fn layer_name(name: &str, layer: usize) -> String {
    // No name of a frame holds this sign.
    if layer == 0 { format!("{name}.png") } else { format!("{name}+{layer}.png") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_that_overlap_keep_all_their_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let square = |x, y| Mask { origin: [x, y], ..Mask::from_fn(3, 3, |_, _| true) };
        let masks = [square(0, 0), square(2, 2), square(5, 0), Mask::default()];
        let mut file = SceneFile { detections: vec![DetectionRecord::default(); 4], ..Default::default() };
        let list: Vec<(usize, &Mask)> = masks.iter().enumerate().collect();
        write_masks(&mut file, &list, [8, 6], folder.path(), "a", folder.path()).unwrap();
        let mut place = |k: usize| file.detections[k].mask.take().map(|mask| (mask.path.unwrap(), mask.value.unwrap()));
        assert_eq!(place(0), Some(("a.png".to_owned(), 1)));
        assert_eq!(place(1), Some(("a+1.png".to_owned(), 1)));
        assert_eq!(place(2), Some(("a.png".to_owned(), 2)));
        assert_eq!(place(3), None);
        let labels = crate::read_label_image(&folder.path().join("a+1.png")).unwrap();
        assert_eq!(labels.mask(1), masks[1]);
        let labels = crate::read_label_image(&folder.path().join("a.png")).unwrap();
        assert_eq!([labels.mask(1), labels.mask(2)], [masks[0].clone(), masks[2].clone()]);
    }
}
