//! `quadlift import-detections`: detections in other programs' files are added to a scene.

mod formats;
mod matching;

use std::path::{Path, PathBuf};

use quadlift_io::correct::Assumption;
use quadlift_io::guard::allow_overwriting;
use quadlift_io::read::detections::{AddedDetections, add_detections};
use quadlift_io::write_scene_file;
use serde_json::{Value, json};

use crate::corrections::{DetectionPixels, corrections_of};
use crate::error::{Outcome, usage};
use crate::files::{check_file, read_scene};
use crate::next::Next;
use crate::output::{Output, one_line};
use crate::words::{count, some_of};

pub use formats::{Format, Names};
pub use matching::Matching;

/// Add the detections of another program to a scene
///
/// The images of the detections are matched to the frames of the scene by name, number or time. Track ids become object
/// ids; without them, `quadlift localize` associates the detections. Existing detections of the scene are kept under
/// their own source.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  quadlift import-detections yolo runs/detect/predict scene.json -o detected.json
  quadlift import-detections coco results.json scene.json -o detected.json --annotations instances.json
  quadlift import-detections mot tracks.txt scene.json -o detected.json --assume frame_offset=1
  quadlift import-detections kitti label_02/0001.txt scene.json -o detected.json
  quadlift import-detections csv boxes.csv scene.json -o detected.json --min-score 0.5
  quadlift import-detections supervision sink.json scene.json -o detected.json --frame-column frame_number
  quadlift import-detections labelme annotations/ scene.json -o detected.json
  quadlift import-detections voc Annotations/ scene.json -o detected.json
  quadlift import-detections cvat annotations.xml scene.json -o detected.json
  quadlift import-detections label-studio export.json scene.json -o detected.json

Exit codes: 0 the scene was written; 1 a file could not be read or written, or no image is a frame of the scene; 2 wrong
usage."
)]
pub struct Args {
    #[command(subcommand)]
    format: Format,
}

/// Options of every format.
#[derive(clap::Args)]
pub struct Common {
    /// The scene to add the detections to
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

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

impl Common {
    /// What `--assume` says.
    fn pixels(&self) -> anyhow::Result<DetectionPixels> {
        let (pixels, others) = DetectionPixels::split(corrections_of(&self.assume)?);
        if others.is_empty() {
            return Ok(pixels);
        }
        let ours = |assumption: &&Assumption| !["image_size", "frame_offset"].contains(&assumption.name());
        let other = self.assume.iter().find(ours).map_or("", Assumption::name);
        usage(format!(
            "--assume {other} is not known here; import-detections takes image_size and frame_offset, quadlift localize the others"
        ))
    }
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let (format, path, common) = args.format.parts();
    check_file(&common.output)?;
    let pixels = common.pixels()?;
    let (mut file, _) = read_scene(&common.scene)?;
    let detections = args.format.read()?;
    let source = common.source.as_deref().unwrap_or(format.name());
    let mut options = common.matching.options(source, pixels, args.format.pixel_centers());
    options.replace = common.replace;
    let read_notes = detections.notes.clone();
    let added = add_detections(&mut file, detections, &options)?;
    file.to_scene().map_err(|error| error.in_file(path))?;
    let folder = |path: &Path| path.parent().unwrap_or(Path::new("")).to_owned();
    file.move_paths([&folder(&common.scene), &folder(&common.output)])?;
    let notes = [read_notes, notes(&added)].concat();
    let about = format!("Detections of the source {source} from {}: {}.", format.title(), notes.join("; "));
    file.notes = Some(file.notes.map_or(about.clone(), |before| format!("{before}\n{about}")));
    // It may be changed in place.
    allow_overwriting(&common.scene);
    write_scene_file(&common.output, &file)?;
    let mut text = format!("wrote {}: {}\n", common.output.display(), one_line(&in_words(&added, source)));
    notes.iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
    let words = ["localize".into(), common.output.as_path().into(), "-o objects.json --report objects.html".into()];
    out.report(&(text + &Next::default().command(words, "localise the objects").text()))?;
    let mut document = to_json(&added, &notes);
    document["output"] = common.output.display().to_string().into();
    document["source"] = source.into();
    out.document(&document)?;
    Ok(Outcome::Fine)
}

/// The added detections, in one line.
pub fn in_words(added: &AddedDetections, source: &str) -> String {
    let images = added.matched_images + added.images_without_frame.len();
    let found = if images == added.matched_images {
        count(images, "image")
    } else {
        format!("{} of {}", added.matched_images, count(images, "image"))
    };
    format!(
        "{} of the source {source} in {found} matched to frames of the scene (by {})",
        count(added.added, "detection"),
        added.matched_by.name()
    )
}

/// Assumptions and skipped detections.
pub fn notes(added: &AddedDetections) -> Vec<String> {
    let mut notes = added.notes.clone();
    if !added.images_without_frame.is_empty() {
        notes.push(format!(
            "{} no frame in the scene, their {} are skipped: {}",
            has_or_have(added.images_without_frame.len(), "image"),
            count(added.in_no_frame, "detection"),
            some_of(&added.images_without_frame)
        ));
    }
    if !added.frames_without_image.is_empty() {
        notes.push(format!(
            "{} no image among the detections: {}",
            has_or_have(added.frames_without_image.len(), "frame"),
            some_of(&added.frames_without_image)
        ));
    }
    for (number, why) in [(added.low_score, "with a lower score"), (added.empty, "without width or height")] {
        if number > 0 {
            notes.push(format!("skipped {} {why}", count(number, "detection")));
        }
    }
    if added.removed > 0 {
        notes.push(format!("{} of the scene were removed", count(added.removed, "detection")));
    }
    notes.push(match added.with_object {
        0 => "no detection has a track id: `quadlift localize` associates the detections".to_owned(),
        n if n < added.added => {
            format!("{n} of {} detections have a track id, which becomes their object id", added.added)
        }
        _ => "track ids become object ids".to_owned(),
    });
    notes
}

fn has_or_have(n: usize, singular: &str) -> String {
    format!("{} {}", count(n, singular), if n == 1 { "has" } else { "have" })
}

/// The added detections as JSON.
pub fn to_json(added: &AddedDetections, notes: &[String]) -> Value {
    json!({
        "detections": added.added,
        "with_object": added.with_object,
        "matched_by": added.matched_by.name(),
        "matched_images": added.matched_images,
        "images_without_frame": added.images_without_frame,
        "frames_without_image": added.frames_without_image,
        "skipped": { "in_no_frame": added.in_no_frame, "low_score": added.low_score, "empty": added.empty },
        "removed": added.removed,
        "notes": notes,
    })
}
