//! A log in MCAP that ROS 2's tools, RViz and Foxglove read: the objects as `vision_msgs/Detection3DArray` and as markers, and what
//! they were measured from: cameras, their poses, 2D detections. Meters; sizes are full extents.
//!
//! Everything has the time of its frame. The markers, and the array of all objects, are latched.

use std::collections::{BTreeMap, HashMap};

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion};
use quadlift::geometry::{Body, CameraModel, Primitive, quaternion_from_rotation};

use super::format::{ExportFormat, Writer};
use super::pose_covariance::pose_covariance;
use super::scores::Scores;
use super::stamps::{SECOND, stamps};
use super::{CheckedScene, Document, Object, colors};
use crate::mcap::{CdrWriter, LogWriter, definition};
use crate::read::from_rows;
use crate::scene_file::{CameraRecord, DetectionRecord};
use crate::wording::count;

/// Types and shapes of `visualization_msgs/Marker`.
const CUBE: i32 = 1;
const SPHERE: i32 = 2;
const CYLINDER: i32 = 3;
const TEXT: i32 = 9;
/// What is done with a marker.
const ADD: i32 = 0;
const DELETE_ALL: i32 = 3;

/// Center, angle, width and height of the box of a detection: the oriented box, or else the box, or that around the outline.
fn box_of(detection: &DetectionRecord) -> Option<[f64; 5]> {
    if let (Some(turned), None) = (&detection.oriented_box, &detection.outline) {
        return Some([turned.center[0], turned.center[1], turned.angle, turned.size[0], turned.size[1]]);
    }
    let around = |corners: &[[f64; 2]]| {
        let first = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        corners.iter().fold(first, |[x0, y0, x1, y1], &[x, y]| [x0.min(x), y0.min(y), x1.max(x), y1.max(y)])
    };
    let [x0, y0, x1, y1] = detection.bounding_box.or_else(|| detection.outline.as_deref().map(around))?;
    Some([0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0, x1 - x0, y1 - y0])
}

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "mcap",
    about: "MCAP: a log of ROS 2 with 3D detections, markers, cameras and 2D detections",
    options: &["enclosing", "frame_id", "length_unit"],
    write: Writer::Bodies(|scene, options| Ok(mcap(scene, options.frame()))),
};

/// The log of a scene; `frame_id` is the name of the world.
pub fn mcap(scene: &CheckedScene, frame_id: &str) -> Document {
    let (meters, unit_note) = scene.meters();
    let mut notes = vec!["the axes are those of the scene's world".to_owned()];
    notes.extend(unit_note);
    let stamps = stamps(scene, &mut notes);
    let log = Log { scene, frame_id, meters, scores: Scores::of(scene, &mut notes) };
    let mut writer = LogWriter::new();
    // Times, channels and contents.
    let mut messages: Vec<(i64, u16, Vec<u8>)> = Vec::new();
    let mut detections = 0;
    let cameras = log.cameras(&mut notes);
    if !cameras.is_empty() {
        let tf = writer.channel("/tf", "tf2_msgs/msg/TFMessage", &definition("tf2_msgs/TFMessage"), false);
        let mut of_frame: HashMap<&str, Vec<&DetectionRecord>> = HashMap::new();
        for detection in &scene.file.detections {
            of_frame.entry(&*detection.frame).or_default().push(detection);
        }
        let mut channels: BTreeMap<&str, (u16, Option<u16>)> = BTreeMap::new();
        for (id, camera) in &cameras {
            let topic = format!("/{}", camera.name);
            let (info, boxes) = ("sensor_msgs/CameraInfo", "vision_msgs/Detection2DArray");
            let channel = |writer: &mut LogWriter, what: &str, name: &str| {
                writer.channel(&format!("{topic}/{what}"), &name.replace('/', "/msg/"), &definition(name), false)
            };
            let info = channel(&mut writer, "camera_info", info);
            let boxes = (!scene.file.detections.is_empty()).then(|| channel(&mut writer, "detections", boxes));
            channels.insert(id, (info, boxes));
        }
        for (frame, &stamp) in scene.file.frames.iter().zip(&stamps) {
            let camera = frame.camera.as_deref().and_then(|id| cameras.get_key_value(id));
            let (Some((id, camera)), Some(pose)) = (camera, frame.cam_from_world) else { continue };
            let (info, boxes) = channels[*id];
            messages.push((stamp, tf, log.transform(stamp, &pose, &camera.frame)));
            messages.push((stamp, info, camera.info(stamp)));
            let found = of_frame.get(frame.id.as_str()).map_or(&[][..], Vec::as_slice);
            let found: Vec<_> = found.iter().filter_map(|&found| Some((found, box_of(found)?))).collect();
            detections += found.len();
            if let Some(boxes) = boxes {
                messages.push((stamp, boxes, log.detections_2d(stamp, &camera.frame, &found)));
            }
        }
    }
    let array = "vision_msgs/Detection3DArray";
    let in_frames = writer.channel("/quadlift/objects", &array.replace('/', "/msg/"), &definition(array), false);
    let all = writer.channel("/quadlift/map", &array.replace('/', "/msg/"), &definition(array), true);
    let markers = "visualization_msgs/MarkerArray";
    let markers = writer.channel("/quadlift/markers", &markers.replace('/', "/msg/"), &definition(markers), true);
    let (first, last) = (stamps.iter().min().copied().unwrap_or(0), stamps.iter().max().copied().unwrap_or(0));
    let mut seen: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for object in scene.seen_objects(true) {
        seen.entry(object.frame_index).or_default().push(object.object_index);
    }
    for (frame, objects) in &seen {
        let id = Some(scene.file.frames[*frame].id.as_str());
        let objects = objects.iter().map(|&index| &scene.objects[index]);
        messages.push((stamps[*frame], in_frames, log.detections_3d(stamps[*frame], objects, id)));
    }
    messages.push((first, markers, log.markers(first, false, |_| true)));
    messages.push((last, all, log.detections_3d(last, scene.objects.iter(), None)));
    // Stable: messages of one time stay in this order, transforms before what needs them.
    messages.sort_by_key(|(time, ..)| *time);
    for (time, channel, data) in &messages {
        writer.message(*channel, u64::try_from(*time).unwrap_or_default(), data);
    }
    let counts = vec![
        ("object", scene.objects.len()),
        ("frame", scene.file.frames.len()),
        ("2D detection", detections),
        ("message", messages.len()),
    ];
    Document { content: writer.finish(), counts, notes }
}

