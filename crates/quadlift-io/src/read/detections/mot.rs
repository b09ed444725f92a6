//! MOTChallenge: lines `frame, id, left, top, width, height, confidence, ...`, of detectors, trackers and the ground
//! truth.
//!
//! Frames and ids count from 1, and so do pixels: the first one has the left edge 1, which becomes 0. Format:
//! the devkit of motchallenge.net and "MOT16: A Benchmark for Multi-Object Tracking" (Milan et al., 2016), section 3.3.

use std::path::{Path, PathBuf};

use super::files::{ByImage, Detected, DetectionFiles, DetectionFormat, ImageKey, Numbering, edges_of_size};
use super::names::{ClassNames, names};
use super::yolo;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::read::format::Format;
use crate::read::options::ReadOptions;
use crate::read::probe::Words;
use crate::text::{Line, lines};

/// Where the files of a sequence lie.
const PLACES: [&str; 2] = ["gt/gt.txt", "det/det.txt"];

/// The classes of the ground truth, from 1.
const CLASSES: [&str; 13] = [
    "pedestrian",
    "person on vehicle",
    "car",
    "bicycle",
    "motorbike",
    "non motorized vehicle",
    "static person",
    "distractor",
    "occluder",
    "occluder on the ground",
    "occluder full",
    "reflection",
    "crowd",
];

/// What the columns after the box mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum MotKind {
    /// Those of the ground truth, where there are nine of them, all confidences are 0 or 1 and all visibilities in
    /// [0, 1]; those of a tracker otherwise.
    #[default]
    Auto,
    /// Confidence, then a position in space (unused).
    Detections,
    /// A flag (0: to be ignored), class, visibility.
    GroundTruth,
    /// Confidence and class: boxmot's files.
    Classes,
}

/// Options that a file does not contain.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MotOptions<'a> {
    /// What the columns after the box mean.
    pub kind: MotKind,
    /// Whether the first pixel has the left edge 0, as written by many trackers, instead of 1.
    pub boxes_from_zero: bool,
    /// Names of the classes.
    pub names: Option<&'a ClassNames>,
}

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "mot",
    title: "MOTChallenge",
    about: "MOTChallenge: detections, tracks or ground truth",
    looks: "MOTChallenge (7 to 10 numbers between commas, or gt/gt.txt)",
    options: &["columns", "box_origin", "class_names"],
    finds: |probe| {
        if let Some(folder) = probe.folder() {
            return probe.when(PLACES.iter().any(|place| folder.join(place).is_file()));
        }
        let is_row = |line: &Words| (7..=10).contains(&line.words.len()) && line.are_numbers();
        probe.when(probe.line()?.is_some_and(|line| is_row(line) && !yolo::is_label(line)))
    },
    read: |path, options| {
        let kinds = [("det", MotKind::Detections), ("gt", MotKind::GroundTruth), ("class", MotKind::Classes)];
        let kind = ReadOptions::choice(path, ("columns", options.columns.as_ref()), &kinds)?;
        let boxes_from_zero = options.boxes_from_zero;
        read_mot(path, &MotOptions { kind, boxes_from_zero, names: names(options)?.as_ref() })
    },
};

/// Reads a file, or the `gt/gt.txt` or `det/det.txt` in the folder of a sequence that has one of them.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
pub(super) fn read_mot(path: &Path, options: &MotOptions) -> Result<DetectionFiles, ReadError> {
    let path = if path.is_dir() { file_in(path)? } else { path.to_owned() };
    parse_mot(&path, &read_bytes(&path)?, options)
}

/// The only file of a sequence.
fn file_in(folder: &Path) -> Result<PathBuf, ReadError> {
    let found: Vec<&str> = PLACES.into_iter().filter(|place| folder.join(place).is_file()).collect();
    match found.as_slice() {
        [place] => Ok(folder.join(place)),
        [] => Err(ReadError::new(folder, format!("expected a file, or a folder with {}", PLACES.join(" or ")))),
        several => Err(ReadError::new(folder, format!("the folder has {}; name one of them", several.join(" and ")))),
    }
}

/// A line as numbers.
struct Row<'a> {
    line: Line<'a>,
    numbers: Vec<f64>,
}

impl Row<'_> {
    fn column(&self, index: usize) -> Option<f64> {
        self.numbers.get(index).copied()
    }

    /// The whole number in a column; `what` is expected there.
    fn whole(&self, index: usize, what: &str) -> Result<i64, ReadError> {
        let number = self.numbers[index];
        if number.fract() != 0.0 || number.abs() > 1e15 {
            return Err(self.line.error(format!("column {} is {number}; expected {what}, a whole number", index + 1)));
        }
        Ok(number as i64)
    }
}

