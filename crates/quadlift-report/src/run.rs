//! The run of a result (`localization` in the file): settings, and notes in sentences.

use quadlift_io::association::AssociationRecord;
use quadlift_io::coverage::CoverageRecord;
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_io::run::{CueScaleRecord, RunRecord, SceneCrossValidationRecord, SkippedRecord};
use serde_json::Value;

/// The quantile of 95 % of chi-square with three degrees of freedom.
const CHI2_95: f64 = 7.814_727_903_251_178;

/// Names and values: the settings that were made, the kind of body, the noise levels, how well held-out views are
/// predicted.
pub(crate) fn run_settings(run: &RunRecord) -> Vec<(String, String)> {
    let mut settings = Vec::new();
    let mut add = |name: &str, text: String| settings.push((name.replace('_', " "), text));
    for (name, value) in run.settings.as_object().into_iter().flatten().filter(|(_, value)| !value.is_null()) {
        add(name, in_words(value));
    }
    for (name, level) in &run.noise {
        add(&format!("noise, {name}"), three_digits(*level));
    }
    if let Some(checked) = &run.cross_validation {
        if let Some(error) = checked.edge_error {
            add("cross-validation, edge error", three_digits(error));
        }
        add("cross-validation, extent", checked.extent.clone());
        add("cross-validation, iou", three_digits(checked.iou));
        add("cross-validation, objects", checked.objects.to_string());
        add("cross-validation, views", checked.views.to_string());
    }
    if let Some(body) = &run.body {
        add("fitted body", body.clone());
    }
    settings
}

/// Overview of a run as names and values: the consistency check, the noise of the boxes, the association, and how well
/// held-out views are predicted.
pub(crate) fn run_overview(run: &RunRecord) -> Vec<(String, String)> {
    let mut overview = Vec::new();
    let mut say = |name: &str, text: String| overview.push((name.to_owned(), text));
    match &run.diagnosis {
        Some(DiagnosisRecord { consistent: false, .. }) => {
            say("consistency check", "failed: see the top of the page".to_owned())
        }
        Some(DiagnosisRecord { score, .. }) => {
            let miss = score.map_or(String::new(), |score| {
                format!("; the center of a box is typically off by {} of its half size", percent(score))
            });
            say("consistency check", format!("passed: boxes and camera poses agree{miss}"));
        }
        None => {}
    }
    if let Some(&noise) = run.noise.get("edge_noise") {
        let pixels = run.noise.get("edge_noise_px").map_or(String::new(), |x| format!(", or {x:.2} px"));
        say("noise of box edges", format!("{} of the box's half size{pixels}", percent(noise)));
    }
    for scale in &run.cue_scales {
        overview_of_scale(scale, &mut say);
    }
    if let Some(AssociationRecord { associated, clutter, objects, .. }) = &run.association {
        let (all, objects) = (associated + clutter, objects.len());
        say(
            "association",
            format!("{associated} of {all} detections assigned to {objects} objects; {clutter} unassigned"),
        );
    }
    if let Some(SceneCrossValidationRecord { iou, views, .. }) = &run.cross_validation {
        say("held-out views", format!("{views} boxes predicted from the other views: mean IoU {iou:.2}"));
    }
    overview
}

/// What a source of depths or 3D boxes is wrong by.
fn overview_of_scale(scale: &CueScaleRecord, say: &mut impl FnMut(&str, String)) {
    let shift = scale.shift.zip(scale.shift_sd);
    let shift = shift.map_or(String::new(), |(shift, sd)| format!(", shifted by {shift:+.3} ± {sd:.3}"));
    let (factor, sd) = (scale.factor, scale.factor * scale.log_sd);
    say(&scale.what(), format!("{factor:.3} ± {sd:.3} of the true ones{shift}"));
}

/// A share as a percentage with two digits.
fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent < 9.95 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// That the scene is inconsistent, and how to correct it.
pub(crate) fn run_banner(run: &RunRecord) -> Option<String> {
    let words = run.diagnosis.as_ref().filter(|diagnosis| !diagnosis.consistent)?.in_words()?;
    Some(format!("The scene is inconsistent: {words}. Positions and sizes on this page are unreliable."))
}

/// The squared distance at which the region of 95 % of a center ends, in units of its covariance: as it was calibrated,
/// else the quantile of chi-square with three degrees of freedom.
pub(crate) fn center_limit(run: &RunRecord) -> f64 {
    calibrated_limit(run).unwrap_or(CHI2_95)
}

