//! Bytes and text of input files, and the files in a folder.

use std::fs::File;
use std::io::{self, IsTerminal, Read};
use std::path::{Path, PathBuf};

use crate::destination::is_open_file;
use crate::error::ReadError;
use crate::guard::note_read;

/// Most bytes that are read from a pipe.
const MAX_FROM_PIPE: u64 = 1 << 32;

/// The bytes of a file; `-` is the standard input. Devices and named pipes are rejected, because they may be endless or
/// never written to; an open pipe (`/dev/stdin`, `/dev/fd/63` of a shell's `<(...)`) is read.
///
/// # Errors
/// [`ReadError`] if there is no such file, if it is a folder, a device or a named pipe, or if the system reports an error.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    if path.as_os_str() == "-" {
        return read_standard_input(path);
    }
    check_readable(path)?;
    note_read(path);
    let read = || {
        let mut bytes = Vec::new();
        let mut file = File::open(path)?;
        if file.metadata()?.is_file() {
            file.read_to_end(&mut bytes)?;
        } else if file.take(MAX_FROM_PIPE).read_to_end(&mut bytes)? as u64 == MAX_FROM_PIPE {
            return Err(io::Error::other("the pipe holds more than 4 GiB"));
        }
        Ok(bytes)
    };
    read().map_err(|error| read_error(path, &error))
}

/// The bytes of the standard input, which `path` names in messages.
fn read_standard_input(path: &Path) -> Result<Vec<u8>, ReadError> {
    let input = io::stdin();
    if input.is_terminal() {
        return Err(ReadError::new(path, "the standard input is a terminal; expected a file or a pipe"));
    }
    note_read(Path::new("/dev/stdin"));
    let mut bytes = Vec::new();
    match input.lock().take(MAX_FROM_PIPE).read_to_end(&mut bytes) {
        Ok(count) if count as u64 == MAX_FROM_PIPE => Err(ReadError::new(path, "the input holds more than 4 GiB")),
        Ok(_) => Ok(bytes),
        Err(error) => Err(read_error(path, &error)),
    }
}

/// Rejects anything but ordinary files and open pipes before opening, which may block forever.
///
/// # Errors
/// As [`read_bytes`].
pub(crate) fn check_readable(path: &Path) -> Result<(), ReadError> {
    let metadata = std::fs::metadata(path).map_err(|error| read_error(path, &error))?;
    if metadata.is_dir() {
        return Err(read_error(path, &io::ErrorKind::IsADirectory.into()));
    }
    if metadata.is_file() || is_pipe(&metadata) && is_open_file(path) {
        return Ok(());
    }
    let what = if is_pipe(&metadata) { "a named pipe" } else { "a device or a socket" };
    Err(ReadError::new(path, format!("this is {what}; expected a file")))
}

#[cfg(unix)]
fn is_pipe(metadata: &std::fs::Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&metadata.file_type())
}

#[cfg(not(unix))]
fn is_pipe(_: &std::fs::Metadata) -> bool {
    false
}

/// What the system says, in words.
pub(crate) fn read_error(path: &Path, error: &io::Error) -> ReadError {
    let problem = match error.kind() {
        io::ErrorKind::NotFound => "there is no such file".to_owned(),
        io::ErrorKind::IsADirectory => "this is a folder; expected a file".to_owned(),
        // Windows reports a folder as "access denied".
        _ if path.is_dir() => "this is a folder; expected a file".to_owned(),
        _ => format!("cannot read the file: {error}"),
    };
    ReadError::new(path, problem)
}

/// Line and column, both from 1, of a byte; the column counts bytes.
pub(crate) fn line_and_column(bytes: &[u8], offset: usize) -> (usize, usize) {
    let before = &bytes[..offset.min(bytes.len())];
    let line = 1 + before.iter().filter(|&&b| b == b'\n').count();
    let start = before.iter().rposition(|&b| b == b'\n').map_or(0, |newline| newline + 1);
    (line, 1 + before.len() - start)
}

