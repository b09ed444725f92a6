//! Localizes one scene, writes its result and prints it.

use std::path::Path;
use std::time::Instant;

use anyhow::anyhow;
use quadlift::solve::{Estimate, Rejection, Status};
use quadlift_io::guard::check_not_read;
use quadlift_io::run::{FileInput, FileOptions, FileRun};
use quadlift_io::scene_file::{Detail, count_localised};
use serde_json::{Value, json};

use super::calibration::calibration_in_words;
use crate::association::localize_in_words;
use crate::corrections::corrected_in_words;
use crate::diagnosis::tell;
use crate::error::Outcome;
use crate::estimate_table::{cue_scales, learnt_sizes, noise_levels, pose_points, render, summaries};
use crate::localization::{run_scene, settings_in_words};
use crate::output::{HEADING, Output, one_line};
use crate::report::write_localized;
use crate::words::{count, duration};

/// Reads and localizes a scene, writes and prints the result and adds it to the JSON document. `name` is the scene's in
/// messages.
pub fn one_scene(
    name: &Path,
    read: impl FnOnce() -> anyhow::Result<FileInput>,
    [output, report]: [Option<&Path>; 2],
    (options, detail): (&FileOptions, Detail),
    out: &Output,
    document: &mut Value,
) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    let title = name.display().to_string();
    let input = read()?;
    [output, report].into_iter().flatten().try_for_each(check_not_read)?;
    let ids = options.run.ids_for(input.scene());
    let images = report.map(|_| input.file.to_images(&input.path).map_err(|error| error.in_file(&input.path)));
    let images = images.transpose()?;
    let read = start.elapsed();
    let run = run_scene(&title, input, options, out)?;
    let solved = start.elapsed();
    if let Some(output) = output {
        run.write(output, detail)?;
        document["output"] = output.display().to_string().into();
    }
    if let (Some(report), Some(images)) = (report, &images) {
        write_localized(report, (&run.input.path, &run.input.file), images, run.input.scene(), &run.result())?;
        document["report"] = report.display().to_string().into();
    }
    let localization = run.localization();
    let localized = count_localised(&localization.estimates);
    let mut text = format!(
        "{HEADING}{}{HEADING:#}: {localized} of {} localised ({})\n\n",
        one_line(&title),
        count(localization.estimates.len(), "object"),
        settings_in_words(&options.run.localize.method, localization.body)
    );
    text.push_str(&corrected_in_words(&run.input.notes));
    if let (Some(ids), Some(association)) = (ids, &run.run.association) {
        let source = options.run.localize.source.as_deref();
        text.push_str(&localize_in_words(&run.input.file, source, ids, association));
        text.push_str("\n\n");
    }
    if !out.json && !out.quiet {
        text.push_str(&render(run.input.scene(), localization, options));
    }
    text.push_str(&options.calibration.as_ref().map_or(String::new(), calibration_in_words));
    for path in [output, report].into_iter().flatten() {
        text.push_str(&format!("wrote {}\n", path.display()));
    }
    out.report(&text)?;
    tell_details(&run, out);
    out.detail(&format!("read in {}, localised in {}", duration(read), duration(solved - read)));
    if out.json {
        document["objects"] = serde_json::to_value(summaries(run.input.scene(), localization))?;
        add_record(document, run.record());
    }
    let problems = &run.input.problems;
    out.errors(problems);
    if !problems.is_empty() {
        document["problems"] = json!(problems);
    }
    // Rays that do not cross (all from one point, one view of each object) cannot disagree.
    let undetermined = |e: &Estimate| matches!(e.status, Status::Degenerate | Status::TooFewViews);
    let check = &run.run.check;
    let unchecked = !check.is_explained() && localization.estimates.iter().all(undetermined);
    let accepted = options.run.localize.accept_inconsistent;
    let outcome = if unchecked { Outcome::Fine } else { tell(check, &run.input.context, accepted, &title, out) };
    if localized == 0 && outcome == Outcome::Fine {
        return Err(anyhow!("{title}: no object could be localised"));
    }
    Ok(if problems.is_empty() { outcome } else { Outcome::SomethingFailed })
}

/// Adds the record of a run to the document of a scene, which has its own `objects`.
fn add_record(document: &mut Value, record: Value) {
    let (Value::Object(document), Value::Object(record)) = (document, record) else { return };
    for (name, value) in record {
        if !["body", "program", "settings", "status", "version"].contains(&name.as_str()) {
            document.entry(name).or_insert(value);
        }
    }
}

/// With `--verbose`: rejected views, noise levels, and what the objects share. Odd scales of cues and points that do not fit are
/// warnings.
fn tell_details(run: &FileRun, out: &Output) {
    let (scene, localization) = (run.input.scene(), run.localization());
    for estimate in &localization.estimates {
        let rejected: Vec<String> = estimate
            .views
            .iter()
            .filter_map(|view| Some((&scene.frames[view.frame_index].id, view.rejected_because?)))
            .map(|(frame, because)| format!("{frame} ({})", rejection_in_words(because)))
            .collect();
        if !rejected.is_empty() {
            let id = &scene.object_ids[estimate.object_index];
            out.detail(&one_line(&format!("{id}: rejected the views {}", rejected.join(", "))));
        }
    }
    if let Some(levels) = noise_levels(localization) {
        out.detail(&levels);
    }
    for (line, is_odd) in cue_scales(scene, localization) {
        if is_odd {
            out.warning(&format!("{line}; if the unit is another one, that is right"));
        } else {
            out.detail(&one_line(&line));
        }
    }
    for line in learnt_sizes(scene, localization) {
        out.detail(&one_line(&line));
    }
    if let Some(points) = &localization.pose_points {
        match points.problem {
            Some(_) => out.warning(&points.to_string()),
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
