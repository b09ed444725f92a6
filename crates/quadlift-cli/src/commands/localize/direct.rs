//! `localize --cameras --detections`: the scene is made of other programs' files, whose formats are recognized.

use std::path::{Path, PathBuf};

use anyhow::Context;
use quadlift_io::SceneFile;
use quadlift_io::correct::DetectionPixels;
use quadlift_io::formats::{find_cameras, find_detections};
use quadlift_io::read::detections::add_detections;
use quadlift_io::read::{Import, ReadOptions};

use crate::commands::import::matching::Matching;
use crate::commands::import::paths::{prefix_images, relative_to_file};
use crate::commands::import::words::{in_words, notes, tell_problems};
use crate::output::{Output, one_line};
use crate::reading::{Given, Localize, Reading};
use crate::words::count;

/// Cameras and detections in other programs' files.
#[derive(clap::Args)]
#[command(next_help_heading = "Files of other programs")]
pub(super) struct DirectArgs {
    /// Cameras and poses: whatever `quadlift import` reads, or a scene file
    #[arg(long, value_name = "PATH", requires = "detections")]
    cameras: Option<PathBuf>,

    /// Detections: whatever `quadlift import` adds to a scene
    #[arg(long, value_name = "PATH", requires = "cameras")]
    detections: Option<PathBuf>,

    #[command(flatten)]
    matching: Matching,

    #[command(flatten)]
    reading: Reading<Localize>,
}

impl DirectArgs {
    /// The minimum score of detections.
    pub(super) fn min_score(&self) -> Option<f64> {
        self.matching.min_score
    }

    /// The options of readers that were given.
    pub(super) fn given(&self) -> &Given<ReadOptions> {
        &self.reading.given
    }

    /// Paths of cameras and detections, if given.
    pub(super) fn paths(&self) -> Option<(&Path, &Path)> {
        self.cameras.as_deref().zip(self.detections.as_deref())
    }

    /// The scene, with the detections of one source. Paths of images are relative to the output. What was read is
    /// reported. Returns the number that the detections give to the frame number 0 too.
    pub(super) fn read(
        &self,
        [cameras, detections]: [&Path; 2],
        output: Option<&Path>,
        (source, pixels): (Option<&str>, DetectionPixels),
        out: &Output,
    ) -> anyhow::Result<(SceneFile, i64)> {
        let (camera_format, camera_path) = find_cameras(cameras)?;
        let format = find_detections(detections)?;
        let found = format!("the cameras are {}, the detections {}", camera_format.name, format.name);
        self.given().check(&[camera_format.options, format.options, &["time_tolerance"]], &found)?;
        let options = self.given().options();
        let options = ReadOptions {
            image_size: options.image_size.or(pixels.image_size),
            detections: Some(detections.to_owned()),
            boxes_follow: pixels.boxes_follow,
            ..options
        };
        let import = (camera_format.read)(&camera_path, &options)?;
        tell_problems(&import, out);
        let (mut file, camera_notes) = placed(import, &camera_path, output)?;
        let found = (format.read)(detections, &options)?;
        let found_notes = found.notes.clone();
        let source = source.unwrap_or(format.name);
        let mut adding = self.matching.options(source, pixels, format, &options);
        // Cameras may come with detections, such as KITTI labels.
        adding.replace = true;
        file.objects.clear();
        let added = add_detections(&mut file, found, &adding)?;
        let mut text = format!(
            "{}: {}, {}\n{}: {}, {}\n",
            cameras.display(),
            camera_format.name,
            count(file.frames.len(), "frame"),
            detections.display(),
            format.name,
            one_line(&in_words(&added, source))
        );
        for note in [camera_notes, found_notes, notes(&added)].concat() {
            text.push_str(&format!("- {}\n", one_line(&note)));
        }
        out.report(&format!("{text}\n"))?;
        Ok((file, added.frame_offset))
    }
}

/// The scene of cameras that were read, with paths that are relative to the output, and notes.
fn placed(import: Import, path: &Path, output: Option<&Path>) -> anyhow::Result<(SceneFile, Vec<String>)> {
    let Import { mut scene, image_folder, notes, is_scene, .. } = import;
    let Some(output) = output else { return Ok((scene, notes)) };
    if is_scene {
        scene.move_paths([path, output].map(|path| path.parent().unwrap_or(Path::new(""))))?;
    } else if let Some(folder) = image_folder {
        let prefix = relative_to_file(&folder, output)
            .with_context(|| format!("cannot find the folder {}", folder.display()))?;
        prefix_images(&mut scene, &prefix, &prefix);
    }
    Ok((scene, notes))
}
