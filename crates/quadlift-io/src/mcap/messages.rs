//! What the messages mean that a scene is made of: calibrations, transforms, poses, 2D detections and images, of ROS 2 and of
//! Foxglove.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use quadlift::geometry::{BoundingBox, Camera, CameraModel, OrientedBox};

use super::value::{At, Value};
use crate::read::PixelCenters;
use crate::scene_file::{CameraRecord, DetectionRecord};

/// What a topic gives, by the type of its messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`.
    Calibration,
    /// `tf2_msgs/TFMessage`, `foxglove.FrameTransform(s)`.
    Transforms,
    /// `nav_msgs/Odometry`.
    Odometry,
    /// `geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped`, `foxglove.PoseInFrame`.
    Pose,
    /// `vision_msgs/Detection2DArray`.
    Detections,
    /// `foxglove.ImageAnnotations`.
    Annotations,
    /// `sensor_msgs/CompressedImage`, `foxglove.CompressedImage`.
    CompressedImage,
    /// `foxglove.SceneUpdate` and `vision_msgs/Detection3DArray`: 3D bodies, which are not read.
    Bodies,
}

/// What a type of messages gives; `None` for all others.
pub(super) fn kind_of(schema: &str) -> Option<Kind> {
    let name = schema.replace("/msg/", "/").replace("foxglove_msgs/", "foxglove.");
    Some(match &*name {
        "sensor_msgs/CameraInfo" | "foxglove.CameraCalibration" => Kind::Calibration,
        "tf2_msgs/TFMessage" | "tf/tfMessage" | "foxglove.FrameTransform" | "foxglove.FrameTransforms" => {
            Kind::Transforms
        }
        "nav_msgs/Odometry" => Kind::Odometry,
        "geometry_msgs/PoseStamped" | "geometry_msgs/PoseWithCovarianceStamped" | "foxglove.PoseInFrame" => Kind::Pose,
        "vision_msgs/Detection2DArray" => Kind::Detections,
        "foxglove.ImageAnnotations" => Kind::Annotations,
        "sensor_msgs/CompressedImage" | "foxglove.CompressedImage" => Kind::CompressedImage,
        "foxglove.SceneUpdate" | "vision_msgs/Detection3DArray" => Kind::Bodies,
        _ => return None,
    })
}

/// The time and the frame of a message: in its header, or beside the other fields (Foxglove).
fn header(message: &At) -> Result<(i64, String), String> {
    let inner = message.optional(&["header"]);
    let header = inner.as_ref().unwrap_or(message);
    let frame = header.optional(&["frame_id"]).map(|name| name.text().map(frame_name)).transpose()?;
    Ok((stamp(&header.field(&["stamp", "timestamp"])?)?, frame.unwrap_or_default()))
}

/// The name of a frame; ROS 1 had a slash before it.
pub(super) fn frame_name(name: &str) -> String {
    name.strip_prefix('/').unwrap_or(name).to_owned()
}

/// Times are before this, so that differences of two are numbers of 64 bits; 126 years in nanoseconds.
const LATEST: i64 = 4_000_000_000_000_000_000;

/// A time in nanoseconds.
fn stamp(time: &At) -> Result<i64, String> {
    let seconds = time.field(&["sec", "seconds", "secs"])?.whole()?;
    let nanoseconds = time.field(&["nanosec", "nanos", "nsec", "nsecs"])?.whole()?;
    let stamp = seconds.checked_mul(1_000_000_000).and_then(|seconds| seconds.checked_add(nanoseconds));
    let stamp = stamp.filter(|stamp| stamp.abs() < LATEST);
    stamp.ok_or_else(|| time.error(format!("found {seconds} seconds; expected a time of this century")))
}

/// Limit of coordinates: what is larger is no place in a world.
const FARTHEST: f64 = 1e12;

/// A rotation and a translation: `translation` and `rotation`, or `position` and `orientation`.
fn isometry(pose: &At) -> Result<Isometry3<f64>, String> {
    let xyz = pose.field(&["translation", "position"])?;
    let [x, y, z] = xyz.coordinates(["x", "y", "z"])?;
    if [x, y, z].iter().any(|x| x.abs() > FARTHEST) {
        return Err(xyz.error(format!("found [{x}, {y}, {z}]; expected coordinates in meters")));
    }
    let quaternion = pose.field(&["rotation", "orientation"])?;
    let [qx, qy, qz, qw] = quaternion.coordinates(["x", "y", "z", "w"])?;
    let given = Quaternion::new(qw, qx, qy, qz);
    if (given.norm() - 1.0).abs() > 0.01 {
        return Err(
            quaternion.error(format!("found the quaternion [{qx}, {qy}, {qz}, {qw}]; expected one of length 1"))
        );
    }
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_normalize(given)))
}

