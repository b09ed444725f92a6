//! The run of a result: settings, counts and noise levels (`localization` in the file).

use quadlift::Localization;
use quadlift::cross_validation::Extent;
use quadlift::geometry::{CamFromWorld, Projection};
use quadlift::nalgebra::Matrix3x4;
use quadlift::scene::Scene;
use quadlift::solve::{
    BodyKind, CueScale, Estimate, LearntCategorySize, PosePointsProblem, ScaledQuantity, Sigmas, Status,
};
use serde_json::{Map, Value, json};

use super::records::SceneFile;
use super::results::estimates_to_objects;
use crate::diagnosis::{Context, diagnosis_record};
use crate::error::EntryError;

/// The name of the kind of body that was fitted: `mixed` where objects differ.
pub fn fitted_body_name(body: Option<BodyKind>) -> String {
    body.map_or_else(|| "mixed".to_owned(), |body| body.to_string())
}

/// Number of localised objects: those with the status `ok`.
pub fn count_localised(estimates: &[Estimate]) -> usize {
    estimates.iter().filter(|estimate| estimate.status == Status::Ok).count()
}

/// The noise levels by name.
pub fn noise_record(localization: &Localization) -> Map<String, Value> {
    localization.noise_levels().map(|(name, level)| (name.to_owned(), Value::from(level))).collect()
}

/// The scales of the sources of cues; empty without any.
pub fn cue_scales_record(scene: &Scene, localization: &Localization) -> Value {
    let record = |found: &CueScale| {
        let source = found.source.and_then(|source| scene.cue_sources.get(source as usize));
        let (quantity, category) = match found.quantity {
            ScaledQuantity::BoxDistance => ("box3d_distance", None),
            ScaledQuantity::BoxSize { category, axis } => {
                (["box3d_length", "box3d_width", "box3d_height"][axis], category)
            }
            _ => ("depth", None),
        };
        let mut json =
            json!({ "source": source, "quantity": quantity, "factor": found.factor, "log_sd": found.log_sd });
        if let ScaledQuantity::DepthOfFrame { frame } = found.quantity {
            json["frame"] = scene.frames[frame].id.as_str().into();
        }
        if let Some(shift) = found.shift {
            (json["shift"], json["shift_sd"]) = (shift.value.into(), shift.sd.into());
        }
        if let Some(category) = category {
            json["category"] = scene.categories[category].as_str().into();
        }
        json
    };
    localization.cue_scales.iter().map(record).collect()
}

/// The sizes of categories that were learnt from the scene; those without a `size` have too few objects, or objects that differ
/// too much.
pub fn learnt_sizes_record(scene: &Scene, localization: &Localization) -> Value {
    let record = |found: &LearntCategorySize| {
        let mut json = json!({
            "category": scene.categories[found.category],
            "body": found.body.to_string(),
            "objects": found.objects,
            "well_determined": found.well_determined,
        });
        if let Some(size) = &found.size {
            json["size"] = size.mean.into();
            json["size_sd"] = size.sd.into();
            json["axes"] = if found.named { "length_width_height" } else { "by_length" }.into();
        }
        json
    };
    localization.learnt_sizes.iter().map(record).collect()
}

/// The points from which poses were corrected beside the objects; null if the scene has none, or poses were not corrected. `problem` says
/// why they were left out.
pub fn pose_points_record(localization: &Localization) -> Value {
    let Some(found) = &localization.pose_points else { return Value::Null };
    let mut json = json!({
        "scene_points": found.scene_points,
        "points": found.points,
        "observations": found.observations,
        "given_error_px": found.given_error,
        "error_px": found.error,
        "noise_px": found.noise,
    });
    if let Some(problem) = &found.problem {
        json["problem"] = problem.name().into();
        json["warning"] = found.to_string().into();
    }
    if let Some(PosePointsProblem::Elsewhere { error }) = found.problem {
        json["position_error_px"] = error.into();
    }
    json
}

/// The cross-validation of a scene; null if no view could be predicted.
pub fn cross_validation_record(localization: &Localization) -> Value {
    let checked = &localization.cross_validation;
    let Some(iou) = checked.iou() else { return Value::Null };
    json!({
        "extent": if checked.extent == Extent::All { "all" } else { "sample" },
        "iou": iou,
        "edge_error": checked.edge_error().filter(|x| x.is_finite()),
        "views": checked.predictions().count(),
        "objects": checked.objects.iter().filter(|object| !object.predictions.is_empty()).count(),
    })
}

