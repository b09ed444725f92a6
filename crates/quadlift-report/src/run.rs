//! The run of a result (`localization` in the file): settings, and notes in sentences.

use quadlift_io::SceneFile;
use quadlift_io::diagnosis::record_in_words;
use serde_json::Value;

/// The quantile of 95 % of chi-square with three degrees of freedom.
const CHI2_95: f64 = 7.814_727_903_251_178;

/// The source whose detections were taken.
pub fn run_source(file: &SceneFile) -> Option<&str> {
    file.localization.as_ref()?.get("settings")?.get("source")?.as_str()
}

/// Names and values: the settings that were made, the kind of body, the noise levels, how well left-out views are
/// predicted.
pub fn run_settings(file: &SceneFile) -> Vec<(String, String)> {
    let Some(run) = &file.localization else { return Vec::new() };
    let mut settings = Vec::new();
    let mut add = |prefix: &str, value: Option<&Value>| {
        for (name, value) in value.and_then(Value::as_object).into_iter().flatten() {
            if !value.is_null() {
                settings.push((format!("{prefix}{}", name.replace('_', " ")), in_words(value)));
            }
        }
    };
    add("", run.get("settings"));
    add("noise, ", run.get("noise"));
    add("cross-validation, ", run.get("cross_validation"));
    if let Some(body) = run.get("body") {
        settings.push(("fitted body".to_owned(), in_words(body)));
    }
    settings
}

/// Overview of a run as names and values: the self-check, the noise of the boxes, the association, and how well
/// left-out views are predicted.
pub fn run_overview(file: &SceneFile) -> Vec<(String, String)> {
    let Some(run) = &file.localization else { return Vec::new() };
    let number = |path: &str| run.pointer(path).and_then(Value::as_f64);
    let mut overview = Vec::new();
    let mut say = |name: &str, text: String| overview.push((name.to_owned(), text));
    match run.pointer("/diagnosis/consistent").and_then(Value::as_bool) {
        Some(false) => say("self-check", "failed: see the top of the page".to_owned()),
        Some(true) => {
            let miss = number("/diagnosis/score").map_or(String::new(), |score| {
                format!("; the center of a box is typically off by {} of its half size", percent(score))
            });
            say("self-check", format!("passed: boxes and camera poses agree{miss}"));
        }
        None => {}
    }
    if let Some(noise) = number("/noise/edge_relative") {
        let pixels = number("/noise/edge_px").map_or(String::new(), |x| format!(", or {x:.2} px"));
        say("noise of box edges", format!("{} of the box's half size{pixels}", percent(noise)));
    }
    for scale in run.get("cue_scales").and_then(Value::as_array).into_iter().flatten() {
        overview_of_scale(scale, &mut say);
    }
    if let (Some(taken), Some(left)) = (number("/association/associated"), number("/association/clutter")) {
        let objects = run.pointer("/association/objects").and_then(Value::as_array).map_or(0, Vec::len);
        say(
            "association",
            format!("{taken:.0} of {:.0} detections assigned to {objects} objects; {left:.0} unassigned", taken + left),
        );
    }
    if let (Some(iou), Some(views)) = (number("/cross_validation/iou"), number("/cross_validation/views")) {
        say("held-out views", format!("{views:.0} boxes predicted from the other views: mean IoU {iou:.2}"));
    }
    overview
}

/// What a source of depths or 3D boxes is wrong by.
fn overview_of_scale(scale: &Value, say: &mut impl FnMut(&str, String)) {
    let text = |name: &str| scale.get(name).and_then(Value::as_str);
    let number = |name: &str| scale.get(name).and_then(Value::as_f64);
    let (Some(quantity), Some(factor), Some(log_sd)) = (text("quantity"), number("factor"), number("log_sd")) else {
        return;
    };
    let what = match quantity {
        "depth" => "depths",
        "box3d_distance" => "distances of the 3D boxes",
        "box3d_length" => "lengths of the 3D boxes",
        "box3d_width" => "widths of the 3D boxes",
        "box3d_height" => "heights of the 3D boxes",
        other => other,
    };
    let of = text("source").map_or(String::new(), |name| format!(" of {name}"));
    let category = text("category").map_or(String::new(), |name| format!(" ({name})"));
    let shift = number("shift").zip(number("shift_sd"));
    let shift = shift.map_or(String::new(), |(shift, sd)| format!(", shifted by {shift:+.3} ± {sd:.3}"));
    say(&format!("{what}{of}{category}"), format!("{factor:.3} ± {:.3} of the true ones{shift}", factor * log_sd));
}

