//! The record of a run: `localization` of a result file. Entries are in alphabetical order, as files hold them.

use std::collections::BTreeMap;

use quadlift::Localization;
use quadlift::cross_validation::{CrossValidation, Extent};
use quadlift::scene::{Scene, SkippedDetections};
use quadlift::solve::{CueScale, Estimate, LearnedCategorySize, PosePointsProblem, PosePointsReport, ScaledQuantity};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::FileRun;
use crate::association::AssociationRecord;
use crate::coverage::CoverageRecord;
use crate::diagnosis::DiagnosisRecord;
use crate::scene_file::{SceneFile, count_localized, fitted_body_name};
use crate::stream::StreamRecord;

/// What a result says of the run that made it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RunRecord {
    /// The association, if detections were associated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub association: Option<AssociationRecord>,
    /// The kind of body that was fitted: `mixed` where objects differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<String>,
    /// How regions are calibrated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coverage: Option<CoverageRecord>,
    /// What was corrected and left out, in words.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub corrections: Vec<String>,
    /// The cross-validation; `None` if no view could be predicted.
    pub cross_validation: Option<SceneCrossValidationRecord>,
    /// The scales of the sources of cues.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cue_scales: Vec<CueScaleRecord>,
    /// The consistency check.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<DiagnosisRecord>,
    /// The sizes of categories that were learned from the scene.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub learned_sizes: Vec<LearnedSizeRecord>,
    /// Number of objects with the status `ok`.
    pub localized: usize,
    /// The noise levels by name.
    pub noise: BTreeMap<String, f64>,
    /// Number of objects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<usize>,
    /// The points from which poses were corrected beside the objects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose_points: Option<PosePointsRecord>,
    /// `quadlift`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub program: Option<String>,
    /// The settings by name.
    #[serde(skip_serializing_if = "Value::is_null")]
    pub settings: Value,
    /// The detections that took no part.
    pub skipped: SkippedRecord,
    /// Number of objects with each status, by its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<BTreeMap<String, usize>>,
    /// How far the stream had come whose map this is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stream: Option<StreamRecord>,
    /// The version of the program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
}

/// The cross-validation of a scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SceneCrossValidationRecord {
    /// Mean error of the edges of predicted boxes.
    pub edge_error: Option<f64>,
    /// How much was checked: `all` or a `sample`.
    pub extent: String,
    /// Mean overlap of predicted boxes.
    pub iou: f64,
    /// Number of objects.
    pub objects: usize,
    /// Number of predicted views.
    pub views: usize,
}

/// The scale of a source of cues.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CueScaleRecord {
    /// The category whose sizes are scaled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// Measured over true length.
    pub factor: f64,
    /// Id of the frame, of a source whose scale differs between frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// Standard deviation of the logarithm of the factor.
    pub log_sd: f64,
    /// What is scaled.
    pub quantity: Quantity,
    /// What is added to the scaled depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift: Option<f64>,
    /// Standard deviation of the shift.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift_sd: Option<f64>,
    /// The source, if it has a name.
    pub source: Option<String>,
}

/// A quantity of cues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Depths.
    Depth,
    /// Distances of 3D boxes.
    Box3dDistance,
    /// Lengths of 3D boxes.
    Box3dLength,
    /// Widths of 3D boxes.
    Box3dWidth,
    /// Heights of 3D boxes.
    Box3dHeight,
}

/// The size of a category that was learned from the scene; without `size` its objects are too few, or differ too much.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LearnedSizeRecord {
    /// What the numbers of the size are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axes: Option<SizeAxes>,
    /// The kind of body.
    pub body: String,
    /// The category.
    pub category: String,
    /// Number of its objects.
    pub objects: usize,
    /// Mean extents.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[f64; 3]>,
    /// Standard deviations of the extents of another object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_sd: Option<[f64; 3]>,
    /// Number of well-determined objects that they are worth.
    pub well_determined: f64,
}

/// The order of three extents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SizeAxes {
    /// By their lengths.
    ByLength,
    /// Length, width and height.
    LengthWidthHeight,
}

