//! Reports: shared code of commands with `--report`, and files of one scene that are shown together.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use quadlift::metrics::Evaluation;
use quadlift::scene::Scene;
use quadlift_io::evaluation::{Matching, evaluate_objects};
use quadlift_io::guard::is_same_file;
use quadlift_io::scene_file::SceneImages;
use quadlift_io::{SceneFile, read_scene_file, write_file};
use quadlift_report::{Content, Scores, page, report};

use crate::error::usage;
use crate::files::{Inputs, check_file, outputs};
use crate::output::Output;

/// The reports' paths, one per input, checked before anything is computed; of several scenes `report` is a folder.
pub(crate) fn report_paths(inputs: &Inputs, report: &Path, output: Option<&Path>) -> anyhow::Result<Vec<PathBuf>> {
    if output == Some(report) && !inputs.several {
        return usage(format!("the report would overwrite {}; choose another name", report.display()));
    }
    let paths = outputs(inputs, report)?;
    Ok(if inputs.several { paths.iter().map(|path| path.with_extension("html")).collect() } else { paths })
}

/// Refuses a report that cannot be written or would take the place of another file, before anything is computed.
pub(crate) fn check_report(report: Option<&PathBuf>, others: &[&Path]) -> anyhow::Result<()> {
    let Some(path) = report else { return Ok(()) };
    check_file(path)?;
    match others.iter().find(|other| **other == path || is_same_file(other, path)) {
        Some(other) => usage(format!("the report would overwrite {}; choose another name", other.display())),
        None => Ok(()),
    }
}

/// Writes a page; warns of images that are not in it, such as those of another size than their camera.
fn write_report(path: &Path, content: &Content, out: &Output) -> anyhow::Result<()> {
    let data = report(content).context("cannot make the report")?;
    for note in data.notes.iter().filter(|note| note.contains("images could not be read")) {
        out.warning(&format!("{}: {note}", path.display()));
    }
    let html = page(&data).context("cannot make the report")?;
    write_file(path, |file| file.write_all(html.as_bytes()))?;
    Ok(())
}

/// Writes the page of a localization that has just been made, of the scene in the file `input` with these images and masks.
pub(crate) fn write_localized(
    path: &Path,
    (input, file): (&Path, &SceneFile),
    images: &SceneImages,
    scene: &Scene,
    result: &SceneFile,
    out: &Output,
) -> anyhow::Result<()> {
    let title = title(input, file);
    let content = Content {
        title: &title,
        scene,
        images: Some(images),
        estimate: Some(result),
        truth: None,
        source: None,
        points: &result.points,
        scores: None,
    };
    write_report(path, &content, out)
}

/// Files of one scene, shown together: detections, estimates and ground truth may be in one or in several files.
pub(crate) struct Gathered {
    title: String,
    /// Frames and detections.
    pub scene: Scene,
    /// Their images.
    pub images: SceneImages,
    /// Times of the frames in seconds, if known.
    pub times: Vec<Option<f64>>,
    /// Points of the scene's surfaces, from the first file that has some.
    points: Vec<[f64; 3]>,
    /// The file with the estimates.
    pub estimate: Option<(PathBuf, SceneFile)>,
    /// The file with the ground truth.
    pub truth: Option<(PathBuf, SceneFile)>,
}

impl Gathered {
    /// Reads the files.
    pub(crate) fn read(paths: &[PathBuf]) -> anyhow::Result<Self> {
        let read = |path: &PathBuf| Ok((path.clone(), read_scene_file(path)?));
        Self::new(paths.iter().map(read).collect::<anyhow::Result<_>>()?)
    }

    /// Frames are taken from the first file with detections, rather from a scene than from a result, or the first with frames.
    pub(crate) fn new(files: Vec<(PathBuf, SceneFile)>) -> anyhow::Result<Self> {
        let first = |fits: &dyn Fn(&SceneFile) -> bool| files.iter().find(|(_, file)| fits(file));
        let estimate = first(&SceneFile::has_estimates).cloned();
        let truth = first(&|file| !file.objects.is_empty() && !file.has_estimates()).cloned();
        let cameras = first(&|file| !file.detections.is_empty() && !file.has_estimates())
            .or(first(&|file| !file.detections.is_empty()))
            .or(first(&|file| !file.frames.is_empty()));
        let Some((path, file)) = cameras.or(files.first()) else { bail!("there is no file to show") };
        for (other, second) in &files {
            if let (Some(a), Some(b)) = (&file.length_unit, &second.length_unit)
                && a != b
            {
                bail!("the length unit of {} is \"{a}\", that of {} is \"{b}\"", path.display(), other.display());
            }
        }
        for (path, file) in estimate.iter().chain(&truth) {
            file.to_objects().map_err(|error| error.in_file(path))?;
        }
        let named = estimate.as_ref().and_then(|(_, result)| with_identities(file, result));
        let scene = named.as_ref().unwrap_or(file).to_scene().map_err(|error| error.in_file(path))?;
        let images = file.to_images(path).map_err(|error| error.in_file(path))?;
        let times = file.frames.iter().map(|frame| frame.time).collect();
        let points = if file.points.is_empty() {
            first(&|file| !file.points.is_empty()).map(|(_, file)| file)
        } else {
            Some(file)
        };
        let points = points.map(|file| file.points.clone()).unwrap_or_default();
        Ok(Self { title: title(path, file), scene, images, times, points, estimate, truth })
    }

    /// What is shown.
    pub(crate) fn content<'a>(&'a self, scores: Option<&'a Scores>) -> Content<'a> {
        Content {
            title: &self.title,
            scene: &self.scene,
            images: Some(&self.images),
            estimate: self.estimate.as_ref().map(|(_, file)| file),
            truth: self.truth.as_ref().map(|(_, file)| file),
            source: None,
            points: &self.points,
            scores,
        }
    }

    /// Writes the report, with scores if the estimates and the ground truth share objects.
    pub(crate) fn write_report_with_scores(&self, path: &Path, out: &Output) -> anyhow::Result<()> {
        let evaluation = match (&self.estimate, &self.truth) {
            (Some((a, estimate)), Some((b, truth))) => evaluate_objects((a, estimate), (b, truth), Matching::Auto).ok(),
            _ => None,
        };
        self.write_report(path, evaluation.as_ref().map(|(evaluation, _)| evaluation), out)
    }

    /// Writes the page, with these scores.
    pub(crate) fn write_report(
        &self,
        path: &Path,
        evaluation: Option<&Evaluation>,
        out: &Output,
    ) -> anyhow::Result<()> {
        write_report(path, &self.content(evaluation.map(Scores::of).as_ref()), out)
    }
}

/// The scene with the identities that an association has found, where `result` has the same detections with their
/// objects and the scene names none.
fn with_identities(scene: &SceneFile, result: &SceneFile) -> Option<SceneFile> {
    let (given, found) = (&scene.detections, &result.detections);
    let is_same = given.len() == found.len()
        && given.iter().zip(found).all(|(a, b)| {
            a.object.is_none() && a.frame == b.frame && a.bounding_box == b.bounding_box && a.source == b.source
        });
    if !is_same || found.iter().all(|detection| detection.object.is_none()) {
        return None;
    }
    let mut named = scene.clone();
    for (detection, with_object) in named.detections.iter_mut().zip(found) {
        detection.object.clone_from(&with_object.object);
    }
    Some(named)
}

/// The title of a report: the name of the scene, or that of its file.
fn title(path: &Path, file: &SceneFile) -> String {
    let name = file.name.clone().filter(|name| !name.trim().is_empty());
    name.unwrap_or_else(|| path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned())
}
