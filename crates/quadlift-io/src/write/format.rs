//! The row of a format that is written.

use super::options::WriteOptions;
use super::{CheckedScene, Document};
use crate::error::{EntryError, ReadError};
use crate::scene_file::SceneFile;

/// A format of other programs that is written.
#[derive(Debug)]
pub struct ExportFormat {
    /// The name on the command line, such as "ply".
    pub name: &'static str,
    /// What it contains, for the help of the program.
    pub about: &'static str,
    /// The options that its writer takes, by their names in [`super::WRITE`].
    pub options: &'static [&'static str],
    /// The writer.
    pub write: Writer,
}

/// What a writer needs, and what it writes.
#[derive(Debug)]
pub enum Writer {
    /// Objects that have bodies, in one file.
    Bodies(fn(&CheckedScene, &WriteOptions) -> Result<Document, ReadError>),
    /// Objects with and without bodies: a table, and that of their views.
    Tables(fn(&SceneFile) -> Result<[Document; 2], EntryError>),
    /// Cameras, in one file.
    Cameras(fn(&SceneFile, &WriteOptions) -> Result<Document, EntryError>),
    /// Cameras, in files of a folder with these names.
    CameraFolder([&'static str; 3], fn(&SceneFile) -> Result<[Document; 3], EntryError>),
}