/// A transform of a tree: maps points of `child` to points of `parent`.
#[derive(Debug, Clone, PartialEq)]
pub struct Transform {
    /// Nanoseconds.
    pub stamp: i64,
    pub parent: String,
    pub child: String,
    pub parent_from_child: Isometry3<f64>,
}

/// The transforms of a message, in its order; those that cannot be read are errors.
pub(super) fn transforms(message: &Value) -> Result<Vec<Result<Transform, String>>, String> {
    let root = At::root(message);
    let one = |entry: &At| {
        let inner = entry.optional(&["transform"]);
        let (stamp, parent) = match entry.optional(&["parent_frame_id"]) {
            Some(parent) => (stamp(&entry.field(&["timestamp"])?)?, frame_name(parent.text()?)),
            None => header(entry)?,
        };
        let child = frame_name(entry.field(&["child_frame_id"])?.text()?);
        if child.is_empty() || parent.is_empty() || child == parent {
            return Err(entry.error(format!("found the transform \"{parent}\" to \"{child}\"; expected two frames")));
        }
        Ok(Transform { stamp, parent, child, parent_from_child: isometry(inner.as_ref().unwrap_or(entry))? })
    };
    match root.optional(&["transforms"]) {
        Some(list) => Ok(list.items()?.map(|entry| one(&entry)).collect()),
        None => Ok(vec![one(&root)]),
    }
}

/// A pose in a frame, and the frame whose pose it is (of odometry).
pub(super) fn pose(message: &Value) -> Result<Transform, String> {
    let root = At::root(message);
    let (stamp, parent) = header(&root)?;
    let child = root.optional(&["child_frame_id"]).map(|name| name.text().map(frame_name)).transpose()?;
    let pose = root.field(&["pose"])?;
    let with_covariance = pose.optional(&["pose"]);
    let parent_from_child = isometry(with_covariance.as_ref().unwrap_or(&pose))?;
    if parent.is_empty() {
        return Err(root.error("the frame_id is empty; expected the frame in which the pose is given"));
    }
    Ok(Transform { stamp, parent, child: child.unwrap_or_default(), parent_from_child })
}

/// A camera as a calibration message describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Nanoseconds.
    pub stamp: i64,
    /// The frame of the camera.
    pub frame: String,
    /// Without an id.
    pub camera: CameraRecord,
    /// Where the camera is in its frame: differs from the identity for rectified images.
    pub cam_from_frame: Isometry3<f64>,
}

/// Which image the pixels of detections belong to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct CameraOptions {
    /// The rectified image (matrices `P` and `R`) instead of the raw one (`K` and `D`).
    pub rectified: bool,
    /// Origin of the pixel coordinates.
    pub pixel_centers: PixelCenters,
}

