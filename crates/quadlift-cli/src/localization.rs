//! A run in the program: its settings, what was measured, and why it failed, in words.

use std::path::Path;

use anyhow::anyhow;
use quadlift::LocalizeError;
use quadlift::association::{AssociateError, Outcome as AssociationOutcome};
use quadlift::geometry::BodyKind;
use quadlift::run::RunError;
use quadlift::scene::SourceError;
use quadlift::solve::Method;
use quadlift_io::association::skipped_in_words;
use quadlift_io::run::{FileInput, FileOptions, FileRun, FileRunError, InputError, PriorSource, run_file};
use quadlift_io::scene_file::fitted_body_name;

use crate::diagnosis::nothing_agrees;
use crate::error::usage;
use crate::output::Output;
use crate::progress::RunProgress;
use crate::words::count;

/// Checks the options of a run and reads the priors.
pub(crate) fn file_options(run: quadlift::run::RunOptions, priors: PriorSource) -> anyhow::Result<FileOptions> {
    if let Err(error) = run.localize.validate() {
        return usage(error.to_string());
    }
    Ok(FileOptions::new(run, priors)?)
}

/// Where the priors of `--priors` come from.
pub(crate) fn prior_source(name: Option<&Path>) -> PriorSource {
    match name {
        None => PriorSource::None,
        Some(name) if name.as_os_str() == "builtin" => PriorSource::Builtin,
        Some(path) => PriorSource::File(path.to_owned()),
    }
}

/// The settings in a few words, with the kind of body that was fitted.
pub(crate) fn settings_in_words(method: &Method, fitted: Option<BodyKind>) -> String {
    match method {
        Method::Posterior(map) => match map.body {
            Some(body) => format!("method posterior, body {body}"),
            None => format!("method posterior, body {} (auto)", fitted_body_name(fitted)),
        },
        Method::Reg(reg) => format!("reg, lambda {:e}", reg.lambda),
        method => method.name().to_owned(),
    }
}

/// Runs all steps on a scene, with progress bars; `title` precedes them and errors. Reports what depth images and points gave.
pub(crate) fn run_scene(title: &str, input: FileInput, options: &FileOptions, out: &Output) -> anyhow::Result<FileRun> {
    let found = run_file(input, options, &RunProgress::new(title, out));
    let input = found.as_ref().map_or_else(|failed| &failed.0, |run| &run.input);
    tell_measured(title, input, out);
    found.map_err(|failed| {
        let (input, error) = *failed;
        match error {
            FileRunError::Run(error) => run_error(*error, title, &input),
            other => anyhow!(other).context(title.to_owned()),
        }
    })
}

/// Why a run failed, with the options that help.
pub(crate) fn run_error(error: RunError<InputError>, title: &str, input: &FileInput) -> anyhow::Error {
    let error = match error {
        // It names the file.
        RunError::Input(InputError::Read(error)) => return error.into(),
        RunError::NothingFound { outcome: AssociationOutcome::NothingAgrees, skipped, check } => {
            nothing_agrees(&check, &input.context, &skipped_in_words(skipped)).into()
        }
        RunError::NothingFound { skipped, .. } => anyhow!("{error}{}", skipped_in_words(skipped)),
        RunError::NothingToLocalize { detections: 1.., .. } => {
            anyhow!("{error} (--associate always associates them)")
        }
        RunError::Associate(AssociateError::Source(SourceError::Several(_)))
        | RunError::Localize(LocalizeError::Source(SourceError::Several(_))) => anyhow!("{error} (--source SOURCE)"),
        other => other.into(),
    };
    error.context(title.to_owned())
}

/// Reports what depth images and points gave.
fn tell_measured(title: &str, input: &FileInput, out: &Output) {
    if let Some(found) = &input.depth_images {
        let with_depth = count(found.detections, "detection");
        out.detail(&format!("depth images: {with_depth} with a depth, {} without", found.without));
        if found.detections == 0 && found.without > 0 {
            out.warning(&format!(
                "{title}: no pixel of a detection has a depth in the depth images; expected counts above 0"
            ));
        }
    }
    if let Some(found) = &input.points {
        out.detail(&format!(
            "points: {} with a depth, {} in other views of their objects, {} without",
            count(found.detections, "detection"),
            found.repeated,
            found.without
        ));
        if found.detections == 0 && found.without > 0 && found.problems.is_empty() {
            out.warning(&format!(
                "{title}: no detection has three points or more; expected some in the boxes (check \"frame\" and \"transform\" of the \
                 point clouds)"
            ));
        }
    }
}
