//! TUM trajectories: lines `time tx ty tz qx qy qz qw`, camera-to-world, OpenCV axes; the intrinsics come from a
//! separate file. Format: the RGB-D benchmark's "file formats"; the association of times is that of its `associate.py`.

use std::path::Path;

use nalgebra::Vector3;
use quadlift::geometry::{Camera, CameraModel};

use super::colmap::camera_fields;
use super::format::{Format, PoseFormat};
use super::import::Import;
use super::options::ReadOptions;
use super::poses::{inverse, matrix4, rotation_of, rows};
use super::probe::Words;
use super::time_units::units;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::scene_file::{CameraRecord, FrameRecord, SceneFile};
use crate::text::{Line, lines};

/// Maximum time difference between an image and its pose, in seconds, by default.
const TIME_TOLERANCE: f64 = 0.02;

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "tum",
    title: "a TUM trajectory",
    about: "A TUM trajectory (lines `time tx ty tz qx qy qz qw`) with an intrinsics file",
    looks: "a TUM trajectory (lines of 8 numbers)",
    options: &["intrinsics", "image_list", "time_tolerance", "image_size", "pixel_centers"],
    finds: |probe| {
        let is_pose = |line: &Words| !line.commas && line.words.len() == 8 && line.are_numbers();
        probe.when(probe.line()?.is_some_and(is_pose))
    },
    read: read_tum,
};

/// Reads a trajectory.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
fn read_tum(trajectory: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let Some(intrinsics) = &options.intrinsics else {
        let problem = "a TUM trajectory has no intrinsics: set their file with --intrinsics FILE";
        return Err(ReadError::lacking_option(trajectory, problem));
    };
    let intrinsics = (intrinsics.as_path(), &*read_bytes(intrinsics)?);
    let images = options.image_list.as_deref().map(read_bytes).transpose()?;
    let mut import = parse_tum((trajectory, &read_bytes(trajectory)?), intrinsics, images.as_deref(), options)?;
    import.image_folder = options.image_list.as_deref().and_then(Path::parent).map(Path::to_owned);
    Ok(import)
}

/// The cameras in the bytes of a trajectory, of a file of intrinsics and of a list of images; the paths serve for
/// messages.
///
/// # Errors
/// As [`read_tum`].
fn parse_tum(
    trajectory: (&Path, &[u8]),
    intrinsics: (&Path, &[u8]),
    images: Option<&[u8]>,
    options: &ReadOptions,
) -> Result<Import, ReadError> {
    let mut notes = vec!["camera-to-world poses were inverted; quaternions are x, y, z, w".to_owned()];
    let camera = camera(intrinsics.0, intrinsics.1, options, &mut notes)?;
    let mut poses = poses(trajectory.0, trajectory.1)?;
    let tolerance = options.time_tolerance.unwrap_or(TIME_TOLERANCE);
    let mut scene = SceneFile { cameras: vec![camera], ..SceneFile::default() };
    let frame = |id: &str, pose: &Pose| FrameRecord {
        id: id.to_owned(),
        camera: Some("camera".to_owned()),
        cam_from_world: Some(pose.cam_from_world),
        ..FrameRecord::default()
    };
    match (options.image_list.as_deref(), images) {
        (Some(path), Some(bytes)) => {
            let mut listed = Vec::new();
            for line in lines(path, as_utf8(path, bytes)?).filter(|line| !line.is_blank_or_comment()) {
                let mut fields = line.fields();
                let time = fields.number("a time in seconds")?;
                let image = fields.rest();
                if image.is_empty() {
                    return Err(line.error("the line ends after 1 field; expected the name of an image"));
                }
                listed.push((time, image.to_owned()));
            }
            let unit = to_seconds(&mut poses, &listed.iter().map(|(time, _)| *time).collect::<Vec<f64>>());
            let mut without_pose = 0;
            for (time, image) in listed.into_iter().map(|(time, image)| (time * unit, image)) {
                match nearest(&poses, time).filter(|pose| (pose.time - time).abs() <= tolerance) {
                    Some(pose) => {
                        let record = frame(&image, pose);
                        scene.frames.push(FrameRecord { time: Some(time), image: Some(image), ..record });
                    }
                    None => without_pose += 1,
                }
            }
            notes.push(format!(
                "{} images have a pose within {tolerance} s, {without_pose} have none and were skipped",
                scene.frames.len()
            ));
        }
        _ => {
            to_seconds(&mut poses, &[]);
            scene.frames.extend(poses.iter().map(|pose| FrameRecord { time: Some(pose.time), ..frame(&pose.id, pose) }))
        }
    }
    if scene.cameras[0].width.is_none() {
        notes.push("the image size is unknown: box edges at the border are not treated as cut off".to_owned());
    }
    Import { scene, notes, ..Import::default() }.checked(trajectory.0)
}

