//! `quadlift reproduce` from end to end.

use crate::common::{Folder, real_scenes};
use serde_json::Value;

#[test]
fn tables_are_printed_and_written() {
    let Some(scenes) = real_scenes() else { return };
    let data = scenes.parent().unwrap().to_str().unwrap();
    let folder = Folder::new();
    let run = folder.run_list(&["reproduce", "tuw", "--data", data, "--out", "out"]);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    assert!(run.stdout.contains("PfD+REG+ES") && run.stdout.contains("± "), "{}", run.stdout);
    let page = folder.read("out/tuw.md");
    assert!(
        page.contains("quadlift reproduce tuw --out out\n") && page.contains("| PfD+REG | paper | O3D |"),
        "{page}"
    );
    // The file holds what --json prints.
    let json = folder.run_list(&["reproduce", "tuw", "--data", data, "--json"]);
    assert_eq!(serde_json::from_str::<Value>(&json.stdout).unwrap(), folder.json("out/tuw.json"));
    let markdown = folder.run_list(&["reproduce", "tuw", "--data", data, "--markdown"]);
    assert!(markdown.stdout.contains("| PfD+REG | paper | O3D |"), "{}", markdown.stdout);
}

#[test]
fn absent_data_is_an_error_before_any_work() {
    let folder = Folder::new();
    let run = folder.run("reproduce all --data nowhere --out out");
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(run.stderr.contains("nowhere") && run.stderr.contains("QUADLIFT_DATA"), "{}", run.stderr);
    assert!(folder.names().is_empty());
}
