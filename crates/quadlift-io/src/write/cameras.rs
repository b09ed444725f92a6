//! Cameras of a scene file, as given or refined, for programs that reconstruct from images: TUM trajectories and COLMAP models (text).

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use nalgebra::{Matrix3x4, Rotation3, Vector3};
use quadlift::geometry::{CamFromWorld, quaternion_from_rotation};

use super::Document;
use super::format::{ExportFormat, Writer};
use crate::error::EntryError;
use crate::scene_file::{FrameRecord, SceneFile};
use crate::time_steps::time_steps;
use crate::wording::count;

/// Names of the files of a COLMAP model, in the order of [`colmap_model`].
pub(super) const COLMAP_FILES: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];

/// A frame with its camera and pose.
struct Posed<'a> {
    frame: &'a FrameRecord,
    /// Index of the frame.
    index: usize,
    camera: &'a str,
    rotation: Rotation3<f64>,
    translation: Vector3<f64>,
}

/// The frames that have a camera and a pose, and notes about the others.
fn posed(file: &SceneFile) -> Result<(Vec<Posed<'_>>, Vec<String>), EntryError> {
    let mut all = Vec::with_capacity(file.frames.len());
    let (mut projections, mut without_pose) = (0, 0);
    for (index, frame) in file.frames.iter().enumerate() {
        let (Some(camera), Some(rows)) = (&frame.camera, &frame.cam_from_world) else {
            *if frame.projection.is_some() { &mut projections } else { &mut without_pose } += 1;
            continue;
        };
        let entry = |field: &str| format!("frames[{index}]{field}");
        let pose = CamFromWorld::new(Matrix3x4::from_fn(|i, j| rows[i][j]))
            .map_err(|error| EntryError::new(entry(".cam_from_world"), error))?;
        let rotation = Rotation3::from_matrix_unchecked(pose.matrix().fixed_columns::<3>(0).into_owned());
        let translation = pose.matrix().column(3).into_owned();
        all.push(Posed { frame, index, camera, rotation, translation });
    }
    let mut notes = Vec::new();
    if projections > 0 {
        notes.push(format!("skipped with a projection instead of a camera: {}", count(projections, "frame")));
    }
    if without_pose > 0 {
        notes.push(format!("skipped without a pose: {}", count(without_pose, "frame")));
    }
    if all.is_empty() {
        return Err(EntryError::new("frames", "no frame has a camera and a pose: there is nothing to export"));
    }
    Ok((all, notes))
}

/// The row of this format.
pub(super) const TUM: ExportFormat = ExportFormat {
    name: "tum",
    about: "TUM: the trajectory of a camera, as given or refined",
    options: &["camera"],
    write: Writer::Cameras(|file, options| tum(file, options.camera.as_deref())),
};

/// The trajectory of one camera: lines `time tx ty tz qx qy qz qw`, camera-to-world, in the order of time. `camera` may be left out if all
/// frames have the same one. Frames without times get their numbers.
///
/// # Errors
/// [`EntryError`]: several cameras and none chosen, a camera without frames, a pose that is not one.
pub(super) fn tum(file: &SceneFile, camera: Option<&str>) -> Result<Document, EntryError> {
    let (mut frames, mut notes) = posed(file)?;
    let cameras: BTreeSet<&str> = frames.iter().map(|posed| posed.camera).collect();
    let known = || cameras.iter().map(|id| format!("\"{id}\"")).collect::<Vec<_>>().join(", ");
    match camera {
        Some(camera) if !cameras.contains(camera) => {
            let problem = format!("no frame has the camera \"{camera}\"; frames have {}", known());
            return Err(EntryError::new("frames", problem));
        }
        Some(camera) => frames.retain(|posed| posed.camera == camera),
        None if cameras.len() > 1 => {
            let problem = format!("the frames have several cameras ({}); a trajectory has one", known());
            return Err(EntryError::new("frames", problem));
        }
        None => {}
    }
    let timed = frames.iter().all(|posed| posed.frame.time.is_some());
    if !timed {
        notes.push("frames have no times: their numbers from 0 are written instead".to_owned());
    }
    let numbers = time_steps(&file.frames);
    let time = |posed: &Posed| posed.frame.time.filter(|_| timed).unwrap_or(numbers[posed.index] as f64);
    frames.sort_by(|a, b| time(a).total_cmp(&time(b)));
    let mut text = String::from("# time tx ty tz qx qy qz qw\n");
    for posed in &frames {
        let world_from_cam = posed.rotation.inverse();
        let center = -(world_from_cam * posed.translation);
        let [w, x, y, z] = quaternion_from_rotation(&world_from_cam);
        let _ = writeln!(text, "{} {} {} {} {x} {y} {z} {w}", time(posed), center.x, center.y, center.z);
    }
    Ok(Document { content: text.into_bytes(), counts: vec![("pose", frames.len())], notes })
}

