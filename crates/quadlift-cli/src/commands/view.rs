//! `quadlift view`: opens a scene or a result in the browser.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde_json::json;

use crate::error::Outcome;
use crate::output::Output;
use crate::report::Gathered;

/// Show scenes and results in the browser
///
/// Writes the same page as --report to the temporary folder and opens it.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Several files of one scene are shown together, in any order: detections, estimates and ground truth may be in one file
or in several. Objects with a status are estimates, objects without one are ground truth.

Examples:
  quadlift view scene.json
  quadlift view estimate.json truth.json
  quadlift view scene.json estimate.json truth.json --no-browser

Exit codes: 0 success; 1 a file cannot be read or the browser cannot be opened; 2 wrong usage."
)]
pub(crate) struct Args {
    /// A scene, and files with its estimates and its ground truth
    #[arg(required = true, value_name = "SCENE.json")]
    files: Vec<PathBuf>,

    /// Print the path of the page without opening it
    #[arg(long)]
    no_browser: bool,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let gathered = Gathered::read(&args.files)?;
    let page = temporary_page(&args.files[0])?;
    gathered.write_report_with_scores(&page, out)?;
    if !args.no_browser {
        let failed = || format!("cannot open a browser; the page is {} (--no-browser opens none)", page.display());
        open::that(&page).with_context(failed)?;
    }
    out.report(&format!("{}\n", page.display()))?;
    out.document(&json!({ "report": page }))?;
    Ok(Outcome::Fine)
}

/// A new file for a page, with the name of the scene in it; it is left to the system to remove it.
fn temporary_page(scene: &Path) -> anyhow::Result<PathBuf> {
    let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut builder = tempfile::Builder::new();
    let prefix = format!("quadlift-{name}-");
    let file = builder.prefix(&prefix).suffix(".html").tempfile().context("cannot make a temporary file")?;
    let (_, path) = file.keep().context("cannot keep the temporary file")?;
    Ok(path)
}
