//! Atomic writes: a file is written completely or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::destination::{Stream, stream};
use crate::error::WriteError;
use crate::guard::check_not_read;
use crate::temporary::{PREFIX, Temporary};

/// Writes a file through a temporary one in the same folder, which takes its place at the end, so that readers never
/// see half a file and the earlier file survives every failure. The file and its folder are synced to the disk.
///
/// A link is followed. Special files are written directly and never replaced: pipes, devices, `-` (the standard
/// output), and open files by their number (`/dev/stdout`, `/dev/fd/3`), to which the content is appended.
///
/// # Errors
/// [`WriteError`] when the folder does not exist, when the path is a folder, a write-protected file or one that this run
/// reads (see [`crate::guard`]), or when the system or `write` fails.
pub fn write_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    let fail = |error: io::Error| WriteError::new(path, plain(&error));
    let to_stream = |out: &mut dyn Write| write_buffered(out, write);
    let write = match stream(path) {
        Some(Stream::Output) => {
            return match to_stream(&mut io::stdout().lock()) {
                // The reader has seen enough (`... -o - | head`).
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
                written => written.map_err(fail),
            };
        }
        Some(Stream::Error) => return to_stream(&mut io::stderr().lock()).map_err(fail),
        Some(Stream::Other) => {
            let mut out = fs::OpenOptions::new().append(true).open(path).map_err(fail)?;
            return to_stream(&mut out).map_err(fail);
        }
        None => to_stream,
    };
    let earlier = fs::metadata(path).ok();
    if let Some(earlier) = &earlier {
        if earlier.is_dir() {
            return Err(WriteError::new(path, "it is a folder; expected the name of a file"));
        }
        if earlier.permissions().readonly() {
            return Err(WriteError::new(path, "the file is write-protected"));
        }
        if !earlier.is_file() {
            return write(&mut fs::OpenOptions::new().write(true).open(path).map_err(fail)?).map_err(fail);
        }
    }
    check_not_read(path)?;
    let target = if earlier.is_some() { fs::canonicalize(path).map_err(fail)? } else { path.to_owned() };
    let folder = folder_of(&target);
    if !folder.is_dir() {
        let problem = format!("the folder {} does not exist", folder.display());
        return Err(WriteError::new(path, problem));
    }
    let (temporary, mut file) = Temporary::file_in(folder).map_err(|error| {
        WriteError::new(path, format!("cannot create a file in the folder {}: {}", folder.display(), plain(&error)))
    })?;
    write(&mut file).map_err(fail)?;
    if let Some(earlier) = earlier {
        // Failing to copy the permissions does not fail the write.
        let _ = fs::set_permissions(temporary.path(), earlier.permissions());
    }
    // Before the new name: otherwise a crash of the machine could leave an empty file in place of the earlier one.
    synced(file.sync_all()).map_err(fail)?;
    drop(file);
    temporary.persist(&target).map_err(fail)?;
    sync_folder(folder).map_err(fail)
}

fn write_buffered(out: &mut dyn Write, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(out);
    write(&mut out)?;
    out.flush()
}

/// The folder that holds a path.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The result of syncing; a file system without sync support is not an error.
fn synced(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        result => result,
    }
}

/// Syncs the names in a folder to the disk.
fn sync_folder(folder: &Path) -> io::Result<()> {
    // Elsewhere folders cannot be opened. A folder that may be written but not read cannot be synced.
    if cfg!(unix)
        && let Ok(folder) = File::open(folder)
    {
        return synced(folder.sync_all());
    }
    Ok(())
}

