//! How a command ends: outcomes, exit codes and error texts.

use std::fmt;

use quadlift_io::ReadError;
use quadlift_io::diagnosis::DiagnosisRecord;

/// The end of a command that could do its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Exit code 0.
    Fine,
    /// Exit code 1: a part failed, and has been reported.
    SomethingFailed,
    /// Exit code 3: a scene is inconsistent, and that has been reported.
    Inconsistent,
}

impl Outcome {
    /// The outcome of two parts: a failure counts more than a scene that is inconsistent.
    pub(crate) fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::SomethingFailed, _) | (_, Self::SomethingFailed) => Self::SomethingFailed,
            (Self::Inconsistent, _) | (_, Self::Inconsistent) => Self::Inconsistent,
            (Self::Fine, Self::Fine) => Self::Fine,
        }
    }
}

/// A scene that is inconsistent, so that nothing can be done with it: exit code 3.
#[derive(Debug)]
pub(crate) struct InconsistentError {
    /// The problem, as text.
    pub text: String,
    /// The diagnosis, for `--json`.
    pub diagnosis: DiagnosisRecord,
}

impl fmt::Display for InconsistentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for InconsistentError {}

/// Wrong usage, exit code 2: errors visible from the command line alone.
#[derive(Debug)]
pub(crate) struct UsageError(pub String);

impl fmt::Display for UsageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for UsageError {}

/// A usage error as a result.
pub(crate) fn usage<T>(text: impl Into<String>) -> anyhow::Result<T> {
    Err(UsageError(text.into()).into())
}

/// The exit code of an error.
pub(crate) fn exit_code(error: &anyhow::Error) -> u8 {
    let lacks_option = error.downcast_ref::<ReadError>().is_some_and(|error| error.lacks_option);
    if lacks_option || error.is::<UsageError>() {
        2
    } else if error.is::<InconsistentError>() {
        3
    } else {
        1
    }
}

/// An error with its causes, in one line.
pub(crate) fn in_words(error: &anyhow::Error) -> String {
    format!("{error:#}")
}
