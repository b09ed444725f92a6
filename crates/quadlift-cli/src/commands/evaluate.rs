//! `quadlift evaluate`: estimates against the truth.

use std::path::PathBuf;

use anyhow::bail;
use quadlift_io::evaluation::identities::{self, DivisionOutcome};
use quadlift_io::evaluation::{EvaluateError, evaluate_objects, found_record, scores_record};
use quadlift_io::read_scene_file;
use quadlift_report::Labels;
use serde_json::json;

use crate::error::Outcome;
use crate::evaluation::{Match, render, render_found, render_identities, why_no_identities};
use crate::next::Next;
use crate::output::Output;
use crate::report::{Gathered, check_report};

/// Score a result against ground truth
///
/// Objects are paired by id, or by overlap if no ids are shared. An object without an estimated body counts as a
/// failure with an IoU of 0. If both files have detections and those of the truth have object ids, the association is
/// scored too.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Columns:
  IoU            intersection over union of the ellipsoids, by volume (O3D of the paper)
  enclosing IoU  the same for the enclosing ellipsoid, which should contain the real object
  cuboid IoU     the same for cuboids; empty for estimates of another kind
  axis           angle between the longest axes; axes of about one length may be exchanged,
                 and balls have none
  center, size   distance of the centers; mean relative error of the semi-axes
  outline, box   area IoU in the images, of the outlines and of their bounding boxes

Below the table:
  found          true objects that an estimate with the status ok overlaps with an IoU of at least 0.25
  identities     pairwise scores of the association, over pairs of detections of true objects

Examples:
  quadlift evaluate estimate.json truth.json
  quadlift evaluate associated.json truth.json
  quadlift evaluate estimate.json scene.json --json

Exit codes: 0 scored; 1 a file cannot be read or the files have no object in common; 2 wrong usage."
)]
pub(crate) struct Args {
    /// The result of localize or associate
    #[arg(value_name = "ESTIMATE.json")]
    estimate: PathBuf,

    /// A scene file with the true objects, or with true object ids of its detections
    #[arg(value_name = "GROUND_TRUTH.json")]
    ground_truth: PathBuf,

    /// How to pair estimates with true objects: ids, overlap, or auto (by ids if any are shared)
    #[arg(long = "match", value_enum, value_name = "HOW", default_value_t = Match::Auto, hide_possible_values = true)]
    matching: Match,

    /// Score the association of this source only; required if the estimate has several sources
    #[arg(long, value_name = "NAME")]
    source: Option<String>,
    /// Write an HTML report with estimates, truth and scores
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    check_report(args.report.as_ref(), &[&args.estimate, &args.ground_truth])?;
    let estimate_file = read_scene_file(&args.estimate)?;
    let truth_file = read_scene_file(&args.ground_truth)?;
    let (estimate, truth) = ((args.estimate.as_path(), &estimate_file), (args.ground_truth.as_path(), &truth_file));
    if truth.1.has_estimates() && !estimate.1.objects.is_empty() && !estimate.1.has_estimates() {
        let [first, second] = [estimate.0, truth.0].map(std::path::Path::display);
        out.warning(&format!("{first} has no estimates and {second} has: the order is ESTIMATE GROUND_TRUTH"));
    }
    let division = identities::score(estimate, truth, args.source.as_deref())?;
    let mut text = String::new();
    let mut document = json!({});
    let mut evaluation = None;
    // `associate` keeps the true objects of its scene, which are no estimates.
    let is_truth = estimate.1.localization.is_none() && estimate.1.objects == truth.1.objects;
    let has_identities = matches!(division, DivisionOutcome::Scored(_));
    // Detections alone can be compared as well.
    let has_objects = !(estimate.1.objects.is_empty() || truth.1.objects.is_empty() || (is_truth && has_identities));
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
        let labels = [estimate, truth].map(|(_, file)| Labels::of_file(file));
        let [of_estimates, of_truth] = &labels;
        text = render(&scores, [of_estimates, of_truth], truth.1.length_unit.as_deref()) + &render_found(&found);
        document = scores_record(&scores);
        document["found"] = found_record(&found);
        evaluation = Some(scores);
    }
    document["identities"] = division.to_record();
    out.report(&(text + &render_identities(&division)))?;
    out.document(&document)?;
    if let Some(report) = &args.report {
        let files = vec![(args.ground_truth.clone(), truth_file), (args.estimate.clone(), estimate_file)];
        Gathered::new(files)?.write_report(report, evaluation.as_ref(), out)?;
        out.report(&format!("wrote {}\n", report.display()))?;
    } else {
        let words = ["view".into(), args.estimate.as_path().into(), args.ground_truth.as_path().into()];
        Next::default().command(words, "view both in the browser").tell(out)?;
    }
    Ok(Outcome::Fine)
}
