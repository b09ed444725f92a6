//! The program `quadlift`: lifts 2D object detections from posed images to 3D objects.
#![forbid(unsafe_code)]

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os();
    let called = arguments.next().unwrap_or_else(|| "quadlift".into());
    ExitCode::from(quadlift_cli::main(vec![command(called)], arguments.collect()))
}

/// What a shell takes for this program: its name if it is on the search path, otherwise its path, as after `cargo run`.
fn command(called: OsString) -> OsString {
    if Path::new(&called).components().count() <= 1 || is_on_path() { "quadlift".into() } else { called }
}

/// Whether `quadlift` on the search path is this program.
fn is_on_path() -> bool {
    let own = std::env::current_exe().and_then(std::fs::canonicalize);
    let (Ok(own), Some(path)) = (own, std::env::var_os("PATH")) else { return false };
    let name = format!("quadlift{}", std::env::consts::EXE_SUFFIX);
    let first = std::env::split_paths(&path).map(|folder| folder.join(&name)).find(|file| file.is_file());
    first.and_then(|file| std::fs::canonicalize(file).ok()) == Some(own)
}
