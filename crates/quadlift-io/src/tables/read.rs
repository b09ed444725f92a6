//! From tables to a scene.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use parquet::column::page::Page;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::{Field, Row};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::columns::{CAMERAS, DETECTIONS, EXTRA, FRAMES, OBJECTS, SCENE, Table, VIEWS};
use super::values::{Cell, Type};
use crate::error::ReadError;
use crate::read::Import;
use crate::scene_file::{FORMAT, SceneFile, VERSION, ViewRecord};
use crate::wording::plain_words;

/// Reads the scene in a folder of tables, written by [`super::write_tables`] or another program: columns may be in any
/// order; optional columns and whole tables may be missing. Null and NaN (which pandas writes) are missing entries.
/// Unknown columns are ignored and named in the notes.
///
/// # Errors
/// [`ReadError`] with the table and the row, from 0, and when the scene is not valid.
pub fn read_tables(folder: &Path) -> Result<Import, ReadError> {
    let tables = [SCENE, CAMERAS, FRAMES, DETECTIONS, OBJECTS, VIEWS];
    if !tables.iter().any(|table| folder.join(table.file).is_file()) {
        let names = tables.map(|table| table.file).join(", ");
        return Err(ReadError::new(folder, format!("there are no tables; expected a folder with {names}")));
    }
    let mut unknown = BTreeSet::new();
    let header: Vec<Map<String, Value>> = read_table(folder, &SCENE, &mut unknown)?;
    let mut scene = scene_of(header, &folder.join(SCENE.file))?;
    scene.cameras = read_table(folder, &CAMERAS, &mut unknown)?;
    scene.frames = read_table(folder, &FRAMES, &mut unknown)?;
    scene.detections = read_table(folder, &DETECTIONS, &mut unknown)?;
    scene.objects = read_table(folder, &OBJECTS, &mut unknown)?;
    let views: Vec<ViewRow> = read_table(folder, &VIEWS, &mut unknown)?;
    let index_of: HashMap<String, usize> =
        scene.objects.iter().enumerate().map(|(index, object)| (object.id.clone(), index)).collect();
    for (row, ViewRow { object, view }) in views.into_iter().enumerate() {
        let index = index_of.get(&object).ok_or_else(|| {
            let problem = format!("\"{object}\" is not an id in {}", OBJECTS.file);
            ReadError::new(&folder.join(VIEWS.file), problem).in_entry(format!("row {row}: object"))
        })?;
        scene.objects[*index].view_residuals_px.push(view);
    }
    let missing = tables.iter().filter(|table| !folder.join(table.file).exists());
    let mut notes: Vec<String> =
        missing.map(|table| format!("there is no {}: its data is missing", table.file)).collect();
    if !unknown.is_empty() {
        let names = unknown.into_iter().collect::<Vec<_>>().join(", ");
        notes.push(format!("unknown columns were ignored: {names}"));
    }
    Import { scene, notes, is_scene: true, ..Import::default() }.checked(folder)
}

/// A row of the table of views.
#[derive(Debug, Deserialize)]
struct ViewRow {
    object: String,
    view: ViewRecord,
}

/// The scene without its records.
fn scene_of(mut rows: Vec<Map<String, Value>>, path: &Path) -> Result<SceneFile, ReadError> {
    if rows.len() > 1 {
        return Err(ReadError::new(path, format!("found {} rows, expected one", rows.len())));
    }
    let Some(header) = rows.pop() else { return Ok(SceneFile::default()) };
    let scene: SceneFile = deserialize(Value::Object(header), path, 0)?;
    if scene.format != FORMAT || scene.version != VERSION {
        let (format, version) = (&scene.format, scene.version);
        let problem = format!("found version {version} of \"{format}\", expected version {VERSION} of \"{FORMAT}\"");
        return Err(ReadError::new(path, problem));
    }
    Ok(scene)
}

/// The records of a table; none if there is no such file.
fn read_table<T: DeserializeOwned>(
    folder: &Path,
    table: &Table,
    unknown: &mut BTreeSet<String>,
) -> Result<Vec<T>, ReadError> {
    let path = folder.join(table.file);
    if !path.exists() {
        return Ok(Vec::new());
    }
    // The crate asserts what files that are damaged do not fulfil; nothing that is used later can be half changed.
    let records = catch_unwind(AssertUnwindSafe(|| read_records(&path, table, unknown)));
    records.unwrap_or_else(|_| Err(ReadError::new(&path, "cannot read the table: it is damaged")))
}

fn read_records<T: DeserializeOwned>(
    path: &Path,
    table: &Table,
    unknown: &mut BTreeSet<String>,
) -> Result<Vec<T>, ReadError> {
    let failed = |error: &dyn std::fmt::Display| {
        let mut problem = format!("cannot read the table: {error}");
        if problem.contains("Disabled feature") {
            problem.push_str(" (expected a table without compression, or compressed with Snappy)");
        }
        ReadError::new(path, problem)
    };
    let file = File::open(path).map_err(|error| failed(&error))?;
    let bytes = file.metadata().map_err(|error| failed(&error))?.len();
    let reader = SerializedFileReader::new(file).map_err(|error| failed(&error))?;
    check_counts(&reader, bytes).map_err(|problem| failed(&problem))?;
    let mut records = Vec::new();
    for (index, row) in reader.get_row_iter(None).map_err(|error| failed(&error))?.enumerate() {
        let row = row.map_err(|error| failed(&error))?;
        let record = record(table, row, unknown)
            .map_err(|(column, problem)| ReadError::new(path, problem).in_entry(format!("row {index}: {column}")))?;
        records.push(deserialize(Value::Object(record), path, index)?);
    }
    Ok(records)
}

