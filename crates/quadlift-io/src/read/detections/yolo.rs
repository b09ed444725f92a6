//! Ultralytics YOLO: a text file for each image, a line `class x y width height` (or a polygon, or the corners of a
//! rotated box) for each object, as `predict` and `track` save them and as data sets have them.
//!
//! Coordinates are shares of the image's width and height, from its corner. Format: `Results.save_txt` of the package
//! ultralytics.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

pub(crate) use super::yolo_columns::{ExtraColumns, YoloKind};

use super::files::{
    Detected, DetectedImage, DetectionFiles, DetectionFormat, ImageKey, LabelFile, Numbering, Outline, label_files,
};
use super::names::{ClassNames, names, read_names, unnamed_classes};
use super::yolo_columns::{Fields, LabelLine, columns};
use crate::error::ReadError;
use crate::input::as_utf8;
use crate::read::format::Format;
use crate::read::options::ReadOptions;
use crate::read::probe::{Words, is_description};
use crate::text::lines;

/// Files with class names, beside the labels or in one of two parent folders.
const NAMES: [&str; 5] = ["data.yaml", "dataset.yaml", "classes.txt", "obj.names", "_darknet.labels"];

/// Whether a line holds a class and coordinates, which come before a score or an id.
pub(super) fn is_label(line: &Words) -> bool {
    let is_share = |number: &Option<f64>| number.is_some_and(|x| (-0.5..=1.5).contains(&x));
    !line.commas && line.words.len() >= 5 && line.are_numbers() && line.numbers()[1..5].iter().all(is_share)
}

/// Whether a line holds a class and the numbers of a box, which may be pixels: no other format has such lines.
fn is_box(line: &Words) -> bool {
    let is_class = |number: &Option<f64>| number.is_some_and(|class| class >= 0.0 && class.fract() == 0.0);
    !line.commas && (5..=6).contains(&line.words.len()) && line.are_numbers() && is_class(&line.numbers()[0])
}

/// What may stand after the coordinates, by the values of `--columns`.
const COLUMNS: [(&str, ExtraColumns); 4] = [
    ("none", ExtraColumns::None),
    ("score", ExtraColumns::Score),
    ("track", ExtraColumns::Track),
    ("score+track", ExtraColumns::ScoreAndTrack),
];

/// Coordinates may lie this far outside of the image, as a share of its size.
const OUTSIDE: f64 = 0.5;

/// Options that the files do not contain.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct YoloOptions<'a> {
    /// Coordinates after the class.
    pub kind: YoloKind,
    /// Columns after the coordinates.
    pub extra: ExtraColumns,
    /// Class names; if absent, they are searched for beside the labels.
    pub names: Option<&'a ClassNames>,
}

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "yolo",
    title: "YOLO",
    about: "Ultralytics YOLO: label files with boxes, polygons or rotated boxes, and track ids",
    looks: "YOLO (a folder of .txt with a class and numbers from 0 to 1)",
    options: &["kind", "columns", "class_names"],
    finds: |probe| match probe.labels("txt")? {
        Some(first) => probe.when(first.line()?.is_some_and(|line| is_label(line) || is_box(line))),
        None => Ok(None),
    },
    read: |path, options| {
        let shapes = [("box", YoloKind::Box), ("polygon", YoloKind::Polygon), ("obb", YoloKind::OrientedBox)];
        let kind = ReadOptions::choice(path, ("kind", options.kind.as_ref()), &shapes)?;
        let extra = ReadOptions::choice(path, ("columns", options.columns.as_ref()), &COLUMNS)?;
        read_yolo(path, &YoloOptions { kind, extra, names: names(options)?.as_ref() })
    },
};

/// Reads a label file, or those of a folder (or of its `labels`) and the folders in it.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
pub(super) fn read_yolo(path: &Path, options: &YoloOptions) -> Result<DetectionFiles, ReadError> {
    let labels = path.join("labels");
    let path = if labels.is_dir() { &labels } else { path };
    let mut files = label_files(path, "txt")?;
    files.retain(|file| !NAMES.iter().any(|name| file.path.ends_with(name)) && !is_description(&file.path));
    let found = match options.names {
        Some(_) => None,
        None => {
            let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
            let places = folder.ancestors().take(3).flat_map(|folder| NAMES.map(|name| folder.join(name)));
            places.into_iter().find(|place| place.is_file())
        }
    };
    let names = found.as_deref().map(read_names).transpose()?;
    let mut labels = parse_yolo(path, &files, &YoloOptions { names: options.names.or(names.as_ref()), ..*options })?;
    if let Some(found) = found {
        labels.notes.push(format!("class names: {}", found.display()));
    }
    Ok(labels)
}

