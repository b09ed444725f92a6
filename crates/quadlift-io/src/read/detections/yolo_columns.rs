//! Infers the columns of YOLO label files from all of them, because the files do not declare them.
//!
//! The class is followed by coordinates from 0 to 1 (a box, the corners of a rotated box, or a polygon), then a score
//! from 0 to 1 if it was saved, then a track id from 1 if there is one. Five numbers after the class are therefore a
//! box with a score or an id, and an even number of them is a polygon, or a shorter polygon with both.

use crate::error::ReadError;
use crate::text::Line;

/// Maximum difference of opposite sides of a rotated box, as a fraction of the image size: the files have six digits.
const PARALLEL: f64 = 1e-4;

/// Coordinates after the class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum YoloKind {
    /// Boxes where no line has more than 6 numbers, oriented boxes where all begin with the corners of a parallelogram and
    /// have at most 10, polygons otherwise.
    #[default]
    Auto,
    /// Center, width and height.
    Box,
    /// Corners of a polygon.
    Polygon,
    /// The four corners of an oriented box.
    OrientedBox,
}

/// Columns after the coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum ExtraColumns {
    /// By the values: scores lie between 0 and 1, ids are whole numbers from 1.
    #[default]
    Auto,
    /// Nothing.
    None,
    /// A score.
    Score,
    /// A track id.
    Track,
    /// A score, then optionally a track id.
    ScoreAndTrack,
}

/// A line of a label file.
pub(super) struct LabelLine<'a> {
    pub line: Line<'a>,
    pub class: u64,
    /// The numbers after the class.
    pub values: Vec<f64>,
}

/// The parts of a line.
pub(super) struct Fields<'v> {
    pub coordinates: &'v [f64],
    pub score: Option<f64>,
    pub track: Option<u64>,
}

/// What the lines of all files hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Columns {
    pub kind: YoloKind,
    pub extra: ExtraColumns,
}

impl Columns {
    /// In words.
    pub(super) fn words(self) -> String {
        let coordinates = match self.kind {
            YoloKind::OrientedBox => "the corners of a rotated box",
            YoloKind::Polygon => "a polygon",
            YoloKind::Box | YoloKind::Auto => "a box",
        };
        let extra = match self.extra {
            ExtraColumns::Auto | ExtraColumns::None => "",
            ExtraColumns::Score => " and a score",
            ExtraColumns::Track => " and a track id",
            ExtraColumns::ScoreAndTrack => ", a score and a track id",
        };
        format!("each line has a class, {coordinates}{extra} (--kind, --columns)")
    }

    /// The coordinates, the score and the track id of a line.
    pub(super) fn split<'v>(self, line: &'v LabelLine) -> Result<Fields<'v>, ReadError> {
        let count = line.values.len();
        let extras = match self.kind {
            YoloKind::Box | YoloKind::Auto => count.checked_sub(4),
            YoloKind::OrientedBox => count.checked_sub(8),
            // Some files have boxes among their polygons.
            YoloKind::Polygon if count == 4 => Some(0),
            YoloKind::Polygon if count.is_multiple_of(2) => {
                Some(if self.extra == ExtraColumns::ScoreAndTrack { 2 } else { 0 })
            }
            YoloKind::Polygon => Some(1),
        };
        let most = match self.extra {
            ExtraColumns::None | ExtraColumns::Auto => 0,
            ExtraColumns::Score | ExtraColumns::Track => 1,
            ExtraColumns::ScoreAndTrack => 2,
        };
        let Some(extras) = extras.filter(|&extras| extras <= most.min(count)) else {
            return Err(line.line.error(format!("found {count} numbers after the class; but {}", self.words())));
        };
        let (coordinates, rest) = line.values.split_at(count - extras);
        let (score, track) = match (rest, self.extra) {
            ([track], ExtraColumns::Track) => (None, Some(track)),
            ([score], _) => (Some(score), None),
            ([score, track], _) => (Some(score), Some(track)),
            _ => (None, None),
        };
        if let Some(score) = score.filter(|score| !(0.0..=1.0).contains(*score)) {
            return Err(line.line.error(format!("the score is {score}; expected a number from 0 to 1")));
        }
        let track = match track {
            Some(track) if track.fract() == 0.0 && (0.0..1e15).contains(track) => Some(*track as u64),
            Some(track) => return Err(line.line.error(format!("the track id is {track}; expected a whole number"))),
            None => None,
        };
        Ok(Fields { coordinates, score: score.copied(), track })
    }
}

