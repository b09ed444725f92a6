//! The table type: made once, rendered as text, Markdown and JSON.

use std::fmt::Write;

use serde_json::{Value, json};
use unicode_width::UnicodeWidthStr;

use crate::scores::Figure;

/// A cell of a table.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Cell {
    /// Nothing; JSON null.
    #[default]
    Empty,
    /// Words.
    Text(String),
    /// A number, shown with so many decimals; JSON has all of its digits.
    Number {
        /// The number.
        value: f64,
        /// Its standard error, where there is one.
        standard_error: Option<f64>,
        /// Decimals that are shown.
        decimals: usize,
    },
}

impl Cell {
    /// A number without a standard error.
    pub fn number(value: f64, decimals: usize) -> Self {
        Self::Number { value, standard_error: None, decimals }
    }

    /// A mean with its standard error; empty when there is none.
    pub fn figure(figure: Option<Figure>, decimals: usize) -> Self {
        let number = |f: Figure| Self::Number { value: f.value, standard_error: f.standard_error, decimals };
        figure.map_or(Self::Empty, number)
    }

    fn shown(&self) -> String {
        match self {
            Self::Empty => String::new(),
            Self::Text(text) => text.clone(),
            Self::Number { value, standard_error: None, decimals } => format!("{value:.decimals$}"),
            Self::Number { value, standard_error: Some(error), decimals } => {
                format!("{value:.decimals$} ± {error:.decimals$}")
            }
        }
    }

    fn to_json(&self) -> Value {
        match self {
            Self::Empty => Value::Null,
            Self::Text(text) => json!(text),
            Self::Number { value, standard_error: None, .. } => json!(value),
            Self::Number { value, standard_error: Some(error), .. } => {
                json!({ "value": value, "standard_error": error })
            }
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        if text.is_empty() { Self::Empty } else { Self::Text(text.to_owned()) }
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::from(text.as_str())
    }
}

/// A table with a title.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// Notes for the reader, one paragraph each.
    pub notes: Vec<String>,
    /// Titles of the columns.
    pub columns: Vec<String>,
    /// The rows, each with one cell for each column.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows.
    pub fn new<T: AsRef<str>>(title: impl Into<String>, columns: impl IntoIterator<Item = T>) -> Self {
        let columns = columns.into_iter().map(|title| title.as_ref().to_owned()).collect();
        Self { title: title.into(), columns, ..Default::default() }
    }

    /// Adds a row; missing cells at its end are empty.
    pub fn push(&mut self, mut row: Vec<Cell>) {
        row.resize(self.columns.len(), Cell::Empty);
        self.rows.push(row);
    }

    /// Adds a note.
    pub fn note(&mut self, text: impl Into<String>) {
        self.notes.push(text.into());
    }

    /// The table as aligned lines of text, with its title and notes.
    pub fn to_text(&self) -> String {
        let (cells, left) = self.shown();
        let widths = widths(&self.columns, &cells);
        let mut text = format!("{}\n\n", self.title);
        for row in std::iter::once(&self.columns).chain(&cells) {
            let mut line = String::new();
            for (column, cell) in row.iter().enumerate() {
                line.push_str(&padded(cell, widths[column], left[column]));
                line.push_str("  ");
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        for note in &self.notes {
            // Writing to a String cannot fail.
            let _ = writeln!(text, "\n{note}");
        }
        text
    }

    /// The table in Markdown, under a heading of the third level.
    pub fn to_markdown(&self) -> String {
        let (cells, left) = self.shown();
        let line = |row: &[String]| format!("| {} |\n", row.join(" | ").replace('\n', " "));
        let escaped = |row: &Vec<String>| -> Vec<String> { row.iter().map(|cell| cell.replace('|', "\\|")).collect() };
        let rule: Vec<String> = left.iter().map(|left| if *left { "---" } else { "---:" }.to_owned()).collect();
        let mut text = format!("### {}\n\n{}{}", self.title, line(&escaped(&self.columns)), line(&rule));
        for row in &cells {
            text.push_str(&line(&escaped(row)));
        }
        for note in &self.notes {
            let _ = writeln!(text, "\n{note}");
        }
        text
    }

    /// The table as JSON: `{"title", "notes", "columns", "rows"}`; a number with a standard error is
    /// `{"value", "standard_error"}`, an empty cell null.
    pub fn to_json(&self) -> Value {
        let rows: Vec<Vec<Value>> = self.rows.iter().map(|row| row.iter().map(Cell::to_json).collect()).collect();
        json!({ "title": self.title, "notes": self.notes, "columns": self.columns, "rows": rows })
    }

    /// The cells as text, and for each column whether it is aligned to the left (it holds no number).
    pub(crate) fn shown(&self) -> (Vec<Vec<String>>, Vec<bool>) {
        let is_number = |row: &Vec<Cell>, column: usize| matches!(row.get(column), Some(Cell::Number { .. }));
        let left = (0..self.columns.len()).map(|c| !self.rows.iter().any(|row| is_number(row, c))).collect();
        (self.rows.iter().map(|row| row.iter().map(Cell::shown).collect()).collect(), left)
    }
}

fn widths(columns: &[String], cells: &[Vec<String>]) -> Vec<usize> {
    let widest = |column: usize| cells.iter().map(|row| row[column].width()).max().unwrap_or(0);
    columns.iter().enumerate().map(|(column, title)| title.width().max(widest(column))).collect()
}

fn padded(cell: &str, width: usize, left: bool) -> String {
    let gap = " ".repeat(width.saturating_sub(cell.width()));
    if left { format!("{cell}{gap}") } else { format!("{gap}{cell}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new("Cars", ["method", "O3D"]);
        table.push(vec!["map|x".into(), Cell::figure(Some(Figure { value: 0.625, standard_error: Some(0.04) }), 2)]);
        table.push(vec!["pfd".into()]);
        table.note("Few cars.");
        table
    }

    #[test]
    fn one_table_three_forms() {
        assert_eq!(table().to_text(), "Cars\n\nmethod          O3D\nmap|x   0.62 ± 0.04\npfd\n\nFew cars.\n");
        assert_eq!(
            table().to_markdown(),
            "### Cars\n\n| method | O3D |\n| --- | ---: |\n| map\\|x | 0.62 ± 0.04 |\n| pfd |  |\n\nFew cars.\n"
        );
        let expected = json!([["map|x", { "value": 0.625, "standard_error": 0.04 }], ["pfd", null]]);
        assert_eq!(table().to_json()["rows"], expected);
    }
}
