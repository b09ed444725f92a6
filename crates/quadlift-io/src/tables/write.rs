//! From a scene to tables.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::parser::parse_message_type;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::columns::{CAMERAS, DETECTIONS, EXTRA, FRAMES, OBJECTS, SCENE, Table, VIEWS};
use super::values::{Cell, Type};
use crate::atomic::write_folder;
use crate::error::WriteError;
use crate::scene_file::{ObjectRecord, SceneFile};

/// Rows that are turned into columns at a time.
const ROWS: usize = 50_000;

/// Writes the tables of a scene into a new folder, as a whole or not at all. Gives the number of records of each kind.
///
/// # Errors
/// [`WriteError`] if the folder exists and is not empty, if the system reports an error, if a number is not finite, or
/// if two objects have the same id, because the residuals of their views would be ambiguous.
pub fn write_tables(folder: &Path, scene: &SceneFile) -> Result<Vec<(&'static str, usize)>, WriteError> {
    scene.to_objects().map_err(|error| WriteError::new(folder, error))?;
    if let Some(index) = scene.points.iter().position(|point| point.iter().any(|x| !x.is_finite())) {
        return Err(WriteError::new(
            Path::new(SCENE.file),
            format!("points[{index}] holds a number that is not finite"),
        ));
    }
    let header = header(scene);
    let views = scene.objects.iter().flat_map(|object| {
        object.view_residuals_px.iter().map(move |view| json!({ "object": object.id, "view": view }))
    });
    write_folder(folder, |folder| {
        write_table(folder, &SCENE, [&header].into_iter())?;
        write_table(folder, &CAMERAS, scene.cameras.iter())?;
        write_table(folder, &FRAMES, scene.frames.iter())?;
        write_table(folder, &DETECTIONS, scene.detections.iter())?;
        let objects = scene.objects.iter().map(|object| {
            // These have separate tables.
            ObjectRecord { view_residuals_px: Vec::new(), ..object.clone() }
        });
        write_table(folder, &OBJECTS, objects)?;
        write_table(folder, &VIEWS, views)
    })?;
    Ok(vec![
        ("camera", scene.cameras.len()),
        ("frame", scene.frames.len()),
        ("detection", scene.detections.len()),
        ("object", scene.objects.len()),
        ("view", scene.objects.iter().map(|object| object.view_residuals_px.len()).sum()),
    ])
}

/// The entries of the scene that are not lists of records.
fn header(scene: &SceneFile) -> Map<String, Value> {
    let mut header = scene.extra.clone();
    let entries = [
        ("format", json!(scene.format)),
        ("version", json!(scene.version)),
        ("name", json!(scene.name)),
        ("length_unit", json!(scene.length_unit)),
        ("notes", json!(scene.notes)),
        ("localization", json!(scene.localization)),
    ];
    header
        .extend(entries.into_iter().filter(|(_, value)| !value.is_null()).map(|(key, value)| (key.to_owned(), value)));
    // Points and sources are no columns: they are kept as JSON with the fields that have none.
    if !scene.points.is_empty() {
        header.insert("points".to_owned(), json!(scene.points));
    }
    header.extend(scene.point_cloud.as_ref().map(|cloud| ("point_cloud".to_owned(), json!(cloud))));
    if !scene.cue_sources.is_empty() {
        header.insert("cue_sources".to_owned(), json!(scene.cue_sources));
    }
    // A direction that is not finite becomes a list with null, which is refused later.
    header.extend(scene.up.map(|up| ("up".to_owned(), json!(up))));
    header
}

/// Writes one table into a folder.
pub(super) fn write_table<T: Serialize>(
    folder: &Path,
    table: &Table,
    records: impl Iterator<Item = T>,
) -> Result<(), WriteError> {
    let path = folder.join(table.file);
    let fail = |problem: String| WriteError::new(Path::new(table.file), problem);
    let failed = |error: ParquetError| fail(error.to_string());
    let types: Vec<(&str, Type)> =
        table.columns.iter().flat_map(|column| column.in_file()).chain([(EXTRA, Type::Text)]).collect();
    let schema = parse_message_type(&schema(&types)).map_err(failed)?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_created_by(concat!("quadlift ", env!("CARGO_PKG_VERSION")).to_owned());
    let file = File::create(&path).map_err(|error| fail(error.to_string()))?;
    let mut writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties.build())).map_err(failed)?;
    let mut columns: Vec<Vec<Cell>> = vec![Vec::new(); types.len()];
    let mut records = records.enumerate().peekable();
    while records.peek().is_some() {
        for (index, record) in records.by_ref().take(ROWS) {
            let cells = row(table, &record).map_err(|what| fail(format!("row {index}: {what}")))?;
            columns.iter_mut().zip(cells).for_each(|(column, cell)| column.push(cell));
        }
        write_row_group(&mut writer, &types, &columns).map_err(failed)?;
        columns.iter_mut().for_each(Vec::clear);
    }
    writer.close().map(drop).map_err(failed)
}

