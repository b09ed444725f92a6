//! Temporary files and folders: named after their process, removed on failure, on request and by later processes.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io;
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, SystemTime};

/// How the names of temporary files and folders begin.
pub(crate) const PREFIX: &str = ".quadlift-";
const SUFFIX: &str = ".tmp";

/// Leftovers of other machines or containers are removed after this time, because their processes cannot be checked.
const DAY: Duration = Duration::from_secs(86_400);

/// The temporary files of this process, and the folders already checked for leftovers.
#[derive(Default)]
struct Register {
    paths: BTreeSet<PathBuf>,
    searched: BTreeSet<PathBuf>,
    closed: bool,
}

static REGISTER: Mutex<Option<Register>> = Mutex::new(None);

fn register() -> MutexGuard<'static, Option<Register>> {
    REGISTER.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary file or folder, which is removed when this is dropped.
pub(crate) struct Temporary {
    path: PathBuf,
    persisted: bool,
}

impl Temporary {
    /// A new file in a folder, open for writing.
    pub(crate) fn file_in(folder: &Path) -> io::Result<(Self, File)> {
        // Temporary files are private by default; the finished one must be as readable as any other new file.
        Self::make(folder, 0o666, |builder| {
            let (file, path) = builder.tempfile_in(folder)?.keep().map_err(|error| error.error)?;
            Ok((path, file))
        })
    }

    /// A new folder in a folder.
    pub(crate) fn folder_in(folder: &Path) -> io::Result<Self> {
        Self::make(folder, 0o777, |builder| Ok((builder.tempdir_in(folder)?.keep(), ()))).map(|(folder, ())| folder)
    }

    fn make<T>(
        folder: &Path,
        mode: u32,
        make: impl FnOnce(&tempfile::Builder) -> io::Result<(PathBuf, T)>,
    ) -> io::Result<(Self, T)> {
        // The register stays locked while the file is made: no file escapes `remove_temporary_files`.
        let mut register = register();
        let register = register.get_or_insert_default();
        if register.closed {
            return Err(io::Error::from(io::ErrorKind::Interrupted));
        }
        if let Ok(folder) = folder.canonicalize()
            && register.searched.insert(folder.clone())
        {
            remove_left_behind(&folder);
        }
        let prefix = format!("{PREFIX}{}-{}-", std::process::id(), tag());
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(SUFFIX);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(mode));
        #[cfg(not(unix))]
        let _ = mode;
        let (path, file) = make(&builder)?;
        register.paths.insert(path.clone());
        Ok((Self { path, persisted: false }, file))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Renames it to its final name, replacing an existing file.
    pub(crate) fn persist(mut self, path: &Path) -> io::Result<()> {
        fs::rename(&self.path, path)?;
        self.persisted = true;
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.persisted {
            remove(&self.path);
        }
        if let Some(register) = register().as_mut() {
            register.paths.remove(&self.path);
        }
    }
}

/// Removes the temporary files and folders of this process, which makes none afterwards: for the end on a signal.
pub fn remove_temporary_files() {
    let mut register = register();
    let register = register.get_or_insert_default();
    register.closed = true;
    mem::take(&mut register.paths).iter().for_each(|path| remove(path));
}

/// Removes leftovers of killed processes from a folder. Ignores errors.
fn remove_left_behind(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let middle = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
        let Some(middle) = middle else { continue };
        if is_left_behind(middle, || entry.metadata()?.modified()) {
            remove(&entry.path());
        }
    }
}

/// Whether the process that made a name, `PID-TAG-RANDOM`, is dead.
fn is_left_behind(middle: &str, modified: impl FnOnce() -> io::Result<SystemTime>) -> bool {
    let mut parts = middle.split('-');
    if let (Some(Ok(process)), Some(its_tag)) = (parts.next().map(str::parse::<u32>), parts.next())
        && its_tag == tag()
        && its_tag != UNKNOWN
    {
        return !Path::new(&format!("/proc/{process}")).exists();
    }
    modified().is_ok_and(|modified| SystemTime::now().duration_since(modified).is_ok_and(|age| age > DAY))
}

fn remove(path: &Path) {
    // Links are not followed.
    let is_folder = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir());
    let _ = if is_folder { fs::remove_dir_all(path) } else { fs::remove_file(path) };
}

/// The tag where process ids cannot be looked up.
const UNKNOWN: &str = "0";

/// Tells apart the machines, runs of them and containers in which a process id has a meaning.
pub(crate) fn tag() -> &'static str {
    static TAG: OnceLock<String> = OnceLock::new();
    TAG.get_or_init(|| {
        let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id");
        let namespace = fs::read_link("/proc/self/ns/pid");
        let (Ok(boot), Ok(namespace)) = (boot, namespace) else { return UNKNOWN.to_owned() };
        let mut hasher = DefaultHasher::new();
        (boot, namespace).hash(&mut hasher);
        format!("{:08x}", hasher.finish() as u32)
    })
}
