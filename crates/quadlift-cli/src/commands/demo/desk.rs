//! The scene of the demo: rendered photographs of a desk and what a simulated detector finds in them, as files; and a copy
//! with wrong poses. The files are in `assets/demo`.

use std::path::Path;

use quadlift::geometry::Body;
use quadlift_io::scene_file::ObjectBodies;
use quadlift_io::{SceneFile, read_scene_file, write_file, write_scene_file};
use serde::Deserialize;

use crate::files::make_folder;

/// Names of the files in the folder of the demo.
pub(super) const SCENE: &str = "scene.json";
pub(super) const GROUND_TRUTH: &str = "truth.json";
pub(super) const WRONG: &str = "wrong-poses.json";

/// Files of `assets/demo`: their names and contents.
macro_rules! files {
    ($($name:expr),* $(,)?) => {
        [$(($name, include_bytes!(concat!("../../../assets/demo/", $name)) as &[u8])),*]
    };
}

/// For each frame its image and the boxes in it as YOLO's labels.
macro_rules! frames {
    ($($name:literal),* $(,)?) => {
        [files![$(concat!("images/", $name, ".jpg")),*], files![$(concat!("labels/", $name, ".txt")),*]]
    };
}

const FRAMES: [[(&str, &[u8]); 16]; 2] = frames![
    "000000", "000001", "000002", "000003", "000004", "000005", "000006", "000007", "000008", "000009", "000010",
    "000011", "000012", "000013", "000014", "000015",
];

/// The scene, the truth, and the cameras and classes as files of COLMAP and YOLO.
const OTHERS: [(&str, &[u8]); 5] =
    files!["scene.json", "truth.json", "sparse/0/cameras.txt", "sparse/0/images.txt", "data.yaml"];

/// What each detection shows.
const SHOWN: &[u8] = include_bytes!("../../../assets/demo/shown.json");

/// The desk and the ground truth.
pub(super) struct Desk {
    /// Cameras and detections.
    pub scene: SceneFile,
    /// Names and bodies of the true objects.
    pub truth: Vec<(String, Option<Body>)>,
    /// For each detection, the index of the true object that it shows.
    pub true_objects: Vec<Option<usize>>,
    /// For each detection, whether it is a false positive or far off.
    pub outliers: Vec<bool>,
}

/// The content of `shown.json`.
#[derive(Deserialize)]
struct Shown {
    true_objects: Vec<Option<usize>>,
    outliers: Vec<usize>,
}

/// Whether a folder is that of an earlier demo: its scene is the demo's.
pub(super) fn is_of_demo(folder: &Path) -> bool {
    let scene = OTHERS.iter().find(|(name, _)| *name == SCENE);
    scene.is_some_and(|(name, bytes)| std::fs::read(folder.join(name)).is_ok_and(|found| found == *bytes))
}

/// The names of all files that [`Desk::write`] writes.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    OTHERS.iter().chain(FRAMES.iter().flatten()).map(|(name, _)| *name).chain([WRONG])
}

impl Desk {
    /// Writes images, scene, truth, the scene for other programs, and the scene with wrong poses.
    pub(super) fn write(folder: &Path) -> anyhow::Result<Self> {
        for name in ["images", "labels", "sparse/0"] {
            make_folder(&folder.join(name))?;
        }
        for (name, bytes) in FRAMES.iter().flatten().chain(&OTHERS) {
            write_file(&folder.join(name), |out| out.write_all(bytes))?;
        }
        let [scene, truth] = [SCENE, GROUND_TRUTH].map(|name| read_scene_file(&folder.join(name)));
        let (scene, truth) = (scene?, truth?);
        write_scene_file(&folder.join(WRONG), &with_opengl_axes(&scene))?;
        let shown: Shown = serde_json::from_slice(SHOWN)?;
        let ids = truth.objects.iter().map(|object| object.id.clone());
        let bodies: Vec<_> = truth.to_objects()?.iter().map(ObjectBodies::body).collect();
        let outliers = (0..scene.detections.len()).map(|index| shown.outliers.contains(&index)).collect();
        Ok(Self { scene, truth: ids.zip(bodies).collect(), true_objects: shown.true_objects, outliers })
    }
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
