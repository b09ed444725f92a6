//! What a recording for Rerun holds, as the JSON document `recording.json` (docs/formats/rerun.md). It is made from the
//! data of a report, with poses, outlines and the objects' colours worked out, so that what logs it computes nothing.

use std::collections::HashSet;

use nalgebra::{Matrix3x4, Vector2};
use quadlift::geometry::{Body, Projection};
use quadlift::scene::{Detection, Scene};
use quadlift_io::EntryError;
use serde::Serialize;

use crate::colors::{Color, UNKNOWN};
use crate::data::{Report, ReportBody, ReportFrame};
use crate::document::{Content, report_of_frames};
use crate::outline::{ellipse_points, outline};
use crate::thumbnails::evenly_spread;
use crate::{MOST_FRAMES, ReportObject};

/// A line through points in pixels.
type Line = Vec<[f64; 2]>;

/// A recording. Lengths are world units; pixels are those of the frames' pinhole cameras, from the corner of the image.
#[derive(Debug, Clone, Serialize)]
pub struct Recording {
    /// `quadlift.recording`.
    pub format: &'static str,
    /// Version of the format: 1.
    pub version: u32,
    /// Name of the scene.
    pub name: String,
    /// World unit, where it is known.
    pub length_unit: Option<String>,
    /// World direction against gravity, of length one, where it is known.
    pub up: Option<[f64; 3]>,
    /// The objects that have a body, estimated or true.
    pub objects: Vec<RecordingObject>,
    /// Centres of the cameras in the order of the frames; of those that have one.
    pub path: Vec<[f64; 3]>,
    /// The frames.
    pub frames: Vec<RecordingFrame>,
    /// What was left out, in sentences.
    pub notes: Vec<String>,
}

/// An object.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingObject {
    /// Id.
    pub id: String,
    /// Category.
    pub category: Option<String>,
    /// How the estimation ended (see [`quadlift::solve::Status::name`]); nothing where none was made.
    pub status: Option<String>,
    /// Red, green, blue, as in reports.
    pub color: Color,
    /// The estimated body.
    pub estimate: Option<RecordingBody>,
    /// The true body.
    pub truth: Option<RecordingBody>,
}

/// A body as Rerun can draw it.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingBody {
    /// What the body is: `ellipsoid`, `cuboid` or `superellipsoid`.
    pub kind: &'static str,
    /// What the numbers describe: `cuboid`, or `ellipsoid`; of a superellipsoid the ellipsoid that stands for it (see
    /// [`Body::ellipsoid`]).
    pub shape: &'static str,
    /// Centre in the world.
    pub center: [f64; 3],
    /// Semi-axes or half extents.
    pub half_sizes: [f64; 3],
    /// Unit quaternion from the body's axes to the world, w last.
    pub quaternion_xyzw: [f64; 4],
}

/// A posed image.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingFrame {
    /// Index into [`Scene::frames`]. Not in the file.
    #[serde(skip)]
    pub frame_index: usize,
    /// Id.
    pub id: String,
    /// Time in seconds, where it is known.
    pub time: Option<f64>,
    /// Width and height in pixels.
    pub size: [f64; 2],
    /// Path of the image in the folder of the recording.
    pub image: Option<String>,
    /// The pinhole camera; nothing where the projection is none of a camera.
    pub camera: Option<RecordingCamera>,
    /// The detected boxes.
    pub boxes: Vec<RecordingBox>,
    /// The detected ellipses.
    pub ellipses: Vec<RecordingOutline>,
    /// Outlines of the estimated bodies that the frame shows.
    pub outlines: Vec<RecordingOutline>,
    /// Outlines of the true bodies that the frame shows.
    pub true_outlines: Vec<RecordingOutline>,
}

/// A pinhole camera: it looks along z, x points right and y down.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingCamera {
    /// The rows of the matrix K; pixels.
    pub intrinsics: [[f64; 3]; 3],
    /// The rows of `[R | t]`: world to camera.
    pub cam_from_world: [[f64; 4]; 3],
}

/// Whose measurement or outline something is.
#[derive(Debug, Clone, Serialize)]
pub struct Owner {
    /// Id of the object, where it is known.
    pub object: Option<String>,
    /// Category.
    pub category: Option<String>,
    /// Whether the estimator has used the view (`true`) or rejected it (`false`); nothing where it is not known.
    pub inlier: Option<bool>,
    /// Colour of the object.
    pub color: Color,
}

/// A detected box.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingBox {
    /// x0, y0, x1, y1.
    pub edges: [f64; 4],
    /// Whose it is.
    #[serde(flatten)]
    pub owner: Owner,
}

/// A detected ellipse, or the outline of a body.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingOutline {
    /// Lines through points: one closed one, or the edges of a cuboid.
    pub lines: Vec<Line>,
    /// Whose it is.
    #[serde(flatten)]
    pub owner: Owner,
}

