//! A segmentation as files: the scene with what was found, and label images of the masks.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, bail};
use quadlift::scene::Scene;
use quadlift_io::scene_file::{DetectionRecord, EllipseRecord, MaskRecord, RleCounts, RleRecord, SegmentationRecord};
use quadlift_io::{SceneFile, write_label_image};
use quadlift_segment::{LabelImage, Mask, Rle, SegmentMethod, reach};

use crate::file_names::FileNames;
use crate::segmentation::{Found, Method, Segmentation, image_size};

/// Label images with more pixels than this are not written.
const MOST_PIXELS: u64 = 1 << 28;

/// Writes what was found into the detections of a scene file; those without a result get a status. With a folder the
/// masks are written there as label images, without one into the scene file itself, as COCO's runs.
///
/// `folders` are that of the scene file as it was read and that of the one that will be written: the paths of images
/// and masks are relative to it.
pub fn add_to_scene(
    file: &mut SceneFile,
    scene: &Scene,
    segmentation: &Segmentation,
    method: Method,
    folders: [&Path; 2],
    out_masks: Option<&Path>,
) -> anyhow::Result<()> {
    move_paths(file, folders)?;
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
    let names = FileNames::new(frames.keys().map(|&frame| scene.frames[frame].id.as_str()));
    for ((&frame, detections), name) in frames.iter().zip(names.iter()) {
        let size = image_size(scene, frame, detections, segmentation);
        let size = size.unwrap_or_else(|| {
            reach(detections.iter().filter_map(|&index| Some(&segmentation.found[index].as_ref()?.mask)))
        });
        let masks = detections.iter().filter_map(|&index| Some((index, &segmentation.found[index].as_ref()?.mask)));
        let masks: Vec<(usize, &Mask)> = masks.collect();
        match out_masks {
            Some(folder) => write_masks(file, &masks, size, folder, name, folders[1])?,
            // Given masks stay as they are.
            None if method == Method::Masks => {}
            None => {
                for (index, mask) in masks {
                    file.detections[index].mask = in_runs(mask, size)?;
                }
            }
        }
    }
    Ok(())
}

/// Changes the paths of images and masks when the scene file moves from the first folder to the second one.
pub fn move_paths(file: &mut SceneFile, folders: [&Path; 2]) -> anyhow::Result<()> {
    let move_path = relocation(folders)?;
    for image in file.frames.iter_mut().filter_map(|frame| frame.image.as_mut()) {
        *image = move_path(image);
    }
    for path in file.detections.iter_mut().filter_map(|d| d.mask.as_mut()?.path.as_mut()) {
        *path = move_path(path);
    }
    Ok(())
}

/// The ellipse of a detection and how it was found.
fn describe(record: &mut DetectionRecord, found: &Found, method: Method) {
    let status = match (found.fell_back, method) {
        (Some(_), _) => "fell_back",
        (None, Method::Image(SegmentMethod::Box)) => "box",
        (None, _) => "ok",
    };
    record.ellipse = Some(Box::new(EllipseRecord {
        center: found.ellipse.center.into(),
        semi_axes: found.ellipse.semi_axes.into(),
        angle: found.ellipse.angle,
        ..Default::default()
    }));
    let share = |share: f64| (share > 0.0).then_some(share);
    record.segmentation = Some(Box::new(SegmentationRecord {
        method: method.name().to_owned(),
        status: status.to_owned(),
        reason: found.fell_back.map(|failure| failure.name().to_owned()),
        confidence: found.confidence,
        cut_by_border: share(found.contacts.border),
        touches_others: share(found.contacts.others),
        ..Default::default()
    }));
}

