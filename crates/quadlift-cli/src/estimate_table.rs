//! The table of estimates: one row per object, then warnings.

use std::fmt::Write;

use anstyle::Style;
use quadlift::Localization;
use quadlift::cross_validation::{CrossValidation, Extent};
use quadlift::geometry::Body;
use quadlift::nalgebra::Vector3;
use quadlift::scene::Scene;
use quadlift::solve::{Estimate, Method, Status};
use quadlift_io::run::{CueScaleRecord, FileOptions, LearnedSizeRecord, PosePointsRecord, Quantity};
use quadlift_io::scene_file::{CrossValidationRecord, cross_validation_of_object};
use quadlift_report::Labels;
use serde::Serialize;

use crate::output::{BAD, DIM, GOOD, WARNING, one_line};
use crate::table::{Cell, MAX_ROWS, Table, decimals, number, rest};
use crate::words::{count, some_of, with_unit};

/// The main figures of an estimate.
#[derive(Debug, Serialize)]
pub(crate) struct Summary<'a> {
    id: &'a str,
    category: Option<&'a str>,
    status: &'static str,
    views_used: usize,
    views: usize,
    center: Option<[f64; 3]>,
    /// Full lengths along the axes of the body, the longest first.
    size: Option<[f64; 3]>,
    /// Their standard deviations.
    size_sd: Option<[f64; 3]>,
    center_sd: Option<f64>,
    residual_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cross_validation: Option<CrossValidationRecord>,
    warnings: Vec<String>,
}

/// The main figures of all estimates.
pub(crate) fn summaries<'a>(scene: &'a Scene, localization: &Localization) -> Vec<Summary<'a>> {
    let checked = &localization.cross_validation;
    let of_object = |index| {
        let object = checked.of_estimate(index).filter(|_| checked.extent == Extent::All)?;
        cross_validation_of_object(scene, object)
    };
    let summary = |(index, estimate): (usize, &Estimate)| {
        let sizes = estimate.body.as_ref().map(|body| full_lengths(body, estimate.half_extents_sd()));
        Summary {
            id: &scene.object_ids[estimate.object_index],
            category: estimate.category_index.map(|index| scene.categories[index].as_str()),
            status: estimate.status.name(),
            views_used: estimate.views_used(),
            views: estimate.views.len(),
            center: estimate.center.map(|center| center.coords.into()),
            size: sizes.map(|sizes| sizes.map(|[length, _]| length)),
            size_sd: sizes.map(|sizes| sizes.map(|[_, sd]| sd)).filter(|sd| sd.iter().all(|sd| sd.is_finite())),
            center_sd: estimate.center_sd().filter(|sd| sd.is_finite()),
            residual_px: estimate.rms_residual_px().filter(|r| r.is_finite()),
            cross_validation: of_object(index),
            warnings: estimate.warnings.iter().map(ToString::to_string).collect(),
        }
    };
    localization.estimates.iter().enumerate().map(summary).collect()
}

/// The full lengths of a body with their standard deviations (not a number where they are unknown), the longest first.
fn full_lengths(body: &Body, half_extents_sd: Option<Vector3<f64>>) -> [[f64; 2]; 3] {
    let sd = half_extents_sd.unwrap_or(Vector3::repeat(f64::NAN));
    let mut lengths = [0, 1, 2].map(|axis| [2.0 * body.half_extents[axis], 2.0 * sd[axis]]);
    lengths.sort_by(|[a, _], [b, _]| b.total_cmp(a));
    lengths
}

