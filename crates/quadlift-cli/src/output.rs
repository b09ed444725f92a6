//! The only place that writes to the terminal.
//!
//! Reports and JSON go to standard output; errors, warnings and details go to standard error. Colors are disabled if
//! the stream is not a terminal, or by NO_COLOR or CLICOLOR=0. A reader that closes the pipe early
//! (`quadlift info scene.json | head`) is not an error.

use std::io::{ErrorKind, Write};

use anstyle::{AnsiColor, Style};
use anyhow::Context;
use serde::Serialize;

/// Style of what went well.
pub(crate) const GOOD: Style = AnsiColor::Green.on_default();
/// Style of what deserves attention.
pub(crate) const WARNING: Style = AnsiColor::Yellow.on_default();
/// Style of what failed.
pub(crate) const BAD: Style = AnsiColor::Red.on_default();
/// Style of headings.
pub(crate) const HEADING: Style = Style::new().bold();
/// Style of what is less important.
pub(crate) const DIM: Style = Style::new().dimmed();

/// Maximum number of errors of one kind that are printed; the JSON document has all of them.
const MAX_ERRORS: usize = 20;

/// Settings of the output.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Output {
    /// Print one JSON document instead of text.
    pub json: bool,
    /// Print errors only (and the JSON document, if requested).
    pub quiet: bool,
    /// Print details on the standard error stream.
    pub verbose: bool,
    /// A result is written to standard output: reports are printed on standard error.
    pub reports_to_stderr: bool,
}

impl Output {
    /// Prints a report, except with `--json` or `--quiet`.
    pub(crate) fn report(&self, text: &str) -> anyhow::Result<()> {
        if self.json || self.quiet {
            return Ok(());
        }
        if self.reports_to_stderr {
            // Errors are ignored if standard error is closed.
            let _ = anstream::stderr().lock().write_all(text.as_bytes());
            return Ok(());
        }
        to_stdout(text)
    }

    /// Prints the JSON document, if requested.
    pub(crate) fn document(&self, value: &impl Serialize) -> anyhow::Result<()> {
        if !self.json {
            return Ok(());
        }
        let mut text = serde_json::to_string_pretty(value).context("cannot express the result as JSON")?;
        text.push('\n');
        to_stdout(&text)
    }

    /// Prints what the command is for, whatever the verbosity.
    pub(crate) fn product(&self, text: &str) -> anyhow::Result<()> {
        to_stdout(text)
    }

    /// Prints a line of a stream at once, whatever the verbosity; whether anybody still reads the standard output.
    pub(crate) fn stream_line(&self, line: &str) -> anyhow::Result<bool> {
        let mut stream = std::io::stdout().lock();
        match stream.write_all(line.as_bytes()).and_then(|()| stream.flush()) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
            Err(error) => Err(error).context("cannot write to the standard output"),
        }
    }

    /// Prints a detail on the standard error stream.
    pub(crate) fn detail(&self, text: &str) {
        if self.verbose {
            to_stderr(&format!("{DIM}{text}{DIM:#}"));
        }
    }

    /// Prints an error.
    pub(crate) fn error(&self, text: &str) {
        let style = BAD.bold();
        to_stderr(&format!("{style}error:{style:#} {}", one_line(text)));
    }

    /// Prints a warning on standard error, except with `--quiet`.
    pub(crate) fn warning(&self, text: &str) {
        if !self.quiet {
            to_stderr(&format!("{WARNING}warning:{WARNING:#} {}", one_line(text)));
        }
    }

    /// Prints errors; of many, the first ones and how many more there are.
    pub(crate) fn errors(&self, texts: &[String]) {
        texts.iter().take(MAX_ERRORS).for_each(|text| self.error(text));
        if texts.len() > MAX_ERRORS {
            self.error(&format!("{} more problems of this kind (--json lists all)", texts.len() - MAX_ERRORS));
        }
    }
}

/// Text from a file, safe to print: control characters (line breaks, terminal codes), and characters that cannot be seen or
/// turn the text around, are written as escapes.
pub(crate) fn one_line(text: &str) -> String {
    quadlift_io::escape(text)
}

fn to_stdout(text: &str) -> anyhow::Result<()> {
    let mut stream = anstream::stdout().lock();
    match stream.write_all(text.as_bytes()).and_then(|()| stream.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("cannot write to standard output"),
        _ => Ok(()),
    }
}

fn to_stderr(line: &str) {
    // Errors are ignored if standard error is closed.
    let _ = writeln!(anstream::stderr().lock(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_files_cannot_steer_the_terminal() {
        assert_eq!(one_line("a\u{1b}[31mb\nc é"), "a\\u{1b}[31mb\\nc é");
        assert_eq!(one_line("a\u{202e}\u{200b}b"), "a\\u{202e}\\u{200b}b");
    }
}