/// The text of a file without a byte order mark.
///
/// # Errors
/// [`ReadError`] with the place of the first byte that is not UTF-8, or when the file is empty.
pub(crate) fn as_utf8<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, ReadError> {
    if bytes.starts_with(&[0xFF, 0xFE]) || bytes.starts_with(&[0xFE, 0xFF]) {
        return Err(ReadError::new(path, "the file is UTF-16 text; save it as UTF-8"));
    }
    let archive = match bytes {
        [b'P', b'K'] | [b'P', b'K', 1..9, ..] => Some("zip"),
        [0x1F, 0x8B, ..] => Some("gzip"),
        _ => None,
    };
    if let Some(kind) = archive {
        return Err(ReadError::new(path, format!("this is a {kind} archive; unpack it and give its folder")));
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let offset = error.valid_up_to();
        let (line, column) = line_and_column(bytes, offset);
        let found = bytes.get(offset).copied().unwrap_or_default();
        ReadError::new(path, format!("the byte {found:#04x} is not UTF-8 text; expected a text file in UTF-8"))
            .at(line, column)
    })?;
    if text.trim().is_empty() {
        return Err(ReadError::new(path, "the file is empty"));
    }
    Ok(text)
}

/// The files with an extension in a folder and in those in it: names relative to the folder, and paths; sorted.
pub(crate) fn paths_below(folder: &Path, extension: &str) -> Result<Vec<(String, PathBuf)>, ReadError> {
    let mut found = Vec::new();
    let mut folders = vec![(String::new(), folder.to_owned())];
    while let Some((prefix, folder)) = folders.pop() {
        let failed = |error: std::io::Error| ReadError::new(&folder, format!("cannot read the folder: {error}"));
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            // Links to folders are not followed: they may lead in circles.
            if entry.file_type().map_err(failed)?.is_dir() {
                folders.push((format!("{name}/"), entry.path()));
            } else if entry.path().extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
                found.push((name, entry.path()));
            }
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_counted_from_one() {
        assert_eq!(line_and_column(b"ab\ncd", 0), (1, 1));
        assert_eq!(line_and_column(b"ab\ncd", 3), (2, 1));
        assert_eq!(line_and_column(b"ab\ncd", 4), (2, 2));
        assert_eq!(line_and_column(b"", 9), (1, 1));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn devices_and_named_pipes_are_refused_and_open_pipes_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let problem = |path: &Path| read_bytes(path).unwrap_err().problem;
        assert_eq!(problem(&pipe), "this is a named pipe; expected a file");
        assert_eq!(problem(Path::new("/dev/zero")), "this is a device or a socket; expected a file");
        assert_eq!(problem(folder.path()), "this is a folder; expected a file");
        assert_eq!(problem(&folder.path().join("no")), "there is no such file");
        let (reader, mut writer) = std::io::pipe().unwrap();
        io::Write::write_all(&mut writer, b"text").unwrap();
        drop(writer);
        let number = std::os::fd::AsRawFd::as_raw_fd(&reader);
        assert_eq!(read_bytes(Path::new(&format!("/dev/fd/{number}"))).unwrap(), b"text");
    }

    #[test]
    fn the_byte_order_mark_is_dropped_and_what_is_no_text_is_named() {
        let path = Path::new("a.json");
        assert_eq!(as_utf8(path, b"\xEF\xBB\xBF{}").unwrap(), "{}");
        assert!(as_utf8(path, b"\xFF\xFE{\0}\0").unwrap_err().problem.contains("UTF-16"));
        assert!(as_utf8(path, b"\xEF\xBB\xBF \n").unwrap_err().problem.contains("empty"));
        for (start, kind) in [(&b"PK\x03\x04\x14\0"[..], "zip"), (b"\x1F\x8B\x08\0", "gzip")] {
            let expected = format!("this is a {kind} archive; unpack it and give its folder");
            assert_eq!(as_utf8(path, start).unwrap_err().problem, expected);
        }
        assert!(as_utf8(path, b"PK,x,y").is_ok());
        let error = as_utf8(path, b"{\n \xC0 }").unwrap_err();
        assert_eq!((error.line, error.column), (Some(2), Some(2)));
    }
}