/// The table and its notes.
pub(crate) fn render(scene: &Scene, localization: &Localization, options: &FileOptions) -> String {
    let rows = summaries(scene, localization);
    let labels = Labels::of_estimates(scene, localization);
    let shown = &rows[..rows.len().min(MAX_ROWS)];
    let mut text = table(scene, shown, &labels, localization.cross_validation.extent == Extent::All);
    text.push_str(&rest(rows.len(), "object", "the result (-o) and --json list all"));
    for note in notes(&rows, &labels, localization, options) {
        let _ = writeln!(text, "{WARNING}note:{WARNING:#} {}", one_line(&note));
    }
    let without = options.categories_without_prior(scene);
    if !without.is_empty() {
        let _ = writeln!(text, "{WARNING}warning:{WARNING:#} no prior for: {}", one_line(&without.join(", ")));
    }
    let skipped = localization.skipped;
    if skipped.without_object > 0 {
        let _ = writeln!(
            text,
            "{WARNING}warning:{WARNING:#} skipped {} without an object id (--associate always associates them)",
            count(skipped.without_object, "detection")
        );
    }
    if skipped.occluded_or_truncated > 0 {
        let _ = writeln!(
            text,
            "skipped {} as too occluded or truncated",
            count(skipped.occluded_or_truncated, "detection")
        );
    }
    if skipped.beyond_lens > 0 {
        let n = count(skipped.beyond_lens, "detection");
        let _ = writeln!(text, "skipped {n} where the lens cannot be undistorted (80 degrees or more from the axis)");
    }
    if skipped.without_measurement > 0 {
        let n = count(skipped.without_measurement, "detection");
        let _ = writeln!(text, "skipped {n} without the measurement that --measurement selects");
    }
    if let Some(noise) = typical_error(localization) {
        let _ = writeln!(text, "{DIM}{noise}{DIM:#}");
    }
    if let Some(agreement) = agreement(&localization.cross_validation) {
        let _ = writeln!(text, "{DIM}{agreement}{DIM:#}");
    }
    text
}

/// Typical measurement errors, as text: edges of boxes, or centers and sizes of ellipses without boxes. `--verbose`
/// prints the full list ([`noise_levels`]).
fn typical_error(localization: &Localization) -> Option<String> {
    let level = |name: &str| localization.noise.get(name);
    let percent = |x: f64| format!("{} %", number(Some(100.0 * x), decimals(100.0 * x, 2)));
    if let Some(relative) = level("edge_noise") {
        let pixels =
            level("edge_noise_px").map_or(String::new(), |px| format!(" and {} px", number(Some(px), decimals(px, 2))));
        return Some(format!("typical error of a box edge: {} of the box's half size{pixels}", percent(relative)));
    }
    let (center, size) = (level("ellipse_center")?, level("ellipse_size")?);
    Some(format!(
        "typical error of an ellipse: {} of its half size in position, {} in size",
        percent(center),
        percent(size)
    ))
}

/// How well left-out views are predicted, in one line; `None` without any.
fn agreement(checked: &CrossValidation) -> Option<String> {
    let iou = number(checked.iou(), 2);
    let views = count(checked.predictions().count(), "view");
    let views = if checked.extent == Extent::All { views } else { format!("a sample of {views}") };
    checked.iou().map(|_| format!("boxes predicted from the other views: IoU {iou} with the measured ones ({views})"))
}

/// The noise levels by their names in results and `--noise-model`; `None` if there are none.
pub(crate) fn noise_levels(localization: &Localization) -> Option<String> {
    let levels: Vec<String> = localization.noise_levels().map(|(name, x)| format!("{name} {x:.4}")).collect();
    (!levels.is_empty()).then(|| format!("noise levels: {}", levels.join(", ")))
}

/// Factors of depths and distances beyond which the unit is probably another one.
const USUAL_SCALES: std::ops::RangeInclusive<f64> = 0.7..=1.4;

