//! The row of a format, and recognition of files by the rows of a table.

use std::path::{Path, PathBuf};

use super::import::Import;
use super::options::ReadOptions;
use super::probe::{Found, Probe};
use super::unread::{UNNAMED, holds_matrices, known_but_unread};
use crate::error::ReadError;

/// A format of other programs that is read.
#[derive(Debug)]
pub struct Format<F: 'static> {
    /// The name on the command line, such as "voc".
    pub name: &'static str,
    /// The name in sentences, such as "Pascal VOC".
    pub title: &'static str,
    /// What it contains, for the help of the program.
    pub about: &'static str,
    /// How its files are recognized, for messages.
    pub looks: &'static str,
    /// The options that its reader takes, by their names in [`super::READ`].
    pub options: &'static [&'static str],
    /// Where the reader begins, if the file or folder is of this format.
    pub finds: fn(&Probe) -> Found,
    /// The reader.
    pub read: fn(&Path, &ReadOptions) -> Result<F, ReadError>,
}

/// A format of cameras and poses.
pub type PoseFormat = Format<Import>;

/// The kind of cameras and poses in messages.
pub(crate) const CAMERA: &str = "camera";

/// The first of the formats that a path is of, and where its reader begins.
///
/// # Errors
/// [`ReadError`] if the path cannot be read, or if it matches no format; the message lists `kind` and the formats.
pub(crate) fn recognize<F>(
    formats: impl Iterator<Item = &'static Format<F>> + Clone,
    kind: &str,
    path: &Path,
) -> Result<(&'static Format<F>, PathBuf), ReadError> {
    let probe = Probe::new(path);
    for format in formats.clone() {
        if let Some(place) = (format.finds)(&probe)? {
            return Ok((format, place));
        }
    }
    probe.check_json()?;
    if let Some(problem) = known_but_unread(&probe)? {
        return Err(ReadError::new(path, problem));
    }
    if kind == CAMERA && holds_matrices(&probe)? {
        return Err(ReadError::new(path, UNNAMED));
    }
    let looks: Vec<&str> = formats.map(|format| format.looks).filter(|looks| !looks.is_empty()).collect();
    let problem = format!(
        "unknown {kind} format: looked for {}; `quadlift import FORMAT` reads a given format",
        looks.join(", ")
    );
    Err(ReadError::new(path, problem))
}
