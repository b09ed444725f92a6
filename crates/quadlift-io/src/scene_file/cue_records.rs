//! Depths and 3D boxes of detections as they are written in a scene file, and their conversion.

use nalgebra::{DMatrix, Matrix3, Point3, Rotation3, SMatrix, Vector3};
use quadlift::geometry::{CamFromWorld, quaternion_from_rotation, rotation_from_quaternion};
use quadlift::scene::{Box3dCue, Box3dSd, DepthCue, DepthScale, SceneBuilder};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::error::EntryError;
use crate::numbers;

/// The fields of detections that hold cues: name, the fields in it that other records do not have, and what to expect, for messages.
pub(super) const CUE_FIELDS: [(&str, &[&str], &str); 2] = [
    (
        "depth",
        &["median"],
        "\"depth\": of a detection {\"median\": number, \"sd\": number, \"source\": \"...\"}, of a frame {\"path\": \"...\", \
         \"scale\": world units of one count}",
    ),
    (
        "box3d",
        &["direction", "distance"],
        "\"box3d\": {\"center\": [x, y, z], \"half_extents\": [l, w, h], \"rotation\": [w, x, y, z], \"frame\": \"camera\"}",
    ),
];

/// How far the visible surface of an object is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct DepthRecord {
    /// Median depth of the visible surface along the optical axis, world units.
    pub median: f64,
    /// Standard deviation of its error, world units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Depth network or sensor: depths of one source may share a wrong scale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Box<str>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What is known of a source of depths.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct CueSourceRecord {
    /// What its depths have in common besides their scale in the scene: `frame` for networks that are right up to a scale in each
    /// image, `scene` (the default) for nothing. `known`: no scale, lengths of the world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<Box<str>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A 3D box of an object from one image, any part of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct Box3dRecord {
    /// Center, world units.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub center: Option<[f64; 3]>,
    /// Half the length, width and height (the extents along the axes of `rotation`), world units.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub half_extents: Option<[f64; 3]>,
    /// Unit quaternion `[w, x, y, z]`; the columns of the rotation are the axes of the box.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub rotation: Option<[f64; 4]>,
    /// The frame of center and rotation: `camera` (x to the right, y down, z forwards; the default) or `world`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<Box<str>>,
    /// Standard deviations of the errors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<Box3dSdRecord>,
    /// Covariance of center (in `frame`), rotation vector (about the axes of the box) and logarithms of the half extents, 9 x 9; takes
    /// the place of `sd`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<Vec<Vec<f64>>>,
    /// 3D detector: boxes of one source may share wrong distances and sizes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Box<str>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Standard deviations of a 3D box.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}", deny_unknown_fields)]
pub struct Box3dSdRecord {
    /// Of the center along the ray, relative to its distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<f64>,
    /// Of the direction of the center, each way, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<f64>,
    /// Of the logarithm of an extent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<f64>,
    /// Of the rotation about each axis, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<f64>,
}

impl CueSourceRecord {
    /// Tells a scene what is known of the source.
    pub(super) fn add_to(&self, name: &str, builder: &mut SceneBuilder) -> Result<(), EntryError> {
        let entry = |field: &str| format!("cue_sources.{name}{field}");
        let index = builder.cue_source(name).map_err(|error| EntryError::new(entry(""), error))?;
        match self.scale.as_deref() {
            None | Some("scene") => {}
            Some("frame") => builder.set_depth_scale(index, DepthScale::Frame),
            Some("known") => builder.set_depth_scale(index, DepthScale::Known),
            Some(other) => {
                let problem = format!(
                    "found \"{other}\"; expected \"frame\" (a scale in each frame), \"scene\" (one scale) or \"known\" (none: lengths \
                     of the world)"
                );
                return Err(EntryError::new(entry(".scale"), problem));
            }
        }
        Ok(())
    }
}

impl Box3dRecord {
    /// The box in the frame of the camera, whose pose is `pose`.
    pub(super) fn cue(
        &self,
        source: Option<u32>,
        pose: impl Fn() -> Option<CamFromWorld>,
        entry: impl Fn(&str) -> String,
    ) -> Result<Box3dCue, EntryError> {
        let rotation = self.rotation.map(|wxyz| {
            rotation_from_quaternion(wxyz).ok_or_else(|| {
                EntryError::new(entry(".rotation"), format!("{wxyz:?} is not a unit quaternion [w, x, y, z]"))
            })
        });
        let (mut center, mut rotation) = (self.center.map(Point3::from), rotation.transpose()?);
        // From the frame of center and rotation to the camera.
        let to_camera = match self.frame.as_deref() {
            None | Some("camera") => Matrix3::identity(),
            Some("world") => {
                let pose =
                    pose().ok_or_else(|| EntryError::new(entry(".frame"), "the camera of the frame has no center"))?;
                center = center.map(|center| Point3::from(pose.matrix() * center.to_homogeneous()));
                let turn = pose.matrix().fixed_columns::<3>(0).into_owned();
                rotation = rotation.map(|rotation| Rotation3::from_matrix_unchecked(turn) * rotation);
                turn
            }
            Some(other) => {
                let problem = format!("\"{other}\" is not a frame of a 3D box; expected \"camera\" or \"world\"");
                return Err(EntryError::new(entry(".frame"), problem));
            }
        };
        let Box3dSdRecord { distance, direction, size, rotation: turn } = self.sd.unwrap_or_default();
        let mut sd = Box3dSd { distance, direction, size, rotation: turn };
        if let Some(rows) = &self.covariance {
            sd = sd_of(rows, center, &to_camera).map_err(|problem| EntryError::new(entry(".covariance"), problem))?;
        }
        Ok(Box3dCue { center, half_extents: self.half_extents.map(Vector3::from), rotation, sd, source })
    }
}

