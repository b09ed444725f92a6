//! `quadlift demo`: the whole way on a synthetic scene, without any file.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use quadlift::Localization;
use quadlift::solve::Estimate;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift_io::{SceneFile, write_scene_file};
use serde_json::json;

use crate::error::Outcome;
use crate::estimate_table::{render, summaries};
use crate::evaluation;
use crate::files::make_folder;
use crate::localization::{Settings, count_localised, localize_scene, result_file};
use crate::output::{HEADING, Output};
use crate::report::{Gathered, check_report};
use crate::synthetic_file::scene_file;
use crate::words::count;

/// Show the whole way on a built-in scene: make it, localise its objects, compare them with the truth
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Writes scene.json (what a user brings), estimate.json (what localize makes of it) and truth.json (what it should be),
so that the other commands have something to work on:
  quadlift info quadlift-demo/scene.json
  quadlift localize quadlift-demo/scene.json -o again.json --method planes
  quadlift evaluate again.json quadlift-demo/truth.json
  quadlift view quadlift-demo/*.json"
)]
pub struct Args {
    /// Folder for the files; it is made if it does not exist
    #[arg(long, value_name = "DIR", default_value = "quadlift-demo")]
    out: PathBuf,

    /// Page that shows the result, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
}

/// Objects of 15 to 60 cm within a metre, seen from ten metres on an arc of 60 degrees.
fn options() -> SyntheticOptions {
    SyntheticOptions {
        seed: 1,
        objects: 8,
        views: 20,
        trajectory: Trajectory::Arc { span: 60.0 },
        scale: 0.05,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        outlier_share: 0.05,
        ..Default::default()
    }
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let folder = &args.out;
    if folder.exists() && !folder.is_dir() {
        bail!("cannot write to {}: it is a file; expected a folder", folder.display());
    }
    check_report(args.report.as_ref(), &[])?;
    make_folder(folder)?;
    let synthetic = generate(&options()).context("cannot make the scene")?;
    let whole =
        SceneFile { name: Some("demo".to_owned()), length_unit: Some("m".to_owned()), ..scene_file(&synthetic) };
    let truth = SceneFile { detections: Vec::new(), ..whole.clone() };
    let file = SceneFile { objects: Vec::new(), ..whole };
    let scene = file.to_scene().context("cannot use the scene")?;
    let outliers = synthetic.outliers.iter().filter(|wrong| **wrong).count();
    out.report(&format!(
        "A synthetic scene: {} within a metre, {} from a camera ten metres away.\nOf the {} boxes, {outliers} are \
         quite wrong; the others have noise of 5 % of their half size.\n\n",
        count(synthetic.truth.len(), "object"),
        count(scene.frames.len(), "view"),
        scene.detections.len(),
    ))?;
    let settings = Settings::default();
    let localization = localize_scene("demo", &scene, &settings, out)?;
    let result = result_file(&file, &scene, &localization, &settings);
    let paths = ["scene.json", "estimate.json", "truth.json"].map(|name| folder.join(name));
    for (path, file) in paths.iter().zip([&file, &result, &truth]) {
        write_scene_file(path, file)?;
    }
    let [_, estimate_path, truth_path] = &paths;
    let evaluation = evaluation::evaluate_files((estimate_path, &result), (truth_path, &truth))?;
    out.report(&format!(
        "{HEADING}Localised{HEADING:#} {} of {} ({}); {} of the {outliers} wrong boxes were found and left out.\n\n{}\n\
         {HEADING}Compared with the truth{HEADING:#}\n\n{}\n",
        count_localised(&localization.estimates),
        count(localization.estimates.len(), "object"),
        settings.in_words(localization.body),
        found_outliers(&synthetic, &localization),
        render(&scene, &localization, &settings),
        evaluation::render(&evaluation, scene.length_unit.as_deref()),
    ))?;
    out.report(&next_steps(&paths))?;
    if let Some(report) = &args.report {
        let files = paths.iter().cloned().zip([file, result, truth]).collect();
        Gathered::new(files)?.write_report(report, Some(&evaluation))?;
        out.report(&format!("Wrote {}.\n", report.display()))?;
    }
    out.document(&json!({
        "files": { "scene": paths[0], "estimate": paths[1], "truth": paths[2] },
        "objects": summaries(&scene, &localization),
        "evaluation": evaluation::to_json(&evaluation),
    }))?;
    Ok(Outcome::Fine)
}

/// Number of wrong boxes that the estimator has rejected.
fn found_outliers(synthetic: &SyntheticScene, localization: &Localization) -> usize {
    let wrong = |object: usize, frame: usize| {
        synthetic.scene.detections.iter().zip(&synthetic.outliers).any(|(detection, outlier)| {
            *outlier && detection.object_index == u32::try_from(object).ok() && detection.frame_index as usize == frame
        })
    };
    let estimates = &localization.estimates;
    let rejected = |e: &Estimate| e.views.iter().filter(|v| !v.inlier && wrong(e.object_index, v.frame_index)).count();
    estimates.iter().map(rejected).sum()
}

fn next_steps(paths: &[PathBuf; 3]) -> String {
    let name = |path: &Path| path.display().to_string();
    let [scene, estimate, truth] = [&paths[0], &paths[1], &paths[2]].map(|path| name(path));
    format!(
        "Wrote {scene}, {estimate} and {truth}. Try next:\n  quadlift info {scene}\n  quadlift localize {scene} -o \
         again.json --method planes\n  quadlift evaluate again.json {truth}\n  quadlift view {scene} {estimate} {truth}\n"
    )
}
