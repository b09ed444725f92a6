//! Files that a run has read are not overwritten by it.
//!
//! Off by default, because users of the library may want to save a scene where it was read. The program switches it on.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::WriteError;

/// The identity of a file, independent of paths and links: device and inode, or the real path where there
/// are no inodes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Identity {
    #[cfg(unix)]
    Inode(u64, u64),
    #[cfg(not(unix))]
    Path(PathBuf),
}

fn identity(path: &Path) -> Option<Identity> {
    let metadata = std::fs::metadata(path).ok()?;
    of_file(path, &metadata)
}

/// The identity of an ordinary file; devices and pipes can be read and written at once.
#[cfg(unix)]
fn of_file(_: &Path, metadata: &Metadata) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    metadata.is_file().then(|| Identity::Inode(metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn of_file(path: &Path, metadata: &Metadata) -> Option<Identity> {
    metadata.is_file().then(|| path.canonicalize().ok().map(Identity::Path))?
}

/// Whether two paths refer to the same existing file: the same path, a link, or another name of the same inode.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    identity(a).is_some_and(|a| identity(b) == Some(a))
}

/// The first path of the second list that leads to the same file as one of the first, with that one.
pub fn common_file<'a>(first: &'a [PathBuf], second: &'a [PathBuf]) -> Option<(&'a Path, &'a Path)> {
    let known: BTreeMap<Identity, &Path> =
        first.iter().filter_map(|path| Some((identity(path)?, path.as_path()))).collect();
    second.iter().find_map(|path| Some((*known.get(&identity(path)?)?, path.as_path())))
}

/// What must not be overwritten.
#[derive(Default)]
struct Guard {
    read: BTreeSet<Identity>,
    /// Files that scenes refer to: checked only if an output already exists.
    named: BTreeSet<PathBuf>,
}

static GUARD: Mutex<Option<Guard>> = Mutex::new(None);

fn guard() -> MutexGuard<'static, Option<Guard>> {
    GUARD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on [`crate::write_file`] refuses to overwrite any file that this process reads, or that a scene which it reads
/// refers to as image or mask.
pub fn protect_what_is_read() {
    guard().get_or_insert_default();
}

/// Notes that a file is read.
pub(crate) fn note_read(path: &Path) {
    if let Some(guard) = guard().as_mut() {
        guard.read.extend(identity(path));
    }
}

/// Notes files that a scene refers to.
pub(crate) fn note_named(paths: impl Iterator<Item = PathBuf>) {
    if let Some(guard) = guard().as_mut() {
        guard.named.extend(paths);
    }
}

/// Allows overwriting a file, for changes in place.
pub fn allow_overwriting(path: &Path) {
    if let (Some(guard), Some(identity)) = (guard().as_mut(), identity(path)) {
        guard.read.remove(&identity);
    }
}

/// Rejects an output that this process has read, or to which a scene refers. Has no effect without
/// [`protect_what_is_read`].
///
/// # Errors
/// [`WriteError`] with the path of the output.
pub fn check_not_read(output: &Path) -> Result<(), WriteError> {
    let guard = guard();
    let Some((guard, identity_of_output)) = guard.as_ref().zip(identity(output)) else { return Ok(()) };
    if guard.read.contains(&identity_of_output) {
        let problem = "the file is an input of this run and would be overwritten; choose another output";
        return Err(WriteError::new(output, problem));
    }
    if guard.named.iter().any(|path| identity(path).as_ref() == Some(&identity_of_output)) {
        let problem = "the file is an image or mask of a scene and would be overwritten; choose another output";
        return Err(WriteError::new(output, problem));
    }
    Ok(())
}
