//! The content of a Rerun recording as a folder: `recording.json` and the images.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::bail;
use quadlift_io::file_names::file_names;
use quadlift_io::{ReadError, WriteError, write_file, write_folder};
use quadlift_report::{Labels, Recording, frame_jpeg, recording};
use rayon::prelude::*;

use crate::error::Outcome;
use crate::output::Output;
use crate::report::Gathered;

/// Quality of the JPEG files: they are looked at in full size.
const QUALITY: u8 = 90;

/// Which files, and where to.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A scene, and files with its estimates and its ground truth
    #[arg(required = true, value_name = "SCENE.json")]
    files: Vec<PathBuf>,

    /// Output folder; it must be new or empty
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

pub(super) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let gathered = Gathered::read(&args.files)?;
    let mut recording = recording(&gathered.content(None), &gathered.times)?;
    if recording.objects.is_empty() && recording.frames.is_empty() {
        bail!("{}: there are neither frames nor objects: there is nothing to export", args.files[0].display());
    }
    write_folder(&args.output, |folder| {
        write_images(&gathered, &mut recording, folder)?;
        let write = |file: &mut dyn io::Write| serde_json::to_writer(file, &recording).map_err(io::Error::from);
        write_file(&folder.join("recording.json"), write)
    })?;
    let images = recording.frames.iter().filter(|frame| frame.image.is_some()).count();
    let boxes = recording.frames.iter().map(|frame| frame.boxes.len()).sum();
    let ellipses = recording.frames.iter().map(|frame| frame.ellipses.len()).sum();
    let counts = [
        ("object", recording.objects.len()),
        ("frame", recording.frames.len()),
        ("image", images),
        ("box", boxes),
        ("ellipse", ellipses),
    ];
    let written = (args.output.as_path(), &counts[..], recording.notes.as_slice());
    let named = gathered.estimate.as_ref().or(gathered.truth.as_ref());
    let labels = named.map(|(_, file)| Labels::of_file(file)).unwrap_or_default();
    super::tell(out, std::iter::once(written), Some((&without_body(&gathered, &recording), &labels)))
}

/// Writes the undistorted images of the frames. Unreadable images are listed in the notes.
fn write_images(gathered: &Gathered, recording: &mut Recording, folder: &Path) -> Result<(), WriteError> {
    let (scene, images) = (&gathered.scene, &gathered.images);
    let of_frame = |index: usize| images.images.get(index).is_some_and(Option::is_some);
    let total = recording.frames.iter().filter(|frame| of_frame(frame.frame_index)).count();
    if total == 0 {
        return Ok(());
    }
    let subfolder = folder.join("images");
    std::fs::create_dir(&subfolder).map_err(|error| WriteError::new(&subfolder, error))?;
    let ids: Vec<String> = recording.frames.iter().map(|frame| frame.id.clone()).collect();
    let names = file_names(ids.iter().map(String::as_str));
    let names: Vec<String> = names.iter().map(|name| format!("images/{name}.jpg")).collect();
    let frames = recording.frames.par_iter_mut().zip(&names).filter(|(frame, _)| of_frame(frame.frame_index));
    let unread: Vec<Option<ReadError>> = frames
        .map(|(frame, name)| {
            let (jpeg, size) = match frame_jpeg(scene, images, frame.frame_index, u32::MAX, QUALITY) {
                Ok(image) => image,
                Err(error) => return Ok(Some(error)),
            };
            write_file(&folder.join(name), |file| file.write_all(&jpeg))?;
            frame.size = size.map(f64::from);
            frame.image = Some(name.clone());
            Ok(None)
        })
        .collect::<Result<_, WriteError>>()?;
    let unread: Vec<ReadError> = unread.into_iter().flatten().collect();
    if let Some(first) = unread.first() {
        recording.notes.push(format!("{} of {total} images could not be read: {first}", unread.len()));
    }
    Ok(())
}

/// Ids of the objects in the files that a recording does not show.
fn without_body(gathered: &Gathered, recording: &Recording) -> Vec<String> {
    let shown: std::collections::HashSet<&str> = recording.objects.iter().map(|object| object.id.as_str()).collect();
    let files = [&gathered.estimate, &gathered.truth].into_iter().flatten();
    let ids = files.flat_map(|(_, file)| &file.objects).map(|object| &object.id);
    let mut ids: Vec<String> = ids.filter(|id| !shown.contains(id.as_str())).cloned().collect();
    ids.sort();
    ids.dedup();
    ids
}
