//! Poses of a rig that were found, in the records of a scene file.

use std::collections::HashSet;

use quadlift::calibrate::{CalibratedCamera, Calibration, RigScale};
use serde_json::{Value, json};

use super::rig::RigScene;
use crate::numbers::significant;
use crate::scene_file::SceneFile;

/// The field of a scene file that says how its cameras were calibrated.
pub const CALIBRATION: &str = "calibration";

/// Significant digits of figures and covariances.
const FIGURE_DIGITS: i32 = 6;
const COVARIANCE_DIGITS: i32 = 9;

/// How the cameras of a rig were calibrated, as JSON: `cameras` (`camera`, `status`, `instants`, `residual_px` and, where a pose was found,
/// `rotation_sd`, `position_sd` and `covariance`), the `reference` camera, `scale` and `scale_sd`, `up_sd`, `edge_sd`.
pub fn calibration_record(ids: &[String], found: &Calibration) -> Value {
    let figure = |x: f64| significant(x, FIGURE_DIGITS);
    let camera = |(id, camera): (&String, &CalibratedCamera)| {
        let mut record = json!({ "camera": id, "status": camera.status.name(), "instants": camera.instants });
        if let Some(residual) = camera.residual_px {
            record["residual_px"] = figure(residual).into();
        }
        if let (Some([rotation, position]), Some(covariance)) = (camera.sds(), camera.covariance) {
            let rows: [[f64; 6]; 6] =
                std::array::from_fn(|i| std::array::from_fn(|j| significant(covariance[(i, j)], COVARIANCE_DIGITS)));
            record["rotation_sd"] = figure(rotation).into();
            record["position_sd"] = figure(position).into();
            record["covariance"] = json!(rows);
        }
        record
    };
    let mut record = json!({
        "cameras": ids.iter().zip(&found.cameras).map(camera).collect::<Vec<_>>(),
        "scale": found.scale.name(),
    });
    if let Some(reference) = found.reference {
        record["reference"] = ids[reference].as_str().into();
    }
    let figures = [("scale_sd", found.scale_sd), ("up_sd", found.vertical.map(|v| v.sd)), ("edge_sd", found.edge_sd)];
    for (key, value) in figures {
        if let Some(value) = value {
            record[key] = figure(value).into();
        }
    }
    record
}

impl RigScene {
    /// Writes what was found into the file: the pose of each calibrated camera into its frames, [`CALIBRATION`], `up` where the vertical was
    /// found, and the length unit, `unit` where sizes or distances tell it.
    ///
    /// Frames of other cameras keep no pose; `posed_only` leaves them out, with their detections.
    pub fn write(&self, file: &mut SceneFile, found: &Calibration, unit: Option<&str>, posed_only: bool) {
        for (frame, &camera) in file.frames.iter_mut().zip(&self.camera_of) {
            let pose = found.cameras[camera].cam_from_world;
            frame.cam_from_world =
                pose.map(|pose| std::array::from_fn(|i| std::array::from_fn(|j| pose.matrix()[(i, j)])));
        }
        file.extra.insert(CALIBRATION.to_owned(), calibration_record(&self.ids, found));
        if !self.any_given() {
            file.up = found.vertical.map(|vertical| (*vertical.up).into());
            file.length_unit = match found.scale {
                RigScale::Arbitrary => None,
                _ => unit.map(str::to_owned),
            };
        } else if let (None, Some(vertical)) = (file.up, found.vertical) {
            file.up = Some((*vertical.up).into());
        }
        if posed_only {
            file.frames.retain(|frame| frame.cam_from_world.is_some());
            let kept: HashSet<&str> = file.frames.iter().map(|frame| &*frame.id).collect();
            file.detections.retain(|detection| kept.contains(&*detection.frame));
        }
    }
}
