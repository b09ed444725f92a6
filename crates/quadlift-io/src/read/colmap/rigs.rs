//! Rigs and frames of a COLMAP model (`rigs` and `frames`, since COLMAP 3.12), as text or binary.
//!
//! A rig has sensors with fixed poses, a frame is a rig at one time step with the images of its cameras. COLMAP still writes the
//! pose of each image to `images`, but reads the poses of the frames: `cam_from_world = sensor_from_rig rig_from_world`. Format:
//! "Output Format" of COLMAP's documentation and `src/colmap/scene/reconstruction_io` of COLMAP.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::{Matrix4, Vector3};

use super::super::bytes::Bytes;
use super::super::poses::{from_rows, inverse, matrix4, rotation_of, rows};
use super::File;
use crate::error::ReadError;
use crate::input::as_utf8;
use crate::numbers::significant;
use crate::scene_file::{FrameRecord, RIG_FRAME};
use crate::text::{Fields, lines};
use crate::wording::count;

/// Largest difference between the pose of an image and that of its frame, in radians and relative to the extent of the cameras.
const TOLERANCE: f64 = 1e-4;

/// A kind of sensor and its id; cameras have the ids of `cameras`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Sensor {
    kind: i32,
    id: u32,
}

/// COLMAP's number of the kind of cameras.
const CAMERA: i32 = 0;

impl Sensor {
    fn named(kind: &str, id: u32) -> Result<Self, String> {
        let kind = match kind {
            "CAMERA" => CAMERA,
            "IMU" => 1,
            other => return Err(format!("found the sensor type \"{other}\"; expected CAMERA or IMU")),
        };
        Ok(Self { kind, id })
    }

    fn numbered(kind: i32, id: u32) -> Result<Self, String> {
        if (CAMERA..=1).contains(&kind) {
            return Ok(Self { kind, id });
        }
        Err(format!("found the sensor type {kind}; expected 0 (CAMERA) or 1 (IMU)"))
    }
}

impl fmt::Display for Sensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", if self.kind == CAMERA { "CAMERA" } else { "IMU" }, self.id)
    }
}

/// The sensors of a rig with `sensor_from_rig`, where it is known.
type Rig = BTreeMap<Sensor, Option<Matrix4<f64>>>;

/// The image of a frame: the frame, the camera, and the pose, unless the rig does not know that of the sensor.
#[derive(Debug, Clone)]
struct RigImage {
    frame: u32,
    camera: u32,
    cam_from_world: Option<Matrix4<f64>>,
}

/// Rigs, and images of their frames by id.
#[derive(Debug, Default)]
pub(super) struct Rigs {
    rigs: BTreeMap<u32, Rig>,
    /// The rig of each sensor.
    rig_of: BTreeMap<Sensor, u32>,
    /// The number of images of each frame.
    frames: BTreeMap<u32, usize>,
    images: BTreeMap<u32, RigImage>,
}

/// An image of `images` with its id and its camera.
#[derive(Debug, Clone)]
pub(super) struct ImageId {
    pub id: u32,
    pub camera: u32,
    pub name: String,
}

/// The rigs and frames in the bytes of `rigs.txt` and `frames.txt`.
pub(super) fn parse_text([rig_file, frame_file]: [File; 2]) -> Result<Rigs, ReadError> {
    let mut found = Rigs::default();
    for line in lines(rig_file.0, as_utf8(rig_file.0, rig_file.1)?).filter(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let sensor = |fields: &mut Fields| {
            let kind = fields.word("a sensor type")?;
            Sensor::named(kind, fields.whole("a sensor id, a whole number")?).map_err(|problem| line.error(problem))
        };
        let id = fields.whole("a rig id, a whole number")?;
        let sensors = fields.whole::<u32>("the number of sensors")?;
        let mut rig = Rig::new();
        for index in 0..sensors {
            let sensor = sensor(&mut fields)?;
            let pose = match index {
                0 => Some(Matrix4::identity()),
                _ if fields.whole::<u8>("1 or 0, whether the sensor has a pose")? == 0 => None,
                _ => {
                    let numbers = fields.numbers("a pose QW QX QY QZ TX TY TZ")?;
                    Some(pose(numbers).map_err(|problem| line.error(format!("sensor {sensor} {problem}")))?)
                }
            };
            add_sensor(&mut rig, sensor, pose).map_err(|problem| line.error(problem))?;
        }
        if !fields.is_empty() {
            return Err(line.error(format!(
                "the rig has {}; found more: {}",
                count(rig.len(), "sensor"),
                fields.rest()
            )));
        }
        found.add_rig(id, rig).map_err(|problem| line.error(problem))?;
    }
    for line in lines(frame_file.0, as_utf8(frame_file.0, frame_file.1)?).filter(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let id = fields.whole("a frame id, a whole number")?;
        let rig = fields.whole("a rig id, a whole number")?;
        let numbers = fields.numbers("a pose QW QX QY QZ TX TY TZ")?;
        let rig_from_world = found.add_frame(id, rig, numbers).map_err(|problem| line.error(problem))?;
        for _ in 0..fields.whole::<u32>("the number of data ids")? {
            let kind = fields.word("a sensor type")?;
            let sensor = Sensor::named(kind, fields.whole("a sensor id, a whole number")?);
            let sensor = sensor.map_err(|problem| line.error(problem))?;
            let data = fields.whole("a data id, a whole number")?;
            found.add_data(id, rig, &rig_from_world, sensor, data).map_err(|problem| line.error(problem))?;
        }
        if !fields.is_empty() {
            return Err(line.error(format!("the line has more than its data ids: {}", fields.rest())));
        }
    }
    Ok(found)
}

