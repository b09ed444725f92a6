//! `quadlift import` of detections, which are added to a scene.

use std::path::{Path, PathBuf};

use quadlift_io::correct::{Assumption, DetectionPixels};
use quadlift_io::guard::allow_overwriting;
use quadlift_io::read::detections::add_detections;
use quadlift_io::read::{DetectionFormat, ReadOptions};
use quadlift_io::write_scene_file;

use super::matching::Matching;
use super::words::{in_words, notes, to_json};
use crate::corrections::corrections_of;
use crate::error::{Outcome, usage};
use crate::files::{check_file, read_scene};
use crate::next::Next;
use crate::output::{Output, one_line};

/// The scene, and how detections are added to it.
#[derive(clap::Args)]
pub(super) struct DetectionArgs {
    /// The scene to add the detections to
    #[arg(long, value_name = "SCENE.json")]
    into: PathBuf,

    /// The scene file to write; it may be SCENE.json itself
    #[arg(short, long, value_name = "OUT.json")]
    output: PathBuf,

    /// Name of the source of these detections [default: the format]
    #[arg(long, value_name = "NAME")]
    source: Option<String>,

    /// Remove the existing detections of the scene
    #[arg(long)]
    replace: bool,

    #[command(flatten)]
    matching: Matching,

    /// What the detections really are: image_size=WxH, the size of the images on which the detector ran, from which boxes are
    /// scaled to the image size of the cameras; frame_offset=N, the number that the detections give to frame number 0 of the
    /// scene (default: inferred from format and names)
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',', value_parser = str::parse::<Assumption>)]
    assume: Vec<Assumption>,
}

impl DetectionArgs {
    /// What `--assume` says.
    fn pixels(&self) -> anyhow::Result<DetectionPixels> {
        let (pixels, others) = DetectionPixels::split(corrections_of(&self.assume)?);
        if others.is_empty() {
            return Ok(pixels);
        }
        let ours = |assumption: &&Assumption| !["image_size", "frame_offset"].contains(&assumption.name());
        let other = self.assume.iter().find(ours).map_or("", Assumption::name);
        usage(format!(
            "--assume {other} is not known here; import takes image_size and frame_offset, quadlift localize the others"
        ))
    }
}

/// Adds the detections in a file or folder to the scene.
pub(super) fn import(
    format: &DetectionFormat,
    path: &Path,
    options: &ReadOptions,
    args: &DetectionArgs,
    out: &Output,
) -> anyhow::Result<Outcome> {
    check_file(&args.output)?;
    let pixels = args.pixels()?;
    let (mut file, _) = read_scene(&args.into)?;
    let detections = (format.read)(path, options)?;
    let source = args.source.as_deref().unwrap_or(format.name);
    let mut adding = args.matching.options(source, pixels, format, options);
    adding.replace = args.replace;
    let read_notes = detections.notes.clone();
    let added = add_detections(&mut file, detections, &adding)?;
    file.to_scene().map_err(|error| error.in_file(path))?;
    let folder = |path: &Path| path.parent().unwrap_or(Path::new("")).to_owned();
    file.move_paths([&folder(&args.into), &folder(&args.output)])?;
    let notes = [read_notes, notes(&added)].concat();
    let about = format!("Detections of the source {source} from {}: {}.", format.title, notes.join("; "));
    file.notes = Some(file.notes.map_or(about.clone(), |before| format!("{before}\n{about}")));
    // It may be changed in place.
    allow_overwriting(&args.into);
    write_scene_file(&args.output, &file)?;
    let mut text = format!("wrote {}: {}\n", args.output.display(), one_line(&in_words(&added, source)));
    notes.iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
    let next = Next::default().localize(&args.output, None, " --report objects.html", "localize the objects");
    out.report(&(text + &next.text()))?;
    let mut document = to_json(&added, &notes);
    document["output"] = args.output.display().to_string().into();
    document["source"] = source.into();
    out.document(&document)?;
    Ok(Outcome::Fine)
}
