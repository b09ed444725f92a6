//! The scene of the demo: photographs of a desk and what a detector finds in them, as files; and a copy with wrong poses.

use std::path::Path;

use anyhow::Context;
use quadlift_io::{SceneFile, write_jpeg, write_scene_file};
use quadlift_segment::render::{DeskOptions, RenderedDesk, render_desk};

use crate::files::make_folder;
use crate::synthetic_file::scene_file;

/// Quality of the images.
const QUALITY: u8 = 90;

/// Names of the files in the folder of the demo.
pub const SCENE: &str = "scene.json";
pub const TRUTH: &str = "truth.json";
pub const WRONG: &str = "wrong-poses.json";

/// Photographs the desk.
pub fn photographs() -> anyhow::Result<RenderedDesk> {
    render_desk(&DeskOptions { views: 16, ..DeskOptions::default() }).context("cannot render the desk")
}

/// Writes images, scene, truth and the scene with wrong poses; gives the scene.
pub fn write(desk: &RenderedDesk, folder: &Path) -> anyhow::Result<SceneFile> {
    make_folder(&folder.join("images"))?;
    let mut file = SceneFile { name: Some("desk".to_owned()), ..scene_file(&desk.synthetic) };
    for (frame, image) in file.frames.iter_mut().zip(&desk.images) {
        let name = format!("images/{}.jpg", frame.id);
        write_jpeg(&folder.join(&name), image, QUALITY)?;
        frame.image = Some(name);
    }
    let scene = &desk.synthetic.scene;
    for (record, detection) in file.detections.iter_mut().zip(&scene.detections) {
        let category = detection.category_index.map(|index| scene.categories[index as usize].as_str().into());
        (record.category, record.score) = (category, detection.score.map(|score| (100.0 * score).round() / 100.0));
        record.bounding_box = record.bounding_box.map(|edges| edges.map(|x| (10.0 * x).round() / 10.0));
    }
    for (object, category) in file.objects.iter_mut().zip(&desk.categories) {
        object.category = Some((*category).to_owned());
    }
    let truth = SceneFile { detections: Vec::new(), ..file.clone() };
    write_scene_file(&folder.join(TRUTH), &truth)?;
    // The output of a detector contains no ground truth.
    file.objects = Vec::new();
    write_scene_file(&folder.join(SCENE), &file)?;
    write_scene_file(&folder.join(WRONG), &with_opengl_axes(&file))?;
    Ok(file)
}

/// The scene as a program would write it whose cameras look along -z with y upwards, as in OpenGL.
fn with_opengl_axes(file: &SceneFile) -> SceneFile {
    let mut wrong = SceneFile { name: Some("desk with wrong poses".to_owned()), ..file.clone() };
    for pose in wrong.frames.iter_mut().filter_map(|frame| frame.cam_from_world.as_mut()) {
        for row in &mut pose[1..] {
            *row = row.map(|x| -x);
        }
    }
    wrong
}