/// The camera of a calibration message.
pub(super) fn calibration(message: &Value, options: CameraOptions) -> Result<Calibration, String> {
    let root = At::root(message);
    let (stamp, frame) = header(&root)?;
    let size = [root.field(&["width"])?.number()?, root.field(&["height"])?.number()?];
    let matrix = |names: &[&'static str; 2], count: usize| -> Result<Vec<f64>, String> {
        let field = root.field(names)?;
        let numbers = field.numbers()?;
        if numbers.len() == count { Ok(numbers) } else { Err(field.error(format!("expected {count} numbers"))) }
    };
    let mut cam_from_frame = Isometry3::identity();
    let (model, [fx, fy, cx, cy], distortion) = if options.rectified {
        let p = matrix(&["p", "P"], 12)?;
        check_focal("P", [p[0], p[5]], p[1])?;
        let rotation = matrix(&["r", "R"], 9)?;
        let rotation = nalgebra::Matrix3::from_row_slice(&rotation);
        if rotation != nalgebra::Matrix3::zeros() {
            if quadlift::geometry::rotation_defect(&rotation) > 1e-3 || rotation.determinant() < 0.0 {
                return Err("r: expected a rotation".to_owned());
            }
            let rotation = nalgebra::Rotation3::from_matrix_unchecked(rotation);
            cam_from_frame.rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        }
        cam_from_frame.translation = Translation3::new(p[3] / p[0], p[7] / p[5], 0.0);
        (CameraModel::Pinhole, [p[0], p[5], p[2], p[6]], Vec::new())
    } else {
        let k = matrix(&["k", "K"], 9)?;
        check_focal("K", [k[0], k[4]], k[1])?;
        let name = root.field(&["distortion_model"])?;
        let numbers = root.field(&["d", "D"])?.numbers()?;
        let (model, distortion) = distortion(name.text()?, &numbers).map_err(|problem| name.error(problem))?;
        (model, [k[0], k[4], k[2], k[5]], distortion)
    };
    // The matrices are those of the full image; the image may be a part of it, with fewer pixels.
    let region = root.optional(&["roi"]);
    let part = |name| region.as_ref().map_or(Ok(0.0), |region| region.field(&[name])?.number());
    let [x, y, width, height] = [part("x_offset")?, part("y_offset")?, part("width")?, part("height")?];
    let binning = |name| root.optional(&[name]).map_or(Ok(1.0), |x| x.number().map(|x| x.max(1.0)));
    let [bx, by] = [binning("binning_x")?, binning("binning_y")?];
    let shift = options.pixel_centers.shift();
    let mut params = vec![fx / bx, fy / by, (cx + shift - x) / bx, (cy + shift - y) / by];
    params.extend(distortion);
    let [width, height] =
        [if width > 0.0 { width } else { size[0] } / bx, if height > 0.0 { height } else { size[1] } / by];
    Camera::new(model, &params).map_err(|error| error.to_string())?;
    let camera = CameraRecord {
        model: model.name().to_owned(),
        width: (width > 0.0 && height > 0.0).then_some(width.floor()),
        height: (width > 0.0 && height > 0.0).then_some(height.floor()),
        params,
        ..CameraRecord::default()
    };
    Ok(Calibration { stamp, frame, camera, cam_from_frame })
}

fn check_focal(name: &str, [fx, fy]: [f64; 2], skew: f64) -> Result<(), String> {
    if fx == 0.0 && fy == 0.0 {
        return Err(format!("{name} is zero: the camera is not calibrated"));
    }
    if skew != 0.0 {
        return Err(format!("{name} has the skew {skew}, which is not supported"));
    }
    Ok(())
}

/// The lens model of ROS's name, with the coefficients that follow the focal lengths and the principal point.
fn distortion(name: &str, d: &[f64]) -> Result<(CameraModel, Vec<f64>), String> {
    if d.iter().all(|&x| x == 0.0) {
        let none = matches!(name, "" | "plumb_bob" | "rational_polynomial" | "none");
        if none {
            return Ok((CameraModel::Pinhole, Vec::new()));
        }
    }
    let expected = |counts: &str| Err(format!("\"{name}\" has {} coefficients; expected {counts}", d.len()));
    match (name, d.len()) {
        ("plumb_bob" | "", 4) => Ok((CameraModel::OpenCv, d.to_vec())),
        ("plumb_bob" | "", 5) if d[4] == 0.0 => Ok((CameraModel::OpenCv, d[..4].to_vec())),
        ("plumb_bob" | "", 5) => Ok((CameraModel::FullOpenCv, vec![d[0], d[1], d[2], d[3], d[4], 0.0, 0.0, 0.0])),
        ("plumb_bob" | "", _) => expected("4 or 5"),
        ("rational_polynomial", 8) => Ok((CameraModel::FullOpenCv, d.to_vec())),
        ("rational_polynomial", 12 | 14) if d[8..].iter().all(|&x| x == 0.0) => {
            Ok((CameraModel::FullOpenCv, d[..8].to_vec()))
        }
        ("rational_polynomial", 12 | 14) => {
            Err("\"rational_polynomial\" with thin-prism or tilt coefficients is not supported".to_owned())
        }
        ("rational_polynomial", _) => expected("8"),
        // ROS has one name, Foxglove another one for the same.
        ("equidistant" | "kannala_brandt" | "fisheye", 4) => Ok((CameraModel::OpenCvFisheye, d.to_vec())),
        ("equidistant" | "kannala_brandt" | "fisheye", 0) => Ok((CameraModel::OpenCvFisheye, vec![0.0; 4])),
        ("equidistant" | "kannala_brandt" | "fisheye", _) => expected("4"),
        _ => Err(format!(
            "the lens model \"{name}\" is not supported; expected plumb_bob, rational_polynomial, equidistant or \
             kannala_brandt"
        )),
    }
}

