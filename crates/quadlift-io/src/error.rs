//! Errors about files. Their text is for the person who made the file.

use std::fmt;
use std::path::{Path, PathBuf};

/// Why a file cannot be read: the file, the place in it and the problem.
///
/// Prints as `scene.json:12:40: detections[3].box: ...`, which editors and terminals can follow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// Line, from 1, if known.
    pub line: Option<usize>,
    /// Column in bytes, from 1, if known.
    pub column: Option<usize>,
    /// The entry of the file, such as `detections[3].box`, if known.
    pub entry: Option<String>,
    /// What was found and what was expected.
    pub problem: String,
    /// Whether an option of the reader is missing.
    pub lacks_option: bool,
}

impl ReadError {
    /// A problem with a whole file. Control characters (the text may quote the file) are written as escapes, so that a
    /// message is one line.
    pub fn new(path: &Path, problem: impl Into<String>) -> Self {
        Self {
            path: path.to_owned(),
            line: None,
            column: None,
            entry: None,
            problem: one_line(problem.into(), LONGEST[0]),
            lacks_option: false,
        }
    }

    /// A file that cannot be read without an option, which the problem names.
    pub(crate) fn lacking_option(path: &Path, problem: &str) -> Self {
        Self { lacks_option: true, ..Self::new(path, problem) }
    }

    /// A file in a format that a feature reads which is off in this build.
    #[cfg(not(all(feature = "images", feature = "xml", feature = "yaml")))]
    pub(crate) fn left_out(path: &Path, format: &str, feature: &str) -> Self {
        Self::new(
            path,
            format!("{format} are left out of this build; the feature \"{feature}\" of quadlift-io has them"),
        )
    }

    /// Adds the line and column of the problem, both from 1; zero means "unknown".
    #[must_use]
    pub fn at(mut self, line: usize, column: usize) -> Self {
        self.line = (line > 0).then_some(line);
        self.column = (line > 0 && column > 0).then_some(column);
        self
    }

    /// The problem is in this entry.
    #[must_use]
    pub fn in_entry(mut self, entry: impl Into<String>) -> Self {
        self.entry = Some(one_line(entry.into(), LONGEST[1]));
        self
    }
}

/// The longest problem and the longest entry in a message, in characters; they may quote the content of a file.
const LONGEST: [usize; 2] = [1000, 200];

/// A text for a message: in one line ([`escape`]), with the middle removed if it is longer than this many characters.
fn one_line(text: String, longest: usize) -> String {
    let text = if text.contains(is_hidden) { escape(&text) } else { text };
    let count = text.chars().count();
    if count <= longest {
        return text;
    }
    let part = |from: usize, to: usize| text.chars().skip(from).take(to - from).collect::<String>();
    let (head, tail) = (longest * 3 / 4, longest / 4);
    format!("{} ... {}", part(0, head), part(count - tail, count))
}

/// A text from a file, safe to print: characters that break lines, steer a terminal, turn the direction of the text around
/// or cannot be seen are written as escapes.
pub fn escape(text: &str) -> String {
    let escaped = |c: char| if is_hidden(c) { c.escape_unicode().to_string() } else { c.to_string() };
    let escaped = |c: char| if c.is_control() { c.escape_default().to_string() } else { escaped(c) };
    text.chars().map(escaped).collect()
}

/// Whether a character is a control character, has no width, or changes the direction of the text around it (Unicode's
/// general category Cf, as far as it is in use, and the separators of lines and paragraphs).
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c,
            '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A path may come from an untrusted file.
        write!(f, "{}", escape(&self.path.display().to_string()))?;
        for number in [self.line, self.column].into_iter().flatten() {
            write!(f, ":{number}")?;
        }
        if let Some(entry) = &self.entry {
            write!(f, ": {entry}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl std::error::Error for ReadError {}

/// A wrong entry of a file whose path is not known here; see [`EntryError::in_file`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{entry}: {problem}")]
pub struct EntryError {
    /// The entry, such as `detections[3]`.
    pub entry: String,
    /// What was found and what was expected.
    pub problem: String,
}

impl EntryError {
    /// A problem with an entry.
    pub fn new(entry: impl Into<String>, problem: impl fmt::Display) -> Self {
        Self { entry: entry.into(), problem: problem.to_string() }
    }

    /// The same problem, with the file of the entry.
    pub fn in_file(self, path: &Path) -> ReadError {
        ReadError::new(path, self.problem).in_entry(self.entry)
    }
}

/// Why a file cannot be written. An existing file of this name is unchanged.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot write {}: {problem}", escape(&path.display().to_string()))]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// What went wrong.
    pub problem: String,
}

impl WriteError {
    /// A problem with a file.
    pub fn new(path: &Path, problem: impl fmt::Display) -> Self {
        Self { path: path.to_owned(), problem: problem.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_print_what_is_known() {
        let error = ReadError::new(Path::new("a.json"), "wrong");
        assert_eq!(error.to_string(), "a.json: wrong");
        assert_eq!(error.clone().at(3, 0).to_string(), "a.json:3: wrong");
        assert_eq!(error.at(3, 7).in_entry("frames[0]").to_string(), "a.json:3:7: frames[0]: wrong");
    }

    #[test]
    fn messages_are_one_line_whatever_they_quote() {
        let error = ReadError::new(Path::new("a.json"), "found \"a\nb\"; é").in_entry("images.\u{1b}[31m");
        assert_eq!(error.to_string(), "a.json: images.\\u{1b}[31m: found \"a\\nb\"; é");
        // Scenes name images and masks.
        let error = ReadError::new(Path::new("a\u{1b}[31m.png"), "there is no such file");
        assert_eq!(error.to_string(), "a\\u{1b}[31m.png: there is no such file");
        let error = WriteError::new(Path::new("a\n.json"), "no");
        assert_eq!(error.to_string(), "cannot write a\\n.json: no");
    }

    #[test]
    fn messages_have_an_end_and_show_what_cannot_be_seen() {
        let path = Path::new("a.json");
        let long = format!("found {}; expected a number", "x".repeat(100_000));
        let error = ReadError::new(path, long).in_entry("[0]".repeat(10_000)).to_string();
        assert!(error.len() < 1500 && error.ends_with("x; expected a number") && error.contains(" ... "), "{error}");
        let problem = ReadError::new(path, "a\u{202e}b\u{200b}c\u{2028}d\u{1b}e é 杯子").problem;
        assert_eq!(problem, "a\\u{202e}b\\u{200b}c\\u{2028}d\\u{1b}e é 杯子");
    }
}
