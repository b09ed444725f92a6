//! Between the JSON of a record and the cells of its row.

use serde_json::{Map, Number, Value};

use super::columns::{Column, Kind};

/// The values of a column of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Null,
    Text(String),
    Number(f64),
    Whole(i64),
    Bool(bool),
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}

/// The type of a column of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Type {
    Text,
    Number,
    Whole,
    Bool,
    Numbers,
    Texts,
}

impl Column {
    /// Names and types of the columns of the file.
    pub(super) fn in_file(&self) -> Vec<(&'static str, Type)> {
        let one = |kind| vec![(self.name, kind)];
        match self.kind {
            Kind::Text | Kind::Json => one(Type::Text),
            Kind::Number => one(Type::Number),
            Kind::Whole => one(Type::Whole),
            Kind::Bool => one(Type::Bool),
            Kind::Texts => one(Type::Texts),
            Kind::Numbers | Kind::Rows(_) => one(Type::Numbers),
            Kind::Split(names) => names.iter().map(|name| (*name, Type::Number)).collect(),
        }
    }

    /// Takes the entry out of a record. `None` if it is not a value of this kind: a non-finite number, which is null in
    /// JSON.
    pub(super) fn take(&self, record: &mut Map<String, Value>) -> Option<Vec<Cell>> {
        let Some(value) = take(record, self.path) else { return Some(vec![Cell::Null; self.in_file().len()]) };
        let cell = match self.kind {
            Kind::Text => Cell::Text(value.as_str()?.to_owned()),
            Kind::Json => Cell::Text(value.to_string()),
            Kind::Number => Cell::Number(value.as_f64()?),
            Kind::Whole => Cell::Whole(value.as_i64()?),
            Kind::Bool => Cell::Bool(value.as_bool()?),
            Kind::Texts => {
                Cell::Texts(value.as_array()?.iter().map(|x| Some(x.as_str()?.to_owned())).collect::<Option<_>>()?)
            }
            Kind::Numbers => Cell::Numbers(numbers(&value)?),
            Kind::Rows(_) => Cell::Numbers(value.as_array()?.iter().map(numbers).collect::<Option<Vec<_>>>()?.concat()),
            Kind::Split(names) => {
                let numbers = numbers(&value)?;
                return (numbers.len() == names.len()).then(|| numbers.into_iter().map(Cell::Number).collect());
            }
        };
        Some(vec![cell])
    }

    /// Puts the entry that stands in these cells into a record; nothing where they are null.
    ///
    /// # Errors
    /// The expected value, as text.
    pub(super) fn put(&self, cells: &[Cell], record: &mut Map<String, Value>) -> Result<(), String> {
        let value = match (self.kind, cells) {
            (_, cells) if cells.iter().all(|cell| *cell == Cell::Null) => return Ok(()),
            (Kind::Json, [Cell::Text(text)]) => {
                serde_json::from_str(text).map_err(|error| format!("expected JSON: {error}"))?
            }
            (Kind::Text, [Cell::Text(text)]) => Value::from(text.as_str()),
            (Kind::Number, [Cell::Number(x)]) => number(*x)?,
            (Kind::Whole, [Cell::Whole(n)]) => Value::from(*n),
            (Kind::Bool, [Cell::Bool(b)]) => Value::from(*b),
            (Kind::Texts, [Cell::Texts(texts)]) => Value::from(texts.as_slice()),
            (Kind::Numbers, [Cell::Numbers(numbers)]) => list(numbers)?,
            (Kind::Rows(length), [Cell::Numbers(numbers)]) => {
                if numbers.len() % length != 0 {
                    return Err(format!("found {} numbers, expected rows of {length}", numbers.len()));
                }
                numbers.chunks(length).map(list).collect::<Result<Vec<_>, _>>()?.into()
            }
            (Kind::Split(names), cells) => {
                let numbers = cells.iter().map(|cell| match cell {
                    Cell::Number(x) => number(*x),
                    _ => Err(format!("expected numbers in all of {}, or in none", names.join(", "))),
                });
                numbers.collect::<Result<Vec<_>, _>>()?.into()
            }
            // The reader makes cells of the column's type.
            (_, _) => return Err("the value is of another type".to_owned()),
        };
        put(record, self.path, value)
    }
}

fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(Value::as_f64).collect()
}

fn number(x: f64) -> Result<Value, String> {
    Number::from_f64(x).map(Value::Number).ok_or_else(|| format!("found {x}, expected a finite number"))
}

fn list(numbers: &[f64]) -> Result<Value, String> {
    numbers.iter().map(|x| number(*x)).collect::<Result<Vec<_>, _>>().map(Value::from)
}

/// Removes what a path leads to, and the objects on the way that become empty.
fn take(record: &mut Map<String, Value>, path: &[&str]) -> Option<Value> {
    match path {
        [] => None,
        [key] => record.remove(*key),
        [key, rest @ ..] => {
            let inner = record.get_mut(*key)?.as_object_mut()?;
            let value = take(inner, rest)?;
            if inner.is_empty() {
                record.remove(*key);
            }
            Some(value)
        }
    }
}

/// Puts a value where a path leads to; makes the objects on the way.
fn put(record: &mut Map<String, Value>, path: &[&str], value: Value) -> Result<(), String> {
    match path {
        [] => Ok(()),
        [key] => {
            record.insert((*key).to_owned(), value);
            Ok(())
        }
        [key, rest @ ..] => {
            let inner = record.entry(*key).or_insert_with(|| Map::new().into());
            let inner = inner.as_object_mut().ok_or_else(|| format!("\"{key}\" in \"extra\" is not an object"))?;
            put(inner, rest, value)
        }
    }
}