/// Standard deviations from a covariance of center, rotation vector and logarithms of the half extents.
fn sd_of(rows: &[Vec<f64>], center: Option<Point3<f64>>, to_camera: &Matrix3<f64>) -> Result<Box3dSd, String> {
    if rows.len() != 9 || rows.iter().any(|row| row.len() != 9) {
        return Err(
            "expected nine rows of nine numbers: center, rotation vector, logarithms of the half extents".to_owned()
        );
    }
    let matrix = SMatrix::<f64, 9, 9>::from_fn(|i, j| rows[i][j]);
    let of_center = to_camera * matrix.fixed_view::<3, 3>(0, 0) * to_camera.transpose();
    let mean = |first: usize| (0..3).map(|k| matrix[(first + k, first + k)]).sum::<f64>() / 3.0;
    let (mut distance, mut direction) = (None, None);
    if let Some(center) = center {
        let ray = center.coords.normalize();
        let along = (ray.transpose() * of_center * ray)[0];
        let across = 0.5 * (of_center.trace() - along);
        (distance, direction) = (Some(along.sqrt() / center.coords.norm()), Some(across.sqrt() / center.coords.norm()));
    }
    Ok(Box3dSd { distance, direction, size: Some(mean(6).sqrt()), rotation: Some(mean(3).sqrt()) })
}

impl DepthRecord {
    /// The depth in a world whose lengths are `factor` times as large.
    pub(super) fn scale(&mut self, factor: f64) {
        self.median *= factor;
        self.sd = self.sd.map(|sd| sd * factor);
    }

    /// The record of a cue, with the name of its source.
    pub(super) fn of(depth: &DepthCue, source: Option<Box<str>>) -> Self {
        Self { median: depth.median, sd: depth.sd, source, extra: Map::new() }
    }
}

impl Box3dRecord {
    /// Moves it with a world whose points `x` become `linear x + origin`; `linear` is a rotation or a mirror, times a factor.
    pub(crate) fn move_by(&mut self, linear: &Matrix3<f64>, origin: &Vector3<f64>) {
        let factor = linear.determinant().abs().cbrt();
        let of_world = self.frame.as_deref() == Some("world");
        let turn = if of_world { linear / factor } else { Matrix3::identity() };
        // A box is its own mirror image: its second axis changes its sign, so that the three stay right-handed.
        let second = turn.determinant().signum();
        let flip = Matrix3::from_diagonal(&[1.0, second, 1.0].into());
        self.center = self.center.map(|center| {
            let center = turn * Point3::from(center) * factor;
            if of_world { center + origin } else { center }.into()
        });
        self.half_extents = self.half_extents.map(|half| half.map(|x| x * factor));
        if turn != Matrix3::identity() {
            self.rotation = self.rotation.map(|wxyz| {
                // `to_scene` reports what is no unit quaternion.
                let Some(rotation) = rotation_from_quaternion(wxyz) else { return wxyz };
                quaternion_from_rotation(&Rotation3::from_matrix_unchecked(turn * rotation.matrix() * flip))
            });
        }
        // `to_scene` reports covariances of another size.
        let is_square = |rows: &Vec<Vec<f64>>| rows.len() == 9 && rows.iter().all(|row| row.len() == 9);
        if let Some(rows) = self.covariance.as_mut().filter(|rows| is_square(rows)) {
            let mut by = DMatrix::identity(9, 9);
            by.view_mut((0, 0), (3, 3)).copy_from(&(turn * factor));
            // Turns about the axes of a mirrored box: they are turned the other way.
            by.view_mut((3, 3), (3, 3)).copy_from(&(flip * second));
            let moved = &by * DMatrix::from_fn(9, 9, |i, j| rows[i][j]) * by.transpose();
            *rows = (0..9).map(|i| moved.row(i).iter().copied().collect()).collect();
        }
    }

