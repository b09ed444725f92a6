//! `quadlift demo`: the whole way on two scenes whose truth is known, without any file.

mod boxes;
mod images;
mod part;

use std::path::{Path, PathBuf};

use anyhow::bail;
use serde_json::json;

use crate::error::Outcome;
use crate::files::make_folder;
use crate::output::{HEADING, Output};
use crate::report::{Gathered, check_report};

/// Show the whole way on two built-in scenes: which boxes show the same object, masks, objects, how good they are
///
/// The first scene has rendered images and boxes, the second one boxes only, a few of them quite wrong. No box says
/// which object it shows.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Files in DIR, for the other commands to work on:
  scene.json, images/   what a user brings: frames with images and cameras, and boxes
  segmented.json        the same with objects, masks and ellipses (associate, segment)
  masks/, sheets/       the masks as label images; pictures of them to look at
  estimate.json         the objects that were found (localize)
  truth.json            the true objects, named as they were found
  boxes/                scene.json, estimate.json and truth.json of the second scene

Next:
  quadlift info quadlift-demo/scene.json
  quadlift localize quadlift-demo/segmented.json -o again.json --method lfd
  quadlift evaluate again.json quadlift-demo/truth.json
  quadlift view quadlift-demo/segmented.json again.json quadlift-demo/truth.json"
)]
pub struct Args {
    /// Folder for the files; it is made if it does not exist
    #[arg(long, value_name = "DIR", default_value = "quadlift-demo")]
    out: PathBuf,

    /// Write over files of an earlier demo in DIR
    #[arg(long)]
    overwrite: bool,

    /// Page that shows the first scene and what was found in it, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let folder = &args.out;
    if folder.exists() && !folder.is_dir() {
        bail!("cannot write to {}: it is a file; expected a folder", folder.display());
    }
    check_report(args.report.as_ref(), &[])?;
    let files =
        ["scene.json", "segmented.json", "estimate.json", "truth.json", "boxes/scene.json", "boxes/estimate.json"];
    if let Some(file) = files.iter().map(|name| folder.join(name)).find(|path| !args.overwrite && path.exists()) {
        bail!("{} exists already; --overwrite writes over the files of an earlier demo", file.display());
    }
    make_folder(folder)?;
    let with_images = images::run(folder, out)?;
    let with_boxes = boxes::run(&folder.join("boxes"), out)?;
    out.report(&next_steps(folder))?;
    if let Some(report) = &args.report {
        let files = ["segmented.json", "estimate.json", "truth.json"].map(|name| folder.join(name));
        Gathered::read(&files)?.write_report_with_scores(report)?;
        out.report(&format!("Wrote {}\n", report.display()))?;
    }
    out.document(&json!({ "images": with_images, "boxes": with_boxes }))?;
    Ok(Outcome::Fine)
}

fn next_steps(folder: &Path) -> String {
    let file = |name: &str| folder.join(name).display().to_string();
    let sheet = file("sheets/object_0000.png");
    format!(
        "{HEADING}Look at{HEADING:#}\n  {:width$}  an image\n  {sheet}  what was found: masks yellow, their ellipses pink\n\
         {HEADING}Try next{HEADING:#}\n  quadlift info {scene}\n  quadlift localize {boxes} -o again.json --method planes\n  \
         quadlift evaluate again.json {truth}\n  quadlift view {segmented} {estimate} {found}\n",
        file("images/000000.png"),
        width = sheet.chars().count(),
        scene = file("scene.json"),
        boxes = file("boxes/scene.json"),
        truth = file("boxes/truth.json"),
        segmented = file("segmented.json"),
        estimate = file("estimate.json"),
        found = file("truth.json"),
    )
}