/// A share as a percentage with two digits.
fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent < 9.95 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// That the scene is inconsistent, and how to correct it.
pub fn run_banner(file: &SceneFile) -> Option<String> {
    let words = record_in_words(file.localization.as_ref()?.get("diagnosis")?)?;
    Some(format!("The scene is inconsistent: {words}. Positions and sizes on this page are unreliable."))
}

/// The squared distance at which the region of 95 % of a centre ends, in units of its covariance: as it was calibrated,
/// else the quantile of chi-square with three degrees of freedom.
pub fn center_limit(file: &SceneFile) -> f64 {
    calibrated_limit(file).unwrap_or(CHI2_95)
}

/// The meaning of the 95 % region of a centre, in sentences.
pub fn run_region(file: &SceneFile) -> String {
    let calibration = file.localization.as_ref().and_then(|run| run.get("calibration"));
    let objects = calibration.and_then(|about| about.get("objects")?.as_u64());
    let results = calibration.and_then(|about| about.get("results")?.as_array());
    let results: Vec<&str> = results.into_iter().flatten().filter_map(Value::as_str).collect();
    let results = results.join(", ");
    let limit = calibrated_limit(file);
    match (objects, limit) {
        (Some(objects), Some(limit)) => format!(
            "Region of 95 %, calibrated on {objects} objects of {results}: the center of the tangent body of a \
             similar object lies inside with a probability of at least 95 % (squared distance {limit:.2}, without \
             calibration {CHI2_95:.2})."
        ),
        _ => {
            let why = match objects {
                Some(objects) => {
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

fn calibrated_limit(file: &SceneFile) -> Option<f64> {
    file.localization.as_ref()?.pointer("/calibration/squared_distance/center/0.95")?.as_f64().filter(|x| *x > 0.0)
}

/// Skipped detections, in sentences.
pub fn run_notes(file: &SceneFile) -> Vec<String> {
    // Files of version 0.1.0 say "left_out".
    let skipped = |name: &str| {
        let about = file.localization.as_ref()?;
        about.get("skipped").or_else(|| about.get("left_out"))?.get(name)?.as_u64()
    };
    let reasons = [
        ("without_object", "they have no object id"),
        ("occluded_or_truncated", "they are too occluded or truncated"),
        ("beyond_lens", "they lie where the lens cannot be undistorted"),
        ("without_measurement", "they lack the selected measurement"),
    ];
    let note = |(name, reason): (&str, &str)| {
        let number = skipped(name).filter(|&number| number > 0)?;
        Some(format!("{number} detections were not used: {reason}"))
    };
    let corrections = file.localization.as_ref().and_then(|run| run.get("corrections")?.as_array());
    let corrected = corrections.into_iter().flatten().filter_map(|note| Some(format!("corrected: {}", note.as_str()?)));
    corrected.chain(reasons.into_iter().filter_map(note)).collect()
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
    use serde_json::json;

    #[test]
    fn the_overview_says_how_the_run_went_in_words() {
        let of = |run: Value| run_overview(&SceneFile { localization: Some(run), ..Default::default() });
        let told = of(json!({
            "diagnosis": {"consistent": true, "score": 0.0294, "causes": []},
            "noise": {"edge_relative": 0.123, "edge_px": 3.456},
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
                    "self-check",
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
        assert_eq!(told, [line("self-check", "failed: see the top of the page")]);
        assert_eq!(run_overview(&SceneFile::default()), []);
    }

    #[test]
    fn a_scene_that_does_not_agree_with_itself_has_a_banner() {
        let file = |consistent: bool| {
            let cause = json!({"name": "opengl_axes", "value": null, "before": 0.9, "after": 0.02,
                "option": "--pose-convention opengl"});
            let diagnosis = json!({"consistent": consistent, "score": 0.9, "causes": [cause]});
            let corrections = ["up is [0, 0, 1]"];
            let run = json!({"diagnosis": diagnosis, "corrections": corrections});
            SceneFile { localization: Some(run), ..Default::default() }
        };
        let banner = run_banner(&file(false)).unwrap();
        assert!(banner.contains("OpenGL axes") && banner.contains("(--pose-convention opengl)"), "{banner}");
        assert_eq!((run_banner(&file(true)), run_banner(&SceneFile::default())), (None, None));
        assert_eq!(run_notes(&file(true)), ["corrected: up is [0, 0, 1]"]);
    }
}
