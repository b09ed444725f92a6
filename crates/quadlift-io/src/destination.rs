//! Outputs to standard streams and other open files.

use std::path::{Path, PathBuf};

/// An output that is open already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stream {
    /// The standard output.
    Output,
    /// The standard error stream.
    Error,
    /// Another open file of this process, by its number.
    Other,
}

/// Maximum number of links to a file; the limit of Linux.
const MAX_LINKS: usize = 40;

/// The open file that a path names: `-`, or one that leads to `/dev/stdout`, `/dev/fd/1`, `/proc/self/fd/1` and the like.
///
/// When such a file is an ordinary one, links alone would lead to it, and it would be replaced: what was in it, and what
/// others write to it, would be lost.
pub(crate) fn stream(path: &Path) -> Option<Stream> {
    if path.as_os_str() == "-" {
        return Some(Stream::Output);
    }
    if !cfg!(unix) {
        return None;
    }
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        if let Some(number) = number_of_open_file(&path) {
            return Some(match number {
                1 => Stream::Output,
                2 => Stream::Error,
                _ => Stream::Other,
            });
        }
        let next = std::fs::read_link(&path).ok()?;
        path = path.parent().map_or(next.clone(), |folder| folder.join(&next));
    }
    None
}

/// Whether a path leads to an open file of this process, such as `/dev/stdin`.
pub(crate) fn is_open_file(path: &Path) -> bool {
    stream(path).is_some()
}

/// Whether a path is that of the standard output: `-`, `/dev/stdout` or the like.
pub fn is_standard_output(path: &Path) -> bool {
    stream(path) == Some(Stream::Output)
}

fn number_of_open_file(path: &Path) -> Option<u32> {
    let number: u32 = path.file_name()?.to_str()?.parse().ok()?;
    let folder = path.parent()?.canonicalize().ok()?;
    let process = PathBuf::from(format!("/proc/{}/fd", std::process::id()));
    // Linux: /dev/fd and /proc/self/fd are links to the third; other systems have the first alone.
    (folder == process || folder == Path::new("/dev/fd")).then_some(number)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn standard_streams_are_known_by_all_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("/dev/stdout", &link).unwrap();
        for path in ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", link.to_str().unwrap()] {
            assert_eq!(stream(Path::new(path)), Some(Stream::Output), "{path}");
        }
        assert_eq!(stream(Path::new("/dev/stderr")), Some(Stream::Error));
        assert_eq!(stream(Path::new("/dev/fd/7")), Some(Stream::Other));
        for path in ["/dev/null", "1", "a/-", "/tmp/fd/1"] {
            assert_eq!(stream(Path::new(path)), None, "{path}");
        }
    }
}