/// The detections in label files; the path is that of their folder and serves for messages.
///
/// # Errors
/// As [`read_yolo`].
pub(super) fn parse_yolo(path: &Path, files: &[LabelFile], options: &YoloOptions) -> Result<DetectionFiles, ReadError> {
    let mut all_lines = Vec::new();
    let mut ends = Vec::new();
    let (mut repeated, mut unnamed) = (0, BTreeMap::new());
    for file in files {
        // A file without text is an image without objects.
        if !file.bytes.trim_ascii().is_empty() {
            let mut seen = HashSet::new();
            let text = as_utf8(&file.path, &file.bytes)?;
            for line in lines(&file.path, text).filter(|line| !line.is_blank_or_comment()) {
                if seen.insert(line.text) {
                    let mut fields = line.fields();
                    let class = fields.whole("the number of a class")?;
                    let values = fields.numbers_left("a coordinate")?;
                    all_lines.push(LabelLine { line, class, values });
                } else {
                    repeated += 1;
                }
            }
        }
        ends.push(all_lines.len());
    }
    let columns = columns(&all_lines, options.kind, options.extra)?;
    let mut images = Vec::new();
    let mut start = 0;
    for (file, end) in files.iter().zip(ends) {
        let mut detections = Vec::new();
        for line in &all_lines[start..end] {
            let Fields { coordinates, score, track } = columns.split(line)?;
            check_coordinates(line, coordinates)?;
            let (bounding_box, outline) = shape(line, coordinates, columns.kind)?;
            let name = options.names.and_then(|names| names.of(line.class));
            if name.is_none() && options.names.is_some() {
                *unnamed.entry(line.class).or_insert(0) += 1;
            }
            detections.push(Detected {
                track: track.map(|id| id.to_string()),
                category: Some(name.map_or_else(|| line.class.to_string(), str::to_owned)),
                score,
                bounding_box,
                outline,
                ..Detected::default()
            });
        }
        start = end;
        images
            .push(DetectedImage { key: ImageKey { name: Some(file.name.clone()), ..ImageKey::default() }, detections });
    }
    let mut notes = vec![columns.words()];
    if repeated > 0 {
        notes.push(format!("{repeated} duplicate lines were ignored: a run may have been repeated"));
    }
    notes.extend(unnamed_classes(&unnamed));
    if options.names.is_none() {
        notes.push("the class names are unknown: category numbers are used (--class-names FILE)".to_owned());
    }
    Ok(DetectionFiles { path: path.to_owned(), images, normalized: true, numbering: Numbering::OfNames, notes })
}

fn check_coordinates(line: &LabelLine, coordinates: &[f64]) -> Result<(), ReadError> {
    let outside = |x: &f64| !(-OUTSIDE..=1.0 + OUTSIDE).contains(x);
    match coordinates.iter().position(outside) {
        Some(index) => Err(line.line.error(format!(
            "coordinate {} is {}; expected a fraction of image width or height, from 0 to 1",
            index + 1,
            coordinates[index]
        ))),
        None => Ok(()),
    }
}

/// Box and outline of the coordinates of a line.
fn shape(line: &LabelLine, coordinates: &[f64], kind: YoloKind) -> Result<(Option<[f64; 4]>, Outline), ReadError> {
    match *coordinates {
        [x, y, width, height] => {
            if width < 0.0 || height < 0.0 {
                return Err(line
                    .line
                    .error(format!("width and height are {width} and {height}; expected positive ones")));
            }
            let edges = [x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height];
            Ok((Some(edges), Outline::Unknown))
        }
        [ax, ay, bx, by, cx, cy, dx, dy] if kind == YoloKind::OrientedBox => {
            Ok((None, Outline::OrientedBox([[ax, ay], [bx, by], [cx, cy], [dx, dy]])))
        }
        _ if coordinates.len() >= 6 && coordinates.len().is_multiple_of(2) => {
            Ok((None, Outline::Polygons(vec![coordinates.to_vec()])))
        }
        _ => {
            let count = coordinates.len();
            Err(line.line.error(format!("found {count} coordinates; expected 4 of a box, or at least 3 points")))
        }
    }
}
