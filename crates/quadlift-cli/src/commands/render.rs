//! `quadlift render`: pictures of frames, for papers and pages.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use image::RgbImage;
use quadlift_io::file_names::file_names;
use quadlift_io::guard::check_not_read;
use quadlift_io::{ReadError, write_file, write_png};
use quadlift_report::{Content, Picture, frame_image, report_of_frames};
use rayon::prelude::*;
use serde_json::json;

use crate::error::{Outcome, usage};
use crate::files::{check_file, make_folder};
use crate::output::{Output, one_line};
use crate::report::Gathered;
use crate::words::{count, some_of};

/// Number of frames that are drawn between two looks at the scene: it takes long, and holds what it finds.
const FRAMES: usize = 200;

/// Draw frames as PNG or SVG
///
/// Draws their detections and the outlines of the bodies: of one frame, or of every frame.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Boxes and ellipses are detections (red and dashed if the estimator rejected them), filled outlines are the estimated
bodies, thin ones bodies that were not detected in the frame, dotted outlines the ground truth. Without an image the
background is blank. Images with lens distortion are undistorted. Several files of one scene are drawn together, as in
`quadlift view`.

Examples:
  quadlift render scene.json estimate.json --frame 000003 -o frame.png
  quadlift render scene.json --frame 000003 -o frame.svg --labels --source yolo
  quadlift render scene.json estimate.json --all -o pictures

Exit codes: 0 success; 1 a file or an image cannot be read; 2 wrong usage."
)]
pub(crate) struct Args {
    /// A scene, and files with its estimates and its ground truth
    #[arg(required = true, value_name = "SCENE.json")]
    files: Vec<PathBuf>,

    /// The frame
    #[arg(long, value_name = "ID")]
    frame: Option<String>,

    /// Draw every frame into the folder of --output, as ID.png with "_" in place of "/" and other signs of its id. Frames whose
    /// image is unknown or cannot be read are blank, and counted
    #[arg(long)]
    all: bool,

    /// Output path; the extension selects the format. With --all a folder
    #[arg(short, long, value_name = "OUT.png|OUT.svg|DIR")]
    output: Option<PathBuf>,

    /// With --all: write SVG in place of PNG
    #[arg(long)]
    svg: bool,

    /// Write labels beside the objects, none over another one
    #[arg(long)]
    labels: bool,

    /// Draw only the detections of this source (default: the source of the estimates, otherwise all)
    #[arg(long, value_name = "NAME")]
    source: Option<String>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let ending = args.output.as_deref().and_then(ending);
    let is_picture = matches!(ending.as_deref(), Some("png" | "svg"));
    match (&args.frame, args.all, &args.output) {
        (Some(_), true, _) => usage("--frame draws one frame, --all every frame: remove one of them"),
        (None, false, _) => usage("which frame? --frame ID -o FILE draws one, --all -o FOLDER every frame"),
        (None, true, None) => usage("--all needs the folder of the pictures: add -o FOLDER"),
        (None, true, Some(folder)) if is_picture => {
            usage(format!("--all writes a folder of pictures, not {}: give -o the name of a folder", folder.display()))
        }
        (None, true, Some(folder)) => every_frame(args, folder, out),
        (Some(_), false, None) => usage("the picture needs a name that ends in .png or .svg: add -o FILE"),
        (Some(_), false, Some(_)) if args.svg => {
            usage("--svg belongs to --all; one picture is SVG if the name after -o ends in .svg")
        }
        (Some(_), false, Some(path)) if !is_picture => {
            usage(format!("{}: expected a name that ends in .png or .svg", path.display()))
        }
        (Some(frame), false, Some(path)) => one_frame(args, frame, path, out),
    }
}

fn one_frame(args: &Args, frame: &str, path: &Path, out: &Output) -> anyhow::Result<Outcome> {
    check_file(path)?;
    let gathered = Gathered::read(&args.files)?;
    check_not_read(path)?;
    let scene = &gathered.scene;
    let Some(index) = scene.frames.iter().position(|known| known.id == frame) else {
        let some: Vec<&str> = scene.frames.iter().take(5).map(|frame| frame.id.as_str()).collect();
        bail!("there is no frame \"{frame}\"; there are {}: {} ...", scene.frames.len(), some.join(", "));
    };
    let content = content(args, &gathered)?;
    gathered.images.videos.want([index]);
    let image = image_of(&gathered, index)?;
    let report = report_of_frames(&content, &[index])?;
    draw(&Picture { report: &report, frame_index: 0, image: image.as_ref(), labels: args.labels }, path)?;
    out.report(&format!("wrote {}\n", path.display()))?;
    out.document(&json!({ "output": path, "frame": frame, "image": image.is_some() }))?;
    Ok(Outcome::Fine)
}

