//! Localizes one scene, writes its result and prints it.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::anyhow;
use quadlift::solve::{Estimate, Rejection, Status};
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_io::guard::check_not_read;
use quadlift_io::run::{FileInput, FileOptions, FileRun, RunRecord};
use quadlift_io::scene_file::{Detail, count_localized};
use quadlift_report::Labels;
use serde::Serialize;
use serde_json::Value;

use super::coverage::coverage_in_words;
use crate::association::localize_in_words;
use crate::corrections::corrected_in_words;
use crate::diagnosis::tell;
use crate::error::Outcome;
use crate::estimate_table::{cue_scales, learned_size, noise_levels, pose_points, render, summaries};
use crate::files::move_paths;
use crate::localization::{run_scene, settings_in_words};
use crate::oddities::{camera_oddity, scene_oddities};
use crate::output::{HEADING, Output, one_line};
use crate::report::write_localized;
use crate::words::{count, duration};

/// What `--json` says of a scene.
#[derive(Serialize, Default)]
pub(super) struct SceneDocument {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cameras: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detections: Option<String>,
    /// The consistency check of a scene that has no result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<DiagnosisRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub problems: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub report: Option<String>,
    #[serde(flatten)]
    pub run: Option<RunRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
}

/// Reads and localizes a scene, writes and prints the result and adds it to the JSON document. `name` is the scene's in
/// messages.
pub(super) fn one_scene(
    name: &Path,
    read: impl FnOnce() -> anyhow::Result<FileInput>,
    [output, report]: [Option<&Path>; 2],
    (options, detail): (&FileOptions, Detail),
    out: &Output,
    document: &mut SceneDocument,
) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    let title = name.display().to_string();
    let input = read()?;
    [output, report].into_iter().flatten().try_for_each(check_not_read)?;
    let ids = options.run.ids_for(input.scene());
    let images = report.map(|_| input.file.to_images(&input.path).map_err(|error| error.in_file(&input.path)));
    let images = images.transpose()?;
    let read = start.elapsed();
    // Those of the scene as it was read: corrections change it.
    let (oddities, of_cameras) = (scene_oddities(input.scene()), camera_oddity(input.scene()));
    let warn = |is_localized: bool| {
        let of_cameras = of_cameras.iter().filter(|_| !is_localized);
        oddities.iter().chain(of_cameras).for_each(|oddity| out.warning(&format!("{title}: {oddity}")));
    };
    let mut run = run_scene(&title, input, options, out).inspect_err(|_| warn(false))?;
    // The paths of images are relative to the file that names them.
    let path = run.input.path.clone();
    output.map_or(Ok(()), |output| move_paths(Arc::make_mut(&mut run.input.file), &path, output))?;
    let solved = start.elapsed();
    // Records of all objects at once are only made for the page.
    let result = report.map(|_| run.result());
    if let Some(output) = output {
        run.write(output, detail, result.as_ref())?;
        document.output = Some(output.display().to_string());
    }
    if let (Some(report), Some(images), Some(result)) = (report, &images, &result) {
        write_localized(report, (&run.input.path, &run.input.file), images, run.input.scene(), result, out)?;
        document.report = Some(report.display().to_string());
    }
    let localization = &run.run.localization;
    let localized = count_localized(&localization.estimates);
    let mut text = format!(
        "{HEADING}{}{HEADING:#}: {localized} of {} localized ({})\n\n",
        one_line(&title),
        count(localization.estimates.len(), "object"),
        settings_in_words(&options.run.localize.method, localization.body)
    );
    text.push_str(&corrected_in_words(&run.input.notes));
    if let (Some(ids), Some(association)) = (ids, &run.run.association) {
        let source = options.run.localize.source.as_deref();
        text.push_str(&localize_in_words(&run.input.file, run.input.scene(), source, ids, association));
        text.push_str("\n\n");
    }
    if !out.json && !out.quiet {
        text.push_str(&render(run.input.scene(), localization, options));
    }
    text.push_str(&options.coverage.as_ref().map_or(String::new(), coverage_in_words));
    for path in [output, report].into_iter().flatten() {
        text.push_str(&format!("wrote {}\n", path.display()));
    }
    out.report(&text)?;
    let record = run.record();
    tell_details(&run, &record, out);
    out.detail(&format!("read in {}, localized in {}", duration(read), duration(solved - read)));
    if out.json {
        document.objects = Some(serde_json::to_value(summaries(run.input.scene(), localization))?);
        // The objects tell their number, bodies and status; the settings are those of the command line.
        document.run = Some(RunRecord {
            body: None,
            objects: None,
            program: None,
            settings: Value::Null,
            status: None,
            version: None,
            ..record
        });
    }
    for warning in &run.input.warnings {
        out.warning(&format!("{title}: {warning}"));
    }
    let problems = &run.input.problems;
    out.errors(problems);
    document.problems.clone_from(problems);
    // Rays that do not cross (all from one point, one view of each object) cannot disagree.
    let undetermined = |e: &Estimate| matches!(e.status, Status::Degenerate | Status::TooFewViews);
    let check = &run.run.check;
    let unchecked = !check.is_explained() && localization.estimates.iter().all(undetermined);
    let accepted = options.run.localize.allow_inconsistent;
    let outcome = if unchecked { Outcome::Fine } else { tell(check, &run.input.context, accepted, &title, out) };
    if localized == 0 && outcome == Outcome::Fine {
        return Err(anyhow!("{title}: no object could be localized"));
    }
    // What --fix corrects explains them, too.
    if !check.is_fixable() {
        warn(localized > 0);
    }
    Ok(if problems.is_empty() { outcome } else { Outcome::SomethingFailed })
}

/// With `--verbose`: rejected views, noise levels, and what the objects share. Odd scales of cues and points that do not fit are
/// warnings.
fn tell_details(run: &FileRun, record: &RunRecord, out: &Output) {
    let (scene, localization) = (run.input.scene(), &run.run.localization);
    let labels = Labels::of_estimates(scene, localization);
    for estimate in &localization.estimates {
        let rejected: Vec<String> = estimate
            .views
            .iter()
            .filter_map(|view| Some((&scene.frames[view.frame_index].id, view.rejection_reason?)))
            .map(|(frame, because)| format!("{frame} ({})", rejection_in_words(because)))
            .collect();
        if !rejected.is_empty() {
            let name = labels.of(&scene.object_ids[estimate.object_index]);
            out.detail(&one_line(&format!("{name}: rejected the views {}", rejected.join(", "))));
        }
    }
    if let Some(levels) = noise_levels(localization) {
        out.detail(&levels);
    }
    for (line, is_odd) in cue_scales(scene, &record.cue_scales) {
        if is_odd {
            out.warning(&format!("{line}; if the unit is another one, that is right"));
        } else {
            out.detail(&one_line(&line));
        }
    }
    for size in &record.learned_sizes {
        out.detail(&one_line(&learned_size(size)));
    }
    if let Some(points) = &record.pose_points {
        match &points.warning {
            Some(warning) => out.warning(warning),
            None => out.detail(&pose_points(points)),
        }
    }
}

/// Why a view was not used.
fn rejection_in_words(because: Rejection) -> &'static str {
    match because {
        Rejection::Residual => "residual",
        Rejection::BehindCamera => "behind the camera",
    }
}
