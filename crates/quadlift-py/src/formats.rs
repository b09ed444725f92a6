//! Files of other programs: cameras and detections that are read, objects and cameras that are written. Formats and their
//! options are rows of tables in quadlift-io.

use std::fs::create_dir_all;
use std::path::{Path, PathBuf, absolute};

use pyo3::prelude::*;
use quadlift_io::correct::{DetectionPixels, correct};
use quadlift_io::formats::{detections, find_cameras, find_detections, poses};
use quadlift_io::python::{Correcting, in_python};
use quadlift_io::read::detections::{AddOptions, MatchBy, add_detections};
use quadlift_io::read::{DetectionFormat, Format, FormatOption, Import, READ, ReadOptions};
use quadlift_io::write::{BodyChoice, CheckedScene, Document, EXPORTS, ExportFormat, WRITE, WriteOptions, Writer};
use quadlift_io::{SceneFile, write_file};

use crate::error::{refuse, refuse_to_read};
use crate::loaded::Loaded;
use crate::options::{assumed, choice};

/// Options with their values as text; that of a flag is empty.
pub(crate) type Given = Vec<(String, String)>;

/// How detections are added to a scene.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct AddKeywords {
    source: Option<String>,
    min_score: Option<f64>,
    #[pyo3(item("match"))]
    matching: String,
    /// What the detections really are, as `--assume` has it.
    assume: String,
    replace: bool,
}

/// The names of the options of readers and of writers.
#[pyfunction]
pub(crate) fn format_options() -> (Vec<&'static str>, Vec<&'static str>) {
    (READ.iter().map(|row| row.name).collect(), WRITE.iter().map(|row| row.name).collect())
}

/// Sets options of a format; one that the format does not take is an error.
fn set<O: Default>(table: &[FormatOption<O>], given: &Given, format: &str, taken: &[&str]) -> PyResult<O> {
    let mut options = O::default();
    for (name, text) in given {
        let Some(row) = table.iter().find(|row| row.name == name && taken.contains(&row.name)) else {
            let known = if taken.is_empty() { "no options".to_owned() } else { taken.join(", ") };
            return Err(refuse(format!("{name} is not an option of the format \"{format}\", which has {known}")));
        };
        (row.set)(&mut options, text).map_err(|expected| refuse(format!("{name} is {text}; {expected}")))?;
    }
    Ok(options)
}

/// The format of this name.
fn format_of<F>(all: impl Iterator<Item = &'static Format<F>> + Clone, name: &str) -> PyResult<&'static Format<F>> {
    let known: Vec<String> = all.clone().map(|format| format!("\"{}\"", format.name)).collect();
    let found = all.into_iter().find(|format| format.name == name);
    found.ok_or_else(|| refuse(format!("format is \"{name}\"; expected one of {}", known.join(", "))))
}

/// Cameras and poses in a file or folder, recognized or of a given format; and what was left out.
pub(crate) fn read_cameras(
    path: &Path,
    format: Option<&str>,
    images: Option<&Path>,
    given: &Given,
) -> PyResult<(Loaded, Vec<String>)> {
    let (format, place) = match format {
        Some(name) => (format_of(poses(), name)?, path.to_owned()),
        None => find_cameras(path).map_err(refuse_to_read)?,
    };
    let options = set(READ, given, format.name, format.options)?;
    let Import { mut scene, image_folder, notes, is_scene, problems, problem_count } =
        (format.read)(&place, &options).map_err(refuse_to_read)?;
    if is_scene {
        return Ok((Loaded::new(scene, place)?, Vec::new()));
    }
    if scene.frames.is_empty() {
        return Err(refuse(format!("{}: no frames found; expected cameras with poses", path.display())));
    }
    if let Some(folder) = images {
        for image in scene.frames.iter_mut().filter_map(|frame| frame.image.as_mut()) {
            *image = absolute(folder.join(&*image)).map_err(refuse)?.display().to_string();
        }
    }
    scene.notes = Some(format!("Imported from {}: {}.", format.title, notes.join("; ")));
    let mut lost = problems;
    if problem_count > lost.len() {
        lost.push(format!("{} more problems", problem_count - lost.len()));
    }
    let lost = lost.iter().map(|problem| in_python(problem, Correcting::Reading)).collect();
    // A name beside the images, to whose folder theirs are relative.
    let place = image_folder.map_or_else(PathBuf::new, |folder| folder.join("scene.json"));
    Ok((Loaded::new(scene, place)?, lost))
}

/// A scene file with the detections in a file or folder too, corrected; and what was left out.
pub(crate) fn with_detections(
    mut file: SceneFile,
    path: &Path,
    format: Option<&str>,
    keywords: &AddKeywords,
    given: &Given,
) -> PyResult<(SceneFile, Vec<String>)> {
    let format = match format {
        Some(name) => format_of(detections(), name)?,
        None => find_detections(path).map_err(refuse_to_read)?,
    };
    let match_by = choice("match", &keywords.matching, &MatchBy::ALL.map(|by| (by.name(), by)))?;
    let (DetectionPixels { image_size, turned, frame_offset, boxes_follow }, corrections) =
        DetectionPixels::split(assumed(&keywords.assume)?);
    let options = ReadOptions { boxes_follow, ..set(READ, given, format.name, &taken_with_time(format))? };
    let found = (format.read)(path, &options).map_err(refuse_to_read)?;
    let of_format = AddOptions::of(format, &options);
    let adding = AddOptions {
        match_by,
        frame_offset,
        image_size,
        turned,
        source: keywords.source.as_deref().unwrap_or(of_format.source),
        min_score: keywords.min_score,
        replace: keywords.replace,
        ..of_format
    };
    let added = add_detections(&mut file, found, &adding).map_err(refuse_to_read)?;
    // Only the new detections are corrected.
    let new = file.detections.split_off(file.detections.len() - added.added);
    let kept = std::mem::replace(&mut file.detections, new);
    correct(&mut file, &corrections).map_err(refuse)?;
    file.detections.splice(0..0, kept);
    let mut lost = Vec::new();
    if added.in_no_frame > 0 {
        let (images, count) = (added.images_without_frame.len(), added.in_no_frame);
        let first = added.images_without_frame.first().map_or("", String::as_str);
        lost.push(format!("{count} detections are skipped: {images} images have no frame, such as \"{first}\""));
    }
    if added.empty > 0 {
        lost.push(format!("{} detections are skipped: their boxes have no width or no height", added.empty));
    }
    Ok((file, lost))
}

/// The options of a format of detections; that of time is for matching.
fn taken_with_time(format: &DetectionFormat) -> Vec<&'static str> {
    format.options.iter().copied().chain(["time_tolerance"]).collect()
}

