//! `render`: rendered scenes as files: images, true masks and the scene file that names them.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use quadlift_io::scene_file::MaskRecord;
use quadlift_io::synthetic_file::scene_file;
use quadlift_io::{SceneFile, write_file, write_label_image, write_png, write_scene_file};
use quadlift_segment::image::RgbImage;
use quadlift_segment::image::codecs::jpeg::JpegEncoder;

use super::objects::ObjectKind;
use super::options::RenderOptions;
use super::{RenderedScene, render};

/// Folders of the images and of the masks, beside the scene file.
const FOLDERS: [&str; 2] = ["images", "masks"];

/// Options of rendered scenes; the rest is that of [`RenderOptions::default`].
#[derive(clap::Args)]
pub struct Args {
    /// New folder for scene.json, with the true objects, images and masks
    #[arg(value_name = "DIR")]
    folder: PathBuf,

    /// Number of objects
    #[arg(long, value_name = "N", default_value_t = 4)]
    objects: usize,

    /// Number of views
    #[arg(long, value_name = "N", default_value_t = 20)]
    views: usize,

    /// Width and height of the images in pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "480x360", value_parser = image_size)]
    image_size: [u32; 2],

    /// Kinds of objects, used in turn [default: all, and a third of them ellipsoids]
    #[arg(long, value_name = "KIND,...", value_delimiter = ',', value_parser = kind)]
    kinds: Vec<ObjectKind>,

    /// Noise of the boxes' edges, relative to the mean half size
    #[arg(long, value_name = "SD", default_value_t = 0.0)]
    box_noise: f64,

    /// Write images as JPEG of this quality instead of PNG
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

fn image_size(text: &str) -> Result<[u32; 2], String> {
    let size = text.split_once('x').map(|(width, height)| [width.parse(), height.parse()]);
    match size {
        Some([Ok(width), Ok(height)]) => Ok([width, height]),
        _ => Err("expected WIDTHxHEIGHT in pixels, such as 640x480".to_owned()),
    }
}

fn kind(text: &str) -> Result<ObjectKind, String> {
    ObjectKind::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| {
        let names: Vec<&str> = ObjectKind::ALL.iter().map(|kind| kind.name()).collect();
        format!("expected {}", names.join(", "))
    })
}

/// Renders a scene and writes its files.
///
/// # Errors
/// The folder exists already, an option is out of its range, or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let folder = &args.folder;
    if folder.exists() {
        bail!("cannot write to {}: it exists; expected a new folder", folder.display());
    }
    let defaults = RenderOptions::default();
    let [width, height] = args.image_size;
    let rendered = render(&RenderOptions {
        seed: args.seed,
        objects: args.objects,
        kinds: if args.kinds.is_empty() { defaults.kinds } else { args.kinds.clone() },
        views: args.views,
        width,
        height,
        box_noise: args.box_noise,
        ..defaults
    })?;
    for name in FOLDERS {
        let inner = folder.join(name);
        std::fs::create_dir_all(&inner).with_context(|| format!("cannot make the folder {}", inner.display()))?;
    }
    let mut file = scene_file(&rendered.synthetic);
    write_images(&rendered, args.jpeg, folder, &mut file)?;
    write_masks(&rendered, folder, &mut file)?;
    for (record, &visible_fraction) in file.detections.iter_mut().zip(&rendered.visible_fractions) {
        record.visible_fraction = Some(visible_fraction);
    }
    for (object, kind) in file.objects.iter_mut().zip(&rendered.kinds) {
        object.category = Some(kind.name().to_owned());
    }
    Ok(write_scene_file(&folder.join("scene.json"), &file)?)
}

/// Writes the images, and their names into the scene.
fn write_images(rendered: &RenderedScene, jpeg: Option<u8>, folder: &Path, file: &mut SceneFile) -> anyhow::Result<()> {
    for (frame, image) in file.frames.iter_mut().zip(&rendered.images) {
        let name = format!("{}/{}.{}", FOLDERS[0], frame.id, if jpeg.is_some() { "jpg" } else { "png" });
        match jpeg {
            Some(quality) => write_jpeg(&folder.join(&name), image, quality)?,
            None => write_png(&folder.join(&name), image)?,
        }
        frame.image = Some(name);
    }
    Ok(())
}

fn write_jpeg(path: &Path, image: &RgbImage, quality: u8) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    image.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality))?;
    Ok(write_file(path, |out| out.write_all(&bytes))?)
}

/// Writes the label images of the true masks, and their names into the scene.
fn write_masks(rendered: &RenderedScene, folder: &Path, file: &mut SceneFile) -> anyhow::Result<()> {
    let name = |frame: usize| format!("{}/{}.png", FOLDERS[1], rendered.synthetic.frames[frame].id);
    for (frame, labels) in rendered.labels.iter().enumerate() {
        write_label_image(&folder.join(name(frame)), labels)?;
    }
    let detections = rendered.synthetic.scene.detections.iter().zip(&rendered.values);
    for (record, (detection, &value)) in file.detections.iter_mut().zip(detections) {
        record.mask = Some(Box::new(MaskRecord {
            path: Some(name(detection.frame_index as usize)),
            value: Some(value.into()),
            ..Default::default()
        }));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift_io::{read_label_image, read_scene_file};

    #[test]
    fn sizes_and_kinds_are_read() {
        assert_eq!(image_size("640x480"), Ok([640, 480]));
        assert!(image_size("640").is_err() && image_size("-1x5").is_err());
        assert_eq!((kind("mug"), kind("cup").is_err()), (Ok(ObjectKind::Mug), true));
    }

    #[test]
    fn the_scene_names_images_and_masks() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("scene");
        let args = |jpeg| Args {
            folder: folder.clone(),
            objects: 2,
            views: 3,
            image_size: [80, 60],
            kinds: Vec::new(),
            box_noise: 0.0,
            jpeg,
            seed: 4,
        };
        for (jpeg, ending) in [(None, "png"), (Some(80), "jpg")] {
            run(&args(jpeg)).unwrap();
            let path = folder.join("scene.json");
            let file = read_scene_file(&path).unwrap();
            let scene = file.to_scene().unwrap();
            let images = file.to_images(&path).unwrap();
            assert_eq!((scene.frames.len(), file.objects.len()), (3, 2));
            for (index, frame) in file.frames.iter().enumerate() {
                assert!(frame.image.as_ref().unwrap().ends_with(ending));
                assert_eq!(images.read_image(&scene, index).unwrap().dimensions(), (80, 60));
            }
            for record in &file.detections {
                let mask = record.mask.as_ref().unwrap();
                let labels = read_label_image(&folder.join(mask.path.as_ref().unwrap())).unwrap();
                let value = u16::try_from(mask.value.unwrap()).unwrap();
                assert_eq!(labels.mask(value).bounding_box().unwrap().edges(), record.bounding_box.unwrap());
            }
            assert!(run(&args(jpeg)).unwrap_err().to_string().contains("it exists"));
            std::fs::remove_dir_all(&folder).unwrap();
        }
    }
}
