//! The content of a Rerun recording, as the JSON document `recording.json` (docs/formats/exports.md). It is made from the
//! data of a report, with precomputed poses, outlines and colors, so that logging needs no computation.

use std::collections::HashSet;

use nalgebra::{Matrix3x4, Vector2};
use quadlift::geometry::{Body, BodyKind, Projection};
use quadlift::scene::{Box3dCue, Detection, Scene};
use quadlift_io::EntryError;
use serde::Serialize;

use crate::colors::{Color, UNKNOWN};
use crate::content::{Content, MAX_FRAMES};
use crate::cues::box_in_world;
use crate::data::{Report, ReportBody, ReportFrame, ReportObject};
use crate::document::report_of_frames;
use crate::outline::{ellipse_points, outline, support_polygon};
use crate::poses::{refined_poses, with_refined_poses};
use crate::thumbnails::evenly_spread;

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
    /// World unit, if known.
    pub length_unit: Option<String>,
    /// Unit world direction against gravity, if known.
    pub up: Option<[f64; 3]>,
    /// The objects that have a body, estimated or true.
    pub objects: Vec<RecordingObject>,
    /// Centers of the cameras in the order of the frames; of those that have one.
    pub path: Vec<[f64; 3]>,
    /// The frames.
    pub frames: Vec<RecordingFrame>,
    /// Notes about omitted parts, in sentences.
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
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordingBody {
    /// Kind of body (see [`BodyKind::name`]).
    pub kind: &'static str,
    /// What the numbers describe: `cuboid`, or `ellipsoid`; for a cylinder or superellipsoid its closest ellipsoid (see
    /// [`Body::closest_ellipsoid`]).
    pub shape: &'static str,
    /// Center in the world.
    pub center: [f64; 3],
    /// Semi-axes or half extents.
    pub half_sizes: [f64; 3],
    /// Unit quaternion from the body's axes to the world, w last.
    pub quaternion_xyzw: [f64; 4],
}

/// A posed image.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingFrame {
    /// Index into [`quadlift::scene::SceneParts::frames`]. Not in the file.
    #[serde(skip)]
    pub frame_index: usize,
    /// Id.
    pub id: String,
    /// Time in seconds, if known.
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
    /// Detected outlines and oriented boxes, as the polygons of the lines that the estimator uses.
    pub detected_outlines: Vec<RecordingOutline>,
    /// The 3D boxes of the detections that have a center, a size and a rotation.
    pub boxes3d: Vec<RecordingBox3d>,
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
    /// Id of the object, if known.
    pub object: Option<String>,
    /// Category.
    pub category: Option<String>,
    /// Whether the estimator used the view (`true`) or rejected it (`false`); `None` if unknown.
    pub inlier: Option<bool>,
    /// Color of the object.
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

/// A detected 3D box.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingBox3d {
    /// The box, in the world.
    pub body: RecordingBody,
    /// Whose it is.
    #[serde(flatten)]
    pub owner: Owner,
}