/// Detections of one image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Detections {
    /// Nanoseconds.
    pub stamp: i64,
    /// The frame of the camera; empty if the message does not say it.
    pub frame: String,
    /// Without their frame.
    pub detections: Vec<DetectionRecord>,
    /// Why some entries are left out.
    pub problems: Vec<String>,
}

/// The boxes of a `vision_msgs/Detection2DArray`, of any version.
pub(super) fn detections(message: &Value) -> Result<Detections, String> {
    let root = At::root(message);
    let (mut stamp, mut frame) = header(&root)?;
    let (mut detections, mut problems) = (Vec::new(), Vec::new());
    let list = root.field(&["detections"])?;
    for entry in list.items()? {
        match detection(&entry) {
            Ok((record, (own_stamp, own_frame))) => {
                if frame.is_empty() {
                    frame = own_frame;
                }
                // Some detectors set the header of each detection only.
                if stamp == 0 {
                    stamp = own_stamp;
                }
                detections.push(record);
            }
            Err(problem) => problems.push(problem),
        }
    }
    Ok(Detections { stamp, frame, detections, problems })
}

/// A detection, with time and frame of its own header; 0 and empty without one.
fn detection(entry: &At) -> Result<(DetectionRecord, (i64, String)), String> {
    let bounding_box = entry.field(&["bbox"])?;
    let center = bounding_box.field(&["center"])?;
    // From version 4 on the position has a name of its own.
    let position = center.optional(&["position"]);
    let [x, y] = position.as_ref().unwrap_or(&center).coordinates(["x", "y"])?;
    let theta = center.field(&["theta"])?.number()?;
    let [width, height] = bounding_box.coordinates(["size_x", "size_y"])?;
    let mut best: Option<(String, f64)> = None;
    let results = entry.field(&["results"])?;
    for result in results.items()? {
        // Before version 3 the id and the score are not in a hypothesis.
        let inner = result.optional(&["hypothesis"]);
        let hypothesis = inner.as_ref().unwrap_or(&result);
        let (class, score) = (hypothesis.field(&["class_id", "id"])?.word()?, hypothesis.field(&["score"])?.number()?);
        if best.as_ref().is_none_or(|(_, known)| score > *known) {
            best = Some((class, score));
        }
    }
    let is_tracking = entry.optional(&["is_tracking"]).map_or(Ok(1), |x| x.whole())? != 0;
    let id = entry.optional(&["id", "tracking_id"]).map_or(Ok(String::new()), |id| id.word())?;
    let own = entry.optional(&["header"]).map_or(Ok(Default::default()), |_| header(entry))?;
    let (category, score) = best.unzip();
    let mut record = DetectionRecord {
        category: category.filter(|name| !name.is_empty()).map(Into::into),
        score,
        object: (is_tracking && !id.is_empty()).then(|| object_id(&id).into()),
        ..DetectionRecord::default()
    };
    let problem =
        || bounding_box.error(format!("found the box {width} x {height} at [{x}, {y}]; expected a size above 0"));
    if theta == 0.0 {
        let [w, h] = [width / 2.0, height / 2.0];
        record.bounding_box = Some(BoundingBox::new([x - w, y - h, x + w, y + h]).map_err(|_| problem())?.edges());
    } else {
        let turned = OrientedBox::new([x, y].into(), [width, height].into(), theta).map_err(|_| problem())?;
        record.oriented_box = Some(Box::new(turned.into()));
    }
    Ok((record, own))
}

/// The object id of a track: `t` with the number, as from other formats.
fn object_id(track: &str) -> String {
    if track.parse::<u64>().is_ok() { format!("t{track}") } else { track.to_owned() }
}

/// Names of a category, a score and an id in the metadata of an annotation.
const METADATA: [&[&str]; 3] = [
    &["category", "class", "class_id", "class_name", "label"],
    &["score", "confidence"],
    &["id", "track_id", "tracking_id", "object"],
];

