//! Every error of the library and of the files is a `quadlift.QuadliftError`.

use std::fmt::Display;

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};
use quadlift_io::python::{Correcting, in_python};

create_exception!(
    quadlift,
    QuadliftError,
    PyValueError,
    "Raised for invalid input; the message names it, what was found and what was expected."
);

/// The Python exception of an error, in the words of Python.
pub(crate) fn refuse(error: impl Display) -> PyErr {
    QuadliftError::new_err(in_python(&error.to_string(), Correcting::Scene))
}

/// The same of a function that reads a file.
pub(crate) fn refuse_to_read(error: impl Display) -> PyErr {
    QuadliftError::new_err(in_python(&error.to_string(), Correcting::Reading))
}
