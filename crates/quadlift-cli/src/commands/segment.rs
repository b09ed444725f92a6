//! `quadlift segment`: from images to masks and ellipses.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, anyhow, bail};
use clap::builder::RangedU64ValueParser;
use quadlift::run::Check;
use quadlift::scene::Scene;
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_io::guard::check_not_read;
use quadlift_io::scene_file::SceneImages;
use quadlift_io::scene_file::way_to_file;
use quadlift_io::segmentation::{Group, Method, Segmentation, Settings, add_to_scene, set_video};
use quadlift_io::write_scene_file;
use quadlift_report::Labels;
use serde_json::{Value, json};

use crate::contact_sheet::write_sheets;
use crate::corrections::{Corrections, corrected_in_words, read_input};
use crate::diagnosis::tell;
use crate::error::{Outcome, usage};
use crate::files::{Inputs, check_result_name, make_folder, outputs};
use crate::next::Next;
use crate::options::{Chosen, OfSegmentation, Segment};
use crate::output::{BAD, GOOD, HEADING, Output, WARNING, one_line};
use crate::report::{Gathered, check_report};
use crate::segmentation::segment_scene;
use crate::table::{Cell, MAX_ROWS, Table, number, rest};
use crate::threads;
use crate::words::{count, duration};

/// Segment the detected objects in their images
///
/// Fits ellipses to the masks. The crops of an object from all its frames are segmented jointly. The result is the same scene with an `ellipse`, a
/// `mask` and a `segmentation` (method, status and confidence) in each detection, as input for `localize`.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Methods:
  graphcut  graph cuts with the colors of all frames together
  sca       Stel Component Analysis, as in the paper
  masks     the masks given in the scene (from SAM, YOLO-seg, Mask R-CNN, ...)

Contact sheets show each crop with the outline of the mask (yellow), the ellipse in the box (blue) and the fitted
ellipse (pink). The frame is green; orange if the mask touches the image border or another object; red if there is no
reliable mask and the ellipse in the box is used.

Examples:
  quadlift segment scene.json -o segmented.json --contact-sheets sheets
  quadlift segment scene.json -o segmented.json --source yolo --out-masks masks
  quadlift segment scene.json -o segmented.json --method masks
  quadlift segment scene.json -o segmented.json --images drive.mp4
  quadlift localize segmented.json -o objects.json

Exit codes: 0 success; 1 at least one detection could not be segmented, or none; 2 wrong usage; 3 the scene is
inconsistent (its masks are written anyway)."
)]
pub(crate) struct Args {
    /// The scene file; its frames must name their images, or --images a video
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

    /// Output: the scene with ellipses and masks
    #[arg(short, long, value_name = "OUT.json")]
    output: PathBuf,

    #[command(flatten)]
    of_segmentation: Chosen<OfSegmentation>,

    /// Take the images from this video: of each frame the one with the number in its name, or in its place (needs ffmpeg)
    #[arg(long, value_name = "VIDEO")]
    images: Option<PathBuf>,

    /// Write the masks to this folder as label images (PNG), one per frame, instead of into OUT.json
    #[arg(long, value_name = "DIR")]
    out_masks: Option<PathBuf>,

    /// Write a picture (PNG) of each object's crops with masks and ellipses to this folder
    #[arg(long, value_name = "DIR")]
    contact_sheets: Option<PathBuf>,

    /// Write an HTML report with the ellipses in their images
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,

    #[command(flatten)]
    corrections: Corrections,

