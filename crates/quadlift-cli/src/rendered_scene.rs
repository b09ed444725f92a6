//! Rendered scenes as files: images, true masks and the scene file that names them.

use std::path::{Path, PathBuf};

use anyhow::bail;
use quadlift_io::scene_file::MaskRecord;
use quadlift_io::{SceneFile, write_label_image, write_png};
use quadlift_segment::render::RenderedScene;

use crate::files::make_folder;
use quadlift_io::synthetic_file::scene_file;

/// Folders of the images and of the masks, beside the scene file.
const FOLDERS: [&str; 2] = ["images", "masks"];

/// Rejects existing folders for images and masks beside a new scene file: they may contain the user's files.
pub(crate) fn check_folders(scene_file: &Path) -> anyhow::Result<()> {
    for folder in folders(scene_file) {
        let taken = folder.exists() && !std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_none());
        if taken && !scene_file.exists() {
            bail!("cannot write to {}: it exists and is not empty; choose a new or empty folder", folder.display());
        }
    }
    Ok(())
}

/// Writes the images of a rendered scene beside the scene file and returns its content, with the ground truth.
pub(crate) fn write_images(rendered: &RenderedScene, path: &Path) -> anyhow::Result<SceneFile> {
    let [images, _] = folders(path);
    make_folder(&images)?;
    let mut file = scene_file(&rendered.synthetic);
    for (index, frame) in file.frames.iter_mut().enumerate() {
        write_png(&images.join(image_name(rendered, index)), &rendered.images[index])?;
        frame.image = Some(format!("{}/{}", FOLDERS[0], image_name(rendered, index)));
    }
    for (record, &visible_fraction) in file.detections.iter_mut().zip(&rendered.visible_fractions) {
        record.visible_fraction = Some(visible_fraction);
    }
    for (object, kind) in file.objects.iter_mut().zip(&rendered.kinds) {
        object.category = Some(kind.name().to_owned());
    }
    Ok(file)
}

/// Writes the label images of the true masks beside the scene file, and their names into its content.
pub(crate) fn write_masks(rendered: &RenderedScene, path: &Path, file: &mut SceneFile) -> anyhow::Result<()> {
    let [_, masks] = folders(path);
    make_folder(&masks)?;
    for (index, labels) in rendered.labels.iter().enumerate() {
        write_label_image(&masks.join(image_name(rendered, index)), labels)?;
    }
    for (index, detection) in rendered.synthetic.scene.detections.iter().enumerate() {
        file.detections[index].mask = Some(Box::new(MaskRecord {
            path: Some(format!("{}/{}", FOLDERS[1], image_name(rendered, detection.frame_index as usize))),
            value: Some(rendered.values[index].into()),
            ..Default::default()
        }));
    }
    Ok(())
}

/// The name of a frame's image and of its label image.
fn image_name(rendered: &RenderedScene, frame: usize) -> String {
    format!("{}.png", rendered.synthetic.frames[frame].id)
}

fn folders(scene_file: &Path) -> [PathBuf; 2] {
    FOLDERS.map(|name| scene_file.parent().unwrap_or(Path::new("")).join(name))
}
