//! Writing a file as a whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::error::WriteError;

/// Writes a file through a temporary one in the same folder, which takes its place at the end, so that readers never
/// see half a file and the earlier file survives every failure.
///
/// A link is followed. What is no ordinary file (`/dev/stdout`, a pipe) is written directly.
///
/// # Errors
/// [`WriteError`] when the folder does not exist, when the path is a folder or a write-protected file, or when the
/// system or `write` fails.
pub fn write_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    let fail = |error: io::Error| WriteError::new(path, error);
    let earlier = fs::metadata(path).ok();
    if let Some(earlier) = &earlier {
        if earlier.is_dir() {
            return Err(WriteError::new(path, "it is a folder; expected the name of a file"));
        }
        if earlier.permissions().readonly() {
            return Err(WriteError::new(path, "the file is write-protected"));
        }
        if !earlier.is_file() {
            let mut out = BufWriter::new(fs::OpenOptions::new().write(true).open(path).map_err(fail)?);
            return write(&mut out).and_then(|()| out.flush()).map_err(fail);
        }
    }
    let target = if earlier.is_some() { fs::canonicalize(path).map_err(fail)? } else { path.to_owned() };
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        let problem = format!("the folder {} does not exist", folder.display());
        return Err(WriteError::new(path, problem));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".quadlift-").suffix(".tmp");
    // Temporary files are private by default; the finished one shall be as readable as any other new file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder.tempfile_in(folder).map_err(|error| {
        WriteError::new(path, format!("cannot create a file in the folder {}: {}", folder.display(), plain(&error)))
    })?;
    let mut out = BufWriter::new(file);
    write(&mut out).map_err(fail)?;
    let file = out.into_inner().map_err(|error| fail(error.into_error()))?;
    if let Some(earlier) = earlier {
        // Failing to keep the permissions is no reason to lose the result.
        let _ = fs::set_permissions(file.path(), earlier.permissions());
    }
    file.persist(&target).map_err(|error| fail(error.error))?;
    Ok(())
}

/// Fills a new folder through a temporary one beside it, which takes its name at the end. A folder that is empty may be
/// there already.
///
/// # Errors
/// [`WriteError`] when the folder above does not exist, when there is a file or a folder with files of this name, or when
/// the system or `fill` fails; then nothing is left behind.
pub fn write_folder(path: &Path, fill: impl FnOnce(&Path) -> Result<(), WriteError>) -> Result<(), WriteError> {
    let fail = |error: io::Error| WriteError::new(path, error);
    if path.exists() {
        if !path.is_dir() {
            return Err(WriteError::new(path, "it is a file; expected the name of a new folder"));
        }
        if fs::read_dir(path).map_err(fail)?.next().is_some() {
            return Err(WriteError::new(path, "the folder is not empty; expected the name of a new folder"));
        }
    }
    let above = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !above.is_dir() {
        return Err(WriteError::new(path, format!("the folder {} does not exist", above.display())));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".quadlift-").suffix(".tmp");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    let folder = builder.tempdir_in(above).map_err(|error| {
        WriteError::new(path, format!("cannot make a folder in {}: {}", above.display(), plain(&error)))
    })?;
    fill(folder.path())?;
    if path.exists() {
        fs::remove_dir(path).map_err(fail)?;
    }
    fs::rename(folder.keep(), path).map_err(fail)
}

/// The system's text without the name of the temporary file, which tells nobody anything.
fn plain(error: &io::Error) -> String {
    match error.raw_os_error().or_else(|| inner_code(error)) {
        Some(code) => io::Error::from_raw_os_error(code).to_string(),
        None => error.kind().to_string(),
    }
}

/// The system's code of an error that `tempfile` has wrapped with a path.
fn inner_code(error: &io::Error) -> Option<i32> {
    std::error::Error::source(error.get_ref()?)?.downcast_ref::<io::Error>()?.raw_os_error()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(content: &'static str) -> impl FnOnce(&mut dyn Write) -> io::Result<()> {
        move |out| out.write_all(content.as_bytes())
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_file(&path, text("one")).unwrap();
        write_file(&path, text("two")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn the_earlier_file_survives_a_failure_and_nothing_is_left_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_file(&path, text("one")).unwrap();
        let error = write_file(&path, |out| {
            out.write_all(&[b'x'; 100_000])?;
            Err(io::Error::other("the disk is full"))
        })
        .unwrap_err();
        assert_eq!(error.problem, "the disk is full");
        assert_eq!(error.to_string(), format!("cannot write {}: the disk is full", path.display()));
        assert_eq!(fs::read_to_string(&path).unwrap(), "one");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn bad_targets_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_file(folder.path(), text("x")).unwrap_err();
        assert_eq!(error.problem, "it is a folder; expected the name of a file");
        let error = write_file(&folder.path().join("no/a.txt"), text("x")).unwrap_err();
        assert_eq!(error.problem, format!("the folder {} does not exist", folder.path().join("no").display()));
        let path = folder.path().join("locked.txt");
        fs::write(&path, "one").unwrap();
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        assert_eq!(write_file(&path, text("x")).unwrap_err().problem, "the file is write-protected");
        assert_eq!(fs::read_to_string(&path).unwrap(), "one");
    }

    #[test]
    fn folders_appear_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new");
        let fill = |folder: &Path| write_file(&folder.join("a.txt"), text("x"));
        write_folder(&path, fill).unwrap();
        assert_eq!((names(folder.path()), names(&path)), (vec!["new".to_owned()], vec!["a.txt".to_owned()]));
        assert!(write_folder(&path, fill).unwrap_err().problem.starts_with("the folder is not empty"));
        assert!(write_folder(&path.join("a.txt"), fill).unwrap_err().problem.starts_with("it is a file"));
        let (no, empty) = (folder.path().join("no/new"), folder.path().join("empty"));
        assert!(write_folder(&no, fill).unwrap_err().problem.ends_with("does not exist"));
        fs::create_dir(&empty).unwrap();
        let failing = |_: &Path| Err(WriteError::new(Path::new("a"), "no"));
        assert_eq!(write_folder(&empty, failing).unwrap_err().problem, "no");
        assert_eq!(names(folder.path()), ["empty", "new"], "nothing is left behind");
        write_folder(&empty, fill).unwrap();
        assert_eq!(names(&empty), ["a.txt"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_takes_no_files_is_named() {
        // The proc file system refuses new files even to the administrator.
        let error = write_file(Path::new("/proc/quadlift.txt"), text("x")).unwrap_err();
        assert!(error.problem.starts_with("cannot create a file in the folder /proc: "), "{}", error.problem);
        assert!(!error.problem.contains(".quadlift-"), "{}", error.problem);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_devices_written_directly_and_permissions_kept() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a.txt"), folder.path().join("link.txt"));
        fs::write(&path, "one").unwrap();
        fs::set_permissions(&path, PermissionsExt::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write_file(&link, text("two")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        write_file(Path::new("/dev/null"), text("x")).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