/// The row of this format.
pub(super) const COLMAP: ExportFormat = ExportFormat {
    name: "colmap",
    about: "COLMAP: a folder with the model of the cameras, as given or refined, in text form",
    options: &[],
    write: Writer::CameraFolder(COLMAP_FILES, colmap_model),
};

/// The cameras, images and points as a COLMAP model in text form: the files of [`COLMAP_FILES`]. Cameras whose ids are not whole numbers
/// get numbers from 1; the points have no tracks, because the scene does not have their pixels.
///
/// # Errors
/// [`EntryError`]: a camera without an image size, an image name with a line break, a pose that is not one.
pub(super) fn colmap_model(file: &SceneFile) -> Result<[Document; 3], EntryError> {
    let (frames, mut notes) = posed(file)?;
    let whole: Option<BTreeSet<u32>> = file.cameras.iter().map(|c| c.id.parse().ok().filter(|id| *id > 0)).collect();
    let keeps = whole.is_some_and(|ids| ids.len() == file.cameras.len());
    if !keeps {
        notes.push("cameras have numbers from 1, in the order of the scene".to_owned());
    }
    let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
    let mut cameras = String::from("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n");
    for (index, (camera, next)) in file.cameras.iter().zip(1u32..).enumerate() {
        let number = camera.id.parse().ok().filter(|_| keeps).unwrap_or(next);
        let (Some(width), Some(height)) = (camera.width, camera.height) else {
            let problem = "the camera has no width and height, which a COLMAP model needs";
            return Err(EntryError::new(format!("cameras[{index}]"), problem));
        };
        let params: Vec<String> = camera.params.iter().map(f64::to_string).collect();
        let _ = writeln!(cameras, "{number} {} {width} {height} {}", camera.model, params.join(" "));
        numbers.insert(&camera.id, number);
    }
    let mut images =
        String::from("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of POINTS2D[], which is empty\n");
    for (posed, number) in frames.iter().zip(1u32..) {
        let name = posed.frame.image.as_deref().unwrap_or(&posed.frame.id);
        let entry = || format!("frames[{}]", posed.index);
        let Some(camera) = numbers.get(posed.camera) else {
            return Err(EntryError::new(entry(), format!("unknown camera \"{}\"", posed.camera)));
        };
        if name.contains(['\n', '\r']) {
            return Err(EntryError::new(entry(), format!("the image name {name:?} has a line break")));
        }
        let [w, x, y, z] = quaternion_from_rotation(&posed.rotation);
        let t = &posed.translation;
        let _ = writeln!(images, "{number} {w} {x} {y} {z} {} {} {} {camera} {name}\n", t.x, t.y, t.z);
    }
    let mut points = String::from("# POINT3D_ID X Y Z R G B ERROR TRACK[]\n");
    for ([x, y, z], number) in file.points.iter().zip(1u32..) {
        let _ = writeln!(points, "{number} {x} {y} {z} 128 128 128 0");
    }
    if !file.points.is_empty() {
        notes.push("points are without their tracks: the scene does not have their pixels".to_owned());
    }
    let document = |text: String, counts, notes| Document { content: text.into_bytes(), counts, notes };
    Ok([
        document(cameras, vec![("camera", file.cameras.len())], Vec::new()),
        document(images, vec![("image", frames.len())], notes),
        document(points, vec![("point", file.points.len())], Vec::new()),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::read_cameras;
    use crate::read::ReadOptions;
    use crate::write::test_scene::three_bodies;

    /// Two cameras, times out of order, turned poses.
    fn scene() -> SceneFile {
        let mut file = three_bodies();
        for (k, frame) in file.frames.iter_mut().enumerate() {
            frame.time = Some(10.5 - k as f64);
        }
        file.points = vec![[1.0, 2.0, -3.0], [0.1, 0.2, 0.3]];
        file
    }

    fn is_close(a: &FrameRecord, b: &FrameRecord) -> bool {
        let (a, b) = (a.cam_from_world.unwrap(), b.cam_from_world.unwrap());
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn a_trajectory_reads_back_as_the_poses() {
        let file = scene();
        let document = tum(&file, None).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let [path, intrinsics] = ["trajectory.txt", "camera.txt"].map(|name| folder.path().join(name));
        std::fs::write(&path, &document.content).unwrap();
        std::fs::write(&intrinsics, "500 500 320 240").unwrap();
        let intrinsics = Some(intrinsics);
        let options = ReadOptions { intrinsics, image_size: Some([640.0, 480.0]), ..ReadOptions::default() };
        let read = read_cameras(&path, &options).unwrap().scene;
        assert_eq!(read.frames.len(), file.frames.len());
        for (frame, read) in file.frames.iter().rev().zip(&read.frames) {
            assert!(is_close(frame, read), "{read:?}");
            assert_eq!(read.id, frame.time.unwrap().to_string());
        }
    }

    #[test]
    fn a_trajectory_has_one_camera() {
        let mut file = scene();
        let mut other = file.cameras[0].clone();
        other.id = "right".to_owned();
        file.cameras.push(other);
        file.frames[1].camera = Some("right".to_owned());
        file.frames[0].time = None;
        let error = tum(&file, None).unwrap_err();
        assert!(error.to_string().contains("\"cam\", \"right\""), "{error}");
        assert!(tum(&file, Some("left")).is_err());
        let document = tum(&file, Some("right")).unwrap();
        assert_eq!(document.counts, [("pose", 1)]);
        let document = tum(&file, Some("cam")).unwrap();
        assert!(document.notes[0].contains("no times"), "{:?}", document.notes);
        file.frames.iter_mut().for_each(|frame| frame.cam_from_world = None);
        assert!(tum(&file, None).is_err());
    }

    #[test]
    fn a_colmap_model_reads_back_as_the_scene() {
        let file = scene();
        let documents = colmap_model(&file).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for (name, document) in COLMAP_FILES.iter().zip(&documents) {
            std::fs::write(folder.path().join(name), &document.content).unwrap();
        }
        let read = read_cameras(folder.path(), &ReadOptions::default()).unwrap().scene;
        assert_eq!((read.cameras.len(), read.points), (1, file.points.clone()));
        assert_eq!((read.cameras[0].id.as_str(), &read.cameras[0].params), ("1", &file.cameras[0].params));
        for frame in &file.frames {
            let of_image = |read: &&FrameRecord| read.image == frame.image;
            assert!(is_close(frame, read.frames.iter().find(of_image).unwrap()));
        }
        assert!(documents[1].notes.iter().any(|note| note.contains("tracks")));
        let mut without_size = file;
        without_size.cameras[0].width = None;
        assert!(colmap_model(&without_size).unwrap_err().to_string().contains("width"));
    }
}
