//! Every error of the library and of the files is a `quadlift.QuadliftError`, with the words of the program.

use std::fmt::Display;

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};

create_exception!(
    quadlift,
    QuadliftError,
    PyValueError,
    "Raised for invalid input; the message names it, what was found and what was expected."
);

/// The Python exception with the words of an error.
pub(crate) fn refuse(error: impl Display) -> PyErr {
    QuadliftError::new_err(error.to_string())
}
