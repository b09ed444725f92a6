//! Poses of a rig that were found, in the records of a scene file.

use std::collections::HashSet;

use quadlift::calibrate_rig::{CalibratedCamera, Calibration, Contradiction, RigScale};
use serde_json::{Value, json};

use super::rig::RigScene;
use crate::numbers::significant;
use crate::scene_file::SceneFile;
use crate::wording::count;

/// The field of a scene file that says how its cameras were calibrated.
pub const CALIBRATION: &str = "calibration";

/// Significant digits of figures and covariances.
const FIGURE_DIGITS: i32 = 6;
const COVARIANCE_DIGITS: i32 = 9;

/// How the cameras of a rig were calibrated, as JSON: whether they are `consistent`, `cameras` (`camera`, `status`, `time_steps`,
/// `residual_px`, `edge_noise`; where the others contradict it, `contradiction` with its value; where a pose was found, `rotation_sd`,
/// `position_sd` and `covariance`), the `reference` camera, `scale` and `scale_sd`, `up_sd`, `edge_noise`.
pub fn calibration_record(ids: &[String], found: &Calibration) -> Value {
    let figure = |x: f64| significant(x, FIGURE_DIGITS);
    let camera = |(id, camera): (&String, &CalibratedCamera)| {
        let mut record = json!({ "camera": id, "status": camera.status.name(), "time_steps": camera.time_steps });
        for (key, value) in [("residual_px", camera.residual_px), ("edge_noise", camera.edge_noise)] {
            if let Some(value) = value {
                record[key] = figure(value).into();
            }
        }
        if let Some(contradiction) = camera.contradiction {
            record["contradiction"] = contradiction.name().into();
            if let Some(value) = contradiction.value() {
                record["contradiction_value"] = figure(value).into();
            }
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
        "consistent": found.is_consistent(),
        "cameras": ids.iter().zip(&found.cameras).map(camera).collect::<Vec<_>>(),
        "scale": found.scale.name(),
    });
    if let Some(reference) = found.reference {
        record["reference"] = ids[reference].as_str().into();
    }
    let figures =
        [("scale_sd", found.scale_sd), ("up_sd", found.vertical.map(|v| v.sd)), ("edge_noise", found.edge_noise)];
    for (key, value) in figures {
        if let Some(value) = value {
            record[key] = figure(value).into();
        }
    }
    record
}

/// Which cameras the others contradict and why; `None` where none is.
pub fn contradictions_in_words(ids: &[String], found: &Calibration) -> Option<String> {
    let mut all: Vec<(String, Vec<&str>)> = Vec::new();
    for (id, camera) in ids.iter().zip(&found.cameras) {
        let Some(contradiction) = camera.contradiction else { continue };
        let text = contradiction_in_words(contradiction);
        match all.iter_mut().find(|(known, _)| *known == text) {
            Some((_, cameras)) => cameras.push(id.as_str()),
            None => all.push((text, vec![id.as_str()])),
        }
    }
    let texts = all.iter().map(|(text, cameras)| {
        let noun = if cameras.len() == 1 { "camera" } else { "cameras" };
        format!("{noun} {}: {text}", cameras.join(", "))
    });
    (!all.is_empty()).then(|| texts.collect::<Vec<_>>().join("; "))
}

fn contradiction_in_words(contradiction: Contradiction) -> String {
    match contradiction {
        Contradiction::Noise(ratio) => format!(
            "edges of boxes are off by {ratio:.1} times as much as those of the other cameras (wrong intrinsics, images of another size, or \
             boxes of another camera)"
        ),
        Contradiction::FocalLength(factor) => format!(
            "boxes agree better with a focal length about {factor:.2} times as long (wrong intrinsics, or images of another size)"
        ),
        Contradiction::Mirrored => "it would be upside down below the floor (mirrored images)".to_owned(),
        Contradiction::Late(steps) => {
            let way = if steps > 0 { "late" } else { "early" };
            let steps = count(steps.unsigned_abs() as usize, "time step");
            format!("it is {steps} {way} against the other cameras (wrong \"time\" or \"rig_frame\")")
        }
        Contradiction::GivenPoses => "a given pose contradicts the boxes, so that its world is not known".to_owned(),
        _ => "boxes do not show what the other cameras see (another place, wrong ids, times or intrinsics)".to_owned(),
    }
}

impl RigScene {
    /// Writes what was found into the file: the pose of each calibrated camera into its frames, [`CALIBRATION`], `up` where the vertical was
    /// found, and the length unit, `unit` where sizes or distances tell it.
    ///
    /// Frames of other cameras keep no pose; `drop_unposed` leaves them out, with their detections.
    pub fn write(&self, file: &mut SceneFile, found: &Calibration, unit: Option<&str>, drop_unposed: bool) {
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
        if drop_unposed {
            file.frames.retain(|frame| frame.cam_from_world.is_some());
            let kept: HashSet<&str> = file.frames.iter().map(|frame| &*frame.id).collect();
            file.detections.retain(|detection| kept.contains(&*detection.frame));
        }
    }
}