/// What a robot publishes of its objects, in CDR, at one time. Messages are made one by one.
pub struct MapMessages<'s, 'a> {
    log: Log<'s, 'a>,
    stamp: i64,
}

impl<'s, 'a> MapMessages<'s, 'a> {
    /// The objects of a result at a time in nanoseconds; `frame_id` is the name of the world.
    pub fn new(scene: &'s CheckedScene<'a>, frame_id: &'s str, stamp: i64) -> Self {
        let (meters, _) = scene.meters();
        Self { log: Log { scene, frame_id, meters, scores: Scores::known(scene) }, stamp }
    }

    /// Adds the fields of a `vision_msgs/Detection3DArray` with the objects whose ids are wanted.
    pub fn add_detections(&self, message: &mut CdrWriter, is_wanted: impl Fn(&str) -> bool) {
        let objects = self.log.scene.objects.iter().filter(|object| is_wanted(&object.id));
        self.log.add_detections_3d(message, self.stamp, objects, None);
    }

    /// A `visualization_msgs/MarkerArray` with the objects whose ids are wanted, in place of all markers before.
    pub fn markers(&self, is_wanted: impl Fn(&str) -> bool) -> Vec<u8> {
        self.log.markers(self.stamp, true, is_wanted)
    }
}

/// A camera in the log.
struct LogCamera<'a> {
    /// As a part of topics.
    name: String,
    /// Its frame.
    frame: String,
    camera: &'a CameraRecord,
    /// ROS's name of the lens model, and its coefficients.
    lens: (&'static str, Vec<f64>),
}

struct Log<'s, 'a> {
    scene: &'s CheckedScene<'a>,
    frame_id: &'s str,
    meters: f64,
    scores: Scores<'a>,
}

