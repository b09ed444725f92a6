//! `docs/method.md` and its tables of constants name files, constants and values as they are, in its prose, too:
//! `docs/method/prose.csv` has the words around each number that is a constant.

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

/// The cells of a line of a CSV file.
fn cells(line: &str) -> Vec<String> {
    let (mut cells, mut in_quotes) = (vec![String::new()], false);
    for character in line.chars() {
        match character {
            '"' => in_quotes = !in_quotes,
            ',' if !in_quotes => cells.push(String::new()),
            _ => cells.last_mut().unwrap().push(character),
        }
    }
    cells
}

/// Whether the code has the constant of a row: name, value, file, kind and where it comes from.
fn check(page: &str, row: &[String]) {
    let [name, value, file, kind, source] = row else { panic!("{page}: {row:?}") };
    let path = root().join("crates/quadlift/src").join(file);
    let code = in_one_line(&read_to_string(&path).unwrap_or_else(|error| panic!("{file}: {error}")));
    assert!(has(&code, name, value), "{page}: {name} is not {value} in {file}");
    assert!(["derived", "convention", "tuned"].contains(&kind.as_str()), "{page}: {name}: {kind}");
    assert!(!source.is_empty(), "{page}: {name} has no source");
}

#[test]
fn constants_are_those_of_the_code() {
    let page = "docs/method/constants.csv";
    let all: Vec<_> = read_to_string(root().join(page)).unwrap().lines().skip(1).map(cells).collect();
    all.iter().for_each(|row| check(page, row));
    assert!(all.len() > 300, "{}", all.len());

    let page = "docs/method/constants.md";
    let text = read_to_string(root().join(page)).unwrap();
    let mut count = 0;
    for line in text.lines().filter(|line| line.starts_with("| `")) {
        let row: Vec<_> =
            line.trim_matches('|').split(" | ").map(|cell| cell.trim().trim_matches('`').into()).collect();
        check(page, &row);
        assert!(all.iter().any(|other| other[..4] == row[..4]), "docs/method/constants.csv has not {}", row[0]);
        count += 1;
    }
    assert!(count > 20, "{count}");
}

/// A number as prose and code write it: `2.5 %`, `\\ln 100`, `third`, `1.5 degrees`, `1.0 / 3.0`, `20_000`.
fn number(text: &str) -> f64 {
    const WORDS: [(&str, f64); 12] = [
        ("half", 0.5),
        ("third", 1.0 / 3.0),
        ("quarter", 0.25),
        ("fifth", 0.2),
        ("tenth", 0.1),
        ("one", 1.0),
        ("two", 2.0),
        ("three", 3.0),
        ("four", 4.0),
        ("five", 5.0),
        ("six", 6.0),
        ("ten", 10.0),
    ];
    if let Some(rest) = text.strip_prefix("\\ln ") {
        return number(rest).ln();
    }
    if let Some(rest) = text.strip_suffix('%') {
        return number(rest.trim_end_matches([' ', '\\'])) / 100.0;
    }
    if let Some(degrees) =
        [" degrees", " degree", " / 180.0 * std::f64::consts::PI"].iter().find_map(|unit| text.strip_suffix(unit))
    {
        return number(degrees).to_radians();
    }
    if let Some((of, parts)) = text.split_once(" / ") {
        return number(of) / number(parts);
    }
    let word = WORDS.iter().find(|(word, _)| *word == text).map(|(_, number)| *number);
    word.unwrap_or_else(|| text.replace([',', '_'], "").parse().unwrap_or_else(|_| panic!("{text} is no number")))
}

#[test]
fn numbers_in_the_prose_are_those_of_the_code() {
    let constants: Vec<_> =
        read_to_string(root().join("docs/method/constants.csv")).unwrap().lines().skip(1).map(cells).collect();
    let page = in_one_line(&read_to_string(root().join("docs/method.md")).unwrap());
    let rows: Vec<_> =
        read_to_string(root().join("docs/method/prose.csv")).unwrap().lines().skip(1).map(cells).collect();
    for row in &rows {
        let [name, file, phrase] = &row[..] else { panic!("docs/method/prose.csv: {row:?}") };
        let shown = phrase.replace(['<', '>'], "");
        let times = page.matches(&shown).count();
        assert_eq!(times, 1, "docs/method.md has {times} times \"{shown}\", with {name} of {file}");
        let constant = constants.iter().find(|row| row[0] == *name && row[2] == *file);
        let value = &constant.unwrap_or_else(|| panic!("docs/method/constants.csv has not {name} of {file}"))[1];
        let in_code: Vec<f64> = value.trim_matches(['[', ']']).split(", ").map(number).collect();
        let in_prose: Vec<f64> =
            phrase.split('<').skip(1).filter_map(|rest| rest.split_once('>')).map(|(text, _)| number(text)).collect();
        // Prose rounds ln 100 and a degree less than the code.
        let agree = |(a, b): (&f64, &f64)| (a - b).abs() <= 3e-3 * a.abs();
        assert!(
            in_code.len() == in_prose.len() && in_code.iter().zip(&in_prose).all(agree),
            "docs/method.md: \"{shown}\", but {name} of {file} is {value}"
        );
    }
    assert!(rows.len() > 150, "{}", rows.len());
}