/// Number of estimates with each status.
pub fn status_counts(estimates: &[Estimate]) -> Map<String, Value> {
    let mut counts = Map::new();
    for estimate in estimates {
        let count = counts.entry(estimate.status.name()).or_insert(json!(0));
        *count = json!(count.as_u64().unwrap_or(0) + 1);
    }
    counts
}

/// The detections that took no part, by reason.
pub fn skipped_record(localization: &Localization) -> Value {
    let skipped = localization.skipped;
    json!({
        "without_object": skipped.without_object,
        "occluded_or_truncated": skipped.occluded_or_truncated,
        "beyond_lens": skipped.beyond_lens,
        "without_measurement": skipped.without_measurement,
    })
}

impl SceneFile {
    /// The noise levels that a result reports.
    ///
    /// # Errors
    /// [`EntryError`] when it reports none, or what is none.
    pub fn noise_levels(&self) -> Result<Sigmas, EntryError> {
        let entry = "localization.noise";
        let levels = self.localization.as_ref().and_then(|about| about.get("noise")?.as_object());
        let levels = levels
            .filter(|levels| !levels.is_empty())
            .ok_or_else(|| EntryError::new(entry, "there are no noise levels; expected a result of the method map"))?;
        let number = |(name, value): (&String, &Value)| {
            let problem = || format!("\"{name}\" is {value}; expected a number");
            value.as_f64().map(|x| (name.clone(), x)).ok_or_else(|| EntryError::new(entry, problem()))
        };
        let levels = levels.iter().map(number).collect::<Result<Vec<_>, _>>()?;
        let levels = levels.iter().map(|(name, x)| (name.as_str(), *x));
        Sigmas::new(levels).map_err(|error| EntryError::new(entry, error))
    }

    /// The same with the corrected poses of its frames, in the order of the scene; the given ones are kept beside them.
    fn with_refined_poses(mut self, localization: &Localization) -> Self {
        for refined in &localization.refined_poses {
            let Some(frame) = self.frames.get_mut(refined.frame_index) else { continue };
            let matrix = |rows: &[[f64; 4]; 3]| Matrix3x4::from_fn(|i, j| rows[i][j]);
            let rows = |matrix: &Matrix3x4<f64>| std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
            if let Some(given) = frame.cam_from_world {
                let corrected = CamFromWorld::new(matrix(&given)).and_then(|given| refined.cam_from_world(&given));
                let Ok(corrected) = corrected else { continue };
                frame.cam_from_world = Some(rows(corrected.matrix()));
                frame.extra.insert("given_cam_from_world".to_owned(), json!(given));
            } else if let Some(given) = frame.projection {
                let corrected = Projection::from_matrix(matrix(&given))
                    .ok()
                    .and_then(|given| given.with_moved_camera(&refined.turn, &refined.shift));
                let Some(corrected) = corrected else { continue };
                frame.projection = Some(rows(corrected.matrix()));
                frame.extra.insert("given_projection".to_owned(), json!(given));
            }
            if let Some(covariance) = &refined.covariance {
                let rows: Vec<Vec<f64>> = covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
                frame.extra.insert("pose_covariance".to_owned(), json!(rows));
            }
        }
        self
    }

    /// The result of a localisation of this file's scene, with its [settings](crate::run::FileOptions::settings).
    #[must_use]
    pub fn localized(&self, scene: &Scene, localization: &Localization, settings: Value) -> Self {
        let objects = estimates_to_objects(scene, localization).collect();
        Self { objects, ..self.localized_without_objects(scene, localization, settings) }
    }

    /// [`Self::localized`] without the objects, for [`super::write_localized_file`].
    #[must_use]
    pub fn localized_without_objects(&self, scene: &Scene, localization: &Localization, settings: Value) -> Self {
        let mut about = json!({
            "program": "quadlift",
            "version": env!("CARGO_PKG_VERSION"),
            "settings": settings,
            "body": fitted_body_name(localization.body),
            "objects": localization.estimates.len(),
            "localised": count_localised(&localization.estimates),
            "status": status_counts(&localization.estimates),
            "skipped": skipped_record(localization),
            "noise": noise_record(localization),
            "cross_validation": cross_validation_record(localization),
            "diagnosis": diagnosis_record(&localization.diagnosis, &Context::of(self, 0)),
        });
        if !localization.cue_scales.is_empty() {
            about["cue_scales"] = cue_scales_record(scene, localization);
        }
        if !localization.learnt_sizes.is_empty() {
            about["learnt_sizes"] = learnt_sizes_record(scene, localization);
        }
        if localization.pose_points.is_some() {
            about["pose_points"] = pose_points_record(localization);
        }
        self.with_results(Vec::new(), about).with_refined_poses(localization)
    }
}
