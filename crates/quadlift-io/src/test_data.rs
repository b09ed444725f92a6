//! Real data for tests, where they are at hand: they cannot be part of the project. The tests of the program and of
//! `bench` include this file.

use std::io::Write;
use std::path::{Path, PathBuf};

/// A file or folder of the real data; where it is missing the test is skipped (see [`skipped`]).
pub(crate) fn real_data(name: &str) -> Option<PathBuf> {
    let data = std::env::var_os("QUADLIFT_DATA").map_or_else(|| repository().join("../shared/data"), PathBuf::from);
    let path = data.join(name);
    if path.exists() {
        return Some(path);
    }
    skipped(&format!("there is no {} (set QUADLIFT_DATA)", path.display()));
    None
}

/// The folder of the repository: that of `Cargo.lock`.
fn repository() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().find(|folder| folder.join("Cargo.lock").exists()).unwrap_or(package)
}

/// Tells that a test has been skipped, past the capture of the test runner; with `QUADLIFT_REQUIRE_DATA=1` it fails.
fn skipped(why: &str) {
    assert!(
        std::env::var_os("QUADLIFT_REQUIRE_DATA").is_none_or(|value| value != "1"),
        "QUADLIFT_REQUIRE_DATA=1, but {why}"
    );
    let name = std::thread::current().name().unwrap_or("a test").to_owned();
    let _ = writeln!(std::io::stderr(), "skipped {name}: {why}");
}
