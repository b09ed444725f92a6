//! `python/quadlift/_run_options.py`: the options of the tables as Python types. With
//! QUADLIFT_UPDATE_DOCS=1 the test writes it.

use std::path::Path;

use quadlift_io::options::{ASSOCIATION, Command, Kind, MAP, RUN, Spec, Value};
use quadlift_io::segmentation::SEGMENTATION;

const HEAD: &str = r#""""Options: types and kinds, written from crates/quadlift-io/src/options by the tests of the program.

Do not edit; after a change of a table: ``QUADLIFT_UPDATE_DOCS=1 cargo test --test program python_options``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypedDict
"#;

/// The type of the values.
fn type_of<O: Default>(row: &Spec<O>) -> String {
    let choice = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
        format!("Literal[{}]", names.join(", "))
    };
    let name = match row.kind {
        Kind::Flag => "bool".to_owned(),
        Kind::Number(_) => "float".to_owned(),
        Kind::Whole(_) => "int".to_owned(),
        Kind::Choice(names) | Kind::ChoiceOr(_, names) => choice(names),
        Kind::Numbers(names) => format!("tuple[{}]", vec!["float"; names.len()].join(", ")),
        Kind::Text => "str".to_owned(),
        Kind::Levels => "Mapping[str, float]".to_owned(),
    };
    if row.default() == Value::Unset { name + " | None" } else { name }
}

/// What Python checks before the library does.
fn kind_of<O>(row: &Spec<O>) -> &'static str {
    match row.kind {
        Kind::Flag => "flag",
        Kind::Number(_) => "number",
        Kind::Whole(_) => "whole",
        Kind::Choice(_) | Kind::ChoiceOr(..) | Kind::Text => "text",
        Kind::Numbers(_) => "numbers",
        Kind::Levels => "levels",
    }
}

/// The help and the default, as a docstring.
fn docstring<O: Default>(row: &Spec<O>) -> String {
    let default = match row.default() {
        Value::Unset | Value::Flag(false) => String::new(),
        Value::Flag(true) => " Default: True.".to_owned(),
        value => format!(" Default: {value}."),
    };
    let text = format!("\"\"\"{}.{default}\"\"\"", row.help.split_whitespace().collect::<Vec<_>>().join(" "));
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.last_mut().unwrap();
        if last.is_empty() {
            last.push_str(word);
        } else if last.chars().count() + 1 + word.chars().count() > 112 {
            lines.push(word.to_owned());
        } else {
            last.push(' ');
            last.push_str(word);
        }
    }
    lines.iter().map(|line| format!("    {line}\n")).collect()
}

/// A class with the options of a table, and a dictionary of their kinds.
fn class_of<O: Default>(class: &str, doc: &str, kinds: &str, rows: &[Spec<O>]) -> String {
    let rows: Vec<_> = rows.iter().filter(|row| row.is_of(Command::Python)).collect();
    let fields: String =
        rows.iter().map(|row| format!("    {}: {}\n{}", row.name, type_of(row), docstring(row))).collect();
    let entries: String = rows.iter().map(|row| format!("    \"{}\": \"{}\",\n", row.name, kind_of(row))).collect();
    format!(
        "\n\nclass {class}(TypedDict, total=False):\n    \"\"\"{doc}\"\"\"\n\n{fields}\n\n{kinds} = {{\n{entries}}}\n\
         \"\"\"The kind of value of each of them.\"\"\"\n"
    )
}

#[test]
fn python_has_the_options_of_the_tables() {
    let of_objects = RUN.iter().filter(|row| row.is_of(Command::Python) && !row.whole_scene);
    let of_objects: String = of_objects.map(|row| format!("        \"{}\",\n", row.name)).collect();
    let text = [
        HEAD.to_owned(),
        class_of("RunOptions", "Options of a run, as the program has them.", "RUN_KINDS", RUN),
        format!(
            "\nOF_OBJECTS = frozenset(\n    {{\n{of_objects}    }}\n)\n\"\"\"Those that concern single objects.\"\"\"\n"
        ),
        class_of("AssociationOptions", "Options of an association.", "ASSOCIATION_KINDS", ASSOCIATION),
        class_of("SegmentationOptions", "Options of a segmentation.", "SEGMENTATION_KINDS", SEGMENTATION),
        class_of("MapOptions", "Options of an object map.", "MAP_KINDS", MAP),
    ]
    .concat();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../python/quadlift/_run_options.py");
    if std::env::var_os("QUADLIFT_UPDATE_DOCS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(text == written, "{} is out of date; run with QUADLIFT_UPDATE_DOCS=1", path.display());
}