/// Gathers a recording without its images; `times` are those of the scene's frames.
///
/// # Errors
/// As [`crate::report()`].
pub fn recording(content: &Content, times: &[Option<f64>]) -> Result<Recording, EntryError> {
    let scene = content.scene;
    let chosen: Vec<usize> = evenly_spread(scene.frames.len(), MOST_FRAMES).collect();
    let report = report_of_frames(content, &chosen)?;
    let mut notes = report.notes.clone();
    if chosen.len() < scene.frames.len() {
        notes.push(format!("{} of {} frames are written, evenly spread", chosen.len(), scene.frames.len()));
    }
    let frames = report.frames.iter().zip(&chosen).map(|(frame, &index)| RecordingFrame {
        frame_index: index,
        time: times.get(index).copied().flatten(),
        ..gather_frame(&report, scene, frame, &scene.frames[index].projection)
    });
    let centers = scene.frames.iter().filter_map(|frame| frame.projection.center_in_world());
    Ok(Recording {
        format: "quadlift.recording",
        version: 1,
        name: report.title.clone(),
        length_unit: report.length_unit.clone(),
        up: report.up,
        objects: gather_objects(&report),
        path: centers.map(|center| center.coords.into()).collect(),
        frames: frames.collect(),
        notes,
    })
}

fn gather_objects(report: &Report) -> Vec<RecordingObject> {
    let object = |(index, object): (usize, &ReportObject)| RecordingObject {
        id: object.id.clone(),
        category: category(report, index),
        status: object.status.clone(),
        color: report.color(index),
        estimate: object.body.as_ref().and_then(drawable),
        truth: object.truth.as_ref().and_then(drawable),
    };
    let objects = report.objects.iter().enumerate().map(object);
    objects.filter(|object| object.estimate.is_some() || object.truth.is_some()).collect()
}

fn category(report: &Report, object_index: usize) -> Option<String> {
    let index = usize::try_from(report.objects.get(object_index)?.category).ok()?;
    report.categories.get(index).cloned()
}

fn drawable(body: &ReportBody) -> Option<RecordingBody> {
    let drawn = match body.body()? {
        Body::Superellipsoid(superellipsoid) => ReportBody::from(&Body::Superellipsoid(superellipsoid).ellipsoid()),
        _ => body.clone(),
    };
    let [w, x, y, z] = drawn.rotation;
    Some(RecordingBody {
        kind: body.kind,
        shape: drawn.kind,
        center: drawn.center,
        half_sizes: drawn.half,
        quaternion_xyzw: [x, y, z, w],
    })
}

/// The frame without its place and time.
fn gather_frame(report: &Report, scene: &Scene, frame: &ReportFrame, projection: &Projection) -> RecordingFrame {
    let rows = &frame.detections;
    let (mut boxes, mut ellipses) = (Vec::new(), Vec::new());
    let (mut outlines, mut true_outlines) = (Vec::new(), Vec::new());
    let mut outlined = HashSet::new();
    for row in 0..rows.object.len() {
        let detection = rows.detection_index[row].and_then(|index| scene.detections.get(index));
        let object = usize::try_from(rows.object[row]).ok();
        let owner = owner(report, scene, object, detection, rows.state[row]);
        if let Some(bounding_box) = detection.and_then(|detection| detection.bounding_box) {
            boxes.push(RecordingBox { edges: bounding_box.edges(), owner: owner.clone() });
        }
        if let Some(ellipse) = detection.and_then(|detection| detection.ellipse) {
            let mut points = ellipse_points(&ellipse);
            points.extend(points.first().copied());
            ellipses.push(RecordingOutline { lines: vec![line(&points)], owner: owner.clone() });
        }
        // An object may have several detections in a frame.
        let Some(index) = object.filter(|&index| outlined.insert(index)) else { continue };
        let object = &report.objects[index];
        for (body, list) in [(&object.body, &mut outlines), (&object.truth, &mut true_outlines)] {
            let shape = body.as_ref().and_then(ReportBody::body).and_then(|body| outline(projection, &body));
            if let Some(shape) = shape {
                let lines = shape.lines.iter().map(|points| line(points)).collect();
                list.push(RecordingOutline { lines, owner: owner.clone() });
            }
        }
    }
    RecordingFrame {
        frame_index: 0,
        id: frame.id.clone(),
        time: None,
        size: frame.size,
        image: None,
        camera: camera(projection),
        boxes,
        ellipses,
        outlines,
        true_outlines,
    }
}

fn owner(report: &Report, scene: &Scene, object: Option<usize>, detection: Option<&Detection>, state: u8) -> Owner {
    let detected = detection.and_then(|detection| scene.categories.get(detection.category_index? as usize));
    Owner {
        object: object.and_then(|index| Some(report.objects.get(index)?.id.clone())),
        category: object.and_then(|index| category(report, index)).or_else(|| detected.cloned()),
        inlier: (state > 0).then_some(state == 1),
        color: object.map_or(UNKNOWN, |index| report.color(index)),
    }
}

/// Points to a hundredth of a pixel.
fn line(points: &[Vector2<f64>]) -> Line {
    points.iter().map(|point| point.map(|x| (100.0 * x).round() / 100.0).into()).collect()
}

fn camera(projection: &Projection) -> Option<RecordingCamera> {
    let pose = projection.camera_pose()?;
    let pose: &Matrix3x4<f64> = pose.matrix();
    let k = projection.m() * pose.fixed_columns::<3>(0).transpose();
    // The scale of a projection is free.
    let k = k / k[(2, 2)];
    Some(RecordingCamera {
        intrinsics: std::array::from_fn(|i| std::array::from_fn(|j| k[(i, j)])),
        cam_from_world: std::array::from_fn(|i| std::array::from_fn(|j| pose[(i, j)])),
    })
}
