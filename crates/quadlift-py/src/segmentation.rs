//! Segmenting the detections of a scene in their images.

use std::fs::create_dir_all;
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use quadlift::Observer;
use quadlift::scene::SourceError;
use quadlift_io::SceneFile;
use quadlift_io::segmentation::{SEGMENTATION, SegmentSceneError, Settings, Step, add_to_scene, segment_scene};

use crate::loaded::Loaded;
use crate::options::{Chosen, chosen};
use crate::run::Ticker;

/// The keywords of `segment`, as Python hands them over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SegmentKeywords {
    /// Those of [`SEGMENTATION`] that are given.
    chosen: Chosen,
    out_masks: Option<PathBuf>,
}

impl SegmentKeywords {
    /// Checks the options.
    pub(crate) fn settings(&self) -> PyResult<Settings> {
        chosen(SEGMENTATION, &self.chosen)
    }

    /// Segments a scene: the file with what was found, as the program writes it, and what went wrong, in words.
    pub(crate) fn segmented(
        self,
        settings: &Settings,
        loaded: &Loaded,
        ticker: &Ticker,
    ) -> Result<(SceneFile, Vec<String>), String> {
        let (file, scene, path) = (loaded.file(), &loaded.scene, &loaded.path);
        let images = file.to_images(path).map_err(|error| error.to_string())?;
        if let Some(folder) = &self.out_masks
            && let Some(path) = folder.canonicalize().ok().and_then(|folder| images.any_in(&folder))
        {
            return Err(format!(
                "out_masks is the folder of {}, which could be overwritten; choose another one",
                path.display()
            ));
        }
        let segmentation = segment_scene(scene, &images, settings, &|step, done, total| {
            let next = ticker.progress(done, total);
            if step == Step::Images && done == total {
                ticker.restart();
            }
            next
        });
        let segmentation = segmentation.map_err(|error| match error {
            SegmentSceneError::Source(error @ SourceError::Several(_)) => format!("{error} (source=...)"),
            error => error.to_string(),
        })?;
        let problems = segmentation.problems.in_words(scene);
        if segmentation.found.iter().all(Option::is_none) {
            return Err([vec!["no detection could be segmented".to_owned()], problems].concat().join("\n"));
        }
        if let Some(folder) = &self.out_masks {
            create_dir_all(folder).map_err(|error| format!("cannot make the folder {}: {error}", folder.display()))?;
        }
        let mut file = SceneFile::clone(file);
        let folder = path.parent().unwrap_or(Path::new(""));
        add_to_scene(&mut file, scene, &segmentation, settings.method, [folder, folder], self.out_masks.as_deref())
            .map_err(|error| error.to_string())?;
        Ok((file, problems))
    }
}

/// Sets how many pixels an image or mask may have.
#[pyfunction]
pub(crate) fn set_max_pixels(pixels: u64) {
    quadlift_io::images::set_max_pixels(pixels);
}