/// The scales of the sources of depths and 3D boxes, one line each, and whether one is so far from 1 that a unit may be wrong.
pub(crate) fn cue_scales(scene: &Scene, scales: &[CueScaleRecord]) -> Vec<(String, bool)> {
    let scaled_by_frame: Vec<&str> =
        scene.scaled_by_frame.iter().filter_map(|&source| Some(&**scene.cue_sources.get(source as usize)?)).collect();
    let line = |found: &CueScaleRecord| {
        let (what, factor, sd) = (found.what(), found.factor, found.factor * found.log_sd);
        let line = match found.shift.zip(found.shift_sd) {
            Some((value, shift_sd)) => {
                let places = decimals(shift_sd, 2);
                let shift =
                    format!("shifted by {value:+.places$} (standard deviations {sd:.3} and {shift_sd:.places$})");
                format!("{what} are {factor:.3} of the true ones, {shift}")
            }
            None => format!("{what} are {factor:.3} of the true ones (standard deviation {sd:.3})"),
        };
        let may_be_odd = match found.quantity {
            Quantity::Depth => !found.source.as_deref().is_some_and(|source| scaled_by_frame.contains(&source)),
            Quantity::Box3dDistance => true,
            Quantity::Box3dLength | Quantity::Box3dWidth | Quantity::Box3dHeight => false,
        };
        (line, may_be_odd && !USUAL_SCALES.contains(&factor))
    };
    let (of_frames, others): (Vec<&CueScaleRecord>, Vec<_>) = scales.iter().partition(|found| found.frame.is_some());
    let mut lines: Vec<_> = others.into_iter().map(line).collect();
    for same in of_frames.chunk_by(|a, b| a.source == b.source) {
        let factor = |pick: fn(f64, f64) -> f64| same.iter().map(|found| found.factor).reduce(pick).unwrap_or(1.0);
        let [least, most] = [factor(f64::min), factor(f64::max)];
        let what = same[0].what();
        lines.push((format!("{what} in single frames are {least:.3} to {most:.3} of the true ones"), false));
    }
    lines
}

/// The size of a category that was learned from the scene, in one line.
pub(crate) fn learned_size(found: &LearnedSizeRecord) -> String {
    let LearnedSizeRecord { category, body, well_determined, .. } = found;
    let objects = format!("{} ({body})", count(found.objects, "object"));
    let worth = format!("{well_determined:.1} well-determined ones");
    let Some((mean, sd)) = found.size.zip(found.size_sd) else {
        return format!(
            "{category}: no size is learned from {objects}, worth {worth}; they are too few or too different"
        );
    };
    // The longest first, as in the table.
    let mut order = [0, 1, 2];
    order.sort_by(|&a: &usize, &b| mean[b].total_cmp(&mean[a]));
    let extents = |x: [f64; 3]| order.map(|axis| format!("{:.3}", x[axis])).join(" x ");
    let (mean, sd) = (extents(mean), extents(sd));
    format!("{category}: size {mean} (standard deviations {sd}), learned from {objects}, worth {worth}")
}

/// The points from which poses were corrected beside the objects, in one line.
pub(crate) fn pose_points(found: &PosePointsRecord) -> String {
    let pixels = |error: Option<f64>| error.map_or_else(|| "-".to_owned(), |error| format!("{error:.2} px"));
    format!(
        "poses: {} of {}, {}; median error {} as given, {} now; noise {}",
        count(found.points, "track"),
        count(found.scene_points, "point"),
        count(found.observations, "observation"),
        pixels(found.given_error_px),
        pixels(found.error_px),
        pixels(found.noise_px)
    )
}

fn table(scene: &Scene, rows: &[Summary], labels: &Labels, cross_validated: bool) -> String {
    // Lengths get as many decimals as three digits of the typical object need.
    let mut lengths: Vec<f64> = rows.iter().filter_map(|row| row.size).map(|size| size[1]).collect();
    lengths.sort_by(f64::total_cmp);
    let places = decimals(lengths.get(lengths.len() / 2).copied().unwrap_or(1.0), 3);
    let unit = scene.length_unit.as_deref();
    let mut columns = vec![
        "<object".to_owned(),
        "<category".to_owned(),
        "<status".to_owned(),
        "views".to_owned(),
        with_unit("x", unit),
        with_unit("y", unit),
        with_unit("z", unit),
        with_unit("size", unit),
        with_unit("sd of center", unit),
        "residual [px]".to_owned(),
    ];
    if cross_validated {
        columns.push("left-out IoU".to_owned());
    }
    let mut table = Table::new(columns);
    for row in rows {
        let coordinate = |axis: usize| number(row.center.map(|center| center[axis]), places).into();
        let mut size = row.size.map_or("-".to_owned(), |s| s.map(|x| number(Some(x), places)).join(" x "));
        if let Some(sd) = row.size_sd {
            // One number for all three: the root of their mean variance.
            let sd = (sd.iter().map(|sd| sd * sd).sum::<f64>() / 3.0).sqrt();
            let _ = write!(size, " ± {}", number(Some(sd), decimals(sd, 2)));
        }
        let mut cells = vec![
            labels.of(row.id).into(),
            labels.category(row.id, row.category).into(),
            Cell::styled(row.status, status_style(row.status)),
            format!("{}/{}", row.views_used, row.views).into(),
            coordinate(0),
            coordinate(1),
            coordinate(2),
            size.into(),
            number(row.center_sd, row.center_sd.map_or(0, |sd| decimals(sd, 2))).into(),
            number(row.residual_px, 2).into(),
        ];
        if cross_validated {
            cells.push(number(row.cross_validation.as_ref().map(|checked| checked.iou), 2).into());
        }
        table.push(cells);
    }
    table.render()
}

