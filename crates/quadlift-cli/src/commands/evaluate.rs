//! `quadlift evaluate`: estimates against the truth.

use std::path::PathBuf;

use anyhow::bail;
use quadlift_io::evaluation::identities::{self, DivisionOutcome};
use quadlift_io::evaluation::{EvaluateError, evaluate_objects, found_record, scores_record};
use quadlift_io::read_scene_file;
use serde_json::json;

use crate::error::Outcome;
use crate::evaluation::{Match, render, render_found, render_identities, why_no_identities};
use crate::next::Next;
use crate::output::Output;
use crate::report::{Gathered, check_report};

/// Score a result against the truth
///
/// Objects are paired by their ids, or by their overlap where no id is common. An object without an estimated body counts
/// as a failure and scores an IoU of 0. Where both files have detections and those of the truth name objects, it is
/// scored too how the detections were divided into objects.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Columns:
  IoU            volume of the intersection over that of the union, of the ellipsoids (O3D of the paper)
  enclosing IoU  the same with the enclosing ellipsoid, which is meant to hold the real object
  cuboid IoU     of the cuboids, where both files have them
  axis           angle between the longest axes (theta_err of the paper)
  centre, size   distance of the centres; mean relative error of the semi-axes
  outline, box   area IoU in the images: of the outlines, of the boxes around them

Below the table:
  found          true objects that an estimate overlaps with an IoU of 0.25 or more, each estimate for one object
  identities     over pairs of detections of true objects: were they put together, do they belong together

Examples:
  quadlift evaluate estimate.json truth.json
  quadlift evaluate associated.json truth.json
  quadlift evaluate estimate.json scene.json --json

Exit codes: 0 scored; 1 a file cannot be read or the files have no object in common; 2 wrong usage."
)]
pub struct Args {
    /// The result of localize or of associate
    #[arg(value_name = "ESTIMATE.json")]
    estimate: PathBuf,

    /// A scene file whose objects, or the ids of whose detections, are the truth
    #[arg(value_name = "TRUTH.json")]
    truth: PathBuf,

    /// How estimates and true objects are paired: ids, overlap, or auto (by ids where any is common)
    #[arg(long = "match", value_enum, value_name = "HOW", default_value_t = Match::Auto, hide_possible_values = true)]
    matching: Match,

    /// Score the identities of the detections of this source only; needed when those of the estimate have several
    #[arg(long, value_name = "NAME")]
    source: Option<String>,
    /// Write a report, an HTML page that shows estimates, truth and scores
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    check_report(args.report.as_ref(), &[&args.estimate, &args.truth])?;
    let estimate_file = read_scene_file(&args.estimate)?;
    let truth_file = read_scene_file(&args.truth)?;
    let (estimate, truth) = ((args.estimate.as_path(), &estimate_file), (args.truth.as_path(), &truth_file));
    let division = identities::score(estimate, truth, args.source.as_deref())?;
    let mut text = String::new();
    let mut document = json!({});
    let mut evaluation = None;
    // Detections alone can be compared as well.
    let has_objects = !(estimate.1.objects.is_empty() || truth.1.objects.is_empty());
    if let Some(why) = why_no_identities(&division)
        && !has_objects
    {
        bail!("{why}");
    }
    if has_objects || division == DivisionOutcome::Absent {
        let (scores, found) = match evaluate_objects(estimate, truth, args.matching.into()) {
            Err(EvaluateError::NoCommonId(why)) => bail!("{why} (--match overlap pairs them by their bodies)"),
            result => result?,
        };
        text = render(&scores, truth.1.length_unit.as_deref()) + &render_found(&found);
        document = scores_record(&scores);
        document["found"] = found_record(&found);
        evaluation = Some(scores);
    }
    document["identities"] = division.to_record();
    out.report(&(text + &render_identities(&division)))?;
    out.document(&document)?;
    if let Some(report) = &args.report {
        let files = vec![(args.truth.clone(), truth_file), (args.estimate.clone(), estimate_file)];
        Gathered::new(files)?.write_report(report, evaluation.as_ref())?;
        out.report(&format!("wrote {}\n", report.display()))?;
    } else {
        let words = ["view".into(), args.estimate.as_path().into(), args.truth.as_path().into()];
        Next::default().command(words, "look at both in the browser").tell(out)?;
    }
    Ok(Outcome::Fine)
}