/// A line of the trajectory.
struct Pose {
    /// The time as it is written.
    id: String,
    time: f64,
    cam_from_world: [[f64; 4]; 3],
}

/// Converts the times of poses to seconds; the seconds of one unit of the other times.
fn to_seconds(poses: &mut [Pose], others: &[f64]) -> f64 {
    let times: Vec<f64> = poses.iter().map(|pose| pose.time).collect();
    let [unit, other] = units(&times, others);
    poses.iter_mut().for_each(|pose| pose.time *= unit);
    other
}

/// The poses, sorted by time.
fn poses(path: &Path, bytes: &[u8]) -> Result<Vec<Pose>, ReadError> {
    let mut poses = Vec::new();
    for line in lines(path, as_utf8(path, bytes)?).filter(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let id = fields.clone().word("a time in seconds")?.to_owned();
        let time = fields.number("a time in seconds")?;
        let translation: [f64; 3] = fields.numbers("a translation tx ty tz")?;
        let [x, y, z, w] = fields.numbers("a quaternion qx qy qz qw")?;
        if !fields.is_empty() {
            return Err(line.error(format!("expected 8 numbers; found more: {}", fields.rest())));
        }
        let rotation = rotation_of([w, x, y, z])
            .ok_or_else(|| line.error(format!("the quaternion {x} {y} {z} {w} is not a rotation")))?;
        let cam_from_world = inverse(&matrix4(&rotation, &Vector3::from(translation)))
            .ok_or_else(|| line.error("the pose cannot be inverted"))?;
        poses.push(Pose { id, time, cam_from_world: rows(&cam_from_world) });
    }
    poses.sort_by(|a, b| a.time.total_cmp(&b.time));
    Ok(poses)
}

/// The pose that is nearest in time.
fn nearest(poses: &[Pose], time: f64) -> Option<&Pose> {
    let after = poses.partition_point(|pose| pose.time < time);
    let candidates = &poses[after.saturating_sub(1)..(after + 1).min(poses.len())];
    candidates.iter().min_by(|a, b| (a.time - time).abs().total_cmp(&(b.time - time).abs()))
}

fn camera(
    path: &Path,
    bytes: &[u8],
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<CameraRecord, ReadError> {
    let text = as_utf8(path, bytes)?;
    let mut content = lines(path, text).filter(|line| !line.is_blank_or_comment());
    let expected = "expected one line: fx fy cx cy [k1 k2 p1 p2 [k3]], or MODEL WIDTH HEIGHT PARAMS as in COLMAP";
    let line = content.next().ok_or_else(|| ReadError::new(path, format!("the file has no numbers; {expected}")))?;
    if let Some(second) = content.next() {
        return Err(second.error(format!("found a second line; {expected}")));
    }
    let (model, params, size) = match colmap_camera(&line) {
        Some(camera) => {
            let (model, size, params) = camera.map_err(|problem| line.error(problem))?;
            notes.push("the intrinsics are COLMAP's: pixels are measured from the corner".to_owned());
            (model, params, options.image_size.or(Some(size)))
        }
        None => {
            let mut numbers = line.numbers()?;
            let model = match numbers.len() {
                4 => CameraModel::Pinhole,
                8 => CameraModel::OpenCv,
                9 => {
                    numbers.extend([0.0; 3]);
                    CameraModel::FullOpenCv
                }
                n => return Err(line.error(format!("found {n} numbers; {expected}"))),
            };
            numbers[2] += options.pixel_centers.shift();
            numbers[3] += options.pixel_centers.shift();
            notes.push(options.pixel_centers.note());
            (model, numbers, options.image_size)
        }
    };
    Camera::new(model, &params).map_err(|error| line.error(error.to_string()))?;
    Ok(CameraRecord {
        id: "camera".to_owned(),
        model: model.name().to_owned(),
        width: size.map(|size| size[0]),
        height: size.map(|size| size[1]),
        params,
        ..CameraRecord::default()
    })
}

type ColmapCamera = (CameraModel, [f64; 2], Vec<f64>);

/// A line as in `cameras.txt`, with or without an id; `None` when there is no word in it.
fn colmap_camera(line: &Line) -> Option<Result<ColmapCamera, String>> {
    let mut fields = line.fields();
    for _ in 0..2 {
        let word = fields.clone().word("").ok()?;
        if word.starts_with(|c: char| c.is_ascii_alphabetic()) && word.parse::<f64>().is_err() {
            return Some(camera_fields(&mut fields));
        }
        fields.word("").ok()?;
    }
    None
}

#[cfg(test)]
#[path = "tum/tests.rs"]
mod tests;