    #[command(flatten)]
    chosen: Chosen<Segment>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    let of_run = args.chosen.options()?;
    let settings = Settings { with_crops: args.contact_sheets.is_some(), ..args.of_segmentation.options()? };
    let inputs = Inputs { paths: vec![args.scene.clone()], several: false };
    check_result_name(&args.output, false)?;
    outputs(&inputs, &args.output)?;
    check_report(args.report.as_ref(), &[&args.scene, &args.output])?;
    let start = Instant::now();
    let mut input = read_input(&args.scene, &args.corrections.list()?)?;
    [Some(&args.output), args.report.as_ref()].into_iter().flatten().try_for_each(|path| check_not_read(path))?;
    let check = Check::with_identities(&mut input, settings.source.as_deref(), of_run.fix)?;
    let (scene, notes) = (input.scene(), &input.notes);
    let mut file = (*input.file).clone();
    let mut of_video = None;
    if let Some(video) = &args.images {
        let folder = args.scene.parent().unwrap_or(Path::new(""));
        of_video = set_video(&mut file, &way_to_file(folder, video)?);
    }
    let images = file.to_images(&args.scene).map_err(|error| error.in_file(&args.scene))?;
    check_folders(args, &images)?;
    let title = args.scene.display().to_string();
    let segmentation = segment_scene(&title, scene, &images, &settings, out).with_context(|| title.clone())?;
    let problems: Vec<String> = segmentation.problems.in_words(scene);
    out.errors(&problems);
    let done = segmentation.found.iter().flatten().count();
    if done == 0 {
        return Err(anyhow!("{title}: no detection could be segmented"));
    }
    let segmented = start.elapsed();
    for folder in [&args.out_masks, &args.contact_sheets].into_iter().flatten() {
        make_folder(folder)?;
    }
    if let Some(folder) = &args.contact_sheets {
        write_sheets(&segmentation, scene, folder)?;
    }
    let folders = [&args.scene, &args.output].map(|path| path.parent().unwrap_or(Path::new("")));
    add_to_scene(&mut file, scene, &segmentation, settings.method, folders, args.out_masks.as_deref())?;
    // Last, so that it never names masks that do not exist.
    write_scene_file(&args.output, &file)?;
    if let Some(report) = &args.report {
        Gathered::new(vec![(args.output.clone(), file)])?.write_report(report, None, out)?;
    }
    let written = start.elapsed() - segmented;
    out.detail(&format!("segmented in {}, written in {}", duration(segmented), duration(written)));
    let purpose = "localize the objects from boxes and ellipses";
    let next = Next::default().localize(&args.output, settings.source.as_deref(), " --report objects.html", purpose);
    let of_video = of_video.map_or_else(String::new, |note| format!("note: {}\n", one_line(&note)));
    out.report(&(report(args, settings.method, scene, &segmentation, notes) + &of_video + &next.text()))?;
    out.document(&json!({
        "scene": title,
        "output": args.output.display().to_string(),
        "method": settings.method.name(),
        "masks": args.out_masks.as_ref().map(|folder| folder.display().to_string()),
        "contact_sheets": args.contact_sheets.as_ref().map(|folder| folder.display().to_string()),
        "objects": segmentation.groups.iter().map(|group| Summary::of(group, &segmentation).to_json()).collect::<Vec<_>>(),
        "without_box": segmentation.without_box.len(),
        "problems": problems,
        "corrections": notes,
        "diagnosis": DiagnosisRecord::of(&check, &input.context),
    }))?;
    let outcome = tell(&check, &input.context, of_run.localize.allow_inconsistent, &title, out);
    Ok(if problems.is_empty() { outcome } else { Outcome::SomethingFailed })
}

/// Rejects folders for masks and sheets that are files or that contain images or masks of the scene, which could be
/// overwritten.
fn check_folders(args: &Args, images: &SceneImages) -> anyhow::Result<()> {
    let folders = [("--out-masks", &args.out_masks), ("--contact-sheets", &args.contact_sheets)];
    let mut seen: Vec<PathBuf> = Vec::new();
    for (option, folder) in folders {
        let Some(folder) = folder else { continue };
        if folder.exists() && !folder.is_dir() {
            bail!("cannot write to {}: it is a file; expected a folder", folder.display());
        }
        let here = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        if seen.contains(&here) {
            return usage("--out-masks and --contact-sheets need different folders");
        }
        if let Some(path) = images.any_in(&here) {
            return usage(format!(
                "{option} {} is the folder of {}, which could be overwritten; choose another one",
                folder.display(),
                path.display()
            ));
        }
        seen.push(here);
    }
    Ok(())
}