/// The rigs and frames in the bytes of `rigs.bin` and `frames.bin`.
pub(super) fn parse_binary([rig_file, frame_file]: [File; 2]) -> Result<Rigs, ReadError> {
    let mut found = Rigs::default();
    let sensor = |bytes: &mut Bytes| {
        let kind = bytes.i32("a sensor type")?;
        Sensor::numbered(kind, bytes.u32("a sensor id")?).map_err(|problem| bytes.error(problem))
    };
    let mut bytes = Bytes::new(rig_file.0, rig_file.1);
    // The counts of the files are not trusted: nothing is allocated for them.
    for _ in 0..bytes.u64("the number of rigs")? {
        let id = bytes.u32("a rig id")?;
        let mut rig = Rig::new();
        for index in 0..bytes.u32("the number of sensors")? {
            let sensor = sensor(&mut bytes)?;
            let pose = match index {
                0 => Some(Matrix4::identity()),
                _ if bytes.u8("1 or 0, whether the sensor has a pose")? == 0 => None,
                _ => {
                    let numbers = bytes.f64s("a pose w, x, y, z, tx, ty, tz")?;
                    Some(pose(numbers).map_err(|problem| bytes.error(format!("sensor {sensor} {problem}")))?)
                }
            };
            add_sensor(&mut rig, sensor, pose).map_err(|problem| bytes.error(problem))?;
        }
        found.add_rig(id, rig).map_err(|problem| bytes.error(problem))?;
    }
    bytes.end()?;
    let mut bytes = Bytes::new(frame_file.0, frame_file.1);
    for _ in 0..bytes.u64("the number of frames")? {
        let (id, rig) = (bytes.u32("a frame id")?, bytes.u32("a rig id")?);
        let numbers = bytes.f64s("a pose w, x, y, z, tx, ty, tz")?;
        let rig_from_world = found.add_frame(id, rig, numbers).map_err(|problem| bytes.error(problem))?;
        for _ in 0..bytes.u32("the number of data ids")? {
            let sensor = sensor(&mut bytes)?;
            let data = bytes.u64("a data id")?;
            found.add_data(id, rig, &rig_from_world, sensor, data).map_err(|problem| bytes.error(problem))?;
        }
    }
    bytes.end()?;
    Ok(found)
}

fn pose([w, x, y, z, translation @ ..]: [f64; 7]) -> Result<Matrix4<f64>, String> {
    let rotation = rotation_of([w, x, y, z])
        .ok_or_else(|| format!("has the quaternion {:?}, which is not a rotation", [w, x, y, z]))?;
    Ok(matrix4(&rotation, &Vector3::from(translation)))
}

fn add_sensor(rig: &mut Rig, sensor: Sensor, pose: Option<Matrix4<f64>>) -> Result<(), String> {
    match rig.insert(sensor, pose) {
        None => Ok(()),
        Some(_) => Err(format!("sensor {sensor} is twice in the rig")),
    }
}

impl Rigs {
    fn add_rig(&mut self, id: u32, rig: Rig) -> Result<(), String> {
        if self.rigs.contains_key(&id) {
            return Err(format!("the rig id {id} is used twice"));
        }
        for sensor in rig.keys() {
            if let Some(other) = self.rig_of.insert(*sensor, id) {
                return Err(format!(
                    "sensor {sensor} is in the rigs {other} and {id}; expected one rig for each sensor"
                ));
            }
        }
        self.rigs.insert(id, rig);
        Ok(())
    }

    /// Adds a frame without images; returns its `rig_from_world`.
    fn add_frame(&mut self, id: u32, rig: u32, numbers: [f64; 7]) -> Result<Matrix4<f64>, String> {
        if !self.rigs.contains_key(&rig) {
            return Err(format!("frame {id} has the rig {rig}, which is not in the file of the rigs"));
        }
        if self.frames.insert(id, 0).is_some() {
            return Err(format!("the frame id {id} is used twice"));
        }
        pose(numbers).map_err(|problem| format!("frame {id} {problem}"))
    }