/// Fills a new folder through a temporary one beside it, which is renamed at the end. An existing empty folder is
/// allowed.
///
/// # Errors
/// [`WriteError`] when the folder above does not exist, when there is a file or a folder with files of this name, or when
/// the system or `fill` fails; then nothing is left behind. Errors of `fill` about paths in the temporary folder are reported
/// with the path that they would have had.
pub fn write_folder(path: &Path, fill: impl FnOnce(&Path) -> Result<(), WriteError>) -> Result<(), WriteError> {
    let fail = |error: io::Error| WriteError::new(path, plain(&error));
    if path.exists() {
        if !path.is_dir() {
            return Err(WriteError::new(path, "it is a file; expected the name of a new folder"));
        }
        if fs::read_dir(path).map_err(fail)?.next().is_some() {
            return Err(WriteError::new(path, "the folder is not empty; expected the name of a new folder"));
        }
    }
    let above = folder_of(path);
    if !above.is_dir() {
        return Err(WriteError::new(path, format!("the folder {} does not exist", above.display())));
    }
    let temporary = Temporary::folder_in(above).map_err(|error| {
        WriteError::new(path, format!("cannot make a folder in {}: {}", above.display(), plain(&error)))
    })?;
    fill(temporary.path()).map_err(|error| {
        let inside = error.path.strip_prefix(temporary.path()).map(|inside| path.join(inside));
        WriteError { path: inside.unwrap_or(error.path), ..error }
    })?;
    sync_folder(temporary.path()).map_err(fail)?;
    if path.exists() {
        fs::remove_dir(path).map_err(fail)?;
    }
    temporary.persist(path).map_err(fail)?;
    sync_folder(above).map_err(fail)
}

/// The error's text without the name of the temporary file, which means nothing to the user.
fn plain(error: &io::Error) -> String {
    match error.raw_os_error().or_else(|| inner_code(error)) {
        Some(code) => io::Error::from_raw_os_error(code).to_string(),
        // `tempfile` has put the path into the text.
        None if error.to_string().contains(PREFIX) => error.kind().to_string(),
        None => error.to_string(),
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
    fn what_a_dead_process_left_behind_is_removed_at_the_next_write() {
        let folder = tempfile::tempdir().unwrap();
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let (dead, living) = (child.id(), std::process::id());
        child.wait().unwrap();
        let tag = crate::temporary::tag();
        let old =
            fs::FileTimes::new().set_modified(std::time::SystemTime::now() - std::time::Duration::from_secs(172_800));
        let make = |name: &str, times: Option<fs::FileTimes>| {
            let file = File::create(folder.path().join(name)).unwrap();
            times.map_or(Ok(()), |times| file.set_times(times)).unwrap();
        };
        make(&format!(".quadlift-{dead}-{tag}-abc.tmp"), None);
        make(&format!(".quadlift-{living}-{tag}-abc.tmp"), None);
        // Of another machine: it cannot be asked whether the process lives.
        make(&format!(".quadlift-{dead}-0123-abc.tmp"), None);
        make(&format!(".quadlift-{dead}-0123-old.tmp"), Some(old));
        make(".quadlift-notes.tmp.txt", Some(old));
        fs::create_dir_all(folder.path().join(format!(".quadlift-{dead}-{tag}-dir.tmp/sub"))).unwrap();
        write_file(&folder.path().join("a.txt"), text("x")).unwrap();
        let mut expected = vec![
            format!(".quadlift-{dead}-0123-abc.tmp"),
            format!(".quadlift-{living}-{tag}-abc.tmp"),
            ".quadlift-notes.tmp.txt".to_owned(),
            "a.txt".to_owned(),
        ];
        expected.sort();
        assert_eq!(names(folder.path()), expected);
    }

    #[test]
    fn errors_name_the_file_and_not_the_temporary_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new");
        let error = write_folder(&path, |inside| write_file(&inside.join("no/a.txt"), text("x"))).unwrap_err();
        assert_eq!(error.path, path.join("no/a.txt"));
        let failing = |_: &mut dyn Write| Err(io::Error::from(io::ErrorKind::StorageFull));
        let error = write_file(&folder.path().join("a.txt"), failing).unwrap_err();
        assert!(!error.to_string().contains(".quadlift-"), "{error}");
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