/// Results of the detections of an object.
#[derive(Debug, Default)]
struct Summary {
    object: Option<String>,
    detections: usize,
    ok: usize,
    fallback: usize,
    failed: usize,
    cut: usize,
    touching: usize,
    /// Mean over the masks that have one.
    confidence: Option<f64>,
}

impl Summary {
    fn of(group: &Group, segmentation: &Segmentation) -> Self {
        let mut summary =
            Self { object: group.object.clone(), detections: group.detections.len(), ..Default::default() };
        let mut confidences = Vec::new();
        for &index in &group.detections {
            let Some(found) = &segmentation.found[index] else {
                summary.failed += 1;
                continue;
            };
            if found.fallback.is_some() {
                summary.fallback += 1;
                continue;
            }
            summary.ok += 1;
            summary.cut += usize::from(found.contacts.truncated_by_border());
            summary.touching += usize::from(found.contacts.touches_another());
            confidences.extend(found.confidence);
        }
        summary.confidence =
            (!confidences.is_empty()).then(|| confidences.iter().sum::<f64>() / confidences.len() as f64);
        summary
    }

    fn to_json(&self) -> Value {
        json!({
            "object": self.object,
            "detections": self.detections,
            "ok": self.ok,
            "fallback": self.fallback,
            "failed": self.failed,
            "truncated_by_border": self.cut,
            "touches_other_masks": self.touching,
            "confidence": self.confidence,
        })
    }

    fn cells(&self, labels: &Labels) -> Vec<Cell> {
        let some = |n: usize, style| if n == 0 { Cell::from("0") } else { Cell::styled(n.to_string(), style) };
        vec![
            Cell::from(self.object.as_deref().map_or("(no object id)", |id| labels.of(id))),
            Cell::from(self.detections.to_string()),
            some(self.ok, GOOD),
            some(self.fallback, WARNING),
            some(self.failed, BAD),
            Cell::from(self.cut.to_string()),
            Cell::from(self.touching.to_string()),
            Cell::from(number(self.confidence, 2)),
        ]
    }
}

fn report(args: &Args, method: Method, scene: &Scene, segmentation: &Segmentation, notes: &[String]) -> String {
    let summaries: Vec<Summary> = segmentation.groups.iter().map(|group| Summary::of(group, segmentation)).collect();
    let total = |f: fn(&Summary) -> usize| summaries.iter().map(f).sum::<usize>();
    let mut table = Table::new([
        "<object",
        "detections",
        "ok",
        "fell back",
        "failed",
        "cut by border",
        "touch others",
        "confidence",
    ]);
    let labels = Labels::of_scene(scene);
    summaries.iter().take(MAX_ROWS).for_each(|summary| table.push(summary.cells(&labels)));
    let mut text = format!(
        "{HEADING}{}{HEADING:#}: {} of {} segmented ({})\n{}\n{}",
        one_line(&args.scene.display().to_string()),
        total(|s| s.detections - s.failed),
        count(total(|s| s.detections), "detection"),
        method.name(),
        corrected_in_words(notes),
        table.render() + &rest(summaries.len(), "object", "--json lists all")
    );
    let fallback = total(|s| s.fallback);
    if fallback > 0 {
        text.push_str(&format!(
            "note: {} without a reliable mask: the ellipse in the box is used\n",
            count(fallback, "detection")
        ));
    }
    if let Some(alone) = summaries.iter().find(|s| s.object.is_none())
        && matches!(method, Method::Image(_))
    {
        text.push_str(&format!(
            "note: {} without an object id: each was segmented alone, which is less reliable\n",
            count(alone.detections, "detection")
        ));
    }
    if !segmentation.without_box.is_empty() {
        text.push_str(&format!("note: skipped {} without a box\n", count(segmentation.without_box.len(), "detection")));
    }
    for folder in [&args.out_masks, &args.contact_sheets].into_iter().flatten() {
        text.push_str(&format!("wrote {}{}\n", folder.display(), std::path::MAIN_SEPARATOR));
    }
    for path in [Some(&args.output), args.report.as_ref()].into_iter().flatten() {
        text.push_str(&format!("wrote {}\n", path.display()));
    }
    text
}