impl<'a> Log<'_, 'a> {
    /// The cameras whose lens ROS can describe.
    fn cameras(&self, notes: &mut Vec<String>) -> BTreeMap<&'a str, LogCamera<'a>> {
        let (mut cameras, mut left_out) = (BTreeMap::new(), Vec::new());
        let file = self.scene.file;
        for camera in &file.cameras {
            let Some(lens) = lens(camera) else {
                left_out.push(format!("{} ({})", camera.id, camera.model));
                continue;
            };
            // Names of topics have letters, digits, _ and /.
            let sign = |c: char| if c.is_ascii_alphanumeric() || c == '/' { c } else { '_' };
            let mut name: String = camera.id.trim_matches('/').chars().map(sign).collect();
            if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) {
                name.insert_str(0, "camera_");
            }
            while cameras.values().any(|other: &LogCamera| other.name == name) {
                name.push('_');
            }
            let frame = format!("{}_optical_frame", name.replace('/', "_"));
            cameras.insert(camera.id.as_str(), LogCamera { name, frame, camera, lens });
        }
        if !left_out.is_empty() {
            let cameras = crate::wording::some_of(&left_out);
            notes.push(format!("ROS has no name for the lens of these cameras, which are left out: {cameras}"));
        }
        let projections = file.frames.iter().filter(|frame| frame.projection.is_some()).count();
        if projections > 0 {
            notes.push(format!(
                "{} with a projection and no camera: their cameras are left out",
                count(projections, "frame")
            ));
        }
        let measured = |d: &&DetectionRecord| d.mask.is_some() || d.ellipse.is_some() || d.outline.is_some();
        let measured = file.detections.iter().filter(measured).count();
        if measured > 0 {
            let outlines =
                if file.detections.iter().any(|d| d.outline.is_some()) { "masks, outlines" } else { "masks" };
            notes.push(format!("{outlines} and ellipses of {} are left out", count(measured, "detection")));
        }
        cameras
    }

    fn transform(&self, stamp: i64, cam_from_world: &[[f64; 4]; 3], child: &str) -> Vec<u8> {
        let matrix = from_rows(cam_from_world);
        let rotation = Rotation3::from_matrix_unchecked(matrix.fixed_view::<3, 3>(0, 0).into_owned());
        let translation = Translation3::from(matrix.fixed_view::<3, 1>(0, 3) * self.meters);
        let world_from_cam =
            Isometry3::from_parts(translation, UnitQuaternion::from_rotation_matrix(&rotation)).inverse();
        let mut message = CdrWriter::default();
        header(message.u32(1), stamp, self.frame_id).text(child);
        message.f64s(world_from_cam.translation.vector.iter().copied());
        message.f64s(world_from_cam.rotation.coords.iter().copied());
        message.finish()
    }

    fn detections_2d(&self, stamp: i64, frame: &str, detections: &[(&DetectionRecord, [f64; 5])]) -> Vec<u8> {
        let mut message = CdrWriter::default();
        header(&mut message, stamp, frame).u32(detections.len() as u32);
        for &(detection, numbers) in detections {
            header(&mut message, stamp, frame).u32(1);
            message.text(detection.category.as_deref().unwrap_or_default()).f64(detection.score.unwrap_or(1.0));
            // No pose is known.
            message.f64s([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).f64s([0.0; 36]);
            message.f64s(numbers);
            message.text(detection.object.as_deref().unwrap_or_default());
        }
        message.finish()
    }

    fn detections_3d<'o>(&self, stamp: i64, objects: impl Iterator<Item = &'o Object>, frame: Option<&str>) -> Vec<u8> {
        let mut message = CdrWriter::default();
        self.add_detections_3d(&mut message, stamp, objects, frame);
        message.finish()
    }

    fn add_detections_3d<'o>(
        &self,
        message: &mut CdrWriter,
        stamp: i64,
        objects: impl Iterator<Item = &'o Object>,
        frame: Option<&str>,
    ) {
        let objects: Vec<&Object> = objects.collect();
        header(message, stamp, self.frame_id).u32(objects.len() as u32);
        for object in objects {
            let body = &object.body;
            let covariance = object.covariance.as_ref().map(|(c, of)| pose_covariance(c, of, self.meters));
            header(message, stamp, self.frame_id).u32(1);
            message.text(object.category_name()).f64(self.scores.get(&object.id, frame));
            self.pose(message, body);
            // In ROS all zeros mean "unknown".
            message.f64s(covariance.unwrap_or_default().transpose().iter().copied());
            let boxed = object.boxed();
            self.pose(message, boxed);
            message.f64s((boxed.half_extents * (2.0 * self.meters)).iter().copied()).text(&object.id);
        }
    }

    fn pose(&self, message: &mut CdrWriter, body: &Body) {
        let [w, x, y, z] = quaternion_from_rotation(&body.rotation);
        message.f64s(body.center.coords.iter().map(|x| x * self.meters)).f64s([x, y, z, w]);
    }

    /// A body and a label for each wanted object, after a marker that removes those before if they are replaced.
    fn markers(&self, stamp: i64, replaces: bool, is_wanted: impl Fn(&str) -> bool) -> Vec<u8> {
        let categories = self.scene.category_indices();
        let objects: Vec<&Object> = self.scene.objects.iter().filter(|object| is_wanted(&object.id)).collect();
        let mut message = CdrWriter::default();
        message.u32(u32::from(replaces) + 2 * objects.len() as u32);
        let rest = |message: &mut CdrWriter, text: &str| {
            // Lifetime: for ever; not locked to its frame; no points, no colors, no texture.
            message.i32(0).u32(0).u8(0).u32(0).u32(0).text("");
            header(message, 0, "").text("").u32(0).u32(0).text(text).text("");
            // No mesh file.
            message.text("").u32(0).u8(0);
        };
        if replaces {
            header(&mut message, stamp, self.frame_id).text("").i32(0).i32(CUBE).i32(DELETE_ALL);
            message.f64s([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).f64s([0.0; 3]).f32(0.0).f32(0.0).f32(0.0).f32(0.0);
            rest(&mut message, "");
        }
        for (id, object) in (0..).zip(objects) {
            let body = &object.body;
            let size = body.half_extents * (2.0 * self.meters);
            let kind = match body.kind.primitive() {
                Primitive::Ball => SPHERE,
                Primitive::Cube => CUBE,
                Primitive::Cylinder => CYLINDER,
            };
            let index = categories.get(object.category_name()).copied().unwrap_or_default();
            let [r, g, b] = colors::of_category(index).map(|byte| f32::from(byte) / 255.0);
            let marker = |message: &mut CdrWriter, ns: &str, kind: i32| {
                header(message, stamp, self.frame_id).text(ns).i32(id).i32(kind);
                message.i32(ADD);
            };
            marker(&mut message, "objects", kind);
            self.pose(&mut message, body);
            message.f64s(size.iter().copied()).f32(r).f32(g).f32(b).f32(0.6);
            rest(&mut message, "");
            marker(&mut message, "labels", TEXT);
            let reach = (body.rotation.matrix().abs() * body.half_extents * self.meters).z;
            let height = 0.3 * size.max().min(1.0);
            let center = body.center.coords * self.meters;
            message.f64s([center.x, center.y, center.z + reach + height, 0.0, 0.0, 0.0, 1.0]);
            message.f64s([0.0, 0.0, height]).f32(1.0).f32(1.0).f32(1.0).f32(1.0);
            rest(&mut message, &format!("{} {}", object.category_name(), object.id));
        }
        message.finish()
    }
}

