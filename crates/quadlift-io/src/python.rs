//! Messages in the words of Python: options of the program become keywords, its commands functions.

use crate::options::{ASSOCIATION, Kind, MAP, RUN, Spec, Spelling};
use crate::read::READ;
use crate::read::detections::MatchBy;
use crate::segmentation::SEGMENTATION;
use crate::write::WRITE;

/// What Python has in the place of commands that messages name.
const COMMANDS: [(&str, &str); 7] = [
    ("`quadlift import FORMAT ... --images DIR`", "`Scene.from_cameras(..., images=...)`"),
    ("`quadlift import FORMAT`", "`format=...`"),
    ("\"quadlift localize --enclosing\"", "localize(enclosing=True)"),
    ("`quadlift localize`", "`Scene.localize`"),
    ("`quadlift segment`", "`Scene.segment`"),
    ("`quadlift relocalize`", "`Estimates.relocalize`"),
    ("`quadlift calibrate-rig`", "`calibrate_rig`"),
];

/// How a correction is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correcting {
    /// `corrected("poses=opengl")`, of a scene or of estimates.
    Scene,
    /// `assume="boxes=xywh"`, of what reads a file.
    Reading,
}

/// The placeholder of an option, empty for a flag, and its values that are names; `None` if there is no such option.
fn values_of(name: &str) -> Option<(&'static str, Vec<&'static str>)> {
    fn of_table<O>(rows: &'static [Spec<O>], name: &str) -> Option<(&'static str, Vec<&'static str>)> {
        let row = rows.iter().find(|row| row.name == name)?;
        let names: &[&str] = match row.kind {
            Kind::Choice(names) | Kind::ChoiceOr(_, names) => names,
            _ => &[],
        };
        Some((row.placeholder, names.to_vec()))
    }
    let read = || READ.iter().find(|row| row.name == name).map(|row| (row.value, Vec::new()));
    let write = || WRITE.iter().find(|row| row.name == name).map(|row| (row.value, Vec::new()));
    let others = || match name {
        "match" => Some(("HOW", MatchBy::ALL.map(MatchBy::name).to_vec())),
        "replace" => Some(("", Vec::new())),
        _ => None,
    };
    of_table(RUN, name)
        .or_else(|| of_table(MAP, name))
        .or_else(|| of_table(ASSOCIATION, name))
        .or_else(|| of_table(SEGMENTATION, name))
        .or_else(read)
        .or_else(write)
        .or_else(others)
}

/// An option with the word that follows it, as Python writes both, and whether the word is its value.
fn keyword(name: &str, word: &str, correcting: Correcting) -> Option<(String, bool)> {
    let is_number = word.split(',').all(|part| part.parse::<f64>().is_ok());
    let several = |text: &str| format!("({})", text.replace(',', ", "));
    match (name, correcting) {
        ("assume", Correcting::Scene) => return Some((format!("corrected(\"{word}\")"), true)),
        ("assume", Correcting::Reading) => return Some((format!("assume=\"{word}\""), true)),
        ("fix", _) => return Some(("corrected(fix=True)".to_owned(), false)),
        ("up", _) if is_number => return Some((format!("corrected(up={})", several(word)), true)),
        ("up", _) => return Some((format!("corrected(up=\"{word}\")"), true)),
        _ => {}
    }
    let (placeholder, names) = values_of(name)?;
    let is_placeholder = word.starts_with(|c: char| c.is_ascii_uppercase()) && !word.contains(char::is_lowercase);
    Some(match word {
        _ if placeholder.is_empty() => (format!("{name}=True"), false),
        _ if names.contains(&word) => (Spelling::Keyword.with_value(name, word), true),
        _ if (is_number || is_placeholder) && word.contains(',') => (format!("{name}={}", several(word)), true),
        _ if is_number => (format!("{name}={word}"), true),
        _ => (format!("{name}=..."), is_placeholder),
    })
}

/// A message with functions in the place of commands.
fn with_functions(message: &str) -> String {
    COMMANDS.iter().fold(message.to_owned(), |text, (command, instead)| text.replace(command, instead))
}