/// A mask as COCO's runs; none where it is empty.
fn in_runs(mask: &Mask, [width, height]: [u32; 2]) -> anyhow::Result<Option<Box<MaskRecord>>> {
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
) -> anyhow::Result<()> {
    if u64::from(width) * u64::from(height) > MOST_PIXELS {
        bail!("cannot write the masks of {name}: an image of {width} x {height} pixels is too large");
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
            path: Some(relative(scene_folder, &folder.join(layer_name(name, layer)))?),
            value: Some(counts[layer].into()),
            ..Default::default()
        }));
    }
    for (layer, values) in layers.into_iter().enumerate() {
        let labels = LabelImage::new(width, height, values)?;
        write_label_image(&folder.join(layer_name(name, layer)), &labels)?;
    }
    Ok(())
}

fn layer_name(name: &str, layer: usize) -> String {
    // No name of a frame holds this sign.
    if layer == 0 { format!("{name}.png") } else { format!("{name}+{layer}.png") }
}

/// What becomes of the relative path of an image when the scene file moves from the first folder to the second one.
fn relocation([from, to]: [&Path; 2]) -> anyhow::Result<impl Fn(&str) -> String> {
    let [from, to] = [absolute(from)?, absolute(to)?];
    Ok(move |path: &str| {
        if from == to || Path::new(path).is_absolute() {
            return path.to_owned();
        }
        // The folder is free of links: ".." is the folder above. Behind the first name of the path it may not be.
        let mut whole = from.clone();
        let mut rest = Path::new(path).components();
        while matches!(rest.clone().next(), Some(Component::ParentDir | Component::CurDir)) {
            if rest.next() == Some(Component::ParentDir) {
                whole.pop();
            }
        }
        whole.extend(rest);
        between(&to, &whole)
    })
}

/// The path of a file in an existing folder, seen from another folder.
fn relative(from: &Path, file: &Path) -> anyhow::Result<String> {
    let folder = absolute(file.parent().unwrap_or(Path::new("")))?;
    let name = file.file_name().context("the file has no name")?;
    Ok(between(&absolute(from)?, &folder.join(name)))
}

/// The way from a folder to a file, with slashes; both are absolute.
fn between(from: &Path, to: &Path) -> String {
    let (from, to): (Vec<Component>, Vec<Component>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if common == 0 {
        // Another drive.
        return to.iter().collect::<PathBuf>().display().to_string();
    }
    let up = std::iter::repeat_n("..".to_owned(), from.len() - common);
    let down = to[common..].iter().map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// A folder without links and without "..".
fn absolute(folder: &Path) -> anyhow::Result<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    folder.canonicalize().with_context(|| format!("cannot find the folder {}", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_follow_the_scene_file() {
        let folder = tempfile::tempdir().unwrap();
        let [scenes, results] = ["data/scenes", "results"].map(|name| folder.path().join(name));
        std::fs::create_dir_all(&scenes).unwrap();
        std::fs::create_dir_all(&results).unwrap();
        let there = relocation([&scenes, &results]).unwrap();
        assert_eq!(there("rgb/a.png"), "../data/scenes/rgb/a.png");
        assert_eq!(there("./../lmo/a.png"), "../data/lmo/a.png");
        assert_eq!(there("../lmo/../b/a.png"), "../data/lmo/../b/a.png", "lmo may be a link");
        assert_eq!(relocation([&results, &results]).unwrap()("./a/../b.png"), "./a/../b.png");
        assert_eq!(relative(&results, &scenes.join("a.png")).unwrap(), "../data/scenes/a.png");
        assert_eq!(relative(&results, &results.join("a.png")).unwrap(), "a.png");
    }

    #[cfg(unix)]
    #[test]
    fn absolute_paths_stay() {
        let folder = tempfile::tempdir().unwrap();
        let there = relocation([folder.path(), Path::new("/")]).unwrap();
        assert_eq!(there("/images/a.png"), "/images/a.png");
    }

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
        let labels = quadlift_io::read_label_image(&folder.path().join("a+1.png")).unwrap();
        assert_eq!(labels.mask(1), masks[1]);
        let labels = quadlift_io::read_label_image(&folder.path().join("a.png")).unwrap();
        assert_eq!([labels.mask(1), labels.mask(2)], [masks[0].clone(), masks[2].clone()]);
    }
}
