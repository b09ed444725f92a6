//! Aligned tables.

use std::fmt::Write;

use anstyle::Style;
use unicode_width::UnicodeWidthStr;

use crate::output::{DIM, HEADING, one_line};

/// A cell: its text and how it is shown.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cell {
    text: String,
    style: Style,
}

impl Cell {
    /// A cell in a style.
    pub(crate) fn styled(text: impl AsRef<str>, style: Style) -> Self {
        Self { text: one_line(text.as_ref()), style }
    }
}

impl<T: AsRef<str>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self::styled(text, Style::new())
    }
}

/// Columns of the terminal; titles of tables that would be wider are broken into several lines.
const WIDTH: usize = 100;

/// Maximum number of rows of a table of objects, frames or cameras.
pub(crate) const MAX_ROWS: usize = 40;

/// The line below a table of the first [`MAX_ROWS`] of so many things, if there are more; `all` says where all are.
pub(crate) fn rest(total: usize, things: &str, all: &str) -> String {
    match total.saturating_sub(MAX_ROWS) {
        0 => String::new(),
        1 => format!("{DIM}and 1 more {things}: {all}{DIM:#}\n"),
        more => format!("{DIM}and {more} more {things}s: {all}{DIM:#}\n"),
    }
}

/// A table with a header; columns are as wide as their widest cell.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    header: Vec<String>,
    left: Vec<bool>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// An empty table. Columns whose title starts with `<` are aligned to the left, all others to the right.
    pub(crate) fn new<T: AsRef<str>>(titles: impl IntoIterator<Item = T>) -> Self {
        let mut table = Self { header: Vec::new(), left: Vec::new(), rows: Vec::new() };
        for title in titles {
            let title = title.as_ref();
            table.left.push(title.starts_with('<'));
            // Escaped here, so that its width is that of what is shown.
            table.header.push(one_line(title.strip_prefix('<').unwrap_or(title)));
        }
        table
    }

    /// Adds a row.
    pub(crate) fn push(&mut self, row: Vec<Cell>) {
        self.rows.push(row);
    }

    /// The table as lines of text; empty columns are omitted.
    pub(crate) fn render(&self) -> String {
        let content = |column: usize| {
            let widest = self.rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.text.width()).max()?;
            (widest > 0).then_some(widest)
        };
        let columns: Vec<(usize, usize)> = (0..self.header.len()).filter_map(|c| Some((c, content(c)?))).collect();
        let total: usize = columns.iter().map(|&(column, width)| width.max(self.header[column].width()) + 2).sum();
        let is_wide = total > WIDTH + 2;
        let titles: Vec<Vec<String>> = (0..self.header.len())
            .map(|column| match columns.iter().find(|(shown, _)| *shown == column) {
                Some(&(_, width)) if is_wide => broken(&self.header[column], width),
                _ => vec![self.header[column].clone()],
            })
            .collect();
        let width_of = |(column, width): (usize, usize)| {
            (column, titles[column].iter().map(|line| line.width()).max().unwrap_or(0).max(width))
        };
        let columns: Vec<(usize, usize)> = columns.into_iter().map(width_of).collect();
        // Tables that are still too wide get narrower gaps.
        let is_tight = columns.iter().map(|(_, width)| width + 2).sum::<usize>() > WIDTH + 2;
        let between = if is_tight { " " } else { "  " };
        // The last lines of the titles stand on one line.
        let lines = titles.iter().map(Vec::len).max().unwrap_or(0);
        let heading: Vec<Vec<Cell>> = (0..lines)
            .map(|line| {
                let cell = |title: &Vec<String>| {
                    let own = (line + title.len()).checked_sub(lines).and_then(|k| title.get(k));
                    own.map_or_else(Cell::default, |text| Cell { text: text.clone(), style: HEADING })
                };
                titles.iter().map(cell).collect()
            })
            .collect();
        let mut text = String::new();
        for row in heading.iter().chain(&self.rows) {
            let mut line = String::new();
            for &(column, width) in &columns {
                let Some(Cell { text, style }) = row.get(column) else { continue };
                let gap = " ".repeat(width - text.width());
                // Writing to a String cannot fail.
                let _ = match self.left[column] {
                    true => write!(line, "{style}{text}{style:#}{gap}{between}"),
                    false => write!(line, "{gap}{style}{text}{style:#}{between}"),
                };
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

/// A title in lines of this width, or of its longest word.
fn broken(title: &str, width: usize) -> Vec<String> {
    let width = title.split(' ').map(|word| word.width()).max().unwrap_or(0).max(width);
    let mut lines: Vec<String> = Vec::new();
    for word in title.split(' ') {
        match lines.last_mut().filter(|line| line.width() + 1 + word.width() <= width) {
            Some(line) => *line = format!("{line} {word}"),
            None => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A number with this many decimals; a dash when it is missing or not finite.
pub(crate) fn number(x: Option<f64>, decimals: usize) -> String {
    match x.filter(|x| x.is_finite()) {
        Some(x) if x.abs() < 1e9 => {
            let text = format!("{x:.decimals$}");
            // No "-0.00".
            if text.trim_start_matches(['-', '0', '.']).is_empty() {
                text.trim_start_matches('-').to_owned()
            } else {
                text
            }
        }
        Some(x) => format!("{x:.3e}"),
        None => "-".to_owned(),
    }
}

/// A positive number with this many significant digits.
pub(crate) fn significant(x: f64, digits: i32) -> String {
    number(Some(x), decimals(x, digits))
}

/// Decimals that show a number of this size with this many significant digits.
pub(crate) fn decimals(size: f64, digits: i32) -> usize {
    if !(size.is_finite() && size > 0.0) {
        return 2;
    }
    (digits - 1 - size.log10().floor() as i32).clamp(0, 9) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_empty_ones_left_out() {
        let mut table = Table::new(["<name", "nothing", "x [m]"]);
        table.push(vec!["a".into(), "".into(), "1.50".into()]);
        table.push(vec!["杯子".into(), "".into(), "-10.25".into()]);
        let text = anstream::adapter::strip_str(&table.render()).to_string();
        assert_eq!(text, "name   x [m]\na       1.50\n杯子  -10.25\n");
    }

    #[test]
    fn titles_of_wide_tables_are_broken() {
        let mut table = Table::new(["<a long name", "distance of centers [m]"]);
        table.push(vec!["x".repeat(80).into(), "1.50".into()]);
        let text = anstream::adapter::strip_str(&table.render()).to_string();
        let row = format!("{}      1.50", "x".repeat(80));
        let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        let head = |left: &str, right: &str| format!("{left:82}{right:>8}");
        let expected = [head("", "distance"), head("", "of"), head("", "centers"), head("a long name", "[m]"), row];
        assert_eq!(lines, expected);
        assert!(lines.iter().all(|line| line.len() <= WIDTH));
    }

    #[test]
    fn control_characters_in_titles_are_escaped_and_keep_the_columns_aligned() {
        let mut table = Table::new(["<name", "x [m\n\u{1b}]"]);
        table.push(vec!["a".into(), "1.50".into()]);
        let text = anstream::adapter::strip_str(&table.render()).to_string();
        assert_eq!(text, "name  x [m\\n\\u{1b}]\na              1.50\n");
    }

    #[test]
    fn what_a_table_leaves_out_is_counted() {
        let rest = |total| anstream::adapter::strip_str(&rest(total, "object", "--json lists all")).to_string();
        assert_eq!([rest(0), rest(40)], ["", ""]);
        assert_eq!(rest(41), "and 1 more object: --json lists all\n");
        assert_eq!(rest(100), "and 60 more objects: --json lists all\n");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(number(Some(-0.001), 2), "0.00");
        assert_eq!(number(Some(-1.25), 1), "-1.2");
        assert_eq!(number(Some(f64::NAN), 1), "-");
        assert_eq!(number(Some(1e12), 1), "1.000e12");
        assert_eq!(number(None, 1), "-");
        assert_eq!((decimals(0.05, 3), decimals(12.0, 3), decimals(0.0, 3)), (4, 1, 2));
    }
}
