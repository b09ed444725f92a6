//! Detections in tables with named columns: what CSV files and lists of JSON objects share.

use std::path::Path;

use super::files::{ByImage, Detected, DetectionFiles, ImageKey, Numbering, Outline, checked_edges, edges_of_size};
use super::names::ClassNames;
use crate::error::ReadError;
use crate::read::options::ReadOptions;

/// Names of the columns of a box by its edges.
const EDGES: [[&str; 4]; 5] = [
    ["x_min", "y_min", "x_max", "y_max"],
    ["xmin", "ymin", "xmax", "ymax"],
    ["x0", "y0", "x1", "y1"],
    ["x1", "y1", "x2", "y2"],
    ["left", "top", "right", "bottom"],
];
/// Names of the columns of a box by its corner and its size.
const SIZES: [[&str; 4]; 4] = [
    ["x", "y", "w", "h"],
    ["x", "y", "width", "height"],
    ["left", "top", "width", "height"],
    ["bb_left", "bb_top", "bb_width", "bb_height"],
];
const SCORE: [&str; 3] = ["score", "confidence", "conf"];
const CATEGORY: [&str; 8] = ["class_name", "category", "label", "class", "name", "type", "class_id", "category_id"];
const TRACK: [&str; 5] = ["tracker_id", "track_id", "track", "object_id", "object"];
const IMAGE: [&str; 7] = ["image_path", "image_name", "file_name", "filename", "frame_name", "image", "path"];
const NUMBER: [&str; 6] = ["frame_number", "frame_index", "frame_idx", "frame_id", "frame", "image_id"];
const TIME: [&str; 3] = ["timestamp", "time", "seconds"];
/// supervision's column of the corners of a rotated box.
const CORNERS: &str = "xyxyxyxy";

/// Options that a table does not contain.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TableOptions<'a> {
    /// The column that identifies the image of a row by name, number or time; detected by its name when absent.
    pub frame_column: Option<&'a str>,
    /// Names of the classes.
    pub names: Option<&'a ClassNames>,
    /// Whether boxes may look reversed.
    pub boxes_follow: bool,
}

/// The options of a table.
pub(super) fn table_options<'a>(options: &'a ReadOptions, names: Option<&'a ClassNames>) -> TableOptions<'a> {
    TableOptions { frame_column: options.frame_column.as_deref(), names, boxes_follow: options.boxes_follow }
}

/// A row with its place in the file.
#[derive(Debug)]
pub(super) struct Row {
    /// Line of the file, where it has lines.
    pub line: Option<usize>,
    /// Entry of the file, where it has entries.
    pub entry: Option<String>,
    /// The cells in the order of the columns; those that are missing are empty, at the end of a row they may be left out.
    pub cells: Vec<String>,
}

/// A table as text.
#[derive(Debug)]
pub(super) struct Table<'a> {
    pub path: &'a Path,
    pub columns: Vec<String>,
    pub rows: Vec<Row>,
}

/// Whether a column with this name is used.
pub(super) fn is_column(name: &str, options: &TableOptions) -> bool {
    let is = |known: &str| name.trim().eq_ignore_ascii_case(known);
    let lists: [&[&str]; 6] = [&SCORE, &CATEGORY, &TRACK, &IMAGE, &NUMBER, &TIME];
    EDGES.iter().chain(&SIZES).flatten().chain(lists.into_iter().flatten()).any(|known| is(known))
        || is(CORNERS)
        || options.frame_column.is_some_and(is)
}

/// Whether columns with these names hold a box.
pub(super) fn has_box(names: &[String]) -> bool {
    let is = |known: &&str| names.iter().any(|name| name.eq_ignore_ascii_case(known));
    EDGES.iter().chain(&SIZES).any(|columns| columns.iter().all(is))
}

/// How a row identifies its image.
#[derive(Clone, Copy)]
enum KeyKind {
    Name,
    Number,
    Time,
}

