//! The program from end to end.

#![allow(clippy::unwrap_used)]

#[path = "../../crates/quadlift-io/src/test_data.rs"]
mod test_data;

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// Runs the program in a folder.
fn bench(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_quadlift-bench")).args(arguments).current_dir(folder).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn is_empty(folder: &Path) -> bool {
    folder.read_dir().unwrap().next().is_none()
}

#[test]
fn tables_are_printed_and_written() {
    let Some(scenes) = test_data::real_data("scenes") else { return };
    let data = scenes.parent().unwrap().canonicalize().unwrap();
    let data = data.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let run = bench(folder.path(), &["tuw", "--data", data, "--out", "out", "--report", "tuw.html"]);
    assert!(run.status.success(), "{}", text(&run.stderr));
    let printed = text(&run.stdout);
    assert!(printed.contains("PfD+REG+ES") && printed.contains("± "), "{printed}");
    let page = std::fs::read_to_string(folder.path().join("out/tuw.md")).unwrap();
    let command = "cargo run --release -p quadlift-bench -- tuw --out out\n";
    assert!(page.contains(command) && page.contains("| PfD+REG | paper | O3D |"), "{page}");
    assert!(std::fs::read_to_string(folder.path().join("tuw.html")).unwrap().contains("PfD+REG"));
    // The file holds what --json prints.
    let json = bench(folder.path(), &["tuw", "--data", data, "--json"]);
    let written = std::fs::read(folder.path().join("out/tuw.json")).unwrap();
    let parsed = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).unwrap();
    assert_eq!(parsed(&json.stdout), parsed(&written));
    let markdown = bench(folder.path(), &["tuw", "--data", data, "--markdown"]);
    assert!(text(&markdown.stdout).contains("| PfD+REG | paper | O3D |"));
}

#[test]
fn absent_data_is_an_error_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let run = bench(folder.path(), &["all", "--data", "nowhere", "--out", "out"]);
    assert_eq!(run.status.code(), Some(1));
    let error = text(&run.stderr);
    assert!(error.starts_with("error: ") && error.contains("nowhere") && error.contains("QUADLIFT_DATA"), "{error}");
    assert!(is_empty(folder.path()));
}

#[test]
fn a_file_in_place_of_the_folder_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("taken"), "").unwrap();
    let run = bench(folder.path(), &["synthetic", "--out", "taken"]);
    assert_eq!(run.status.code(), Some(1));
    assert_eq!(text(&run.stderr), "error: cannot write to taken: it is a file; expected a folder\n");
}

#[test]
fn programs_that_cannot_be_compared_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let run = bench(folder.path(), &["compare", "nowhere/quadlift", "nowhere/quadlift"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(text(&run.stderr).starts_with("error: nowhere/quadlift: there is no such program"), "{run:?}");
    // This program knows no `localize`.
    let other = env!("CARGO_BIN_EXE_quadlift-bench");
    let run = bench(folder.path(), &["compare", other, other, "--seeds", "1"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(text(&run.stderr).contains("localize"), "{run:?}");
}
