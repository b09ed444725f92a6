//! The content of a Rerun recording; it is logged in Python.

use std::path::Path;

use pyo3::prelude::*;
use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::scene_file::SceneImages;
use quadlift_io::video::frame_of_video;
use quadlift_report::{Content, frame_jpeg, recording};

use crate::error::refuse;
use crate::loaded::Loaded;

/// Quality of the JPEG images, as the program writes them.
const QUALITY: u8 = 90;

/// The recording as JSON, without its images, and for each of its frames the index of that of the scene.
pub(crate) fn recorded(
    title: &str,
    loaded: &Loaded,
    scene: &Scene,
    estimate: &SceneFile,
    truth: Option<&SceneFile>,
) -> PyResult<(String, Vec<usize>)> {
    let content = Content {
        title,
        scene,
        images: None,
        estimate: Some(estimate),
        truth,
        source: None,
        points: &[],
        scores: None,
    };
    let times: Vec<Option<f64>> = loaded.file().frames.iter().map(|frame| frame.time).collect();
    let recording = recording(&content, &times).map_err(refuse)?;
    let frames = recording.frames.iter().map(|frame| frame.frame_index).collect();
    Ok((serde_json::to_string(&recording).map_err(refuse)?, frames))
}

/// The image of a frame as its pinhole camera sees it, as JPEG, and its width and height; none where it names none.
pub(crate) fn jpeg(loaded: &Loaded, frame_index: usize) -> PyResult<Option<(Vec<u8>, [u32; 2])>> {
    let Some(image) = loaded.file().frames.get(frame_index).and_then(|frame| frame.image.as_ref()) else {
        return Ok(None);
    };
    let path = |image: &String| loaded.path.parent().unwrap_or(Path::new("")).join(image);
    // A recording asks for one after another: for this one alone, but of a video for all, which are decoded together.
    let paths = if frame_of_video(Path::new(image)).is_some() {
        loaded.file().frames.iter().map(|frame| frame.image.as_ref().map(path)).collect()
    } else {
        let mut paths = vec![None; frame_index];
        paths.push(Some(path(image)));
        paths
    };
    let images = SceneImages {
        scene_file: loaded.path.clone(),
        images: paths,
        masks: Vec::new(),
        boxes: Vec::new(),
        videos: loaded.videos.clone(),
    };
    frame_jpeg(&loaded.scene, &images, frame_index, u32::MAX, QUALITY).map(Some).map_err(refuse)
}
