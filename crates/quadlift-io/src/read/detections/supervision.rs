//! supervision's `CSVSink` and `JSONSink`: a row for each detection, with the data that the user has added.
//!
//! The sinks do not write the image: one of the user's columns must identify it
//! (`custom_data={"frame_number": ...}`). Format: `detection/tools/csv_sink.py` and `json_sink.py` of the package
//! supervision.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use super::csv::table;
use super::files::{DetectionFiles, DetectionFormat};
use super::names::names;
use super::table::{Row, Table, TableOptions, is_column, table_options};
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::read::format::Format;
use crate::read::json::{Node, parse_json};

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "supervision",
    title: "supervision",
    about: "The file of supervision's CSVSink or JSONSink",
    looks: "supervision (a column x_min)",
    options: &["frame_column", "class_names", "pixel_centers"],
    finds: |probe| {
        let is_header = probe.line()?.is_some_and(|line| line.are_names() && line.have("x_min"));
        probe.when(is_header || probe.keys()?.has("x_min"))
    },
    read: |path, options| {
        parse_supervision(path, &read_bytes(path)?, &table_options(options, names(options)?.as_ref()))
    },
};

/// The detections in the bytes of such a file; the path serves for messages.
///
/// # Errors
/// [`ReadError`] with line or entry, what was found and what was expected.
pub(super) fn parse_supervision(
    path: &Path,
    bytes: &[u8],
    options: &TableOptions,
) -> Result<DetectionFiles, ReadError> {
    let text = as_utf8(path, bytes)?;
    if text.trim_start().starts_with(['[', '{']) {
        let value = parse_json(path, bytes)?;
        table_of(path, &Node::root(path, &value), options)?.detections(options)
    } else {
        table(path, text)?.detections(options)
    }
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