fn header<'m>(message: &'m mut CdrWriter, stamp: i64, frame: &str) -> &'m mut CdrWriter {
    message.i32(stamp.div_euclid(SECOND) as i32).u32(stamp.rem_euclid(SECOND) as u32).text(frame)
}

impl LogCamera<'_> {
    fn info(&self, stamp: i64) -> Vec<u8> {
        let CameraRecord { width, height, params, .. } = self.camera;
        let [fx, fy, cx, cy] = focal(self.camera, params);
        let mut message = CdrWriter::default();
        header(&mut message, stamp, &self.frame);
        message.u32(height.unwrap_or_default() as u32).u32(width.unwrap_or_default() as u32);
        message.text(self.lens.0).u32(self.lens.1.len() as u32).f64s(self.lens.1.iter().copied());
        message.f64s([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]).f64s([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        message.f64s([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        message.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0);
        message.finish()
    }
}

/// Focal lengths and principal point, which come first in all models that ROS knows.
fn focal(camera: &CameraRecord, params: &[f64]) -> [f64; 4] {
    let p = |index: usize| params.get(index).copied().unwrap_or_default();
    if camera.model.starts_with("SIMPLE_") || camera.model == "RADIAL" {
        [p(0), p(0), p(1), p(2)]
    } else {
        [p(0), p(1), p(2), p(3)]
    }
}

/// ROS's name of a lens model with its coefficients; `None` if it has none.
fn lens(camera: &CameraRecord) -> Option<(&'static str, Vec<f64>)> {
    let p = &camera.params;
    let model = CameraModel::from_name(&camera.model)?;
    Some(match model {
        CameraModel::SimplePinhole | CameraModel::Pinhole => ("plumb_bob", vec![0.0; 5]),
        CameraModel::SimpleRadial => ("plumb_bob", vec![p[3], 0.0, 0.0, 0.0, 0.0]),
        CameraModel::Radial => ("plumb_bob", vec![p[3], p[4], 0.0, 0.0, 0.0]),
        CameraModel::OpenCv => ("plumb_bob", vec![p[4], p[5], p[6], p[7], 0.0]),
        CameraModel::FullOpenCv => ("rational_polynomial", p[4..].to_vec()),
        CameraModel::OpenCvFisheye => ("equidistant", p[4..].to_vec()),
        _ => return None,
    })
}