/// The points from which poses were corrected beside the objects.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PosePointsRecord {
    /// Median error of an observation with the corrected poses, pixels.
    pub error_px: Option<f64>,
    /// The same with the poses as given.
    pub given_error_px: Option<f64>,
    /// Noise level of the observations, pixels.
    pub noise_px: Option<f64>,
    /// Number of observations.
    pub observations: usize,
    /// Number of chosen points.
    pub points: usize,
    /// Median distance of an observation from where its point would be at its position, pixels; there for one problem only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_error_px: Option<Option<f64>>,
    /// Why the points were left out ([`PosePointsProblem::name`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
    /// Number of the scene's points.
    pub scene_points: usize,
    /// The problem in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warning: Option<String>,
}

/// Numbers of detections that took no part, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct SkippedRecord {
    /// They lie where the lens cannot be undistorted.
    pub beyond_lens: usize,
    /// They are too occluded or truncated.
    pub occluded_or_truncated: usize,
    /// They lack the selected measurement.
    pub without_measurement: usize,
    /// They have no object id.
    pub without_object: usize,
}

impl RunRecord {
    /// The record of a run.
    pub(crate) fn of(run: &FileRun) -> Self {
        let (scene, found) = (run.input.scene(), &run.run.localization);
        Self {
            association: run.run.association.as_ref().map(|association| AssociationRecord::of(scene, association)),
            body: Some(fitted_body_name(found.body)),
            coverage: run.options.coverage.clone(),
            corrections: run.input.notes.clone(),
            cross_validation: SceneCrossValidationRecord::of(&found.cross_validation),
            cue_scales: found.cue_scales.iter().map(|scale| CueScaleRecord::of(scale, scene)).collect(),
            diagnosis: Some(run.diagnosis()),
            learned_sizes: found.learned_sizes.iter().map(|size| LearnedSizeRecord::of(size, scene)).collect(),
            localized: count_localized(&found.estimates),
            noise: found.noise_levels().map(|(name, level)| (name.to_owned(), level)).collect(),
            objects: Some(found.estimates.len()),
            pose_points: found.pose_points.as_ref().map(PosePointsRecord::of),
            program: Some("quadlift".to_owned()),
            settings: run.options.settings(),
            skipped: SkippedRecord::of(found),
            status: Some(status_counts(&found.estimates)),
            stream: run.input.memory.as_ref().and_then(|memory| memory.stream.clone()),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        }
    }

    /// The source whose detections were taken.
    pub fn source(&self) -> Option<&str> {
        self.settings.get("source")?.as_str()
    }
}

impl SceneFile {
    /// What a result says of its run; entries that are not as this version writes them count as missing.
    pub fn run_record(&self) -> Option<RunRecord> {
        let entries = self.localization.as_ref()?.as_object()?;
        let fits = |(name, entry): &(&String, &Value)| RunRecord::deserialize(json!({ *name: entry })).is_ok();
        let known = entries.iter().filter(fits).map(|(name, entry)| (name.clone(), entry.clone()));
        RunRecord::deserialize(Value::Object(known.collect())).ok()
    }
}

fn status_counts(estimates: &[Estimate]) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for estimate in estimates {
        *counts.entry(estimate.status.name().to_owned()).or_default() += 1;
    }
    counts
}

impl SceneCrossValidationRecord {
    fn of(checked: &CrossValidation) -> Option<Self> {
        Some(Self {
            edge_error: checked.edge_error().filter(|x| x.is_finite()),
            extent: (if checked.extent == Extent::All { "all" } else { "sample" }).to_owned(),
            iou: checked.iou()?,
            objects: checked.objects.iter().filter(|object| !object.predictions.is_empty()).count(),
            views: checked.predictions().count(),
        })
    }
}