fn every_frame(args: &Args, folder: &Path, out: &Output) -> anyhow::Result<Outcome> {
    if folder.is_file() {
        bail!("cannot write {}: it is a file; expected a folder", folder.display());
    }
    let gathered = Gathered::read(&args.files)?;
    let content = content(args, &gathered)?;
    let frames = &gathered.scene.frames;
    if frames.is_empty() {
        bail!("{}: there are no frames: there is nothing to draw", args.files[0].display());
    }
    let ending = if args.svg { "svg" } else { "png" };
    let names = file_names(frames.iter().map(|frame| frame.id.as_str()));
    let paths: Vec<PathBuf> = names.iter().map(|name| folder.join(format!("{name}.{ending}"))).collect();
    // Of all before the first is written.
    paths.iter().try_for_each(|path| check_not_read(path))?;
    make_folder(folder)?;
    let (mut has_image, mut unread) = (Vec::with_capacity(frames.len()), Vec::new());
    let indices: Vec<usize> = (0..frames.len()).collect();
    for indices in indices.chunks(FRAMES) {
        let report = report_of_frames(&content, indices)?;
        let drawn = indices.par_iter().enumerate().map(|(frame_index, &index)| {
            let image = image_of(&gathered, index);
            let picture = Picture {
                report: &report,
                frame_index,
                image: image.as_ref().ok().and_then(Option::as_ref),
                labels: args.labels,
            };
            draw(&picture, &paths[index])?;
            Ok(image.map(|image| image.is_some()))
        });
        // The first failure is that of the first frame, whichever thread was faster.
        for image in drawn.collect::<Vec<anyhow::Result<_>>>() {
            let image = image?;
            has_image.push(*image.as_ref().unwrap_or(&false));
            unread.extend(image.err());
        }
    }
    let named = gathered.images.images.iter().flatten().count();
    let mut text = format!("wrote {} to {}", count(frames.len(), "picture"), folder.display());
    let mut notes = Vec::new();
    if named < frames.len() {
        notes.push(format!("{} without an image: blank", count(frames.len() - named, "frame")));
    }
    if let Some(first) = unread.first() {
        notes.push(format!("{} of {} could not be read, blank: {first}", unread.len(), count(named, "image")));
    }
    notes.iter().for_each(|note| text.push_str(&format!("\n- {}", one_line(note))));
    out.report(&(text + "\n"))?;
    let picture = |k: usize| json!({ "frame": frames[k].id, "output": paths[k], "image": has_image[k] });
    let pictures: Vec<_> = (0..frames.len()).map(picture).collect();
    out.document(&json!({ "output": folder, "pictures": pictures, "notes": notes }))?;
    Ok(Outcome::Fine)
}

/// What is drawn, with a source that there is.
fn content<'a>(args: &'a Args, gathered: &'a Gathered) -> anyhow::Result<Content<'a>> {
    let sources = &gathered.scene.sources;
    match args.source.as_deref() {
        Some(source) if !sources.iter().any(|known| known == source) => {
            usage(format!("there are no detections of the source \"{source}\"; there are {}", some_of(sources)))
        }
        source => Ok(Content { images: None, source, ..gathered.content(None) }),
    }
}

/// The image of a frame, if it names one.
fn image_of(gathered: &Gathered, frame_index: usize) -> Result<Option<RgbImage>, ReadError> {
    let (scene, images) = (&gathered.scene, &gathered.images);
    let is_named = images.images.get(frame_index).is_some_and(Option::is_some);
    is_named.then(|| frame_image(scene, images, frame_index, u32::MAX).map(|image| image.image)).transpose()
}

/// Writes a picture in the format of the name's ending.
fn draw(picture: &Picture, path: &Path) -> anyhow::Result<()> {
    let failed = |reason| anyhow!("cannot draw the frame: {reason}");
    if ending(path).as_deref() == Some("svg") {
        let svg = picture.svg().map_err(failed)?;
        write_file(path, |file| file.write_all(svg.as_bytes()))?;
    } else {
        write_png(path, &picture.bitmap().map_err(failed)?)?;
    }
    Ok(())
}

fn ending(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}