/// A message in the words of Python. Unknown options, as those in names of files, stay as they are.
pub fn in_python(message: &str, correcting: Correcting) -> String {
    let message = with_functions(message);
    let mut parts = message.split("--");
    let mut told = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(part.len());
        let (name, rest) = part.split_at(end);
        let after = rest.strip_prefix(' ').unwrap_or_default();
        let end = after.find([' ', ')', ';', ':', '"', '`']).unwrap_or(after.len());
        let (word, others) = after.split_at(end);
        let follows = told.chars().next_back().is_none_or(|c| " (\"`".contains(c));
        match keyword(&name.replace('-', "_"), word, correcting).filter(|_| follows) {
            None => told.extend(["--", part]),
            Some((words, false)) => told.extend([&words, rest]),
            // Another option follows.
            Some((words, true)) if others == " " => told.extend([&words, ", "]),
            Some((words, true)) => told.extend([&words, others]),
        }
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn options_become_keywords() {
        for (words, expected) in [
            ("wrong (--assume poses=opengl)", "wrong (corrected(\"poses=opengl\"))"),
            ("wrong (--up -y)", "wrong (corrected(up=\"-y\"))"),
            ("wrong (--up 0,0.6,0.8)", "wrong (corrected(up=(0, 0.6, 0.8)))"),
            ("two mistakes (--fix)", "two mistakes (corrected(fix=True))"),
            ("ids switch (--associate always --ids ignore)", "ids switch (associate=\"always\", ids=\"ignore\")"),
            ("several (--source SOURCE)", "several (source=...)"),
            ("set it with --north X,Y,Z", "set it with north=(X, Y, Z)"),
            ("1 was subtracted (--box-origin 0 keeps them)", "1 was subtracted (box_origin=0 keeps them)"),
            ("; --match index compares the numbers", "; match=\"index\" compares the numbers"),
            ("raw (K and D; --rectified: P)", "raw (K and D; rectified=True: P)"),
            ("a topic (--world-frame, --camera-frame)", "a topic (world_frame=..., camera_frame=...)"),
            ("a gap; --skip-errors uses the rest", "a gap; skip_errors=True uses the rest"),
            ("\"quadlift localize --enclosing\" adds them", "localize(enclosing=True) adds them"),
            ("`quadlift import FORMAT` reads a given format", "`format=...` reads a given format"),
            ("a--source.json: --unknown 3 -- none", "a--source.json: --unknown 3 -- none"),
        ] {
            assert_eq!(in_python(words, Correcting::Scene), expected);
        }
        let words = "x, y, width, height: --assume boxes=xywh; center and size: --assume boxes=cxcywh)";
        let expected = "x, y, width, height: assume=\"boxes=xywh\"; center and size: assume=\"boxes=cxcywh\")";
        assert_eq!(in_python(words, Correcting::Reading), expected);
    }

    /// The parts of the code that are not tests, without comments.
    fn add_lines(folder: &Path, lines: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                add_lines(&path, lines);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
                let is_code = |line: &&str| !line.trim_start().starts_with("//");
                lines.extend(code.lines().filter(is_code).map(str::to_owned));
            }
        }
    }

    /// So that no message reaches Python with an option of the program.
    #[test]
    fn every_option_in_a_message_is_a_keyword() {
        let mut lines = Vec::new();
        for folder in ["src", "../quadlift/src", "../quadlift-segment/src", "../quadlift-report/src"] {
            add_lines(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut lines);
        }
        let mut options = Vec::new();
        // Of another program.
        for line in lines.iter().filter(|line| !line.contains("--dst")) {
            for part in with_functions(line).split("--").skip(1) {
                let name: String = part.chars().take_while(|c| c.is_ascii_lowercase() || *c == '-').collect();
                if name.len() > 1 {
                    assert!(keyword(&name.replace('-', "_"), "", Correcting::Scene).is_some(), "--{name} in {line}");
                    options.push(name);
                }
            }
        }
        assert!(options.len() > 20 && options.iter().any(|name| name == "camera-frame"), "{options:?}");
    }
}
