//! Localises one scene, writes its result and prints it.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, anyhow};
use quadlift::association::AssociateOptions;
use quadlift::solve::{Estimate, Rejection, Status};
use quadlift_io::association::{add_to_result, association_record};
use quadlift_io::diagnosis::refuse_objects;
use quadlift_io::guard::check_not_read;
use quadlift_io::scene_file::{Detail, write_localized_file};
use quadlift_io::scene_file::{
    count_localised, cross_validation_record, cue_scales_record, learnt_sizes_record, noise_record, pose_points_record,
    skipped_record,
};
use quadlift_io::write_scene_file;
use serde_json::{Value, json};

use super::args::Args;
use super::calibration::calibration_in_words;
use crate::association::{associate_and_check, associated_scene, localize_in_words};
use crate::corrections::{CorrectedScene, corrected_in_words};
use crate::diagnosis::Check;
use crate::error::Outcome;
use crate::estimate_table::{cue_scales, learnt_sizes, noise_levels, pose_points, render, summaries};
use crate::localization::{
    Settings, localize_scene, read_depths, read_masks, read_points, result_file, result_file_without_objects,
};
use crate::output::{HEADING, Output, one_line};
use crate::report::write_localized;
use crate::words::{count, duration};

/// Reads and localises a scene, writes and prints the result and adds it to the JSON document. `input` names it, the paths
/// in it are relative to the file `place`.
pub fn one_scene(
    [input, place]: [&Path; 2],
    read: impl FnOnce() -> anyhow::Result<CorrectedScene>,
    [output, report]: [Option<&Path>; 2],
    args: &Args,
    (settings, calibration): (&Settings, Option<&Value>),
    out: &Output,
    document: &mut Value,
) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    let title = input.display().to_string();
    let mut corrected = read()?;
    [output, report].into_iter().flatten().try_for_each(check_not_read)?;
    let source = settings.options.source.as_deref();
    let ids = args.associate.ids_for(&corrected.scene, source, args.ids);
    let mut check = Check::new(&mut corrected, &args.check, source, ids, input)?;
    let read = start.elapsed();
    let mut association = None;
    if let Some(ids) = ids {
        let options = AssociateOptions {
            source: settings.options.source.clone(),
            ids,
            priors: settings.priors_on_categories(),
            ..Default::default()
        };
        let found = associate_and_check(&title, &mut corrected, input, &options, &mut check, out);
        association = Some((ids, found.with_context(|| title.clone())?));
    }
    let CorrectedScene { mut file, mut scene, notes, .. } = corrected;
    let mut problems = Vec::new();
    for read in [read_masks, read_depths] {
        let found = read(&title, (place, &file), &mut scene, &settings.options, out).with_context(|| title.clone())?;
        // Both read masks.
        problems.extend(found.into_iter().filter(|problem| !problems.contains(problem)).collect::<Vec<_>>());
    }
    let words = association.as_ref().map(|(ids, found)| localize_in_words(&scene, source, *ids, found));
    if let Some((_, found)) = &association {
        scene = associated_scene(&scene, found, source)?;
    }
    // The points of an object count once, so its views must be known.
    let found =
        read_points(&title, (place, &file), &mut scene, &settings.options, out).with_context(|| title.clone())?;
    problems.extend(found.into_iter().filter(|problem| !problems.contains(problem)).collect::<Vec<_>>());
    file.objects = Vec::new();
    // The page shows masks, which are named by the detections.
    let images = report.map(|_| file.to_images(place).map_err(|error| error.in_file(place))).transpose()?;
    // Detections are the bulk of a large scene; a result has them where their identities are found.
    let detections = std::mem::take(&mut file.detections);
    let mut identities = None;
    if let (Some((_, association)), Some(words)) = (association, words) {
        document["association"] = association_record(&scene, &association);
        identities = Some((detections, association, words));
    } else {
        drop(detections);
    }
    let mut localization = localize_scene(&title, &scene, settings, out).with_context(|| title.clone())?;
    if identities.is_some() {
        // Told with the identities.
        localization.skipped.without_object = 0;
    }
    check.update_localized(&localization, identities.is_none());
    refuse_objects(&mut localization, &check.diagnosis, args.check.accept_inconsistent);
    document["diagnosis"] = check.record();
    let solved = start.elapsed();
    let estimates = &localization.estimates;
    let found = identities.as_ref().map_or(String::new(), |(.., words)| format!("{words}\n\n"));
    // Records of all objects at once are only made for what needs them.
    let needs_records = report.is_some() || identities.is_some();
    let mut result = if needs_records {
        result_file(&file, &scene, &localization, settings)
    } else {
        result_file_without_objects(&file, &scene, &localization, settings)
    };
    if let Some(about) = &mut result.localization {
        about["diagnosis"] = check.record();
        if !notes.is_empty() {
            about["corrections"] = json!(notes);
            document["corrections"] = json!(notes);
        }
        if let Some(calibration) = calibration {
            about["calibration"] = calibration.clone();
        }
    }
    if let Some((detections, association, _)) = identities {
        add_to_result(&mut result, detections, &scene, source, &association);
    }
    if let Some(output) = output {
        let detail = Detail::from(args.detail);
        if needs_records && detail == Detail::Full {
            write_scene_file(output, &result)?;
        } else if needs_records {
            // The page shows everything.
            let mut brief = result.clone();
            brief.objects.iter_mut().for_each(|object| detail.apply(object));
            write_scene_file(output, &brief)?;
        } else {
            write_localized_file(output, &result, &scene, &localization, detail)?;
        }
        document["output"] = output.display().to_string().into();
    }
    if let (Some(report), Some(images)) = (report, &images) {
        write_localized(report, (place, &file), images, &scene, &result)?;
        document["report"] = report.display().to_string().into();
    }
    let localised = count_localised(estimates);
    let mut text = format!(
        "{HEADING}{}{HEADING:#}: {localised} of {} localised ({})\n\n",
        one_line(&title),
        count(estimates.len(), "object"),
        settings.in_words(localization.body)
    );
    text.push_str(&corrected_in_words(&notes));
    text.push_str(&found);
    if !out.json && !out.quiet {
        text.push_str(&render(&scene, &localization, settings));
    }
    text.push_str(&calibration.map_or(String::new(), calibration_in_words));
    for path in [output, report].into_iter().flatten() {
        text.push_str(&format!("wrote {}\n", path.display()));
    }
    out.report(&text)?;
    for estimate in estimates {
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
    if let Some(levels) = noise_levels(&localization) {
        out.detail(&levels);
    }
    for (line, is_odd) in cue_scales(&scene, &localization) {
        if is_odd {
            out.warning(&format!("{line}; if the unit is another one, that is right"));
        } else {
            out.detail(&one_line(&line));
        }
    }
    for line in learnt_sizes(&scene, &localization) {
        out.detail(&one_line(&line));
    }
    if let Some(points) = &localization.pose_points {
        match points.problem {
            Some(_) => out.warning(&points.to_string()),
            None => out.detail(&pose_points(points)),
        }
    }
    out.detail(&format!("read in {}, localised in {}", duration(read), duration(solved - read)));
    if out.json {
        document["objects"] = serde_json::to_value(summaries(&scene, &localization))?;
        document["localised"] = localised.into();
        document["noise"] = noise_record(&localization).into();
        if !localization.cue_scales.is_empty() {
            document["cue_scales"] = cue_scales_record(&scene, &localization);
        }
        if !localization.learnt_sizes.is_empty() {
            document["learnt_sizes"] = learnt_sizes_record(&scene, &localization);
        }
        if localization.pose_points.is_some() {
            document["pose_points"] = pose_points_record(&localization);
        }
        document["cross_validation"] = cross_validation_record(&localization);
        document["skipped"] = skipped_record(&localization);
        if let Some(calibration) = calibration {
            document["calibration"] = calibration.clone();
        }
    }
    out.errors(&problems);
    if !problems.is_empty() {
        document["problems"] = json!(problems);
    }
    // Rays that do not cross (all from one point, one view of each object) cannot disagree.
    let undetermined = |e: &Estimate| matches!(e.status, Status::Degenerate | Status::TooFewViews);
    let cannot_tell = !check.is_explained() && estimates.iter().all(undetermined);
    let outcome = if cannot_tell { Outcome::Fine } else { check.tell(&title, out) };
    if localised == 0 && outcome == Outcome::Fine {
        return Err(anyhow!("{title}: no object could be localised"));
    }
    Ok(if problems.is_empty() { outcome } else { Outcome::SomethingFailed })
}

/// Why a view was not used.
fn rejection_in_words(because: Rejection) -> &'static str {
    match because {
        Rejection::Residual => "residual",
        Rejection::BehindCamera => "behind the camera",
    }
}
