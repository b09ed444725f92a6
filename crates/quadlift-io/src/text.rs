//! Text files with one record a line: numbers between blanks, and messages that name the line.

use std::path::Path;

use crate::error::ReadError;

/// A line of a file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line<'a> {
    path: &'a Path,
    /// Its number, from 1.
    pub number: usize,
    /// The text, without blanks around it.
    pub text: &'a str,
}

/// The lines of a text.
pub(crate) fn lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = Line<'a>> {
    text.lines().enumerate().map(move |(index, text)| Line { path, number: index + 1, text: text.trim() })
}

impl<'a> Line<'a> {
    /// Whether there is nothing on it, or a comment.
    pub(crate) fn is_blank_or_comment(&self) -> bool {
        self.text.is_empty() || self.text.starts_with('#')
    }

    /// A problem with this line.
    pub(crate) fn error(&self, problem: impl Into<String>) -> ReadError {
        ReadError::new(self.path, problem).at(self.number, 0)
    }

    /// Its fields, between blanks.
    pub(crate) fn fields(&self) -> Fields<'a> {
        Fields { line: *self, rest: self.text, index: 0 }
    }

    /// All its fields as finite numbers.
    pub(crate) fn numbers(&self) -> Result<Vec<f64>, ReadError> {
        self.fields().numbers_left("a number")
    }
}

impl Line<'_> {
    /// All its fields, between commas (or blanks, where there is no comma), as finite numbers. A comma at the end does
    /// not count.
    pub(crate) fn numbers_between_commas(&self) -> Result<Vec<f64>, ReadError> {
        if !self.text.contains(',') {
            return self.numbers();
        }
        let fields = self.text.strip_suffix(',').unwrap_or(self.text).split(',').map(str::trim);
        let number = |(index, field): (usize, &str)| {
            let number = field.parse::<f64>().ok().filter(|x| x.is_finite());
            let shown: String = field.chars().take(40).collect();
            number.ok_or_else(|| self.error(format!("column {} is \"{shown}\"; expected a number", index + 1)))
        };
        fields.enumerate().map(number).collect()
    }
}

/// The fields of a line that are still to be read.
#[derive(Debug, Clone)]
pub(crate) struct Fields<'a> {
    line: Line<'a>,
    rest: &'a str,
    index: usize,
}

impl<'a> Fields<'a> {
    /// Whether none is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// The rest of the line.
    pub(crate) fn rest(&self) -> &'a str {
        self.rest
    }

    /// The next field; `what` is expected there.
    pub(crate) fn word(&mut self, what: &str) -> Result<&'a str, ReadError> {
        if self.rest.is_empty() {
            return Err(self.line.error(format!("the line ends after {} fields; expected {what}", self.index)));
        }
        let (word, rest) = self.rest.split_once(char::is_whitespace).unwrap_or((self.rest, ""));
        self.rest = rest.trim_start();
        self.index += 1;
        Ok(word)
    }

    /// The next field as a finite number.
    pub(crate) fn number(&mut self, what: &str) -> Result<f64, ReadError> {
        let word = self.word(what)?;
        let number = word.parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| self.wrong(word, what))
    }

    /// The next `N` fields as finite numbers.
    pub(crate) fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N], ReadError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(what)?;
        }
        Ok(numbers)
    }

    /// All fields that are left as finite numbers.
    pub(crate) fn numbers_left(&mut self, what: &str) -> Result<Vec<f64>, ReadError> {
        let mut numbers = Vec::new();
        while !self.is_empty() {
            numbers.push(self.number(what)?);
        }
        Ok(numbers)
    }

    /// The next field as a whole number, in any notation: `3`, `3.0`, `3e0`.
    pub(crate) fn whole<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, ReadError> {
        let word = self.word(what)?;
        let whole = || {
            let x: f64 = word.parse().ok()?;
            // Larger numbers need not be the one that is meant.
            let is_whole = x.fract() == 0.0 && x.abs() < 2f64.powi(53);
            format!("{x:.0}").parse().ok().filter(|_| is_whole)
        };
        word.parse().ok().or_else(whole).ok_or_else(|| self.wrong(word, what))
    }

    /// A problem with the field that was read last.
    fn wrong(&self, word: &str, what: &str) -> ReadError {
        let shown: String = word.chars().take(40).collect();
        self.line.error(format!("field {} is \"{shown}\"; expected {what}", self.index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_line_and_field() {
        let path = Path::new("a.txt");
        let line = lines(path, "# x\n 1 2.5  x\r\n").nth(1).unwrap();
        let mut fields = line.fields();
        assert_eq!(fields.whole::<u32>("an id").unwrap(), 1);
        assert_eq!(fields.number("a width").unwrap(), 2.5);
        assert_eq!(fields.clone().rest(), "x");
        assert_eq!(fields.number("a height").unwrap_err().to_string(), "a.txt:2: field 3 is \"x\"; expected a height");
        assert_eq!(
            fields.word("a name").unwrap_err().to_string(),
            "a.txt:2: the line ends after 3 fields; expected a name"
        );
        assert!(line.numbers().is_err());
        assert!(lines(path, "nan").next().unwrap().numbers().is_err());
    }
}