/// The detections in the bytes of a file; the path serves for messages.
///
/// # Errors
/// As [`read_mot`].
pub(super) fn parse_mot(path: &Path, bytes: &[u8], options: &MotOptions) -> Result<DetectionFiles, ReadError> {
    let text = as_utf8(path, bytes)?;
    let content = lines(path, text).filter(|line| !line.is_blank_or_comment());
    let rows = content.map(row).collect::<Result<Vec<_>, _>>()?;
    let kind = match options.kind {
        MotKind::Auto => kind_of(&rows),
        kind => kind,
    };
    let origin = if options.boxes_from_zero { 0.0 } else { 1.0 };
    let (mut found, mut ignored, mut first) = (ByImage::default(), 0, 1);
    for row in &rows {
        let number = row.whole(0, "the number of a frame")?;
        if number < 0 {
            return Err(row.line.error(format!("the number of the frame is {number}; expected 0 or more")));
        }
        first = first.min(number);
        let image = found.image(ImageKey { number: Some(number), ..ImageKey::default() });
        let confidence = row.column(6);
        if kind == MotKind::GroundTruth && confidence == Some(0.0) {
            ignored += 1;
            continue;
        }
        let track = row.whole(1, "an id")?;
        let size = [row.numbers[2] - origin, row.numbers[3] - origin, row.numbers[4], row.numbers[5]];
        // With ten columns a position in space takes the place of class and visibility (MOT15).
        let has_class = kind != MotKind::Detections && (8..=9).contains(&row.numbers.len());
        let class = if has_class { Some(row.whole(7, "the number of a class")?) } else { None };
        image.detections.push(Detected {
            track: (track >= 0).then(|| track.to_string()),
            category: class.map(|class| class_name(class, kind, options.names)),
            // A confidence of -1 means none.
            score: confidence.filter(|score| *score != -1.0 && kind != MotKind::GroundTruth),
            bounding_box: Some(edges_of_size(size).map_err(|problem| row.line.error(problem))?),
            visible_fraction: row
                .column(8)
                .filter(|visible| kind == MotKind::GroundTruth && has_class && (0.0..=1.0).contains(visible)),
            ..Detected::default()
        });
    }
    let columns = match kind {
        MotKind::GroundTruth => "ground truth: the columns after the box are flag, class and visibility",
        MotKind::Classes => "the columns after the box are confidence and class",
        MotKind::Detections | MotKind::Auto => "the column after the box is the confidence",
    };
    let edges = match options.boxes_from_zero {
        true => "left and top edges of boxes count from 0",
        false => "left and top edges of boxes count from 1: 1 was subtracted (--box-origin 0 keeps them)",
    };
    let mut notes = vec![format!("{columns} (--columns)"), edges.to_owned()];
    if ignored > 0 {
        notes.push(format!("{ignored} boxes with the flag 0 were skipped"));
    }
    Ok(DetectionFiles {
        path: path.to_owned(),
        images: found.images,
        numbering: Numbering::From(first),
        notes,
        ..DetectionFiles::default()
    })
}

fn row(line: Line) -> Result<Row, ReadError> {
    let numbers = line.numbers_between_commas()?;
    if !(6..=10).contains(&numbers.len()) {
        return Err(line.error(format!(
            "found {} columns; expected 6 to 10: frame, id, left, top, width, height, confidence, ...",
            numbers.len()
        )));
    }
    Ok(Row { line, numbers })
}

/// What the columns say of themselves.
fn kind_of(rows: &[Row]) -> MotKind {
    let columns = |count: usize| rows.iter().all(|row| row.numbers.len() == count);
    let all = |index: usize, is: fn(f64) -> bool| rows.iter().all(|row| row.column(index).is_some_and(is));
    if columns(9) && all(6, |flag| flag == 0.0 || flag == 1.0) && all(8, |visible| (0.0..=1.0).contains(&visible)) {
        MotKind::GroundTruth
    } else if (columns(8) || columns(9)) && all(7, |class| class >= 0.0 && class.fract() == 0.0) {
        MotKind::Classes
    } else {
        MotKind::Detections
    }
}

fn class_name(class: i64, kind: MotKind, names: Option<&ClassNames>) -> String {
    let of_benchmark = || {
        let index = usize::try_from(class.checked_sub(1)?).ok()?;
        CLASSES.get(index).filter(|_| kind == MotKind::GroundTruth).map(|name| (*name).to_owned())
    };
    let given = names.and_then(|names| names.of(u64::try_from(class).ok()?));
    given.map(str::to_owned).or_else(of_benchmark).unwrap_or_else(|| class.to_string())
}
