//! The program `quadlift` as a function, which the command of the package calls.

use std::ffi::OsString;
use std::panic::catch_unwind;

use pyo3::prelude::*;

/// The exit code of a Rust program that panics.
const PANICKED: u8 = 101;

/// Runs the program and gives its exit code: once in a process, because it takes over signals and threads. `command` are the
/// words by which a shell calls it, `arguments` what follows them.
#[pyfunction]
pub(crate) fn run_program(py: Python, command: Vec<OsString>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| catch_unwind(|| quadlift_cli::main(command, arguments)).unwrap_or(PANICKED))
}
