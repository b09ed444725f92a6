//! Plain tables of boxes, one row each: CSV, or a list of JSON objects. The files of supervision's `CSVSink` and `JSONSink` are
//! such tables (`detection/tools/csv_sink.py` and `json_sink.py` of the package supervision).
//!
//! The first row names the columns: which image (`frame`, `image`, `time`, ...), the box (`x0, y0, x1, y1` or
//! `x, y, width, height`, ...), and optionally `score`, `category`, `track_id`. Without a header the columns are
//! `frame, x0, y0, x1, y1`, and `score` if there are six.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use super::files::{DetectionFiles, DetectionFormat};
use super::names::names;
use super::table::{Row, Table, TableOptions, has_box, is_column, table_options};
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::read::format::Format;
use crate::read::json::{Node, parse_json};
use crate::read::unread::known_but_unread;

/// The columns of a table that does not name them.
const COLUMNS: [&str; 6] = ["frame", "x0", "y0", "x1", "y1", "score"];

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "csv",
    title: "a CSV table",
    about: "A CSV table of boxes, such as that of supervision's CSVSink or JSONSink",
    looks: "CSV (names of columns, or 5 or 6 numbers)",
    options: &["frame_column", "class_names", "pixel_centers"],
    finds: |probe| {
        if probe.keys()?.has("x_min") {
            return probe.when(true);
        }
        let Some(line) = probe.line()? else { return Ok(None) };
        let is_score = |number: &Option<f64>| number.is_some_and(|score| (0.0..=1.0).contains(&score));
        probe.when(
            line.commas
                && match line.words.len() {
                    5.. if line.are_names() => has_box(&line.words) || known_but_unread(probe)?.is_none(),
                    5 => true,
                    6 => line.numbers().get(5).is_some_and(is_score),
                    _ => false,
                },
        )
    },
    read: |path, options| parse_csv(path, &read_bytes(path)?, &table_options(options, names(options)?.as_ref())),
};

/// The detections in the bytes of a table; the path serves for messages.
///
/// # Errors
/// [`ReadError`] with line or entry, what was found and what was expected.
pub(super) fn parse_csv(path: &Path, bytes: &[u8], options: &TableOptions) -> Result<DetectionFiles, ReadError> {
    let text = as_utf8(path, bytes)?;
    if text.trim_start().starts_with(['[', '{']) {
        let value = parse_json(path, bytes)?;
        return table_of(path, &Node::root(path, &value), options)?.detections(options);
    }
    table(path, text)?.detections(options)
}

/// A table by its text.
pub(super) fn table<'a>(path: &'a Path, text: &str) -> Result<Table<'a>, ReadError> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut table = Table { path, columns: Vec::new(), rows: Vec::new() };
    for record in reader.records() {
        let record = record.map_err(|error| {
            let line = error.position().map_or(0, |position| position.line());
            ReadError::new(path, format!("this is not valid CSV: {error}")).at(line as usize, 0)
        })?;
        let line = record.position().map_or(0, |position| position.line()) as usize;
        let error = |problem: String| ReadError::new(path, problem).at(line, 0);
        let cells: Vec<String> = record.iter().map(str::to_owned).collect();
        if table.columns.is_empty() {
            if cells.iter().skip(1).all(|cell| cell.parse::<f64>().is_err()) {
                table.columns = cells;
                continue;
            }
            if !(5..=6).contains(&cells.len()) {
                return Err(error(format!(
                    "found {} columns without names; expected names in the first line, or 5 or 6 columns: frame, x0, y0, \
                     x1, y1, score",
                    cells.len()
                )));
            }
            table.columns = COLUMNS.iter().take(cells.len()).map(|name| (*name).to_owned()).collect();
        }
        if cells.len() != table.columns.len() {
            return Err(error(format!("found {} columns; expected {}", cells.len(), table.columns.len())));
        }
        table.rows.push(Row { line: Some(line), entry: None, cells });
    }
    Ok(table)
}

/// How many columns that are not read a message may list.
const OTHER_COLUMNS: usize = 20;

/// A list of objects as a table, whose columns are the keys of the first one: those that are read, and the first of the
/// others for messages.
pub(super) fn table_of<'a>(path: &'a Path, root: &Node, options: &TableOptions) -> Result<Table<'a>, ReadError> {
    let mut table = Table { path, columns: Vec::new(), rows: Vec::new() };
    for (index, item) in root.items()?.iter().enumerate() {
        let members = item.object()?;
        if index == 0 {
            let (mut names, mut others) = (BTreeSet::new(), 0);
            for key in members.keys() {
                let is_read = is_column(key, options) && names.insert(key.trim().to_lowercase());
                others += usize::from(!is_read);
                if is_read || others <= OTHER_COLUMNS {
                    table.columns.push(key.clone());
                }
            }
        }
        let cell = |column: &String| match members.get(column) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
        };
        let mut cells: Vec<String> = table.columns.iter().map(cell).collect();
        let filled = cells.iter().rposition(|cell| !cell.is_empty()).map_or(0, |last| last + 1);
        cells.truncate(filled);
        cells.shrink_to_fit();
        table.rows.push(Row { line: None, entry: Some(format!("[{index}]")), cells });
    }
    Ok(table)
}