fn status_style(status: &str) -> Style {
    if status == Status::Ok.name() {
        GOOD
    } else if [Status::Inconsistent, Status::Undetermined, Status::NotAnEllipsoid].map(Status::name).contains(&status) {
        WARNING
    } else {
        BAD
    }
}

/// Notes about the objects, each with the labels of the affected ones.
fn notes(rows: &[Summary], labels: &Labels, localization: &Localization, options: &FileOptions) -> Vec<String> {
    let mut notes: Vec<(String, Vec<&str>)> = Vec::new();
    for (row, estimate) in rows.iter().zip(&localization.estimates) {
        let odd = row.cross_validation.as_ref().and_then(|checked| checked.suspect_view.as_deref());
        let odd = odd.map(|view| format!("the view {view} contradicts the others"));
        let reason = reason(estimate.status, &options.run.localize.method, options.run.localize.min_views);
        for text in reason.into_iter().chain(row.warnings.iter().cloned()).chain(odd) {
            match notes.iter_mut().find(|(known, _)| *known == text) {
                Some((_, names)) => names.push(labels.of(row.id)),
                None => notes.push((text, vec![labels.of(row.id)])),
            }
        }
    }
    notes.into_iter().map(|(text, names)| format!("{}: {text}", some_of(&names))).collect()
}

/// Why an object is not localized.
fn reason(status: Status, method: &Method, min_views: usize) -> Option<String> {
    let fewest = min_views.max(method.min_views());
    Some(match status {
        Status::Ok => return None,
        Status::Inconsistent => {
            "no body agrees with the views, or the scene is inconsistent; the reported one is unreliable".to_owned()
        }
        Status::Undetermined => {
            "the views leave open where it is: its center is uncertain by most of its own size".to_owned()
        }
        Status::NotAnEllipsoid => {
            "the best-fitting quadric is not an ellipsoid; only its center is reported".to_owned()
        }
        Status::TooFewViews => format!("too few views; {method} needs {fewest} here"),
        Status::Degenerate => {
            "the views do not determine the object, for example because all are from the same position".to_owned()
        }
        Status::Diverged => "the refinement found no finite object in front of the cameras".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::scene::SceneParts;
    use quadlift::solve::SceneSolution;

    #[test]
    fn a_table_has_forty_rows_at_most() {
        let count = MAX_ROWS + 7;
        let object_ids = (0..count).map(|k| format!("thing{k}")).collect();
        let scene = Scene::from_parts(SceneParts { object_ids, ..Default::default() }).unwrap();
        let estimates = (0..count).map(|k| Estimate::failed(k, None, Status::Inconsistent)).collect();
        let localization =
            Localization { solution: SceneSolution { estimates, ..Default::default() }, ..Default::default() };
        let text = render(&scene, &localization, &FileOptions::default());
        let is_row = |line: &&str| line.starts_with("thing");
        assert_eq!(text.lines().filter(is_row).count(), MAX_ROWS);
        assert!(text.contains("and 7 more objects: the result (-o) and --json list all"), "{text}");
    }
}