/// The meaning of the 95 % region of a center, in sentences.
pub(crate) fn run_region(run: &RunRecord) -> String {
    match (&run.coverage, calibrated_limit(run)) {
        (Some(CoverageRecord { objects, results, .. }), Some(limit)) => format!(
            "Region of 95 %, calibrated on {objects} objects of {}: the center of the tangent body of a \
             similar object lies inside with a probability of at least 95 % (squared distance {limit:.2}, without \
             calibration {CHI2_95:.2}).",
            results.join(", ")
        ),
        (calibration, _) => {
            let why = match calibration {
                Some(CoverageRecord { objects, .. }) => {
                    format!("not calibrated, since {objects} objects with ground truth are too few for 95 %")
                }
                None => "not calibrated against ground truth".to_owned(),
            };
            format!(
                "Region of 95 %, {why}: the center of the tangent body lies inside for 95 % of the objects, if the \
                 errors follow the scene's residuals. Errors common to all views of all objects, such as a wrong \
                 scale, are not included."
            )
        }
    }
}

fn calibrated_limit(run: &RunRecord) -> Option<f64> {
    run.coverage.as_ref()?.squared_distance.center.p95.filter(|x| *x > 0.0)
}

/// Corrections and skipped detections, in sentences.
pub(crate) fn run_notes(run: &RunRecord) -> Vec<String> {
    let SkippedRecord { beyond_lens, occluded_or_truncated, without_measurement, without_object } = run.skipped;
    let skipped = [
        (without_object, "they have no object id"),
        (occluded_or_truncated, "they are too occluded or truncated"),
        (beyond_lens, "they lie where the lens cannot be undistorted"),
        (without_measurement, "they lack the selected measurement"),
    ];
    let skipped = skipped.into_iter().filter(|(number, _)| *number > 0);
    let skipped = skipped.map(|(number, reason)| format!("{number} detections were not used: {reason}"));
    run.corrections.iter().map(|note| format!("corrected: {note}")).chain(skipped).collect()
}

/// A number with three significant digits: enough to look at.
pub(crate) fn three_digits(x: f64) -> String {
    let digits = if x == 0.0 { 0 } else { (2 - x.abs().log10().floor() as i32).clamp(0, 12) };
    format!("{x:.*}", digits as usize)
}

fn in_words(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::Number(number) => match number.as_f64() {
            Some(x) if number.is_f64() => three_digits(x),
            _ => number.to_string(),
        },
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift_io::SceneFile;
    use serde_json::json;

    fn record(run: Value) -> RunRecord {
        SceneFile { localization: Some(run), ..Default::default() }.run_record().unwrap()
    }

    #[test]
    fn the_overview_says_how_the_run_went_in_words() {
        let of = |run: Value| run_overview(&record(run));
        let told = of(json!({
            "diagnosis": {"consistent": true, "score": 0.0294, "causes": []},
            "noise": {"edge_noise": 0.123, "edge_noise_px": 3.456},
            "cue_scales": [
                {"source": "net", "quantity": "depth", "factor": 1.0923, "log_sd": 0.002},
                {"source": "near", "quantity": "depth", "factor": 1.1, "log_sd": 0.01, "shift": -0.98, "shift_sd": 0.05},
                {"source": null, "quantity": "box3d_length", "category": "car", "factor": 1.08, "log_sd": 0.01},
            ],
            "association": {"associated": 153, "clutter": 7, "objects": [{"id": "a"}, {"id": "b"}]},
            "cross_validation": {"iou": 0.911, "views": 26},
        }));
        let line = |name: &str, text: &str| (name.to_owned(), text.to_owned());
        assert_eq!(
            told,
            [
                line(
                    "consistency check",
                    "passed: boxes and camera poses agree; the center of a box is typically off by 2.9 % of its half \
                     size"
                ),
                line("noise of box edges", "12 % of the box's half size, or 3.46 px"),
                line("depths of net", "1.092 ± 0.002 of the true ones"),
                line("depths of near", "1.100 ± 0.011 of the true ones, shifted by -0.980 ± 0.050"),
                line("lengths of the 3D boxes (car)", "1.080 ± 0.011 of the true ones"),
                line("association", "153 of 160 detections assigned to 2 objects; 7 unassigned"),
                line("held-out views", "26 boxes predicted from the other views: mean IoU 0.91"),
            ]
        );
        let told = of(json!({"diagnosis": {"consistent": false, "score": 0.9, "causes": []}}));
        assert_eq!(told, [line("consistency check", "failed: see the top of the page")]);
        assert_eq!(run_overview(&RunRecord::default()), []);
    }

    #[test]
    fn a_scene_that_does_not_agree_with_itself_has_a_banner() {
        let run = |consistent: bool| {
            let cause = json!({"name": "opengl_axes", "value": null, "before": 0.9, "after": 0.02,
                "option": "--assume poses=opengl"});
            let diagnosis = json!({"consistent": consistent, "score": 0.9, "causes": [cause]});
            let corrections = ["up is [0, 0, 1]"];
            record(json!({"diagnosis": diagnosis, "corrections": corrections}))
        };
        let banner = run_banner(&run(false)).unwrap();
        assert!(banner.contains("OpenGL axes") && banner.contains("(--assume poses=opengl)"), "{banner}");
        assert_eq!((run_banner(&run(true)), run_banner(&RunRecord::default())), (None, None));
        assert_eq!(run_notes(&run(true)), ["corrected: up is [0, 0, 1]"]);
    }
}