    /// Adds an image, or other data, to a frame.
    fn add_data(
        &mut self,
        frame: u32,
        rig: u32,
        rig_from_world: &Matrix4<f64>,
        sensor: Sensor,
        data: u64,
    ) -> Result<(), String> {
        let Some(sensor_from_rig) = self.rigs.get(&rig).and_then(|rig| rig.get(&sensor)) else {
            return Err(format!("frame {frame} has data of sensor {sensor}, which is not in its rig {rig}"));
        };
        if sensor.kind != CAMERA {
            return Ok(());
        }
        let id = u32::try_from(data).map_err(|_| format!("the image id {data} has more than 32 bits"))?;
        let cam_from_world = sensor_from_rig.map(|sensor_from_rig| sensor_from_rig * rig_from_world);
        *self.frames.entry(frame).or_default() += 1;
        match self.images.insert(id, RigImage { frame, camera: sensor.id, cam_from_world }) {
            None => Ok(()),
            Some(other) => Err(format!("image {id} is in the frames {} and {frame}", other.frame)),
        }
    }

    /// Gives images without a pose that of their frame and rig, and images of a frame with several cameras the id of the
    /// frame. Returns notes.
    ///
    /// # Errors
    /// The first image that has no pose, or another camera than its frame says.
    pub(super) fn apply(
        &self,
        images: &[ImageId],
        frames: &mut BTreeMap<String, FrameRecord>,
    ) -> Result<Vec<String>, String> {
        let several = self.frames.values().any(|&images| images > 1);
        let mut computed = 0;
        let mut without_frame = Vec::new();
        let mut poses = Vec::new();
        for image in images {
            let Some(record) = frames.get_mut(&image.name) else { continue };
            let Some(rig_image) = self.images.get(&image.id) else {
                without_frame.push(image.name.as_str());
                continue;
            };
            let (frame, camera) = (rig_image.frame, rig_image.camera);
            if camera != image.camera {
                let (name, own) = (&image.name, image.camera);
                return Err(format!("image \"{name}\" has the camera {own}, and in frame {frame} the camera {camera}"));
            }
            if several {
                record.extra.insert(RIG_FRAME.to_owned(), frame.into());
            }
            let Some(of_rig) = rig_image.cam_from_world else { continue };
            match &record.cam_from_world {
                Some(own) => poses.push((image.name.as_str(), from_rows(own), of_rig)),
                None => {
                    record.cam_from_world = Some(rows(&of_rig));
                    computed += 1;
                }
            }
        }
        if let Some(image) = images.iter().find(|x| frames.get(&x.name).is_some_and(|y| y.cam_from_world.is_none())) {
            let (name, camera) = (&image.name, image.camera);
            return Err(match self.images.get(&image.id) {
                Some(_) => format!("image \"{name}\" has no pose, and its rig has none for the camera {camera}"),
                None => format!("image \"{name}\" has no pose, and it is in no frame"),
            });
        }
        let mut notes = Vec::new();
        let many = self.rigs.values().filter(|rig| rig.len() > 1).count();
        if many > 0 {
            let time_steps = self.frames.values().filter(|&&images| images > 1).count();
            let rigs = count(many, "rig");
            let frames = count(time_steps, "frame");
            notes.push(format!("{rigs} with several sensors, {frames} with several images, which have one rig_frame"));
        }
        if computed > 0 {
            notes.push(format!("the poses of {} were computed from the frames and rigs", count(computed, "image")));
        }
        if let Some(first) = without_frame.first() {
            let images = count(without_frame.len(), "image");
            notes.push(format!("{images} in no frame of the rigs, such as \"{first}\": their own poses are used"));
        }
        notes.extend(disagreement(&poses));
        Ok(notes)
    }
}

/// A note on images whose own poses differ from those of their frames.
fn disagreement(poses: &[(&str, Matrix4<f64>, Matrix4<f64>)]) -> Option<String> {
    let center = |pose: &Matrix4<f64>| inverse(pose).map(|world| world.fixed_view::<3, 1>(0, 3).into_owned());
    let first = center(&poses.first()?.1)?;
    let distances = poses.iter().filter_map(|(_, own, _)| center(own)).map(|c| (c - first).norm());
    let extent = Some(distances.fold(0.0, f64::max)).filter(|extent| *extent > 0.0).unwrap_or(1.0);
    let mut wrong: Vec<(&str, f64, f64)> = Vec::new();
    for (name, own, of_rig) in poses {
        let turn = (own * inverse(of_rig)?).fixed_view::<3, 3>(0, 0).into_owned();
        let sine = 0.5 * (turn - turn.transpose()).norm() / std::f64::consts::SQRT_2;
        let angle = sine.atan2(0.5 * (turn.trace() - 1.0));
        let shift = (center(own)? - center(of_rig)?).norm();
        if angle > TOLERANCE || shift > TOLERANCE * extent {
            wrong.push((name, angle, shift));
        }
    }
    let images = count(wrong.len(), "image");
    let (name, angle, shift) = wrong.first()?;
    let (angle, shift) = ((1e6 * angle).round() / 1e6, significant(*shift, 3));
    Some(format!(
        "the rigs are inconsistent with {images}, such as \"{name}\" by {angle} radians and {shift} units: the poses of the \
         file of the images are used, COLMAP uses those of frames and rigs"
    ))
}

#[cfg(test)]
#[path = "rig_tests.rs"]
mod tests;
