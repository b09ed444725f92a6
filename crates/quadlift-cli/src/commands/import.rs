//! `quadlift import`: cameras and poses of other programs become a scene file.

pub mod formats;
pub mod paths;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use quadlift_io::read::Import;
use quadlift_io::{is_standard_output, write_scene_file};
use serde_json::json;

use crate::error::Outcome;
use crate::files::check_file;
use crate::next::Next;
use crate::output::Output;
use crate::words::count;

/// Convert the cameras and poses of another program to a scene file
///
/// Axes, transforms, pixel origins, quaternions and units are converted to the conventions of scene files. Conversions and
/// assumptions are printed and stored in the notes of the scene.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  quadlift import colmap model/ -o scene.json
  quadlift import nerfstudio transforms.json -o scene.json
  quadlift import opensfm reconstruction.json -o scene.json
  quadlift import arkit capture/ -o scene.json
  quadlift import tum trajectory.txt --intrinsics camera.txt --image-size 640x480 -o scene.json
  quadlift import kitti training/ --sequence 0001 --frames 90-106 -o scene.json
  quadlift import kitti-raw 2011_09_26/2011_09_26_drive_0005_sync -o scene.json
  quadlift import nuscenes data/nuscenes --scene scene-0061 -o scene.json
  quadlift import bop lm/test/000005 --world-object 5 -o scene.json
  quadlift import projections projections.csv --image-size 640x480 -o scene.json
  quadlift import mcap log.mcap -o scene.json
  quadlift import parquet tables/ -o scene.json

Exit codes: 0 success; 1 a file could not be read or written; 2 wrong usage."
)]
pub struct Args {
    #[command(subcommand)]
    format: formats::Format,
}

/// Options of every format.
#[derive(clap::Args)]
pub struct Common {
    /// Output: the scene file
    #[arg(short, long, value_name = "SCENE.json")]
    output: PathBuf,

    /// Folder of the images (default: that of the format)
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let (format, source, common) = args.format.parts();
    check_file(&common.output)?;
    let Import { mut scene, image_folder, mut notes } = args.format.read(out)?;
    let is_scene = args.format.is_scene();
    if scene.frames.is_empty() && !is_scene {
        bail!("{}: no frames found; expected cameras with poses", source.display());
    }
    match common.images.as_ref().or(image_folder.as_ref()) {
        Some(folder) => {
            let prefix = |folder: &Path| {
                paths::relative_to_file(folder, &common.output)
                    .with_context(|| format!("cannot find the folder {}", folder.display()))
            };
            // `--images` says where the images are, not the depth images.
            let of_depths = image_folder.as_ref().map_or(Ok(PathBuf::new()), |folder| prefix(folder))?;
            paths::prefix_images(&mut scene, &prefix(folder)?, &of_depths);
        }
        None if !is_scene && scene.frames.iter().any(|frame| frame.image.is_some()) => {
            notes.push("the image folder is unknown: set it with --images DIR".to_owned());
        }
        None => {}
    }
    if !is_scene {
        if scene.name.is_none() && !is_standard_output(&common.output) {
            scene.name = common.output.file_stem().map(|name| name.to_string_lossy().into_owned());
        }
        scene.notes = Some(format!("Imported from {}: {}.", format, notes.join("; ")));
    }
    write_scene_file(&common.output, &scene)?;
    let (cameras, frames) = (scene.cameras.len(), scene.frames.len());
    let (detections, objects) = (scene.detections.len(), scene.objects.len());
    let mut text = format!(
        "wrote {}: {}, {}, {}, {}\n",
        common.output.display(),
        count(cameras, "camera"),
        count(frames, "frame"),
        count(detections, "detection"),
        count(objects, if is_scene { "object" } else { "true object" }),
    );
    notes.iter().for_each(|note| text.push_str(&format!("- {}\n", crate::output::one_line(note))));
    let path = common.output.as_path();
    let next = match detections {
        0 => Next::default()
            .command(["import-detections --help".into()], "list the detection formats")
            .command(["view".into(), path.into()], "look at the cameras"),
        _ => Next::default()
            .command(["info".into(), path.into()], "summarise and check the scene")
            .command(["localize".into(), path.into(), "-o objects.json".into()], "localise the objects"),
    };
    out.report(&(text + &next.text()))?;
    out.document(&json!({
        "output": common.output.display().to_string(),
        "cameras": cameras,
        "frames": frames,
        "detections": detections,
        "true_objects": objects,
        "notes": notes,
    }))?;
    Ok(Outcome::Fine)
}
