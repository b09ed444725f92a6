//! KITTI's tracking benchmark: folders `calib`, `oxts`, `label_02` (and `image_02`) with a file for each sequence.
//!
//! World frame: the rectified axes of camera 0 in the first selected frame (x right, y down, z forward, meters). Frames
//! are those of the left color camera, `P2`. Labels become detections of the source `label` and, for static objects,
//! the true objects.

use std::path::Path;

use nalgebra::Matrix4;

use super::format::{Format, PoseFormat};
use super::import::{Import, PixelCenters};
use super::kitti_geometry::{Oxts, calibration, camera_rows, image_size_of, rect_from_world};
use super::kitti_labels::{KittiLabel, parse_labels};
use super::options::ReadOptions;
use super::poses::inverse;
use super::static_objects::LabelledObjects;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::scene_file::{DetectionRecord, FrameRecord, SceneFile};
use crate::text::lines;
use crate::wording::count;

/// The files of a sequence with their paths, which serve for messages.
#[derive(Debug, Clone, Copy)]
pub struct KittiFiles<'a> {
    /// Calibration.
    pub calib: (&'a Path, &'a [u8]),
    /// GPS/IMU data.
    pub oxts: (&'a Path, &'a [u8]),
    /// Labels, where there are any.
    pub labels: Option<(&'a Path, &'a [u8])>,
}

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "kitti",
    title: "KITTI tracking",
    about: "A sequence of KITTI's tracking benchmark",
    looks: "KITTI (folders calib and oxts)",
    options: &["sequence", "frames", "image_size", "pixel_centers"],
    finds: |probe| probe.when(probe.has("oxts") && probe.has("calib")),
    read: read_kitti,
};

/// Reads a sequence from the folder that holds `calib`, `oxts` and `label_02` (as `training` of the benchmark does).
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
fn read_kitti(folder: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let sequence = sequence(folder, options)?;
    let file = |kind: &str| folder.join(kind).join(format!("{sequence}.txt"));
    let (calib, oxts, labels) = (file("calib"), file("oxts"), file("label_02"));
    let (calib_bytes, oxts_bytes) = (read_bytes(&calib)?, read_bytes(&oxts)?);
    let labels_bytes = if labels.is_file() { Some(read_bytes(&labels)?) } else { None };
    let files = KittiFiles {
        calib: (&calib, &calib_bytes),
        oxts: (&oxts, &oxts_bytes),
        labels: labels_bytes.as_ref().map(|bytes| (labels.as_path(), bytes.as_slice())),
    };
    let mut import = parse_kitti(files, &sequence, options)?;
    let images = folder.join("image_02").join(&sequence);
    if images.is_dir() {
        import.scene.frames.iter_mut().for_each(|frame| frame.image = Some(format!("{}.png", frame.id)));
        import.image_folder = Some(images);
    }
    Ok(import)
}

/// The sequence that the options name, or that of the detections.
fn sequence(folder: &Path, options: &ReadOptions) -> Result<String, ReadError> {
    let of_detections = options.detections.as_deref().and_then(Path::file_stem);
    let of_detections = of_detections.map(|stem| stem.to_string_lossy().into_owned());
    let exists = |name: &String| folder.join("calib").join(format!("{name}.txt")).is_file();
    options.sequence.clone().or(of_detections.filter(exists)).ok_or_else(|| {
        ReadError::lacking_option(folder, "the folder holds several KITTI sequences: choose one with --sequence NAME")
    })
}

/// From the rectified axes of camera 0, in which labels are written, to those of the left color camera, in meters: from
/// `P2` of a calibration file.
///
/// # Errors
/// [`ReadError`] when the file cannot be read or has no such projection.
pub(crate) fn read_cam_from_rect(path: &Path) -> Result<Matrix4<f64>, ReadError> {
    Ok(calibration(path, &read_bytes(path)?)?.rectified_camera("P2")?.cam_from_rect)
}

