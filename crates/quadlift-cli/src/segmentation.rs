//! Segmenting one scene with progress bars: what `segment` and `demo` share.

use std::ops::ControlFlow;

use anyhow::bail;
use quadlift::scene::{Scene, SourceError};
use quadlift_io::scene_file::SceneImages;
use quadlift_io::segmentation::{self, SegmentSceneError, Segmentation, Settings, Step};

use crate::output::Output;
use crate::progress::counting_bar;

/// Segments the detections of a scene; `title` precedes the progress bars.
pub fn segment_scene(
    title: &str,
    scene: &Scene,
    images: &SceneImages,
    settings: &Settings,
    out: &Output,
) -> anyhow::Result<Segmentation> {
    let (of_images, of_objects) = (counting_bar(title, "images", out), counting_bar(title, "objects", out));
    let result = segmentation::segment_scene(scene, images, settings, &|step, done, total| {
        let bar = match step {
            Step::Images => &of_images,
            Step::Objects => &of_objects,
        };
        bar.set_length(total as u64);
        bar.set_position(done as u64);
        if done == total {
            bar.finish_and_clear();
        }
        ControlFlow::Continue(())
    });
    of_images.finish_and_clear();
    match result {
        Err(SegmentSceneError::Source(error @ SourceError::Several(_))) => bail!("{error} (--source NAME)"),
        result => Ok(result?),
    }
}
