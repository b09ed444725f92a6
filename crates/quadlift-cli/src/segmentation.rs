//! Segmenting one scene with a progress bar: what `segment` and `demo` share.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::bail;
use quadlift::Observer;
use quadlift::scene::{Scene, SourceError};
use quadlift_io::scene_file::SceneImages;
use quadlift_io::segmentation::{self, SegmentSceneError, Segmentation, Settings, Step};

use crate::output::Output;
use crate::progress::RunProgress;

/// Segments the detections of a scene; `title` precedes the progress bar.
pub(crate) fn segment_scene(
    title: &str,
    scene: &Scene,
    images: &SceneImages,
    settings: &Settings,
    out: &Output,
) -> anyhow::Result<Segmentation> {
    let progress = RunProgress::new(title, out);
    progress.begin("reading images", 0.3);
    let is_reading = AtomicBool::new(true);
    // Objects are segmented after all images were read.
    let result = segmentation::segment_scene(scene, images, settings, &|step, done, total| {
        if step == Step::Objects && is_reading.swap(false, Ordering::Relaxed) {
            progress.begin("segmenting objects", 1.0);
        }
        progress.progress(done, total)
    });
    drop(progress);
    match result {
        Err(SegmentSceneError::Source(error @ SourceError::Several(_))) => bail!("{error} (--source SOURCE)"),
        result => Ok(result?),
    }
}
