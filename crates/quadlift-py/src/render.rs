//! A picture of one frame, as `quadlift render` draws it.

use std::path::Path;

use pyo3::prelude::*;
use quadlift::scene::Scene;
use quadlift_io::{SceneFile, write_file, write_png};
use quadlift_report::{Content, Picture, frame_image, report_of_frames};

use crate::error::refuse;
use crate::loaded::Loaded;

/// What is drawn, and where to.
pub(crate) struct Drawing<'a> {
    pub frame: &'a str,
    pub output: &'a Path,
    pub labels: bool,
    pub source: Option<&'a str>,
}

/// Draws a frame of a scene with its detections, estimates and ground truth; the ending of the file selects PNG or SVG.
pub(crate) fn render(
    loaded: &Loaded,
    scene: &Scene,
    (estimate, truth): (Option<&SceneFile>, Option<&SceneFile>),
    drawing: &Drawing,
) -> PyResult<()> {
    let Drawing { frame, output, labels, source } = *drawing;
    let ending = output.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let is_svg = match ending.as_deref() {
        Some("svg") => true,
        Some("png") => false,
        _ => return Err(refuse(format!("path is {}; expected a name that ends in .png or .svg", output.display()))),
    };
    loaded.check_output(output)?;
    let Some(index) = scene.frames.iter().position(|known| known.id == frame) else {
        let some: Vec<&str> = scene.frames.iter().take(5).map(|frame| frame.id.as_str()).collect();
        let count = scene.frames.len();
        return Err(refuse(format!("frame is \"{frame}\"; expected one of {count} frames: {}", some.join(", "))));
    };
    scene.source_index(source).map_err(|error| refuse(format!("{error} (source=...)")))?;
    let mut images = loaded.file().to_images(&loaded.path).map_err(refuse)?;
    images.videos = loaded.videos.clone();
    images.videos.want([index]);
    let image = match images.images.get(index) {
        Some(Some(_)) => Some(frame_image(scene, &images, index, u32::MAX).map_err(refuse)?.image),
        _ => None,
    };
    let content = Content { title: "", scene, images: None, estimate, truth, source, points: &[], scores: None };
    let report = report_of_frames(&content, &[index]).map_err(refuse)?;
    let picture = Picture { report: &report, frame_index: 0, image: image.as_ref(), labels };
    if is_svg {
        let svg = picture.svg().map_err(refuse)?;
        return write_file(output, |file| file.write_all(svg.as_bytes())).map_err(refuse);
    }
    write_png(output, &picture.bitmap().map_err(refuse)?).map_err(refuse)
}
