//! `quadlift render`: a picture of one frame, for papers and pages.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use quadlift_io::guard::check_not_read;
use quadlift_io::{write_file, write_png};
use quadlift_report::{Content, Picture, frame_image, report_of_frames};
use serde_json::json;

use crate::error::{Outcome, usage};
use crate::files::check_file;
use crate::output::Output;
use crate::report::Gathered;
use crate::words::some_of;

/// Draw one frame as PNG or SVG
///
/// Draws its detections and the outlines of the bodies.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Boxes and ellipses are detections (red and dashed if the estimator rejected them), filled outlines are the estimated
bodies, dotted outlines the ground truth. Without an image the background is blank. Images with lens distortion are
undistorted. Several files of one scene are drawn together, as in `quadlift view`.

Examples:
  quadlift render scene.json estimate.json --frame 000003 -o frame.png
  quadlift render scene.json --frame 000003 -o frame.svg --labels --source yolo

Exit codes: 0 success; 1 a file or an image cannot be read; 2 wrong usage."
)]
pub(crate) struct Args {
    /// A scene, and files with its estimates and its ground truth
    #[arg(required = true, value_name = "SCENE.json")]
    files: Vec<PathBuf>,

    /// The frame
    #[arg(long, value_name = "ID")]
    frame: String,

    /// Output path; the extension selects the format
    #[arg(short, long, value_name = "OUT.png|OUT.svg")]
    output: PathBuf,

    /// Write labels beside the objects
    #[arg(long)]
    labels: bool,

    /// Draw only the detections of this source (default: the source of the estimates, otherwise all)
    #[arg(long, value_name = "NAME")]
    source: Option<String>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let is_svg = match ending(&args.output).as_deref() {
        Some("svg") => true,
        Some("png") => false,
        _ => return usage(format!("{}: expected a name that ends in .png or .svg", args.output.display())),
    };
    check_file(&args.output)?;
    let gathered = Gathered::read(&args.files)?;
    check_not_read(&args.output)?;
    let scene = &gathered.scene;
    let Some(index) = scene.frames.iter().position(|frame| frame.id == args.frame) else {
        let some: Vec<&str> = scene.frames.iter().take(5).map(|frame| frame.id.as_str()).collect();
        bail!("there is no frame \"{}\"; there are {}: {} ...", args.frame, scene.frames.len(), some.join(", "));
    };
    let images = &gathered.images;
    images.videos.want([index]);
    let image = match images.images.get(index) {
        Some(Some(_)) => Some(frame_image(scene, images, index, u32::MAX)?.image),
        _ => None,
    };
    let content = Content { images: None, source: args.source.as_deref(), ..gathered.content(None) };
    if let Some(source) = content.source.filter(|source| !scene.sources.iter().any(|known| known == source)) {
        return usage(format!(
            "there are no detections of the source \"{source}\"; there are {}",
            some_of(&scene.sources)
        ));
    }
    let report = report_of_frames(&content, &[index])?;
    let picture = Picture { report: &report, frame_index: 0, image: image.as_ref(), labels: args.labels };
    let failed = |reason| anyhow!("cannot draw the frame: {reason}");
    if is_svg {
        let svg = picture.svg().map_err(failed)?;
        write_file(&args.output, |file| file.write_all(svg.as_bytes()))?;
    } else {
        write_png(&args.output, &picture.bitmap().map_err(failed)?)?;
    }
    out.report(&format!("wrote {}\n", args.output.display()))?;
    out.document(&json!({ "output": args.output, "frame": args.frame, "image": image.is_some() }))?;
    Ok(Outcome::Fine)
}

fn ending(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}
