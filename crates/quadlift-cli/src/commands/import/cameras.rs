//! `quadlift import` of cameras and poses, which become a scene file.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use quadlift_io::read::{Import, PoseFormat, ReadOptions, find_images};
use quadlift_io::{is_standard_output, write_scene_file};
use serde_json::json;

use super::paths;
use super::words::tell_problems;
use crate::error::Outcome;
use crate::files::{check_file, make_folder};
use crate::next::Next;
use crate::output::{Output, one_line};
use crate::words::count;

/// Where the scene goes.
#[derive(clap::Args)]
pub(super) struct CameraArgs {
    /// Output: the scene file
    #[arg(short, long, value_name = "SCENE.json")]
    output: PathBuf,

    /// Folder of the images (default: that of the format). Finds them by the names or ids of the frames, also with another extension or
    /// without one
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

/// Reads a file or folder and writes the scene.
pub(super) fn import(
    format: &PoseFormat,
    path: &Path,
    options: &ReadOptions,
    args: &CameraArgs,
    out: &Output,
) -> anyhow::Result<Outcome> {
    check_file(&args.output)?;
    options.write_images.as_deref().map_or(Ok(()), make_folder)?;
    let import = (format.read)(path, options)?;
    tell_problems(&import, out);
    let Import { mut scene, image_folder, mut notes, is_scene, .. } = import;
    if scene.frames.is_empty() && !is_scene {
        bail!("{}: no frames found; expected cameras with poses", path.display());
    }
    if let Some(folder) = &args.images {
        find_images(&mut scene, folder);
    }
    match args.images.as_ref().or(image_folder.as_ref()) {
        Some(folder) => {
            let prefix = |folder: &Path| {
                paths::relative_to_file(folder, &args.output)
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
        if scene.name.is_none() && !is_standard_output(&args.output) {
            scene.name = args.output.file_stem().map(|name| name.to_string_lossy().into_owned());
        }
        scene.notes = Some(format!("Imported from {}: {}.", format.title, notes.join("; ")));
    }
    write_scene_file(&args.output, &scene)?;
    let (cameras, frames) = (scene.cameras.len(), scene.frames.len());
    let (detections, objects) = (scene.detections.len(), scene.objects.len());
    let mut text = format!(
        "wrote {}: {}, {}, {}, {}\n",
        args.output.display(),
        count(cameras, "camera"),
        count(frames, "frame"),
        count(detections, "detection"),
        count(objects, if is_scene { "object" } else { "true object" }),
    );
    notes.iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
    let path = args.output.as_path();
    let next = match detections {
        0 => Next::default()
            .command(["import --help".into()], "list the detection formats")
            .command(["view".into(), path.into()], "look at the cameras"),
        _ => Next::default().command(["info".into(), path.into()], "summarize and check the scene").localize(
            path,
            None,
            "",
            "localize the objects",
        ),
    };
    out.report(&(text + &next.text()))?;
    out.document(&json!({
        "output": args.output.display().to_string(),
        "cameras": cameras,
        "frames": frames,
        "detections": detections,
        "true_objects": objects,
        "notes": notes,
    }))?;
    Ok(Outcome::Fine)
}
