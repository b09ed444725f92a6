//! KITTI's raw data: a drive's folder with `oxts`, calibration files in the folder above, tracklets in XML.
//!
//! World frame: the rectified axes of camera 0 in the first selected frame, as for the tracking benchmark. Static
//! tracklets become the true objects; they have no boxes in the images.
//!
//! Format: `readme.txt` and `dataformat.txt` of the raw data's devkit; the transforms are those of pykitti.

use std::path::Path;

use nalgebra::{Matrix4, Rotation3, Vector3};

use super::format::{Format, PoseFormat};
use super::import::Import;
use super::kitti::frame_id;
use super::kitti_geometry::{Oxts, calibration, camera_rows, rect_from_world};
use super::options::ReadOptions;
use super::poses::{inverse, matrix4};
use super::static_objects::LabelledObjects;
use super::xml::{DocumentType, Element, Xml};
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::scene_file::{FrameRecord, SceneFile};
use crate::text::lines;

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "kitti-raw",
    title: "KITTI raw",
    about: "A drive of KITTI's raw data",
    looks: "KITTI raw (oxts/data)",
    options: &["camera", "calibration_folder", "frames", "pixel_centers"],
    finds: |probe| probe.when(probe.has("oxts/data")),
    read: read_kitti_raw,
};

/// Reads a drive from its folder, such as `2011_09_26/2011_09_26_drive_0005_sync`.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
fn read_kitti_raw(drive: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let number = options.camera.unwrap_or(2);
    let day = match &options.calibration_folder {
        Some(folder) => folder.clone(),
        None => drive.join(".."),
    };
    let (cam_path, velo_path, imu_path) =
        (day.join("calib_cam_to_cam.txt"), day.join("calib_velo_to_cam.txt"), day.join("calib_imu_to_velo.txt"));
    let (cam_bytes, velo_bytes, imu_bytes) = (read_bytes(&cam_path)?, read_bytes(&velo_path)?, read_bytes(&imu_path)?);
    let calib = calibration(&cam_path, &cam_bytes)?;
    let camera = calib.rectified_camera(&format!("P_rect_{number:02}"))?;
    let image_size = calib.numbers::<2>(&[&format!("S_rect_{number:02}")])?;
    let rect_from_velo =
        calib.rotation(&["R_rect_00"])? * calibration(&velo_path, &velo_bytes)?.rotation_and_translation()?;
    let rect_from_imu = rect_from_velo * calibration(&imu_path, &imu_bytes)?.rotation_and_translation()?;

    let oxts_folder = drive.join("oxts/data");
    let numbers = frame_numbers(&oxts_folder)?;
    let chosen = |number: &usize| options.frames.as_ref().is_none_or(|range| range.contains(number));
    let taken: Vec<usize> = numbers.iter().copied().filter(chosen).collect();
    let (Some(&first), Some(&first_taken)) = (numbers.first(), taken.first()) else {
        let problem = format!("the drive has {} frames, and none of the requested ones", numbers.len());
        return Err(ReadError::new(&oxts_folder, problem));
    };
    let read_oxts = |number: usize| {
        let path = oxts_folder.join(format!("{number:010}.txt"));
        let bytes = read_bytes(&path)?;
        let text = as_utf8(&path, &bytes)?;
        let line = lines(&path, text).next().ok_or_else(|| ReadError::new(&path, "the file is empty"))?;
        Oxts::read(&line)
    };
    let oxts = taken.iter().map(|&number| read_oxts(number)).collect::<Result<Vec<_>, _>>()?;
    let scale = read_oxts(first)?.mercator_scale();
    let poses = rect_from_world(&oxts, scale, &rect_from_imu)
        .ok_or_else(|| ReadError::new(&oxts_folder, "a pose cannot be inverted"))?;
    let times = times(&drive.join("oxts/timestamps.txt"), first_taken)?;
    let mut notes = vec![
        "world: rectified axes of camera 0 in the first frame; poses from GPS/IMU, which drift".to_owned(),
        options.pixel_centers.note(),
    ];
    let images = drive.join(format!("image_{number:02}/data"));
    let has_images = images.is_dir();
    let mut scene = SceneFile {
        name: drive.file_name().map(|name| name.to_string_lossy().into_owned()),
        length_unit: Some("m".to_owned()),
        up: Some([0.0, -1.0, 0.0]),
        cameras: vec![camera.record(Some(image_size), options.pixel_centers)],
        frames: (taken.iter().zip(&poses))
            .map(|(&number, pose)| FrameRecord {
                id: frame_id(number),
                camera: Some("camera".to_owned()),
                cam_from_world: Some(camera_rows(&camera, pose)),
                image: has_images.then(|| format!("{number:010}.png")),
                time: times.as_ref().and_then(|times| times.get(number).copied()),
                ..FrameRecord::default()
            })
            .collect(),
        ..SceneFile::default()
    };
    let tracklets = drive.join("tracklet_labels.xml");
    if tracklets.is_file() {
        let tracklets = parse_tracklets(&tracklets, &read_bytes(&tracklets)?)?;
        let mut objects = LabelledObjects::default();
        for (index, tracklet) in tracklets.iter().enumerate() {
            for (k, pose) in tracklet.poses.iter().enumerate() {
                let Ok(position) = taken.binary_search(&tracklet.first_frame.saturating_add(k)) else { continue };
                let Some(world_from_rect) = inverse(&poses[position]) else { continue };
                let world_from_object = world_from_rect * rect_from_velo * tracklet.velo_from_object(pose);
                let category = tracklet.kind.to_lowercase();
                objects.add(&format!("t{index}"), Some(&category), &world_from_object, tracklet.half_extents());
            }
        }
        let (still, moving) = objects.objects();
        notes.push(format!(
            "{} static tracklets are the true objects; {} moving ones are not",
            still.len(),
            moving.len()
        ));
        scene.objects = still;
    }
    let image_folder = has_images.then_some(images);
    Import { scene, image_folder, notes, ..Import::default() }.checked(&cam_path)
}

