//! `quadlift demo`: photographs of a desk and the boxes in them, which the program contains. Localizes the objects and runs the
//! consistency check on wrong poses.

mod desk;
mod findings;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args as _, FromArgMatches};
use quadlift::run::{Check, diagnose_unnamed};
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_io::run::FileInput;
use quadlift_io::{SceneFile, read_scene_file};
use serde_json::json;

use super::localize;
use crate::error::Outcome;
use crate::files::make_folder;
use crate::next::Next;
use crate::output::{HEADING, Output};
use crate::report::check_report;
use desk::{Desk, GROUND_TRUTH, SCENE, WRONG};
use findings::Findings;

/// Names of the found objects.
const ESTIMATE: &str = "estimate.json";
const PAGE: &str = "report.html";
const MENDED: &str = "mended.json";

/// Localize the objects on a rendered desk
///
/// Needs no files. The images are rendered, so the true objects are known. The boxes come from a simulated detector: they have
/// categories but no object ids, and some are wrong or false positives. A second part runs the consistency check on the same
/// boxes with wrong camera poses.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Files written to DIR:
  scene.json, images/  the input: images, cameras and poses, and boxes
  estimate.json        the estimated objects (localize)
  report.html          the report (localize --report)
  truth.json           the true objects
  sparse/0, labels,    the same cameras and boxes as a COLMAP model and as YOLO files
  data.yaml
  wrong-poses.json     the same scene with poses in OpenGL axes
  mended.json          the objects estimated from it after correction (localize --fix)

Next:
  quadlift info quadlift-demo/scene.json
  quadlift localize quadlift-demo/scene.json -o again.json
  quadlift evaluate quadlift-demo/estimate.json quadlift-demo/truth.json
  quadlift view quadlift-demo/scene.json quadlift-demo/estimate.json"
)]
pub(crate) struct Args {
    /// Output folder; it is created if it does not exist, and the files of an earlier demo in it are overwritten
    #[arg(long, value_name = "DIR", default_value = "quadlift-demo")]
    out: PathBuf,

    /// Path of the report [default: DIR/report.html]
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,

    /// Open the report in the browser
    #[arg(long)]
    open: bool,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let folder = &args.out;
    if folder.exists() && !folder.is_dir() {
        bail!("cannot write to {}: it is a file; expected a folder", folder.display());
    }
    check_report(args.report.as_ref(), &[])?;
    let mut files = desk::names().chain([ESTIMATE, PAGE, MENDED]).map(|name| folder.join(name));
    // The files of an earlier demo are the demo's own.
    if !desk::is_of_demo(folder)
        && let Some(file) = files.find(|path| path.exists())
    {
        bail!("{} exists already and is not of an earlier demo; choose another folder with --out", file.display());
    }
    make_folder(folder)?;
    let page = args.report.clone().unwrap_or_else(|| folder.join(PAGE));
    let desk = Desk::write(folder)?;
    let path = |name: &str| folder.join(name);

    localize(&path(SCENE), &path(ESTIMATE), Some(&page), false)?;
    let result = read_scene_file(&path(ESTIMATE))?;
    let found = Findings::new(&desk, &result)?;
    out.report(&first_part(&desk.scene, &found, &path(SCENE), &page))?;

    let wrong = FileInput::read(&path(WRONG), &[])?;
    let check = Check::of_diagnosis(diagnose_unnamed(wrong.scene(), None), &wrong, None);
    let said = DiagnosisRecord::of(&check, &wrong.context).in_words();
    let said = said.unwrap_or_else(|| "the scene is consistent".to_owned());
    localize(&path(WRONG), &path(MENDED), None, true)?;
    let mended = read_scene_file(&path(MENDED))?;
    let again = Findings::new(&desk, &mended)?;
    out.report(&second_part(&said, &again))?;

    next_steps(folder).tell(out)?;
    let self_check = json!({ "said": said, "mended": again.to_json() });
    out.document(&json!({ "desk": found.to_json(), "wrong_poses": self_check, "report": page.display().to_string() }))?;
    if args.open {
        let failed = || format!("cannot open a browser; the page is {}", page.display());
        open::that(&page).with_context(failed)?;
    }
    Ok(Outcome::Fine)
}

/// Runs `quadlift localize` on a scene, silently.
fn localize(scene: &Path, output: &Path, report: Option<&Path>, fix: bool) -> anyhow::Result<()> {
    let command = localize::Args::augment_args(clap::Command::new("localize").no_binary_name(true));
    let mut words = vec![scene.as_os_str(), "--output".as_ref(), output.as_os_str()];
    words.extend(report.into_iter().flat_map(|report| ["--report".as_ref(), report.as_os_str()]));
    words.extend(fix.then_some(std::ffi::OsStr::new("--fix")));
    let args = localize::Args::from_arg_matches(&command.try_get_matches_from(words)?)?;
    let silent = Output { json: false, quiet: true, verbose: false, reports_to_stderr: false };
    match localize::run(&args, &silent)? {
        Outcome::Fine => Ok(()),
        _ => bail!("the demo's scene could not be localized: {}", scene.display()),
    }
}

fn first_part(file: &SceneFile, found: &Findings, scene: &Path, page: &Path) -> String {
    let ([things, all], boxes) = (found.found(), found.boxes());
    let (frames, images) = (file.frames.len(), scene.with_file_name("images"));
    let missing = found.missing();
    let missing = if missing.is_empty() { String::new() } else { format!(" (missing: {})", missing.join(", ")) };
    format!(
        "{HEADING}1. A desk{HEADING:#}\n\
         {frames} images of {all} objects ({}) and {} boxes from a simulated detector. Boxes have\n\
         categories but no object ids; {} of them are false positives or far off.\n\n\
         Localized {things} of {all} objects{missing}.\n\
         Rejected {} of the {} wrong boxes and {} of the {} others.\n\n{}\n\
         Report: {}\n\n",
        images.display(),
        boxes.all,
        boxes.wrong,
        boxes.wrong_refused,
        boxes.wrong,
        boxes.right_refused,
        boxes.all - boxes.wrong,
        found.table(),
        page.display(),
    )
}

fn second_part(said: &str, mended: &Findings) -> String {
    let [things, all] = mended.found();
    format!(
        "{HEADING}2. The same boxes with wrong camera poses{HEADING:#}\n\
         {WRONG} has poses in OpenGL axes, in which cameras look along -z. The consistency check reports:\n\n{}\n\n\
         With --fix, {things} of {all} objects are localized.\n",
        crate::help::fill_indented(said, 2),
    )
}

fn next_steps(folder: &Path) -> Next {
    let [scene, estimate, truth, wrong] = [SCENE, ESTIMATE, GROUND_TRUTH, WRONG].map(|name| folder.join(name));
    let [scene, estimate, truth, wrong] = [&scene, &estimate, &truth, &wrong].map(PathBuf::as_path);
    Next::default()
        .command(["view".into(), scene.into(), estimate.into()], "open the report")
        .command(["info".into(), scene.into()], "summarize the scene")
        .command(["localize".into(), scene.into(), "-o again.json".into()], "localize the objects again")
        .command(["evaluate".into(), estimate.into(), truth.into()], "compare with the truth")
        .command(["localize".into(), wrong.into(), "--fix".into()], "correct the wrong poses")
}
