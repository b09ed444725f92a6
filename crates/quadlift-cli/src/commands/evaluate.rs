//! `quadlift evaluate`: estimates against the truth.

use std::path::PathBuf;

use quadlift_io::read_scene_file;

use crate::error::Outcome;
use crate::evaluation::{evaluate_files, render, to_json};
use crate::output::Output;
use crate::report::{Gathered, check_report};

/// Score a result against the truth
///
/// Objects are paired by their ids. An object without an estimated body counts as a failure and scores an IoU of 0.
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

Examples:
  quadlift evaluate estimate.json truth.json
  quadlift evaluate estimate.json scene.json --json

Exit codes: 0 scored; 1 a file cannot be read or the files have no object in common; 2 wrong usage."
)]
pub struct Args {
    /// The result of localize
    #[arg(value_name = "ESTIMATE.json")]
    estimate: PathBuf,

    /// A scene file whose objects are the truth
    #[arg(value_name = "TRUTH.json")]
    truth: PathBuf,

    /// Page that shows estimates, truth and scores, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    check_report(args.report.as_ref(), &[&args.estimate, &args.truth])?;
    let estimate = read_scene_file(&args.estimate)?;
    let truth = read_scene_file(&args.truth)?;
    let evaluation = evaluate_files((&args.estimate, &estimate), (&args.truth, &truth))?;
    out.report(&render(&evaluation, truth.length_unit.as_deref()))?;
    out.document(&to_json(&evaluation))?;
    if let Some(report) = &args.report {
        let files = vec![(args.truth.clone(), truth), (args.estimate.clone(), estimate)];
        Gathered::new(files)?.write_report(report, Some(&evaluation))?;
        out.report(&format!("wrote {}\n", report.display()))?;
    }
    Ok(Outcome::Fine)
}