/// The cells of a record.
fn row(table: &Table, record: &impl Serialize) -> Result<Vec<Cell>, String> {
    let value = serde_json::to_value(record).map_err(|error| error.to_string())?;
    let Value::Object(mut rest) = value else { return Err("a record is not a JSON object".to_owned()) };
    let mut cells = Vec::with_capacity(table.columns.len() + 1);
    for column in table.columns {
        let taken = column.take(&mut rest);
        cells.extend(taken.ok_or_else(|| format!("\"{}\" holds a number that is not finite", column.name))?);
    }
    cells.push(if rest.is_empty() { Cell::Null } else { Cell::Text(Value::Object(rest).to_string()) });
    Ok(cells)
}

/// The schema in Parquet's language. Every column may be null.
fn schema(types: &[(&str, Type)]) -> String {
    let column = |(name, kind): &(&str, Type)| match kind {
        Type::Text => format!("OPTIONAL BYTE_ARRAY {name} (STRING);"),
        Type::Number => format!("OPTIONAL DOUBLE {name};"),
        Type::Whole => format!("OPTIONAL INT64 {name};"),
        Type::Bool => format!("OPTIONAL BOOLEAN {name};"),
        Type::Numbers => {
            format!("OPTIONAL GROUP {name} (LIST) {{ REPEATED GROUP list {{ REQUIRED DOUBLE element; }} }}")
        }
        Type::Texts => format!(
            "OPTIONAL GROUP {name} (LIST) {{ REPEATED GROUP list {{ REQUIRED BYTE_ARRAY element (STRING); }} }}"
        ),
    };
    format!("message scene {{ {} }}", types.iter().map(column).collect::<Vec<_>>().join(" "))
}

fn write_row_group(
    writer: &mut SerializedFileWriter<File>,
    types: &[(&str, Type)],
    columns: &[Vec<Cell>],
) -> Result<(), ParquetError> {
    let mut group = writer.next_row_group()?;
    for ((_, kind), cells) in types.iter().zip(columns) {
        let Some(column) = group.next_column()? else { break };
        write_column(column, *kind, cells)?;
    }
    group.close().map(drop)
}

/// Values without nulls, and Parquet's levels: how deep each one is defined (0: null; of a list 1: empty, 2: an entry) and
/// whether it continues a list (1).
#[derive(Debug, Default)]
struct Levels {
    definition: Vec<i16>,
    repetition: Vec<i16>,
}

impl Levels {
    fn scalar(&mut self, is_some: bool) {
        self.definition.push(i16::from(is_some));
        self.repetition.push(0);
    }

    fn list(&mut self, length: usize) {
        if length == 0 {
            self.definition.push(1);
            self.repetition.push(0);
        }
        for k in 0..length {
            self.definition.push(2);
            self.repetition.push(i16::from(k > 0));
        }
    }

    fn write<T: DataType>(&self, mut column: SerializedColumnWriter, values: &[T::T]) -> Result<(), ParquetError> {
        column.typed::<T>().write_batch(values, Some(&self.definition), Some(&self.repetition))?;
        column.close()
    }
}

fn write_column(column: SerializedColumnWriter, kind: Type, cells: &[Cell]) -> Result<(), ParquetError> {
    let mut levels = Levels::default();
    let (mut texts, mut numbers, mut wholes, mut bools) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for cell in cells {
        match cell {
            Cell::Numbers(list) => levels.list(list.len()),
            Cell::Texts(list) => levels.list(list.len()),
            cell => levels.scalar(*cell != Cell::Null),
        }
        match cell {
            Cell::Null => {}
            Cell::Text(text) => texts.push(ByteArray::from(text.as_str())),
            Cell::Number(x) => numbers.push(*x),
            Cell::Whole(n) => wholes.push(*n),
            Cell::Bool(b) => bools.push(*b),
            Cell::Numbers(list) => numbers.extend(list),
            Cell::Texts(list) => texts.extend(list.iter().map(|text| ByteArray::from(text.as_str()))),
        }
    }
    match kind {
        Type::Text | Type::Texts => levels.write::<ByteArrayType>(column, &texts),
        Type::Number | Type::Numbers => levels.write::<DoubleType>(column, &numbers),
        Type::Whole => levels.write::<Int64Type>(column, &wholes),
        Type::Bool => levels.write::<BoolType>(column, &bools),
    }
}