    /// The record of a cue in the frame of the camera, with the name of its source.
    pub(super) fn of(measured: &Box3dCue, source: Option<Box<str>>) -> Self {
        let Box3dSd { distance, direction, size, rotation } = measured.sd;
        let sd = Box3dSdRecord { distance, direction, size, rotation };
        Self {
            center: measured.center.map(Into::into),
            half_extents: measured.half_extents.map(Into::into),
            rotation: measured.rotation.as_ref().map(quaternion_from_rotation),
            sd: (measured.sd != Box3dSd::default()).then_some(sd),
            source,
            ..Default::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::scene_file::{DetectionRecord, SceneFile};

    fn file(box3d: Value) -> SceneFile {
        serde_json::from_value(json!({
            "format": "quadlift.scene", "version": 1,
            "cameras": [{"id": "c", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}],
            "frames": [{"id": "a", "camera": "c", "cam_from_world": [[0, 1, 0, 1], [0, 0, -1, 2], [-1, 0, 0, 9]]}],
            "detections": [{"frame": "a", "object": "b", "box": [300, 200, 340, 260], "box3d": box3d,
                "depth": {"median": 8.5, "source": "net"}}],
        }))
        .unwrap()
    }

    #[test]
    fn boxes_of_the_world_become_those_of_the_camera_and_are_written_as_such() {
        let world =
            json!({"center": [1, 2, 3], "half_extents": [2, 1, 0.5], "rotation": [1, 0, 0, 0], "frame": "world"});
        let scene = file(world).to_scene().unwrap();
        let cues = scene.detections[0].cues.as_deref().unwrap();
        let box3d = cues.box3d.unwrap();
        assert_eq!(box3d.center, Some(Point3::new(3.0, -1.0, 8.0)));
        assert!(
            (box3d.rotation.unwrap().matrix() - Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, 0.0)).amax()
                < 1e-12
        );
        assert_eq!(
            (cues.depth.unwrap().source, scene.cue_sources.as_slice()),
            (Some(0), ["net".to_owned()].as_slice())
        );
        let written = DetectionRecord::of_scene(&scene, &scene.detections[0]);
        assert_eq!(written.depth.unwrap().source.as_deref(), Some("net"));
        let again = file(serde_json::to_value(written.box3d.unwrap()).unwrap()).to_scene().unwrap();
        let again = again.detections[0].cues.as_deref().unwrap().box3d.unwrap();
        assert_eq!((again.center, again.half_extents), (box3d.center, box3d.half_extents));
        assert!((again.rotation.unwrap().matrix() - box3d.rotation.unwrap().matrix()).amax() < 1e-12);
    }

    #[test]
    fn a_source_says_that_its_scale_is_that_of_a_frame() {
        let with = |source: Value| {
            let mut value = serde_json::to_value(json!({"cue_sources": {"net": source}})).unwrap();
            let mut file = file(json!({"center": [0, 0, 10]}));
            file.cue_sources = serde_json::from_value(value["cue_sources"].take()).unwrap();
            file.to_scene()
        };
        assert!(with(json!({})).unwrap().scaled_by_frame.is_empty());
        assert!(with(json!({"scale": "scene"})).unwrap().scaled_by_frame.is_empty());
        let scene = with(json!({"scale": "frame"})).unwrap();
        let depth = scene.detections[0].cues.as_deref().unwrap().depth.unwrap();
        assert!(scene.scaled_by_frame.contains(&depth.source.unwrap()));
        let known = with(json!({"scale": "known"})).unwrap();
        assert!(known.scaled_by_frame.is_empty() && known.scale_known.contains(&0));
        let error = with(json!({"scale": "image"})).unwrap_err();
        assert_eq!(error.entry, "cue_sources.net.scale");
        assert!(error.problem.contains("found \"image\"; expected \"frame\""), "{}", error.problem);
    }

    #[test]
    fn a_covariance_is_split_along_the_ray() {
        let mut rows = vec![vec![0.0; 9]; 9];
        // One meter along z, the direction of the center; 0.1 across; 0.2 radians; 0.3 of the sizes.
        for (k, sd) in [0.1, 0.1, 1.0, 0.2, 0.2, 0.2, 0.3, 0.3, 0.3].into_iter().enumerate() {
            rows[k][k] = sd * sd;
        }
        let scene = file(json!({"center": [0, 0, 10], "covariance": rows})).to_scene().unwrap();
        let sd = scene.detections[0].cues.as_deref().unwrap().box3d.unwrap().sd;
        let close = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-12, "{a:?} {b}");
        close(sd.distance, 0.1);
        close(sd.direction, 0.01);
        close(sd.rotation, 0.2);
        close(sd.size, 0.3);
        let error = file(json!({"center": [0, 0, 10], "covariance": [[1]]})).to_scene().unwrap_err().to_string();
        assert!(error.contains("detections[0].box3d.covariance") && error.contains("nine rows"), "{error}");
    }
}
