//! Suggested next commands at the end of a command, which work as printed.

use std::ffi::OsStr;
use std::path::Path;

use crate::call;
use crate::output::{DIM, HEADING, Output};

/// A word of a command.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Word<'a> {
    /// A verbatim word.
    Text(&'a str),
    /// A path, which may need quotes.
    Path(&'a Path),
}

impl<'a> From<&'a str> for Word<'a> {
    fn from(text: &'a str) -> Self {
        Word::Text(text)
    }
}

impl<'a> From<&'a Path> for Word<'a> {
    fn from(path: &'a Path) -> Self {
        Word::Path(path)
    }
}

/// Commands that make sense next, each with what it is for.
#[derive(Debug, Default)]
pub(crate) struct Next {
    lines: Vec<(String, String)>,
}

impl Next {
    /// One more command (without the name of the program). Commands that read from standard output as a file are
    /// omitted, because it cannot be read again.
    pub(crate) fn command<'a>(mut self, words: impl IntoIterator<Item = Word<'a>>, purpose: &str) -> Self {
        let mut line = program();
        let words: Vec<Word> = words.into_iter().collect();
        debug_assert!(matches!(words[0], Word::Text(name) if crate::is_command(name)), "{words:?}");
        for word in words {
            match word {
                Word::Path(path) if path == Path::new("-") || path.starts_with("/dev") => return self,
                Word::Path(path) => line = format!("{line} {}", quoted(path.as_os_str())),
                Word::Text(text) => line = format!("{line} {text}"),
            }
        }
        self.lines.push((line, purpose.to_owned()));
        self
    }

    /// `localize` for the detections of a source of a scene, to a file that is not the scene; with other options behind it.
    pub(crate) fn localize(self, scene: &Path, source: Option<&str>, options: &str, purpose: &str) -> Self {
        let is_taken = scene.file_name() == Some(OsStr::new("objects.json"));
        let output = format!("-o {}{options}", if is_taken { "localized.json" } else { "objects.json" });
        let source = source.into_iter().flat_map(|name| ["--source".into(), Path::new(name).into()]);
        let words = ["localize".into(), scene.into()].into_iter().chain(source).chain([output.as_str().into()]);
        self.command(words, purpose)
    }

    /// The command of this run once more, with other options behind it.
    pub(crate) fn again(mut self, options: &str, purpose: &str) -> Self {
        let words: Vec<String> = call::arguments().iter().map(|word| quoted(word)).collect();
        self.lines.push((format!("{} {} {options}", program(), words.join(" ")), purpose.to_owned()));
        self
    }

    /// The lines, with a heading; empty without suggestions.
    pub(crate) fn text(&self) -> String {
        if self.lines.is_empty() {
            return String::new();
        }
        let mut text = format!("\n{HEADING}Next{HEADING:#}\n");
        let width = self.lines.iter().map(|(_, purpose)| purpose.chars().count()).max().unwrap_or(0);
        // The command comes last: behind it a shell would not always take a text for a comment.
        for (command, purpose) in &self.lines {
            text.push_str(&format!("  {DIM}{purpose:width$}{DIM:#}  {command}\n"));
        }
        text
    }

    /// Prints the lines below a report.
    pub(crate) fn tell(&self, out: &Output) -> anyhow::Result<()> {
        out.report(&self.text())
    }
}

/// The words by which a shell calls the program.
fn program() -> String {
    let words: Vec<String> = call::command().iter().map(|word| quoted(word)).collect();
    words.join(" ")
}

/// A path as a shell takes it.
fn quoted(path: &OsStr) -> String {
    let text = crate::output::one_line(&path.to_string_lossy());
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:,@\\".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text
    } else if cfg!(windows) {
        format!("\"{text}\"")
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_quoted_where_a_shell_needs_it() {
        assert_eq!(quoted(OsStr::new("a/b-1.json")), "a/b-1.json");
        if !cfg!(windows) {
            assert_eq!(quoted(OsStr::new("my scene's.json")), "'my scene'\\''s.json'");
        }
    }

    #[test]
    fn what_went_to_the_standard_output_is_not_read_again() {
        let next = Next::default().command(["view".into(), Path::new("-").into()], "look");
        assert_eq!(next.localize(Path::new("/dev/stdout"), None, "", "find").text(), "");
        let next = Next::default();
        let next = next.command(["view".into(), Path::new("a.json").into()], "look");
        assert!(next.text().ends_with(" view a.json\n"), "{}", next.text());
    }

    #[test]
    fn a_scene_is_not_overwritten_by_its_objects() {
        let text = |scene: &str| Next::default().localize(Path::new(scene), Some("a b"), " --fix", "find").text();
        assert!(text("a.json").ends_with("localize a.json --source 'a b' -o objects.json --fix\n") || cfg!(windows));
        assert!(text("b/objects.json").contains(" -o localized.json"), "{}", text("b/objects.json"));
    }
}