/// A sequence from the bytes of its files.
///
/// # Errors
/// As [`read_kitti`].
fn parse_kitti(files: KittiFiles, sequence: &str, options: &ReadOptions) -> Result<Import, ReadError> {
    let calib = calibration(files.calib.0, files.calib.1)?;
    let camera = calib.rectified_camera("P2")?;
    let rect_from_imu = calib.rotation(&["R0_rect", "R_rect"])?
        * calib.transform(&["Tr_velo_to_cam", "Tr_velo_cam"])?
        * calib.transform(&["Tr_imu_to_velo", "Tr_imu_velo"])?;
    let oxts_lines = lines(files.oxts.0, as_utf8(files.oxts.0, files.oxts.1)?).filter(|line| !line.text.is_empty());
    let oxts = oxts_lines.map(|line| Oxts::read(&line)).collect::<Result<Vec<_>, _>>()?;
    let first = options.frames.as_ref().map_or(0, |range| *range.start());
    let end = options.frames.as_ref().map_or(oxts.len(), |range| range.end().saturating_add(1));
    let taken = oxts.get(first..end).filter(|taken| !taken.is_empty()).ok_or_else(|| {
        let problem =
            format!("the sequence has {} frames; requested were {first} to {}", oxts.len(), end.saturating_sub(1));
        ReadError::new(files.oxts.0, problem)
    })?;
    // The scale is that of the whole sequence, so that it does not depend on the selection.
    let scale = oxts.first().map_or(1.0, Oxts::mercator_scale);
    let poses = rect_from_world(taken, scale, &rect_from_imu)
        .ok_or_else(|| ReadError::new(files.oxts.0, "a pose cannot be inverted"))?;
    let image_size = options.image_size.or(image_size_of(camera.intrinsics.fx));
    let mut notes = vec![
        "world: rectified axes of camera 0 in the first frame; poses from GPS/IMU, which drift".to_owned(),
        options.pixel_centers.note(),
        match (options.image_size, image_size) {
            (None, Some([width, height])) => {
                format!("image size {width} x {height}, from the recording day with this focal length")
            }
            (_, Some([width, height])) => format!("image size {width} x {height}"),
            (_, None) => "the image size is unknown: box edges at the border are not treated as cut off".to_owned(),
        },
    ];
    let mut scene = SceneFile {
        name: Some(format!("kitti_{sequence}")),
        length_unit: Some("m".to_owned()),
        up: Some([0.0, -1.0, 0.0]),
        cameras: vec![camera.record(image_size, options.pixel_centers)],
        frames: (poses.iter().enumerate())
            .map(|(index, pose)| FrameRecord {
                id: frame_id(first + index),
                camera: Some("camera".to_owned()),
                cam_from_world: Some(camera_rows(&camera, pose)),
                ..FrameRecord::default()
            })
            .collect(),
        ..SceneFile::default()
    };
    if let Some((path, bytes)) = files.labels {
        add_labels(&mut scene, &parse_labels(path, bytes)?, &poses, first, options.pixel_centers, &mut notes);
    }
    Import { scene, notes, ..Import::default() }.checked(files.calib.0)
}

/// The id of a frame by its number, as KITTI names its images.
pub(super) fn frame_id(number: usize) -> String {
    format!("{number:06}")
}

/// Detections of the source `label`, and the static objects.
fn add_labels(
    scene: &mut SceneFile,
    labels: &[KittiLabel],
    rect_from_world: &[Matrix4<f64>],
    first: usize,
    pixel_centers: PixelCenters,
    notes: &mut Vec<String>,
) {
    let mut objects = LabelledObjects::default();
    for label in labels {
        let pose = label.frame.checked_sub(first).and_then(|index| rect_from_world.get(index));
        let Some(pose) = pose.filter(|_| label.track >= 0 && label.kind != "DontCare") else { continue };
        let (id, category) = (format!("t{}", label.track), label.kind.to_lowercase());
        let [x0, y0, x1, y1] = label.bounding_box.map(|x| x + pixel_centers.shift());
        if x0 < x1 && y0 < y1 {
            let level = |level: f64| (level >= 0.0).then_some(level);
            scene.detections.push(DetectionRecord {
                frame: frame_id(label.frame).into(),
                object: Some(id.clone().into()),
                category: Some(category.clone().into()),
                source: Some("label".into()),
                score: label.score,
                bounding_box: Some([x0, y0, x1, y1]),
                occluded: level(label.occluded),
                truncated: level(label.truncated),
                ..DetectionRecord::default()
            });
        }
        if label.has_cuboid()
            && let Some(world_from_rect) = inverse(pose)
        {
            objects.add(&id, Some(&category), &(world_from_rect * label.rect_from_object()), label.half_extents());
        }
    }
    let (still, moving) = objects.objects();
    notes.push(format!(
        "true objects: {}; left out: {}",
        count(still.len(), "static labeled object"),
        count(moving.len(), "moving object")
    ));
    scene.objects = still;
}

#[cfg(test)]
#[path = "kitti/tests.rs"]
mod tests;