/// The columns of these lines. Values other than [`YoloKind::Auto`] or [`ExtraColumns::Auto`] are used as given.
pub(super) fn columns(lines: &[LabelLine], kind: YoloKind, extra: ExtraColumns) -> Result<Columns, ReadError> {
    let counts = || lines.iter().map(|line| line.values.len());
    if kind == YoloKind::Auto
        && let [first, _, _, ..] = lines
        && first.values.len() > 10
        && counts().all(|n| n == first.values.len())
    {
        let count = first.values.len();
        let problem = format!(
            "every line has {count} numbers after the class, which looks like a box and keypoints; keypoints are not \
             supported (--kind polygon if the lines are polygons)"
        );
        return Err(first.line.error(problem));
    }
    let kind = match kind {
        YoloKind::Auto if counts().all(|n| n <= 6) => YoloKind::Box,
        YoloKind::Auto if are_oriented_boxes(lines) => YoloKind::OrientedBox,
        YoloKind::Auto => YoloKind::Polygon,
        kind => kind,
    };
    let extra = if extra == ExtraColumns::Auto { extra_columns(lines, kind)? } else { extra };
    Ok(Columns { kind, extra })
}

/// Whether all lines have 8 to 10 numbers, of which the first 8 are the corners of parallelograms, some of them turned.
fn are_oriented_boxes(lines: &[LabelLine]) -> bool {
    let is_zero = |x: f64| x.abs() < PARALLEL;
    let is_parallelogram = |line: &LabelLine| match line.values.as_slice() {
        [ax, ay, bx, by, cx, cy, dx, dy, rest @ ..] if rest.len() <= 2 => {
            is_zero(ax + cx - bx - dx) && is_zero(ay + cy - by - dy)
        }
        _ => false,
    };
    let is_turned = |line: &LabelLine| match line.values.as_slice() {
        [ax, ay, bx, by, ..] => !is_zero(ax - bx) && !is_zero(ay - by),
        _ => false,
    };
    lines.iter().all(is_parallelogram) && lines.iter().any(is_turned)
}

fn extra_columns(lines: &[LabelLine], kind: YoloKind) -> Result<ExtraColumns, ReadError> {
    let last = |line: &LabelLine| line.values.last().copied().unwrap_or_default();
    let is_polygon = kind == YoloKind::Polygon;
    let base = if kind == YoloKind::OrientedBox { 8 } else { 4 };
    // No coordinate is 2 or more.
    let has_both = |line: &LabelLine| match is_polygon {
        true => line.values.len().is_multiple_of(2) && last(line) >= 2.0,
        false => line.values.len() == base + 2,
    };
    if lines.iter().any(has_both) {
        return Ok(ExtraColumns::ScoreAndTrack);
    }
    let has_one =
        |line: &&LabelLine| if is_polygon { line.values.len() % 2 == 1 } else { line.values.len() == base + 1 };
    let ones: Vec<&LabelLine> = lines.iter().filter(has_one).collect();
    if ones.is_empty() {
        return Ok(ExtraColumns::None);
    }
    if ones.iter().any(|line| last(line) > 1.0) {
        return Ok(ExtraColumns::Track);
    }
    if ones.iter().any(|line| last(line).fract() != 0.0) {
        return Ok(ExtraColumns::Score);
    }
    let problem = "the last number of every line is 0 or 1: a score, or the id of the only track? Choose with \
         --columns score or --columns track";
    Err(ones[0].line.error(problem))
}