/// Checks that a table of this many bytes can contain what it claims, before allocating memory for it.
fn check_counts(reader: &SerializedFileReader<File>, bytes: u64) -> Result<(), String> {
    // A row that differs from the last one takes a bit at least.
    let of_group = |group| u64::try_from(reader.metadata().row_group(group).num_rows()).unwrap_or(0);
    let rows = (0..reader.num_row_groups()).map(of_group).fold(0, u64::saturating_add);
    if rows > 8 * bytes {
        return Err(format!("it claims to have {rows} rows in {bytes} bytes"));
    }
    for group in 0..reader.num_row_groups() {
        // What cannot be read here is an error where the rows are read.
        let Ok(group) = reader.get_row_group(group) else { continue };
        for column in 0..group.num_columns() {
            let first = group.get_column_page_reader(column).and_then(|mut pages| pages.get_next_page());
            let Ok(Some(Page::DictionaryPage { buf, num_values, .. })) = first else { continue };
            if num_values as usize > buf.len() {
                let size = buf.len();
                return Err(format!("it claims to have a dictionary of {num_values} values in {size} bytes"));
            }
        }
    }
    Ok(())
}

/// The JSON of a row; an error names the column.
fn record(table: &Table, row: Row, unknown: &mut BTreeSet<String>) -> Result<Map<String, Value>, (String, String)> {
    let mut fields: HashMap<String, Field> = row.into_columns().into_iter().collect();
    let mut record = match fields.remove(EXTRA) {
        None | Some(Field::Null) => Map::new(),
        Some(Field::Str(text)) => serde_json::from_str(&text)
            .map_err(|error| (EXTRA.to_owned(), format!("expected a JSON object: {error}")))?,
        Some(other) => return Err((EXTRA.to_owned(), format!("found {other}, expected text"))),
    };
    for column in table.columns {
        let mut cells = Vec::new();
        for (name, kind) in column.in_file() {
            let field = fields.remove(name).unwrap_or(Field::Null);
            cells.push(cell(field, kind).map_err(|problem| (name.to_owned(), problem))?);
        }
        column.put(&cells, &mut record).map_err(|problem| (column.name.to_owned(), problem))?;
    }
    for name in fields.into_keys() {
        if !unknown.contains(&name) {
            unknown.insert(name);
        }
    }
    Ok(record)
}

/// The value of a field in the type of its column.
fn cell(field: Field, kind: Type) -> Result<Cell, String> {
    match (kind, &field) {
        (_, Field::Null) => Ok(Cell::Null),
        (Type::Text, Field::Str(text)) => Ok(Cell::Text(text.clone())),
        (Type::Bool, Field::Bool(b)) => Ok(Cell::Bool(*b)),
        (Type::Number | Type::Whole, _) => match number(&field) {
            Some(x) if x.is_nan() => Ok(Cell::Null),
            Some(x) if kind == Type::Number => Ok(Cell::Number(x)),
            // pandas makes floating point of whole numbers of which some are missing.
            Some(x) if x.fract() == 0.0 && x.abs() < 1e15 => Ok(Cell::Whole(x as i64)),
            _ => Err(format!(
                "found {field}, expected a {}",
                if kind == Type::Whole { "whole number" } else { "number" }
            )),
        },
        (Type::Numbers, Field::ListInternal(list)) => {
            let numbers: Option<Vec<f64>> = list.elements().iter().map(number).collect();
            numbers.map(Cell::Numbers).ok_or_else(|| format!("found {field}, expected a list of numbers"))
        }
        (Type::Texts, Field::ListInternal(list)) => {
            let text = |field: &Field| match field {
                Field::Str(text) => Some(text.clone()),
                _ => None,
            };
            let texts: Option<Vec<String>> = list.elements().iter().map(text).collect();
            texts.map(Cell::Texts).ok_or_else(|| format!("found {field}, expected a list of texts"))
        }
        (kind, field) => {
            let expected = match kind {
                Type::Text => "text",
                Type::Bool => "true or false",
                _ => "a list",
            };
            Err(format!("found {field}, expected {expected}"))
        }
    }
}

fn number(field: &Field) -> Option<f64> {
    Some(match field {
        Field::Double(x) => *x,
        Field::Float(x) => f64::from(*x),
        Field::Byte(n) => f64::from(*n),
        Field::Short(n) => f64::from(*n),
        Field::Int(n) => f64::from(*n),
        Field::UByte(n) => f64::from(*n),
        Field::UShort(n) => f64::from(*n),
        Field::UInt(n) => f64::from(*n),
        Field::Long(n) => *n as f64,
        Field::ULong(n) => *n as f64,
        _ => return None,
    })
}

fn deserialize<T: DeserializeOwned>(value: Value, path: &Path, row: usize) -> Result<T, ReadError> {
    serde_path_to_error::deserialize(value).map_err(|error| {
        let entry = match error.path().to_string() {
            place if place == "." => format!("row {row}"),
            place => format!("row {row}: {place}"),
        };
        ReadError::new(path, plain_words(&error.inner().to_string())).in_entry(entry)
    })
}