impl Table<'_> {
    fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.trim().eq_ignore_ascii_case(name))
    }

    fn first_of(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.column(name))
    }

    fn four_of(&self, names: &[[&str; 4]]) -> Option<[usize; 4]> {
        let all = |four: &[&str; 4]| {
            let [a, b, c, d] = four.map(|name| self.column(name));
            Some([a?, b?, c?, d?])
        };
        names.iter().find_map(all)
    }

    fn error(&self, problem: String) -> ReadError {
        let columns: Vec<String> = self.columns.iter().take(20).map(|c| c.chars().take(40).collect()).collect();
        ReadError::new(self.path, format!("{problem}; the columns are {}", columns.join(", "))).at(1, 0)
    }

    /// The column of the images and how to read it.
    fn key(&self, options: &TableOptions) -> Result<(usize, KeyKind), ReadError> {
        let known = |index: usize| {
            let name = self.columns[index].trim().to_lowercase();
            match name.as_str() {
                name if TIME.contains(&name) => KeyKind::Time,
                name if NUMBER.contains(&name) => KeyKind::Number,
                _ => KeyKind::Name,
            }
        };
        match options.frame_column {
            Some(name) => {
                let index = self.column(name).ok_or_else(|| self.error(format!("there is no column \"{name}\"")))?;
                // A column of any name may hold numbers.
                let kind = known(index);
                Ok((index, if matches!(kind, KeyKind::Name) { KeyKind::Number } else { kind }))
            }
            None => {
                let found = self.first_of(&IMAGE).or(self.first_of(&NUMBER)).or(self.first_of(&TIME));
                let index = found.ok_or_else(|| {
                    let problem = "no column identifies the image of a row (\"frame\", \"image\" or \"time\"; \
                                   --frame-column NAME)";
                    self.error(problem.to_owned())
                })?;
                Ok((index, known(index)))
            }
        }
    }

    /// The detections of the rows.
    pub(super) fn detections(&self, options: &TableOptions) -> Result<DetectionFiles, ReadError> {
        let (key_column, key_kind) = self.key(options)?;
        let (box_columns, by_size) = match (self.four_of(&EDGES), self.four_of(&SIZES)) {
            (Some(columns), _) => (columns, false),
            (None, Some(columns)) => (columns, true),
            (None, None) => {
                return Err(self.error("no columns contain a box (x0, y0, x1, y1, or x, y, width, height)".to_owned()));
            }
        };
        let (score, category) = (self.first_of(&SCORE), self.first_of(&CATEGORY));
        let (track, corners) = (self.first_of(&TRACK), self.column(CORNERS));
        let mut found = ByImage::default();
        for row in &self.rows {
            let key = self.image_key(row, key_column, key_kind)?;
            let mut numbers = [0.0; 4];
            for (number, column) in numbers.iter_mut().zip(box_columns) {
                *number = self.number(row, column)?;
            }
            let edges = match by_size {
                true => edges_of_size(numbers),
                false if options.boxes_follow => Ok(numbers),
                false => checked_edges(numbers),
            };
            let edges = edges.map_err(|problem| self.row_error(row, problem))?;
            let text = |column: Option<usize>| Some(row.cells.get(column?)?.as_str()).filter(|text| !text.is_empty());
            let corners = text(corners).and_then(|text| serde_json::from_str::<[[f64; 2]; 4]>(text).ok());
            // The ids of trackers are whole, but some tables have them as 3.0; -1 means none.
            let id = text(track).map(|id| id.strip_suffix(".0").unwrap_or(id)).filter(|id| *id != "-1");
            found.image(key).detections.push(Detected {
                track: id.map(str::to_owned),
                category: text(category).map(|name| category_name(name, options.names)),
                score: match text(score) {
                    Some(_) => score.map(|column| self.number(row, column)).transpose()?,
                    None => None,
                },
                // The box of the corners is larger than the object.
                bounding_box: corners.is_none().then_some(edges),
                outline: corners.map_or(Outline::Unknown, Outline::OrientedBox),
                ..Detected::default()
            });
        }
        let name = |column: usize| self.columns[column].trim().to_owned();
        let mut columns: Vec<String> =
            [Some(key_column), score, category, track].into_iter().flatten().map(name).collect();
        columns.insert(1, box_columns.map(name).join(" "));
        Ok(DetectionFiles {
            path: self.path.to_owned(),
            images: found.images,
            numbering: Numbering::Unknown,
            notes: vec![format!("columns read: {}", columns.join(", "))],
            ..DetectionFiles::default()
        })
    }

    fn image_key(&self, row: &Row, column: usize, kind: KeyKind) -> Result<ImageKey, ReadError> {
        let cell = row.cells.get(column).map(String::as_str).unwrap_or_default();
        if cell.is_empty() {
            let name = &self.columns[column];
            return Err(self.row_error(row, format!("the column \"{name}\" is empty; expected the image of the row")));
        }
        let number = cell.strip_suffix(".0").unwrap_or(cell).parse().ok();
        Ok(match (kind, number) {
            (KeyKind::Time, _) => ImageKey { time: Some(self.number(row, column)?), ..ImageKey::default() },
            (KeyKind::Number, Some(number)) => ImageKey { number: Some(number), ..ImageKey::default() },
            _ => ImageKey { name: Some(cell.to_owned()), ..ImageKey::default() },
        })
    }

    fn number(&self, row: &Row, column: usize) -> Result<f64, ReadError> {
        let cell = row.cells.get(column).map(String::as_str).unwrap_or_default();
        cell.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| {
            let (name, shown) = (self.columns[column].trim(), cell.chars().take(40).collect::<String>());
            self.row_error(row, format!("the column \"{name}\" is \"{shown}\"; expected a number"))
        })
    }

    fn row_error(&self, row: &Row, problem: String) -> ReadError {
        let error = ReadError::new(self.path, problem).at(row.line.unwrap_or_default(), 0);
        match &row.entry {
            Some(entry) => error.in_entry(entry.clone()),
            None => error,
        }
    }
}

/// The name of a category: that of its number, where it is a number that has a name.
fn category_name(text: &str, names: Option<&ClassNames>) -> String {
    let named = |names: &ClassNames| names.of(text.parse().ok()?).map(str::to_owned);
    names.and_then(named).unwrap_or_else(|| text.to_owned())
}