impl CueScaleRecord {
    /// What is scaled, in words.
    pub fn what(&self) -> String {
        let what = match self.quantity {
            Quantity::Depth => "depths",
            Quantity::Box3dDistance => "distances of the 3D boxes",
            Quantity::Box3dLength => "lengths of the 3D boxes",
            Quantity::Box3dWidth => "widths of the 3D boxes",
            Quantity::Box3dHeight => "heights of the 3D boxes",
        };
        let of = self.source.as_ref().map_or(String::new(), |name| format!(" of {name}"));
        let category = self.category.as_ref().map_or(String::new(), |name| format!(" ({name})"));
        format!("{what}{of}{category}")
    }

    fn of(found: &CueScale, scene: &Scene) -> Self {
        let (quantity, category) = match found.quantity {
            ScaledQuantity::BoxDistance => (Quantity::Box3dDistance, None),
            ScaledQuantity::BoxSize { category, axis } => {
                ([Quantity::Box3dLength, Quantity::Box3dWidth, Quantity::Box3dHeight][axis], category)
            }
            _ => (Quantity::Depth, None),
        };
        let frame = match found.quantity {
            ScaledQuantity::DepthOfFrame { frame } => Some(scene.frames[frame].id.clone()),
            _ => None,
        };
        Self {
            category: category.map(|category| scene.categories[category].clone()),
            factor: found.factor,
            frame,
            log_sd: found.log_sd,
            quantity,
            shift: found.shift.map(|shift| shift.value),
            shift_sd: found.shift.map(|shift| shift.sd),
            source: found.source.and_then(|source| scene.cue_sources.get(source as usize).cloned()),
        }
    }
}

impl LearnedSizeRecord {
    fn of(found: &LearnedCategorySize, scene: &Scene) -> Self {
        let axes = if found.named { SizeAxes::LengthWidthHeight } else { SizeAxes::ByLength };
        Self {
            axes: found.size.map(|_| axes),
            body: found.body.to_string(),
            category: scene.categories[found.category].clone(),
            objects: found.objects,
            size: found.size.map(|size| size.mean),
            size_sd: found.size.map(|size| size.sd),
            well_determined: found.well_determined,
        }
    }
}

impl PosePointsRecord {
    fn of(found: &PosePointsReport) -> Self {
        Self {
            error_px: found.error,
            given_error_px: found.given_error,
            noise_px: found.noise,
            observations: found.observations,
            points: found.points,
            position_error_px: match found.problem {
                Some(PosePointsProblem::Elsewhere { error }) => Some(error),
                _ => None,
            },
            problem: found.problem.map(|problem| problem.name().to_owned()),
            scene_points: found.scene_points,
            warning: found.problem.map(|_| found.to_string()),
        }
    }
}

impl SkippedRecord {
    fn of(localization: &Localization) -> Self {
        let SkippedDetections { beyond_lens, occluded_or_truncated, without_measurement, without_object, .. } =
            localization.skipped;
        Self { beyond_lens, occluded_or_truncated, without_measurement, without_object }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{FileInput, FileOptions, run_file};
    use quadlift::synthetic::{Observations, SyntheticOptions, generate};

    #[test]
    fn a_record_is_read_as_it_was_written_and_what_is_not_known_is_missing() {
        let made = SyntheticOptions { objects: 5, views: 6, observations: Observations::Boxes, ..Default::default() };
        let scene = generate(&made).unwrap().scene;
        let input = FileInput::of(SceneFile::default().into(), scene.into(), "".as_ref());
        let run = run_file(input, &FileOptions::default(), &quadlift::Unobserved).unwrap();
        let mut file = run.result();
        let written = file.run_record().unwrap();
        assert_eq!(written, run.record());
        assert!(written.noise.len() > 1 && written.diagnosis.as_ref().unwrap().consistent);
        let cause = json!({ "name": "of_a_later_version", "before": 1.0, "after": 0.1, "option": null, "value": null });
        let about = file.localization.as_mut().unwrap();
        about["diagnosis"]["causes"] = json!([cause]);
        about["localized"] = json!("five");
        about["later"] = json!([1, 2]);
        assert_eq!(file.run_record(), Some(RunRecord { diagnosis: None, localized: 0, ..written }));
        file.localization = Some(json!("map"));
        assert_eq!(file.run_record(), None);
    }
}
