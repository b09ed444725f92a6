//! `quadlift localize`: from detections to objects.

mod coverage;
mod direct;
mod args;
mod one_scene;

use std::path::{Path, PathBuf};

use quadlift_io::correct::{DetectionPixels, RecordCorrection};
use quadlift_io::mcap::{self, is_mcap};
use quadlift_io::run::FileInput;
use quadlift_io::scene_file::Detail;
use quadlift_io::{ReadError, SceneFile};
use serde_json::json;

use crate::commands::import::words::tell_problems;
use crate::corrections::read_input;
use crate::error::{InconsistentError, Outcome, in_words};
use crate::files::{check_file, check_result_name, expand, outputs};
use crate::next::{Next, Word};
use crate::output::{Output, one_line};
use crate::report::{check_report, report_paths};
use crate::threads;
use crate::words::count;

pub(crate) use args::{Args, with_requirements};
use coverage::read_coverage;
use one_scene::{SceneDocument, one_scene};

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    args.output.as_deref().map_or(Ok(()), |output| check_result_name(output, true))?;
    let mut options = args.options()?;
    options.coverage = read_coverage(&args.coverage)?;
    let corrections = args.corrections.list()?;
    let chosen = (&options, Detail::from(args.compact));
    if let Some((cameras, detections)) = args.direct.paths() {
        let [output, report] = [&args.output, &args.report].map(Option::as_deref);
        output.map_or(Ok(()), check_file)?;
        let others: Vec<&Path> = [cameras, detections].into_iter().chain(output).collect();
        check_report(args.report.as_ref(), &others)?;
        // The base folder of image paths.
        let place = output.or(report);
        // The size of the images and the numbers of the frames are dealt with where detections are added.
        let (pixels, corrections) = DetectionPixels::split(corrections);
        let source = options.run.localize.source.as_deref();
        let input = || {
            let (file, frame_offset) = args.direct.read([cameras, detections], place, (source, pixels), out)?;
            let mut input = FileInput::from_file(file, place.unwrap_or(Path::new("")), &corrections)
                .map_err(|error| ReadError { path: detections.to_owned(), ..error })?;
            let measured_at = pixels.image_size.map(RecordCorrection::ImageSize);
            input.context.frame_offset = frame_offset;
            input.context = input.context.after(measured_at.as_slice());
            Ok(input)
        };
        let mut document = SceneDocument {
            cameras: Some(cameras.display().to_string()),
            detections: Some(detections.display().to_string()),
            ..SceneDocument::default()
        };
        let outcome = one_scene(detections, input, [output, report], chosen, out, &mut document)?;
        if outcome == Outcome::Fine {
            next_steps(None, [output, report]).tell(out)?;
        }
        out.document(&json!({ "scenes": [document] }))?;
        return Ok(outcome);
    }
    let inputs = expand(&args.scenes)?;
    check_read_options(args, &inputs.paths)?;
    let outputs = args.output.as_ref().map(|output| outputs(&inputs, output)).transpose()?;
    let reports =
        args.report.as_ref().map(|report| report_paths(&inputs, report, args.output.as_deref())).transpose()?;
    let mut documents = Vec::with_capacity(inputs.paths.len());
    let mut outcome = Outcome::Fine;
    // One scene after another: the largest one bounds the memory.
    for (index, input) in inputs.paths.iter().enumerate() {
        let [output, report] = [&outputs, &reports].map(|paths| paths.as_ref().map(|paths| paths[index].as_path()));
        let mut document = SceneDocument { scene: Some(input.display().to_string()), ..SceneDocument::default() };
        if index > 0 {
            out.report("\n")?;
        }
        let read = || {
            let mut found = match is_mcap(input) {
                true => FileInput::from_file(read_log(args, input, out)?, input, &corrections)?,
                false => read_input(input, &corrections)?,
            };
            args.direct.min_score().map_or(Ok(()), |min_score| found.drop_below_score(min_score))?;
            Ok(found)
        };
        match one_scene(input, read, [output, report], chosen, out, &mut document) {
            Ok(ended) => outcome = outcome.and(ended),
            Err(error) => {
                out.error(&in_words(&error));
                document.error = Some(in_words(&error));
                outcome = outcome.and(match error.downcast::<InconsistentError>() {
                    Ok(InconsistentError { diagnosis, .. }) => {
                        document.diagnosis = Some(diagnosis);
                        Outcome::Inconsistent
                    }
                    Err(_) => Outcome::SomethingFailed,
                });
            }
        }
        documents.push(document);
    }
    if let ([scene], Outcome::Fine) = (&inputs.paths[..], outcome) {
        let [output, report] = [&outputs, &reports].map(|paths| paths.as_ref().map(|paths| paths[0].as_path()));
        let scene = Some(scene.as_path()).filter(|scene| !is_mcap(scene));
        next_steps(scene, [output, report]).tell(out)?;
    }
    out.document(&json!({ "scenes": documents }))?;
    Ok(outcome)
}

/// Refuses options of readers that have no effect on scene files, and on logs if there are any.
fn check_read_options(args: &Args, paths: &[PathBuf]) -> anyhow::Result<()> {
    let of_logs = Some(mcap::FORMAT.options).filter(|_| paths.iter().any(|path| is_mcap(path)));
    args.direct.given().check(&[of_logs.unwrap_or_default()], "--cameras is not given")
}

/// The scene in a log; what was read is reported.
fn read_log(args: &Args, path: &Path, out: &Output) -> anyhow::Result<SceneFile> {
    let import = (mcap::FORMAT.read)(path, &args.direct.given().options())?;
    let (frames, detections) = (import.scene.frames.len(), import.scene.detections.len());
    let (frames, detections) = (count(frames, "frame"), count(detections, "detection"));
    let mut text = format!("{}: mcap, {frames}, {detections}\n", path.display());
    import.notes.iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
    out.report(&format!("{text}\n"))?;
    tell_problems(&import, out);
    Ok(import.scene)
}

/// Suggested next commands for the result.
fn next_steps(scene: Option<&Path>, [output, report]: [Option<&Path>; 2]) -> Next {
    let mut next = Next::default();
    match (output, report) {
        (None, None) => next.again("-o objects.json --report objects.html", "save the result and a report"),
        (Some(output), report) => {
            if report.is_none() {
                let files = scene.into_iter().chain([output]).map(Word::from);
                next = next.command([Word::from("view")].into_iter().chain(files), "view it in the browser");
            }
            next.command(["export ply".into(), output.into(), "-o objects.ply".into()], "export for other programs")
        }
        (None, Some(_)) => next,
    }
}
