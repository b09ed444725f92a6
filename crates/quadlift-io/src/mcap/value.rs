//! The content of a message, whatever its encoding: a tree of named fields.

use std::fmt;
use std::sync::Arc;

/// A value of a message.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// A number, or `true` (1) and `false` (0). Whole numbers beyond 2^53 are [`Value::Whole`].
    Number(f64),
    /// A whole number.
    Whole(i64),
    /// A text.
    Text(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// A list.
    List(Vec<Value>),
    /// Fields with their names, in the order of the definition.
    Struct(Vec<(Arc<str>, Value)>),
}

/// A value with its place in the message.
#[derive(Debug, Clone, Copy)]
pub(super) struct At<'a> {
    value: &'a Value,
    parent: Option<&'a At<'a>>,
    step: Step<'a>,
}

#[derive(Debug, Clone, Copy)]
enum Step<'a> {
    Root,
    Field(&'a str),
    Item(usize),
}

impl fmt::Display for At<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(parent) = self.parent {
            parent.fmt(f)?;
            let is_first = matches!(parent.step, Step::Root);
            match self.step {
                Step::Field(name) if is_first => f.write_str(name)?,
                Step::Field(name) => write!(f, ".{name}")?,
                Step::Item(index) => write!(f, "[{index}]")?,
                Step::Root => {}
            }
        }
        Ok(())
    }
}

impl<'a> At<'a> {
    /// The message.
    pub(super) fn root(value: &'a Value) -> Self {
        Self { value, parent: None, step: Step::Root }
    }

    /// A problem with this value.
    pub(super) fn error(&self, problem: impl fmt::Display) -> String {
        let place = self.to_string();
        if place.is_empty() { problem.to_string() } else { format!("{place}: {problem}") }
    }

    fn unexpected(&self, expected: &str) -> String {
        let found = match self.value {
            Value::Number(number) => number.to_string(),
            Value::Whole(number) => number.to_string(),
            Value::Text(text) => format!("the text \"{}\"", text.chars().take(40).collect::<String>()),
            Value::Bytes(bytes) => format!("{} bytes", bytes.len()),
            Value::List(list) => format!("a list of {}", list.len()),
            Value::Struct(_) => "fields".to_owned(),
        };
        self.error(format!("found {found}; expected {expected}"))
    }

    /// The field of one of these names that comes first in this list, if there is one.
    pub(super) fn optional(&'a self, names: &[&'a str]) -> Option<At<'a>> {
        let Value::Struct(fields) = self.value else { return None };
        names.iter().find_map(|name| {
            let (_, value) = fields.iter().find(|(known, _)| **known == **name)?;
            Some(At { value, parent: Some(self), step: Step::Field(name) })
        })
    }

    /// A field of one of these names.
    pub(super) fn field(&'a self, names: &[&'a str]) -> Result<At<'a>, String> {
        self.optional(names).ok_or_else(|| match self.value {
            Value::Struct(_) => self.error(format!("there is no field \"{}\"", names.join("\" or \""))),
            _ => self.unexpected("fields"),
        })
    }

    /// The items of a list.
    pub(super) fn items(&'a self) -> Result<impl Iterator<Item = At<'a>>, String> {
        let Value::List(list) = self.value else { return Err(self.unexpected("a list")) };
        Ok(list.iter().enumerate().map(|(index, value)| At { value, parent: Some(self), step: Step::Item(index) }))
    }

    /// A finite number.
    pub(super) fn number(&self) -> Result<f64, String> {
        let number = match self.value {
            Value::Number(number) => *number,
            Value::Whole(number) => *number as f64,
            _ => return Err(self.unexpected("a number")),
        };
        if number.is_finite() { Ok(number) } else { Err(self.unexpected("a finite number")) }
    }

    /// A whole number.
    pub(super) fn whole(&self) -> Result<i64, String> {
        match self.value {
            Value::Whole(number) => Ok(*number),
            Value::Number(number) if number.fract() == 0.0 && number.abs() < 9e15 => Ok(*number as i64),
            // JSON of protobuf has 64-bit numbers as text.
            Value::Text(text) => text.parse().map_err(|_| self.unexpected("a whole number")),
            _ => Err(self.unexpected("a whole number")),
        }
    }

    /// A text.
    pub(super) fn text(&self) -> Result<&'a str, String> {
        match self.value {
            Value::Text(text) => Ok(text),
            _ => Err(self.unexpected("text")),
        }
    }

    /// A text, or a whole number as text.
    pub(super) fn word(&self) -> Result<String, String> {
        match self.value {
            Value::Text(text) => Ok(text.clone()),
            _ => self.whole().map(|number| number.to_string()),
        }
    }

    /// Any number of finite numbers.
    pub(super) fn numbers(&'a self) -> Result<Vec<f64>, String> {
        self.items()?.map(|item| item.number()).collect()
    }

    /// The fields of these names as numbers.
    pub(super) fn coordinates<const N: usize>(&'a self, names: [&'a str; N]) -> Result<[f64; N], String> {
        let mut numbers = [0.0; N];
        for (number, name) in numbers.iter_mut().zip(names) {
            *number = self.field(&[name])?.number()?;
        }
        Ok(numbers)
    }

    /// Whether this is a text.
    pub(super) fn is_text(&self) -> bool {
        matches!(self.value, Value::Text(_))
    }
}
