//! JSON documents of other programs, with messages that name the entry.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use crate::error::ReadError;
use crate::input::as_utf8;
use crate::wording::plain_words;

/// The document in the bytes of a file.
pub(crate) fn parse_json(path: &Path, bytes: &[u8]) -> Result<Value, ReadError> {
    serde_json::from_str(as_utf8(path, bytes)?).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        let message = error.to_string();
        let message = message.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&message);
        ReadError::new(path, format!("this is not valid JSON: {}", plain_words(message))).at(line, column)
    })
}

/// A value with its place in the document.
#[derive(Debug, Clone)]
pub(crate) struct Node<'a> {
    path: &'a Path,
    entry: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    /// The outermost value.
    pub(crate) fn root(path: &'a Path, value: &'a Value) -> Self {
        Self { path, entry: String::new(), value }
    }

    /// A problem with this value.
    pub(crate) fn error(&self, problem: impl Into<String>) -> ReadError {
        let error = ReadError::new(self.path, problem);
        if self.entry.is_empty() { error } else { error.in_entry(self.entry.clone()) }
    }

    fn unexpected(&self, expected: &str) -> ReadError {
        let found = match self.value {
            Value::Object(_) => "an object {...}".to_owned(),
            Value::Array(list) => format!("a list of {}", list.len()),
            Value::String(text) => format!("the text \"{}\"", text.chars().take(40).collect::<String>()),
            other => other.to_string(),
        };
        self.error(format!("found {found}, expected {expected}"))
    }

    fn child(&self, step: &str, value: &'a Value) -> Self {
        let dot = if self.entry.is_empty() || step.starts_with('[') { "" } else { "." };
        Self { path: self.path, entry: format!("{}{dot}{step}", self.entry), value }
    }

    /// The members of an object without their places.
    pub(crate) fn object(&self) -> Result<&'a Map<String, Value>, ReadError> {
        self.value.as_object().ok_or_else(|| self.unexpected("an object {...}"))
    }

    /// Whether this is an object.
    pub(crate) fn is_object(&self) -> bool {
        self.value.is_object()
    }

    /// The members of an object.
    pub(crate) fn members(&self) -> Result<Vec<(&'a str, Self)>, ReadError> {
        Ok(self.object()?.iter().map(|(key, value)| (key.as_str(), self.child(key, value))).collect())
    }

    /// A member of an object, if present and not `null`.
    pub(crate) fn optional(&self, key: &str) -> Result<Option<Self>, ReadError> {
        let value = self.object()?.get(key).filter(|value| !value.is_null());
        Ok(value.map(|value| self.child(key, value)))
    }

    /// A member that must be there.
    pub(crate) fn member(&self, key: &str) -> Result<Self, ReadError> {
        self.optional(key)?.ok_or_else(|| self.error(format!("there is no \"{key}\"")))
    }

    /// The items of a list.
    pub(crate) fn items(&self) -> Result<Vec<Self>, ReadError> {
        let list = self.value.as_array().ok_or_else(|| self.unexpected("a list"))?;
        Ok(list.iter().enumerate().map(|(index, value)| self.child(&format!("[{index}]"), value)).collect())
    }

    pub(crate) fn number(&self) -> Result<f64, ReadError> {
        self.value.as_f64().ok_or_else(|| self.unexpected("a number"))
    }

    pub(crate) fn whole(&self) -> Result<u64, ReadError> {
        self.value.as_u64().ok_or_else(|| self.unexpected("a whole number"))
    }

    pub(crate) fn boolean(&self) -> Result<bool, ReadError> {
        self.value.as_bool().ok_or_else(|| self.unexpected("true or false"))
    }

    pub(crate) fn text(&self) -> Result<&'a str, ReadError> {
        self.value.as_str().ok_or_else(|| self.unexpected("text in quotes"))
    }

    /// Any number of numbers.
    pub(crate) fn list_of_numbers(&self) -> Result<Vec<f64>, ReadError> {
        self.items()?.iter().map(Self::number).collect()
    }

    /// A record.
    pub(crate) fn record<T: DeserializeOwned>(&self) -> Result<T, ReadError> {
        serde_path_to_error::deserialize(self.value).map_err(|error| {
            let entry = format!("{}.{}", self.entry, error.path());
            ReadError::new(self.path, plain_words(&error.inner().to_string())).in_entry(entry)
        })
    }

    /// Whether this is a list.
    pub(crate) fn is_list(&self) -> bool {
        self.value.is_array()
    }

    /// Text, or a number as text.
    pub(crate) fn word(&self) -> Result<String, ReadError> {
        match self.value {
            Value::String(text) => Ok(text.clone()),
            Value::Number(number) => Ok(number.to_string()),
            _ => Err(self.unexpected("text in quotes or a number")),
        }
    }

    /// Exactly `N` numbers.
    pub(crate) fn numbers<const N: usize>(&self) -> Result<[f64; N], ReadError> {
        let expected = || self.unexpected(&format!("a list of {N} numbers"));
        let list = self.value.as_array().filter(|list| list.len() == N).ok_or_else(expected)?;
        let mut numbers = [0.0; N];
        for (index, (number, value)) in numbers.iter_mut().zip(list).enumerate() {
            *number = self.child(&format!("[{index}]"), value).number()?;
        }
        Ok(numbers)
    }

    /// [`Self::three_rows`], or twelve numbers by rows.
    pub(crate) fn matrix(&self) -> Result<[[f64; 4]; 3], ReadError> {
        match self.numbers::<12>() {
            Ok([a, b, c, d, e, f, g, h, i, j, k, l]) => Ok([[a, b, c, d], [e, f, g, h], [i, j, k, l]]),
            Err(_) => self.three_rows(),
        }
    }

    /// Three rows of four numbers. A fourth row must be `[0, 0, 0, w]`; a matrix is known up to the factor w.
    pub(crate) fn three_rows(&self) -> Result<[[f64; 4]; 3], ReadError> {
        let items = self.items()?;
        if !(3..=4).contains(&items.len()) {
            return Err(self.unexpected("three or four rows of four numbers"));
        }
        let rows: [[f64; 4]; 3] = [items[0].numbers()?, items[1].numbers()?, items[2].numbers()?];
        let Some(last) = items.get(3) else { return Ok(rows) };
        match last.numbers()? {
            [0.0, 0.0, 0.0, w] if w != 0.0 => Ok(rows.map(|row| row.map(|x| x / w))),
            found => Err(last.error(format!("the last row is {found:?}; expected [0, 0, 0, 1], of a matrix by rows"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fourth_rows_are_checked() {
        let path = Path::new("a.json");
        let rows = |last: &str| {
            let text = format!("[[2, 0, 0, 4], [0, 2, 0, 6], [0, 0, 2, 8]{last}]");
            Node::root(path, &parse_json(path, text.as_bytes()).unwrap()).three_rows()
        };
        let given = [[2.0, 0.0, 0.0, 4.0], [0.0, 2.0, 0.0, 6.0], [0.0, 0.0, 2.0, 8.0]];
        assert_eq!(rows(""), Ok(given));
        assert_eq!(rows(", [0, 0, 0, 1]"), Ok(given));
        assert_eq!(rows(", [0, 0, 0, 2]"), Ok(given.map(|row| row.map(|x| 0.5 * x))));
        for wrong in [", [5, 5, 5, 7]", ", [0, 0, 0, 0]"] {
            let error = rows(wrong).unwrap_err().to_string();
            assert!(error.contains("a.json: [3]: the last row is ["), "{error}");
        }
    }

    #[test]
    fn messages_name_the_entry() {
        let path = Path::new("a.json");
        let value = parse_json(path, br#"{"a": [{"b": [1, "x"], "c": null}]}"#).unwrap();
        let root = Node::root(path, &value);
        let item = &root.member("a").unwrap().items().unwrap()[0];
        assert!(item.optional("c").unwrap().is_none());
        let message = |result: Result<[f64; 2], ReadError>| result.unwrap_err().to_string();
        let b = item.member("b").unwrap();
        assert_eq!(message(b.numbers()), "a.json: a[0].b[1]: found the text \"x\", expected a number");
        assert_eq!(
            b.numbers::<3>().unwrap_err().to_string(),
            "a.json: a[0].b: found a list of 2, expected a list of 3 numbers"
        );
        assert_eq!(root.member("z").unwrap_err().to_string(), "a.json: there is no \"z\"");
        assert_eq!(parse_json(path, b"{\n \"a\": NaN}").unwrap_err().line, Some(2));
    }
}
