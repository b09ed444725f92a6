//! `docs/method.md` and its table of constants name files, constants and values as they are.

use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Rust files below a folder.
fn rust_files(folder: &Path, files: &mut Vec<String>) {
    for entry in read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path.display().to_string().replace('\\', "/"));
        }
    }
}

/// Texts between backquotes.
fn quoted(page: &str) -> impl Iterator<Item = &str> {
    page.split('`').skip(1).step_by(2)
}

/// The text on one line.
fn in_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether a source has a constant of this name and value, or both in another place: fields and functions.
fn has(source: &str, name: &str, value: &str) -> bool {
    if name.chars().any(char::is_lowercase) {
        return source.contains(name) && source.contains(value);
    }
    let value = format!("{value};");
    let is_value = |rest: &str| rest.split_once(" = ").is_some_and(|(_, rest)| rest.starts_with(&value));
    let tuned = format!(" {name} = {value}");
    source.split(&format!("const {name}: ")).skip(1).any(is_value) || source.contains(&tuned)
}

#[test]
fn files_that_the_method_names_exist() {
    let mut files = Vec::new();
    for folder in ["crates/quadlift/src", "crates/quadlift/tests", "crates/quadlift-segment/src"] {
        rust_files(&root().join(folder), &mut files);
    }
    let page = read_to_string(root().join("docs/method.md")).unwrap();
    let named: Vec<&str> = quoted(&page).filter(|text| text.ends_with(".rs")).collect();
    assert!(named.len() > 30, "{named:?}");
    for name in named {
        assert!(files.iter().any(|file| file.ends_with(&format!("/{name}"))), "docs/method.md names {name}");
    }
}

#[test]
fn constants_are_those_of_the_code() {
    let page = read_to_string(root().join("docs/method/constants.md")).unwrap();
    let mut count = 0;
    for line in page.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.split('|').map(|cell| cell.trim().trim_matches('`')).collect();
        let [_, name, value, file, kind, ..] = cells[..] else { panic!("docs/method/constants.md: {line}") };
        let path = root().join("crates/quadlift/src").join(file);
        let source = in_one_line(&read_to_string(&path).unwrap_or_else(|error| panic!("{file}: {error}")));
        assert!(has(&source, name, value), "docs/method/constants.md: {name} is not {value} in {file}");
        assert!(["derived", "convention", "tuned"].contains(&kind), "{name}: {kind}");
        count += 1;
    }
    assert!(count > 100, "{count}");
}