impl RecordingBox3d {
    /// A 3D box in the frame of a camera; `None` if it lacks center, size or rotation.
    pub(crate) fn new(measured: &Box3dCue, projection: &Projection, owner: &Owner) -> Option<Self> {
        let body = drawable(&ReportBody::from(&box_in_world(measured, projection)?))?;
        Some(Self { body, owner: owner.clone() })
    }
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
    let poses = content.estimate.map(refined_poses).transpose()?.unwrap_or_default();
    let scene = &*with_refined_poses(content.scene, &poses);
    let chosen: Vec<usize> = evenly_spread(scene.frames.len(), MAX_FRAMES).collect();
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

pub(crate) fn drawable(body: &ReportBody) -> Option<RecordingBody> {
    let whole = body.body()?;
    // Rerun has ellipsoids and boxes.
    let is_drawn = matches!(whole.kind, BodyKind::Ellipsoid | BodyKind::Cuboid);
    let drawn = if is_drawn { body.clone() } else { ReportBody::from(&Body::from(whole.closest_ellipsoid())) };
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
    let (mut detected_outlines, mut boxes3d) = (Vec::new(), Vec::new());
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
        if let Some(lines) = detection.and_then(|detection| detection.tangent_lines.as_deref()) {
            let lines = vec![line(&support_polygon(lines))];
            detected_outlines.push(RecordingOutline { lines, owner: owner.clone() });
        }
        let measured = detection.and_then(|detection| detection.cues.as_deref()?.box3d);
        boxes3d.extend(measured.and_then(|measured| RecordingBox3d::new(&measured, projection, &owner)));
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
        camera: recording_camera(projection),
        boxes,
        ellipses,
        detected_outlines,
        boxes3d,
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
pub(crate) fn line(points: &[Vector2<f64>]) -> Line {
    points.iter().map(|point| point.map(|x| (100.0 * x).round() / 100.0).into()).collect()
}

pub(crate) fn recording_camera(projection: &Projection) -> Option<RecordingCamera> {
    let pose = projection.camera_pose()?;
    let pose: &Matrix3x4<f64> = pose.matrix();
    let k = projection.m() * pose.fixed_columns::<3>(0).transpose();
    // The scale of a projection is free.
    let k = k / k[(2, 2)];
    Some(RecordingCamera {
        // Below the diagonal there are zeros, but for rounding.
        intrinsics: std::array::from_fn(|i| std::array::from_fn(|j| if j < i { 0.0 } else { k[(i, j)] })),
        cam_from_world: std::array::from_fn(|i| std::array::from_fn(|j| pose[(i, j)])),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use quadlift::geometry::{BoundingBox, CamFromWorld, Ellipse, Intrinsics};
    use quadlift::scene::{NewDetection, SceneBuilder};
    use quadlift_io::SceneFile;
    use serde_json::json;

    fn turned_camera() -> Projection {
        let mut pose = Matrix3x4::zeros();
        pose.fixed_columns_mut::<3>(0).copy_from(Rotation3::from_euler_angles(0.3, -0.8, 0.2).matrix());
        pose.set_column(3, &nalgebra::Vector3::new(0.5, -1.0, 6.0));
        let intrinsics = Intrinsics::new(700.0, 650.0, 320.0, 240.0).unwrap();
        Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap())
    }

    #[test]
    fn a_projection_of_any_scale_is_its_camera_and_pose() {
        let matrix = *turned_camera().matrix();
        for scale in [1.0, -0.02] {
            let found = recording_camera(&Projection::from_matrix(matrix * scale).unwrap()).unwrap();
            let k = nalgebra::Matrix3::from_fn(|i, j| found.intrinsics[i][j]);
            let pose = Matrix3x4::from_fn(|i, j| found.cam_from_world[i][j]);
            assert!((k * pose - matrix).norm() < 1e-9, "{k} {pose}");
            assert_eq!((k[(1, 0)], k[(2, 0)], k[(2, 1)], k[(2, 2)]), (0.0, 0.0, 0.0, 1.0));
        }
    }

    /// A frame with a box, a box of the same object by another detector and an ellipse of nobody.
    fn scene() -> Scene {
        let mut builder = SceneBuilder::new("test");
        builder.add_frame("a", turned_camera(), None).unwrap();
        let bounding_box = BoundingBox::new([10.04, 20.0, 110.0, 60.0]).ok();
        let ellipse = Ellipse::new(Vector2::new(50.0, 40.0), Vector2::new(20.0, 10.0), 0.5).ok();
        for (object, category, source, bounding_box, ellipse) in [
            (Some("cup"), Some("cup"), Some("yolo"), bounding_box, None),
            (Some("cup"), Some("cup"), Some("label"), bounding_box, None),
            (None, Some("car"), None, None, ellipse),
        ] {
            let input =
                NewDetection { frame: "a", object, category, source, bounding_box, ellipse, ..NewDetection::default() };
            builder.add_detection(&input).unwrap();
        }
        builder.build()
    }

    fn recorded(body: &str, fields: serde_json::Value) -> Recording {
        let file: SceneFile = serde_json::from_value(json!({ "format": "quadlift.scene", "version": 1, "objects": [
            { "id": "cup", "category": "cup", "status": "ok", body: fields,
              "view_residuals_px": [{ "frame": "a", "inlier": false, "residual_px": 7.0 }] }, { "id": "lost" }] }))
        .unwrap();
        let (scene, title) = (scene(), "t");
        let content = Content {
            points: &[],
            title,
            scene: &scene,
            images: None,
            estimate: Some(&file),
            truth: None,
            source: None,
            scores: None,
        };
        recording(&content, &[Some(1.5)]).unwrap()
    }

    #[test]
    fn detections_are_exact_and_an_object_has_one_outline_per_frame() {
        let body = json!({ "center": [0, 0, 0], "semi_axes": [1, 2, 0.5], "rotation": [1, 0, 0, 0] });
        let recording = recorded("ellipsoid", body);
        let frame = &recording.frames[0];
        assert_eq!((recording.objects.len(), frame.time), (1, Some(1.5)), "what has no body is left out");
        assert_eq!(frame.boxes[0].edges, [10.04, 20.0, 110.0, 60.0]);
        let owner = |owner: &Owner| (owner.object.clone(), owner.category.clone(), owner.inlier);
        let cup = || Some("cup".to_owned());
        assert_eq!(owner(&frame.boxes[0].owner), (cup(), cup(), Some(false)));
        assert_eq!(owner(&frame.boxes[1].owner), (cup(), cup(), None));
        assert_eq!(owner(&frame.ellipses[0].owner), (None, Some("car".to_owned()), None));
        assert_eq!((frame.boxes.len(), frame.ellipses.len(), frame.outlines.len()), (2, 1, 1));
        let line = &frame.ellipses[0].lines[0];
        assert_eq!(line.first(), line.last());
        assert!(line.iter().all(|[x, y]| {
            let (u, v) = (x - 50.0, y - 40.0);
            let (sin, cos) = 0.5f64.sin_cos();
            (((u * cos + v * sin) / 20.0).hypot((v * cos - u * sin) / 10.0) - 1.0).abs() < 2e-3
        }));
    }

    #[test]
    fn a_superellipsoid_is_drawn_as_the_ellipsoid_that_stands_for_it() {
        let body = json!({ "center": [0, 0, 0], "semi_axes": [1, 2, 0.5], "rotation": [0.6, 0, 0.8, 0],
                           "support_exponent": 1.5 });
        let recording = recorded("superellipsoid", body);
        let found = recording.objects[0].estimate.as_ref().unwrap();
        assert_eq!((found.kind, found.shape), ("superellipsoid", "ellipsoid"));
        // Between the inscribed ellipsoid and the one about the cuboid; the flatter the body the thicker.
        let ratios: Vec<f64> =
            found.half_sizes.iter().zip([1.0, 2.0, 0.5]).map(|(found, given)| found / given).collect();
        assert!(ratios.iter().all(|ratio| *ratio > 1.01 && *ratio < 3f64.sqrt()), "{ratios:?}");
        assert!(ratios[1] < ratios[0] && ratios[0] < ratios[2], "{ratios:?}");
        let expected = [0.0, 0.8, 0.0, 0.6];
        assert!(found.quaternion_xyzw.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }
}
