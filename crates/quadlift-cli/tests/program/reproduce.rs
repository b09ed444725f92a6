//! `quadlift reproduce` from end to end; in a program without it, what it says.

use crate::common::Folder;

#[cfg(not(feature = "reproduce"))]
#[test]
fn a_program_without_it_says_how_to_get_it() {
    let folder = Folder::new();
    for arguments in ["reproduce", "reproduce --help", "reproduce tuw --data nowhere --out out", "reproduce all -o x"] {
        let run = folder.run(arguments);
        assert_eq!(run.code, 2, "{arguments}: {}", run.stdout);
        let message = "error: this program was built without `reproduce`, which is for research; to add it: cargo \
                       install --path crates/quadlift-cli --features reproduce\n";
        assert_eq!(run.stderr, message, "{arguments}");
    }
    let json = folder.run("--json reproduce all");
    assert!(json.stdout.contains("--features reproduce"), "{}", json.stdout);
    for help in ["-h", "--help"] {
        assert!(!folder.run(help).stdout.contains("reproduce"));
    }
    assert!(folder.names().is_empty());
}

#[cfg(feature = "reproduce")]
#[test]
fn tables_are_printed_and_written() {
    let Some(scenes) = crate::common::real_scenes() else { return };
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
    assert_eq!(serde_json::from_str::<serde_json::Value>(&json.stdout).unwrap(), folder.json("out/tuw.json"));
    let markdown = folder.run_list(&["reproduce", "tuw", "--data", data, "--markdown"]);
    assert!(markdown.stdout.contains("| PfD+REG | paper | O3D |"), "{}", markdown.stdout);
}

#[cfg(feature = "reproduce")]
#[test]
fn absent_data_is_an_error_before_any_work() {
    let folder = Folder::new();
    let run = folder.run("reproduce all --data nowhere --out out");
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(run.stderr.contains("nowhere") && run.stderr.contains("QUADLIFT_DATA"), "{}", run.stderr);
    assert!(folder.names().is_empty());
}

#[cfg(feature = "reproduce")]
#[test]
fn a_file_in_place_of_the_folder_is_an_error() {
    let folder = Folder::new();
    folder.write("taken", "");
    let run = folder.run("reproduce synthetic --out taken");
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert_eq!(run.stderr, "error: cannot write to taken: it is a file; expected a folder\n");
}
