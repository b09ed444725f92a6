//! Files and pipes of lines.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use crate::error::ReadError;
use crate::guard::note_read;
use crate::input::read_error;

/// Opens a file of lines. Unlike files that are read as a whole, it may be a named pipe.
///
/// # Errors
/// [`ReadError`] when there is no such file, when it is a folder, or when the system refuses.
pub fn open(path: &Path) -> Result<Box<dyn BufRead + Send>, ReadError> {
    note_read(path);
    let failed = |error: io::Error| read_error(path, &error);
    let file = File::open(path).map_err(failed)?;
    if file.metadata().map_err(failed)?.is_dir() {
        return Err(read_error(path, &io::ErrorKind::IsADirectory.into()));
    }
    Ok(Box::new(BufReader::new(file)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_and_missing_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let problem = |path: &Path| open(path).err().map(|error| error.problem);
        assert_eq!(problem(folder.path()).unwrap(), "this is a folder; expected a file");
        assert_eq!(problem(&folder.path().join("no")).unwrap(), "there is no such file");
    }
}
