//! `quadlift info`: summary of a scene file and possible problems.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use quadlift::diagnosis::Diagnosis;
use quadlift::run::{Check, diagnose_source, diagnose_unnamed};
use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_report::Labels;
use serde::Serialize;

use crate::corrections::{Corrections, corrected_in_words, read_input};
use crate::error::Outcome;
use crate::next::Next;
use crate::oddities::{Reach, camera_oddity, one_point, reaches, scene_oddities};
use crate::output::{HEADING, Output, WARNING, one_line};
use crate::pose_check::pose_oddities;
use crate::table::Table;
use crate::words::{count, some_of};

/// Summarize and check a scene file
///
/// The file is validated as for localization. Suspicious values that are not errors are listed and do not change the
/// exit code, not even if the scene is inconsistent.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  quadlift info scene.json
  quadlift info scene.json --json

Exit codes: 0 the scene is valid; 1 it is not, or it cannot be read; 2 wrong usage."
)]
pub(crate) struct Args {
    /// The scene file
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

    #[command(flatten)]
    corrections: Corrections,
}

/// Summary of a scene file.
#[derive(Serialize)]
struct Report {
    scene: String,
    name: Option<String>,
    length_unit: Option<String>,
    up: Option<[f64; 3]>,
    frames: usize,
    points: usize,
    #[serde(skip_serializing_if = "is_zero")]
    observed_points: usize,
    #[serde(skip_serializing_if = "is_zero")]
    point_clouds: usize,
    cameras: usize,
    /// Width, height and number of frames.
    image_sizes: Vec<(f64, f64, usize)>,
    frames_without_image_size: usize,
    #[serde(skip_serializing_if = "is_zero")]
    depth_images: usize,
    categories: Vec<String>,
    true_objects: usize,
    /// Objects of a result.
    #[serde(skip_serializing_if = "Option::is_none")]
    estimated_objects: Option<usize>,
    detections: usize,
    sources: Vec<Source>,
    oddities: Vec<String>,
    corrections: Vec<String>,
    diagnosis: Option<DiagnosisRecord>,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde asks for a reference.
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// The detections of one source.
#[derive(Serialize, Default)]
struct Source {
    /// Absent for detections without a source.
    name: Option<String>,
    detections: usize,
    objects: usize,
    frames: usize,
    boxes: usize,
    ellipses: usize,
    masks: usize,
    #[serde(skip_serializing_if = "is_zero")]
    outlines: usize,
    #[serde(skip_serializing_if = "is_zero")]
    oriented_boxes: usize,
    #[serde(skip_serializing_if = "is_zero")]
    depths: usize,
    #[serde(skip_serializing_if = "is_zero")]
    boxes3d: usize,
    without_object: usize,
    objects_seen_once: Vec<String>,
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let input = read_input(&args.scene, &args.corrections.list()?)?;
    let (file, scene) = (&*input.file, input.scene());
    // The objects of the file are checked as well: the evaluation reads them.
    file.to_objects().map_err(|error| error.in_file(&args.scene))?;
    // Objects of other files are the truth.
    let is_result = file.has_estimates();
    let mut report = Report {
        scene: args.scene.display().to_string(),
        name: file.name.clone(),
        length_unit: file.length_unit.clone(),
        up: file.up,
        frames: scene.frames.len(),
        points: file.points.len(),
        observed_points: file.frames.iter().filter_map(|frame| Some(frame.observed_points.as_ref()?.len())).sum(),
        point_clouds: file.frames.iter().map(|frame| &frame.point_cloud).chain([&file.point_cloud]).flatten().count(),
        cameras: file.cameras.len(),
        image_sizes: image_sizes(scene),
        frames_without_image_size: scene.frames.iter().filter(|frame| frame.image_size.is_none()).count(),
        depth_images: file.frames.iter().filter(|frame| frame.depth.is_some()).count(),
        categories: scene.categories.clone(),
        true_objects: if is_result { 0 } else { file.objects.len() },
        estimated_objects: is_result.then_some(file.objects.len()),
        detections: scene.detections.len(),
        sources: sources(file, scene),
        oddities: Vec::new(),
        corrections: input.notes.clone(),
        diagnosis: None,
    };
    report.oddities = oddities(file, scene, &report);
    // The source that agrees least with the poses, or the only one.
    let diagnoses = report.sources.iter().flat_map(|source| {
        let name = source.name.as_deref();
        [(diagnose_source(scene, name), name), (diagnose_unnamed(scene, name), name)]
    });
    let miss = |d: &Diagnosis| d.agreement.map_or(0.0, |agreement| agreement.miss);
    let worst = |(a, _): &(Diagnosis, Option<&str>), (b, _): &(Diagnosis, Option<&str>)| {
        b.consistent.cmp(&a.consistent).then(miss(a).total_cmp(&miss(b)))
    };
    let (diagnosis, name) = diagnoses.max_by(worst).unwrap_or_default();
    let check = Check::of_diagnosis(diagnosis, &input, name);
    let diagnosis = DiagnosisRecord::of(&check, &input.context);
    report.oddities.extend(diagnosis.in_words());
    report.diagnosis = Some(diagnosis);
    let path = args.scene.as_path();
    let mut next = Next::default();
    let is_fixable = check.is_fixable();
    if report.detections > 0 && !is_result && !one_point(scene) && (check.diagnosis.consistent || is_fixable) {
        // Of several sources one must be chosen.
        let source = report.sources.iter().find_map(|s| s.name.as_deref()).filter(|_| report.sources.len() > 1);
        let (options, purpose) = match is_fixable {
            true => (" --fix", "correct that and localize the objects"),
            false => ("", "localize the objects"),
        };
        next = next.localize(path, source, options, purpose);
    }
    let next = next.command(["view".into(), path.into()], "view it in the browser");
    out.report(&(render(&report) + &next.text()))?;
    out.document(&report)?;
    Ok(Outcome::Fine)
}

fn image_sizes(scene: &Scene) -> Vec<(f64, f64, usize)> {
    let mut sizes: Vec<(f64, f64, usize)> = Vec::new();
    for size in scene.frames.iter().filter_map(|frame| frame.image_size) {
        match sizes.iter_mut().find(|known| (known.0, known.1) == (size.x, size.y)) {
            Some(known) => known.2 += 1,
            None => sizes.push((size.x, size.y, 1)),
        }
    }
    sizes
}

/// One entry per source, in the order of the scene; detections without a source come last.
fn sources(file: &SceneFile, scene: &Scene) -> Vec<Source> {
    let names = scene.sources.iter().map(|name| Some(name.clone())).chain([None]);
    let mut sources: Vec<Source> = names.map(|name| Source { name, ..Default::default() }).collect();
    let mut views = vec![BTreeMap::<u32, usize>::new(); sources.len()];
    let mut frames = vec![vec![false; scene.frames.len()]; sources.len()];
    // The records stand in the order of the detections that were made of them.
    for (detection, record) in scene.detections.iter().zip(&file.detections) {
        let index = detection.source_index.map_or(scene.sources.len(), |index| index as usize);
        let source = &mut sources[index];
        source.detections += 1;
        source.boxes += usize::from(detection.bounding_box.is_some());
        source.ellipses += usize::from(detection.ellipse.is_some());
        source.masks += usize::from(record.mask.is_some());
        source.outlines += usize::from(record.outline.is_some());
        source.oriented_boxes += usize::from(record.oriented_box.is_some());
        let cues = detection.cues.as_deref().copied().unwrap_or_default();
        source.depths += usize::from(cues.depth.is_some());
        source.boxes3d += usize::from(cues.box3d.is_some());
        frames[index][detection.frame_index as usize] = true;
        match detection.object_index {
            Some(object) => *views[index].entry(object).or_default() += 1,
            None => source.without_object += 1,
        }
    }
    for ((source, views), frames) in sources.iter_mut().zip(&views).zip(&frames) {
        source.objects = views.len();
        source.frames = frames.iter().filter(|seen| **seen).count();
        let once = views.iter().filter(|(_, n)| **n == 1);
        source.objects_seen_once = once.map(|(object, _)| scene.object_ids[*object as usize].clone()).collect();
    }
    sources.retain(|source| source.detections > 0);
    sources
}

/// Possible problems of a valid scene.
fn oddities(file: &SceneFile, scene: &Scene, report: &Report) -> Vec<String> {
    let mut oddities = Vec::new();
    let labels = Labels::of_scene(scene);
    if scene.frames.is_empty() {
        oddities.push("there are no frames".to_owned());
    }
    if scene.detections.is_empty() {
        oddities.push("there are no detections".to_owned());
    }
    if report.sources.len() > 1 {
        oddities.push("there are several sources of detections: localize needs --source".to_owned());
    }
    for source in &report.sources {
        let of = source.name.as_ref().map(|name| format!(" of \"{name}\"")).unwrap_or_default();
        if !source.objects_seen_once.is_empty() {
            let names = labels.of_all(&source.objects_seen_once);
            oddities.push(format!("objects{of} seen in one frame only: {}", some_of(&names)));
        }
    }
    oddities.extend(scene_oddities(scene).into_iter().chain(camera_oddity(scene)));
    let beyond = scene.detections.iter().filter(|d| reaches(scene, d) == Some(Reach::Beyond)).count();
    if beyond > 0 {
        oddities.push(format!("{} beyond the image border: edges there are treated as cut off", boxes_reach(beyond)));
    }
    let beyond_lens = scene.detections.iter().filter(|d| !d.is_measured()).count();
    if beyond_lens > 0 {
        let n = count(beyond_lens, "detection");
        oddities.push(format!("{n} where the lens cannot be undistorted: skipped by localize"));
    }
    if report.frames_without_image_size > 0 && !scene.frames.is_empty() {
        oddities.push(format!(
            "{} without an image size: box edges at the border are not treated as cut off there",
            count(report.frames_without_image_size, "frame")
        ));
    }
    oddities.extend(pose_oddities(file, scene));
    let mut seen = vec![false; scene.frames.len()];
    scene.detections.iter().for_each(|detection| seen[detection.frame_index as usize] = true);
    let blank: Vec<String> =
        scene.frames.iter().zip(&seen).filter(|(_, seen)| !**seen).map(|(f, _)| f.id.clone()).collect();
    if !blank.is_empty() && !scene.detections.is_empty() {
        oddities.push(format!("frames without detections: {}", some_of(&blank)));
    }
    let several = objects_of_several_categories(scene);
    let several = labels.of_all(&several);
    if !several.is_empty() {
        oddities
            .push(format!("objects with several categories (the most frequent one is used): {}", some_of(&several)));
    }
    let unused: Vec<String> = (file.cameras.iter())
        .filter(|camera| !file.frames.iter().any(|frame| frame.camera.as_deref() == Some(&camera.id)))
        .map(|camera| camera.id.clone())
        .collect();
    if !unused.is_empty() {
        oddities.push(format!("cameras not used by any frame: {}", some_of(&unused)));
    }
    oddities
}

fn boxes_reach(n: usize) -> String {
    if n == 1 { "1 box reaches".to_owned() } else { format!("{n} boxes reach") }
}

fn objects_of_several_categories(scene: &Scene) -> Vec<String> {
    let mut first: Vec<Option<u32>> = vec![None; scene.object_ids.len()];
    let mut several = vec![false; scene.object_ids.len()];
    for detection in &scene.detections {
        if let (Some(object), Some(category)) = (detection.object_index, detection.category_index) {
            several[object as usize] |= *first[object as usize].get_or_insert(category) != category;
        }
    }
    scene.object_ids.iter().zip(several).filter(|(_, several)| *several).map(|(id, _)| id.clone()).collect()
}

/// How many detections have object ids.
fn object_ids(report: &Report) -> String {
    match report.sources.iter().map(|source| source.without_object).sum::<usize>() {
        0 => "every detection has one".to_owned(),
        n if n == report.detections => "none: localize associates the detections".to_owned(),
        1 => format!("1 of {} has none", count(report.detections, "detection")),
        n => format!("{n} of {} have none", count(report.detections, "detection")),
    }
}

fn render(report: &Report) -> String {
    let mut text = corrected_in_words(&report.corrections);
    let mut line = |title: &str, value: String| {
        let _ = writeln!(text, "{title:<13}{}", one_line(&value));
    };
    line("scene", report.name.clone().unwrap_or_else(|| "(no name)".to_owned()));
    line("length unit", report.length_unit.clone().unwrap_or_else(|| "not known".to_owned()));
    line("up", report.up.map_or("not known".to_owned(), |up| format!("[{}, {}, {}]", up[0], up[1], up[2])));
    line("frames", report.frames.to_string());
    line("cameras", report.cameras.to_string());
    if report.depth_images > 0 {
        line("depth images", report.depth_images.to_string());
    }
    if report.points > 0 {
        line("points", report.points.to_string());
    }
    if report.observed_points > 0 {
        line("observations", report.observed_points.to_string());
    }
    if report.point_clouds > 0 {
        line("point clouds", report.point_clouds.to_string());
    }
    let sizes = report.image_sizes.iter().map(|(w, h, n)| format!("{w} x {h} ({})", count(*n, "frame")));
    let sizes: Vec<String> = sizes.collect();
    line("image size", if sizes.is_empty() { "not known".to_owned() } else { sizes.join(", ") });
    line("categories", if report.categories.is_empty() { "none".to_owned() } else { some_of(&report.categories) });
    match report.estimated_objects {
        None => line("true objects", report.true_objects.to_string()),
        Some(estimated) => line("objects", format!("{estimated} estimated")),
    }
    line("detections", report.detections.to_string());
    if report.detections > 0 {
        line("object ids", object_ids(report));
    }
    if !report.sources.is_empty() {
        let optional = |s: &Source| [s.outlines, s.oriented_boxes, s.depths, s.boxes3d];
        let all = report.sources.iter().map(optional).fold([0; 4], |sum, of| std::array::from_fn(|k| sum[k] + of[k]));
        let present = |numbers: [usize; 4]| numbers.into_iter().zip(all).filter(|(_, all)| *all > 0).map(|(n, _)| n);
        let usual = ["<source", "detections", "objects", "frames", "boxes", "ellipses", "masks"];
        let titles = ["outlines", "oriented boxes", "depths", "3D boxes"];
        let titles = titles.into_iter().zip(all).filter(|(_, all)| *all > 0).map(|(title, _)| title);
        let mut table = Table::new(usual.into_iter().chain(titles));
        for source in &report.sources {
            let numbers =
                [source.detections, source.objects, source.frames, source.boxes, source.ellipses, source.masks];
            let numbers = numbers.into_iter().chain(present(optional(source)));
            let name = source.name.as_deref().unwrap_or("(none)");
            table.push(std::iter::once(name.into()).chain(numbers.map(|n| n.to_string().into())).collect());
        }
        let _ = write!(text, "\n{}", table.render());
    }
    if !report.oddities.is_empty() {
        let _ = writeln!(text, "\n{HEADING}Possible problems{HEADING:#}");
        for oddity in &report.oddities {
            let _ = writeln!(text, "{WARNING}-{WARNING:#} {}", one_line(oddity));
        }
    }
    text
}