/// The numbers of the frames with GPS/IMU data (some drives lack a few).
fn frame_numbers(folder: &Path) -> Result<Vec<usize>, ReadError> {
    let entries = std::fs::read_dir(folder)
        .map_err(|error| ReadError::new(folder, format!("cannot read the folder of GPS/IMU data: {error}")))?;
    let mut numbers: Vec<usize> =
        entries.filter_map(|entry| entry.ok()?.file_name().to_str()?.strip_suffix(".txt")?.parse().ok()).collect();
    numbers.sort_unstable();
    Ok(numbers)
}

/// The times of all frames in seconds after the frame `first`, from lines `2011-09-26 13:02:25.594360375`; `None` when
/// there is no such file.
fn times(path: &Path, first: usize) -> Result<Option<Vec<f64>>, ReadError> {
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = read_bytes(path)?;
    let mut times = Vec::new();
    for line in lines(path, as_utf8(path, &bytes)?).filter(|line| !line.text.is_empty()) {
        let parts: Vec<f64> = line.text.split(['-', ' ', ':']).filter_map(|part| part.parse().ok()).collect();
        let &[_, _, day, hour, minute, second] = parts.as_slice() else {
            return Err(line.error("expected a time such as 2011-09-26 13:02:25.594360375"));
        };
        times.push(((day * 24.0 + hour) * 60.0 + minute) * 60.0 + second);
    }
    let start = times.get(first).copied().unwrap_or_default();
    // Nanoseconds; a drive does not last over the end of a month.
    Ok(Some(times.iter().map(|time| ((time - start) * 1e9).round() / 1e9).collect()))
}

/// A tracklet: one object in consecutive frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tracklet {
    /// Type, as it is written (`Car`, ...).
    pub kind: String,
    /// Height, width, length.
    pub size: [f64; 3],
    /// Number of the frame of the first pose.
    pub first_frame: usize,
    /// `tx, ty, tz, rx, ry, rz`: middle of the bottom face in the laser scanner's axes, and turns about its axes.
    pub poses: Vec<[f64; 6]>,
}

impl Tracklet {
    /// Half the length, width and height: along the axes of [`Tracklet::velo_from_object`].
    fn half_extents(&self) -> Vector3<f64> {
        let [height, width, length] = self.size;
        Vector3::new(length, width, height) * 0.5
    }

    /// The pose of the center: x along the length, y along the width, z up.
    fn velo_from_object(&self, pose: &[f64; 6]) -> Matrix4<f64> {
        let &[x, y, z, rx, ry, rz] = pose;
        let rotation = Rotation3::from_euler_angles(rx, ry, rz);
        // rx and ry are zero in KITTI's files, so that the bottom face is below the center.
        matrix4(rotation.matrix(), &(Vector3::new(x, y, z) + rotation * Vector3::new(0.0, 0.0, 0.5 * self.size[0])))
    }
}

/// The tracklets in the bytes of `tracklet_labels.xml`; the path serves for messages.
///
/// # Errors
/// [`ReadError`] with line and column, what was found and what was expected.
fn parse_tracklets(path: &Path, bytes: &[u8]) -> Result<Vec<Tracklet>, ReadError> {
    // The files name their type in a DOCTYPE.
    let xml = Xml::parse(path, bytes, "tracklets", DocumentType::Allowed)?;
    xml.child(&xml.root, "tracklets")?.children("item").map(|item| tracklet(&xml, item)).collect()
}

fn tracklet(xml: &Xml, item: &Element) -> Result<Tracklet, ReadError> {
    let (first, first_element) = xml.text(item, "first_frame")?;
    let first_frame = first
        .parse()
        .map_err(|_| xml.error(first_element, format!("<first_frame> is \"{first}\"; expected a whole number")))?;
    let pose = |pose: &Element| -> Result<[f64; 6], ReadError> {
        let mut numbers = [0.0; 6];
        for (number, name) in numbers.iter_mut().zip(["tx", "ty", "tz", "rx", "ry", "rz"]) {
            *number = xml.number(pose, name)?;
        }
        Ok(numbers)
    };
    Ok(Tracklet {
        kind: xml.text(item, "objectType")?.0.to_owned(),
        size: [xml.number(item, "h")?, xml.number(item, "w")?, xml.number(item, "l")?],
        first_frame,
        poses: xml.child(item, "poses")?.children("item").map(pose).collect::<Result<_, _>>()?,
    })
}

#[cfg(test)]
#[path = "kitti_raw/tests.rs"]
mod tests;
