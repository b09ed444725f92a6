//! `quadlift associate`: which detections show the same object.

use std::path::PathBuf;
use std::time::Instant;

use clap::builder::RangedU64ValueParser;
use quadlift::association::AssociateOptions;
use quadlift::run::identify;
use quadlift_io::association::{AssociationRecord, write_objects};
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_io::guard::check_not_read;
use quadlift_io::priors::check_meters;
use quadlift_io::{builtin_priors, read_priors, write_scene_file};
use serde_json::json;

use crate::association::{in_words, labels};
use crate::corrections::{Corrections, corrected_in_words, read_input};
use crate::diagnosis::tell;
use crate::error::Outcome;
use crate::files::{Inputs, check_result_name, move_paths, outputs};
use crate::localization::run_error;
use crate::next::Next;
use crate::options::{Associate, Chosen, OfAssociation};
use crate::output::{HEADING, Output, WARNING, one_line};
use crate::progress::RunProgress;
use crate::table::{Cell, MAX_ROWS, Table, rest};
use crate::threads;
use crate::words::duration;

/// Associate detections of the same object
///
/// For detectors that give boxes without object ids. The result is the same scene with an `object` id in each assigned
/// detection; unassigned detections have none. Objects that seem to move, or to be several objects, are marked as
/// uncertain.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Columns:
  views     frames with a detection of the object / frames in which it should be visible
  evidence  log Bayes factor of the object against false positives (natural logarithm)

Examples:
  quadlift associate scene.json -o associated.json
  quadlift associate street.json -o associated.json --source rrc --min-score 0.5
  quadlift localize associated.json -o objects.json

Exit codes: 0 success; 1 a file cannot be read or written, or there are too few detections to associate; 2 wrong usage;
3 the scene is inconsistent, or no object was found because no detections agree."
)]
pub(crate) struct Args {
    /// The scene file
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

    /// Output: the scene with object ids
    #[arg(short, long, value_name = "OUT.json")]
    output: PathBuf,

    #[command(flatten)]
    of_association: Chosen<OfAssociation>,

    /// Sizes of categories: "builtin" (for scenes in meters) or a TOML file
    #[arg(long, value_name = "builtin|FILE.toml")]
    priors: Option<PathBuf>,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,

    #[command(flatten)]
    corrections: Corrections,

    #[command(flatten)]
    chosen: Chosen<Associate>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    let of_run = args.chosen.options()?;
    let inputs = Inputs { paths: vec![args.scene.clone()], several: false };
    check_result_name(&args.output, false)?;
    outputs(&inputs, &args.output)?;
    let options = AssociateOptions {
        priors: match &args.priors {
            None => Default::default(),
            Some(name) if name.as_os_str() == "builtin" => builtin_priors(),
            Some(path) => read_priors(path)?,
        },
        ..args.of_association.options()?
    };
    let mut input = read_input(&args.scene, &args.corrections.list()?)?;
    check_not_read(&args.output)?;
    if args.priors.as_ref().is_some_and(|name| name.as_os_str() == "builtin") {
        check_meters(input.scene().length_unit.as_deref()).map_err(anyhow::Error::msg)?;
    }
    let title = args.scene.display().to_string();
    let start = Instant::now();
    let found = identify(&mut input, &options, of_run.fix, &RunProgress::new(&title, out));
    let (check, association) = found.map_err(|error| run_error(error, &title, &input))?;
    out.detail(&format!("associated in {}", duration(start.elapsed())));
    let scene = input.scene();
    let associated = association.applied_to(scene, scene.source_index(options.source.as_deref())?);
    let mut file = (*input.file).clone();
    move_paths(&mut file, &args.scene, &args.output)?;
    write_objects(&mut file.detections, &associated);
    // The true objects, if the scene has any, have other ids.
    file.objects = Vec::new();
    write_scene_file(&args.output, &file)?;
    let mut table = Table::new(["<object", "<category", "views", "evidence", "<uncertain"]);
    let labels = labels(scene, &association);
    for object in association.objects.iter().take(MAX_ROWS) {
        let category = object.category_index.map_or("", |index| scene.categories[index as usize].as_str());
        table.push(vec![
            Cell::from(labels.of(&object.id)),
            Cell::from(labels.category(&object.id, Some(category))),
            Cell::from(format!("{} of {}", object.views, object.expected_views)),
            Cell::from(object.evidence.map_or_else(String::new, |evidence| format!("{evidence:.0}"))),
            Cell::styled(object.uncertain.map_or("", |doubt| doubt.text()), WARNING),
        ]);
    }
    out.report(&format!(
        "{HEADING}{}{HEADING:#}: {}\n{}\n{}{}wrote {}\n",
        one_line(&title),
        in_words(&association),
        corrected_in_words(&input.notes),
        table.render(),
        rest(association.objects.len(), "object", "--json lists all"),
        args.output.display()
    ))?;
    Next::default().localize(&args.output, options.source.as_deref(), "", "localize the objects").tell(out)?;
    let mut document = json!(AssociationRecord::of(scene, &association));
    if !input.notes.is_empty() {
        document["corrections"] = json!(input.notes);
    }
    document["output"] = args.output.display().to_string().into();
    document["diagnosis"] = json!(DiagnosisRecord::of(&check, &input.context));
    out.document(&document)?;
    Ok(tell(&check, &input.context, of_run.localize.allow_inconsistent, &title, out))
}