/// Writes objects or cameras of a scene in a format of another program; what was converted, assumed and left out.
pub(crate) fn export(loaded: &Loaded, format: &str, output: &Path, given: &Given) -> PyResult<Vec<String>> {
    let rows: Vec<(&str, &ExportFormat)> = EXPORTS.iter().map(|row| (row.name, row)).collect();
    let format = choice("format", format, &rows)?;
    let options = WriteOptions { scene: loaded.path.clone(), ..set(WRITE, given, format.name, format.options)? };
    let file = loaded.file();
    let has_objects = !file.objects.is_empty();
    if !has_objects && matches!(format.write, Writer::Bodies(_) | Writer::Tables(_)) {
        return Err(refuse("the scene has no objects: there is nothing to export"));
    }
    let mut without_body = Vec::new();
    let documents: Vec<(PathBuf, Document)> = match &format.write {
        Writer::Bodies(write) => {
            let choice = if options.enclosing { BodyChoice::Enclosing } else { BodyChoice::Body };
            let checked = CheckedScene::new(file, choice).map_err(refuse)?.in_unit(options.length_unit.as_deref());
            if checked.bodies() == 0 {
                return Err(refuse("no object has a body: there is nothing to export"));
            }
            without_body = checked.without_body.clone();
            vec![(output.to_owned(), write(&checked, &options).map_err(refuse)?)]
        }
        Writer::Tables(write) => {
            let [objects, views] = write(file).map_err(refuse)?;
            if options.views.as_deref() == Some(output) {
                return Err(refuse(format!(
                    "views is {}, the file of the objects; expected another one",
                    output.display()
                )));
            }
            let second = options.views.clone().map(|path| (path, views));
            [Some((output.to_owned(), objects)), second].into_iter().flatten().collect()
        }
        Writer::Cameras(write) => vec![(output.to_owned(), write(file, &options).map_err(refuse)?)],
        Writer::CameraFolder(names, write) => {
            let documents = write(file).map_err(refuse)?;
            create_dir_all(output)
                .map_err(|error| refuse(format!("{}: the folder cannot be made: {error}", output.display())))?;
            names.iter().map(|name| output.join(name)).zip(documents).collect()
        }
    };
    let mut notes = Vec::new();
    for (path, document) in documents {
        loaded.check_output(&path)?;
        write_file(&path, |out| out.write_all(&document.content)).map_err(refuse)?;
        notes.extend(document.notes);
    }
    if !without_body.is_empty() {
        notes.push(format!("skipped without a body: {}", without_body.join(", ")));
    }
    Ok(notes.iter().map(|note| in_python(note, Correcting::Scene)).collect())
}
