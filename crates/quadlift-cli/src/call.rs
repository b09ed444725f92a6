//! How the program was called, which the process need not know: its arguments may be those of Python.

use std::ffi::OsString;
use std::sync::{Mutex, PoisonError};

static CALL: Mutex<Call> = Mutex::new(Call { command: Vec::new(), arguments: Vec::new() });

struct Call {
    command: Vec<OsString>,
    arguments: Vec<OsString>,
}

/// The program begins: the words by which a shell calls it, and its arguments.
pub(crate) fn begin(command: Vec<OsString>, arguments: Vec<OsString>) {
    *CALL.lock().unwrap_or_else(PoisonError::into_inner) = Call { command, arguments };
}

/// The words by which a shell calls the program.
pub(crate) fn command() -> Vec<OsString> {
    CALL.lock().unwrap_or_else(PoisonError::into_inner).command.clone()
}

/// The arguments of the program.
pub(crate) fn arguments() -> Vec<OsString> {
    CALL.lock().unwrap_or_else(PoisonError::into_inner).arguments.clone()
}