/// The boxes of a `foxglove.ImageAnnotations`: closed lines with four corners whose sides are horizontal and vertical. The
/// category is that of its metadata, or the text that stands nearest to its upper left corner, within half the box. `None` if the
/// message is empty, and so has no time.
pub(super) fn annotations(message: &Value) -> Result<Option<Detections>, String> {
    let root = At::root(message);
    let mut texts = Vec::new();
    if let Some(list) = root.optional(&["texts"]) {
        for entry in list.items()? {
            texts.push((
                entry.field(&["position"])?.coordinates(["x", "y"])?,
                entry.field(&["text"])?.text()?.to_owned(),
            ));
        }
    }
    let mut found = Detections { stamp: 0, frame: String::new(), detections: Vec::new(), problems: Vec::new() };
    let mut time = None;
    if let Some(list) = root.optional(&["points"]) {
        for entry in list.items()? {
            let at = stamp(&entry.field(&["timestamp"])?)?;
            if *time.get_or_insert(at) != at {
                found.problems.push(entry.error("it has another time than those before it, and is left out"));
                continue;
            }
            if let Some(record) = annotated_box(&entry, &texts)? {
                found.detections.push(record);
            }
        }
    }
    // Without a box the time may be that of a text; without anything it is unknown.
    if time.is_none()
        && let Some(list) = root.optional(&["texts"])
        && let Some(entry) = list.items()?.next()
    {
        time = Some(stamp(&entry.field(&["timestamp"])?)?);
    }
    Ok(time.map(|stamp| Detections { stamp, ..found }))
}

fn annotated_box(entry: &At, texts: &[([f64; 2], String)]) -> Result<Option<DetectionRecord>, String> {
    let kind = entry.field(&["type"])?;
    // LINE_LOOP is 2, LINE_STRIP 3.
    let kind = if kind.is_text() { i64::from(kind.text()? != "LINE_LOOP") + 2 } else { kind.whole()? };
    let list = entry.field(&["points"])?;
    let corners: Vec<[f64; 2]> = list.items()?.map(|point| point.coordinates(["x", "y"])).collect::<Result<_, _>>()?;
    let corners = match (kind, corners.as_slice()) {
        (2, [a, b, c, d]) => [*a, *b, *c, *d],
        (3, [a, b, c, d, e]) if a == e => [*a, *b, *c, *d],
        _ => return Ok(None),
    };
    let [x0, y0] = corners.into_iter().reduce(|[x, y], [a, b]| [x.min(a), y.min(b)]).unwrap_or_default();
    let [x1, y1] = corners.into_iter().reduce(|[x, y], [a, b]| [x.max(a), y.max(b)]).unwrap_or_default();
    let is_corner = |[x, y]: [f64; 2]| (x == x0 || x == x1) && (y == y0 || y == y1);
    let Ok(bounding_box) = BoundingBox::new([x0, y0, x1, y1]) else { return Ok(None) };
    if !corners.into_iter().all(is_corner) || corners[0] == corners[2] || corners[1] == corners[3] {
        return Ok(None);
    }
    let mut told = [None, None, None];
    if let Some(metadata) = entry.optional(&["metadata"]) {
        for pair in metadata.items()? {
            let (key, value) = (pair.field(&["key"])?.text()?, pair.field(&["value"])?.text()?);
            for (told, names) in told.iter_mut().zip(METADATA) {
                if names.contains(&key) && told.is_none() && !value.is_empty() {
                    *told = Some(value.to_owned());
                }
            }
        }
    }
    let [category, score, id] = told;
    let reach = 0.5 * (x1 - x0).max(y1 - y0);
    let distance = |[x, y]: [f64; 2]| (x - x0).hypot(y - y0);
    let label =
        texts.iter().filter(|(at, _)| distance(*at) <= reach).min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
    let category = category.or_else(|| label.map(|(_, text)| text.clone()));
    Ok(Some(DetectionRecord {
        category: category.filter(|name| !name.is_empty()).map(Into::into),
        score: score.and_then(|score| score.parse().ok()).filter(|score: &f64| score.is_finite()),
        object: id.map(|id| object_id(&id).into()),
        bounding_box: Some(bounding_box.edges()),
        ..DetectionRecord::default()
    }))
}

/// A compressed image: its time, its frame, its format and its bytes.
pub(super) struct CompressedImage<'a> {
    pub stamp: i64,
    pub frame: String,
    pub format: String,
    pub bytes: &'a [u8],
}

/// The image of a message.
pub(super) fn compressed_image(message: &Value) -> Result<CompressedImage<'_>, String> {
    let root = At::root(message);
    let (stamp, frame) = header(&root)?;
    let Value::Struct(fields) = message else { return Err("expected fields".to_owned()) };
    let bytes = fields.iter().find_map(|(name, value)| match value {
        Value::Bytes(bytes) if &**name == "data" => Some(&**bytes),
        _ => None,
    });
    let bytes = bytes.ok_or("data: expected bytes (images in JSON are not supported)")?;
    Ok(CompressedImage { stamp, frame, format: root.field(&["format"])?.text()?.to_lowercase(), bytes })
}

#[cfg(test)]
#[path = "message_tests.rs"]
mod tests;
