//! `docs/troubleshooting.md`: what one sees of each mistake, from the program's real output. With QUADLIFT_UPDATE_DOCS=1 the
//! test rewrites it.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod common;

use std::fmt::Write;
use std::path::Path;

use common::Folder;
use common::mistakes::{Mistake, mistakes, right_scene};

const INTRODUCTION: &str = "\
# When it does not work

A wrong input rarely looks wrong: the numbers are numbers. `quadlift localize`, `associate` and `segment` check whether the
scene agrees with itself. Where it does not they end with exit code 3, say why, and name the option that mends it; no
object is `ok` then. `quadlift info scene.json` shows the same before anything is computed.

Each mistake below was made in a right scene of 8 objects in 12 frames; what the program says was recorded by its tests.
Mend the file where you can, or give the option that is named; `--fix` takes the proposed one, and
`--accept-inconsistent` goes on without any. All options are listed in [the program](cli.md#the-self-check).

This page is written by the tests; do not edit it. After a change: `QUADLIFT_UPDATE_DOCS=1 cargo test -p quadlift-cli --test
troubleshooting`
";

const UNSEEN: &str = "
## What cannot be seen

- The unit of lengths: a scene in millimetres is a scene in metres, a thousand times as large. Only known sizes of
  categories (`--priors`) or the height of the cameras (`--camera-height`) tell.
- Where all is wrong in the same way so that boxes still meet, such as a world that is mirrored or turned as a whole.
- Small mistakes in scenes with few frames, few objects or very noisy boxes: they hide in the noise.

## It is not a mistake of the input

- Few views: an object in two views is known roughly, in one not at all. `quadlift localize -v` names views that were
  rejected.
- Objects that move do not agree with any poses. `quadlift associate` calls them doubtful.
- Objects that are too small: see tangent and enclosing bodies in [concepts](concepts.md).
- Messages about files are listed in [errors](errors.md).
";

/// A line that is longer than the page is wide, in several.
fn wrapped(line: &str) -> String {
    let (mut text, mut width) = (String::new(), 0);
    for word in line.split(' ') {
        if width > 0 && width + 1 + word.len() > 118 {
            text.push('\n');
            width = 0;
        } else if width > 0 {
            text.push(' ');
            width += 1;
        }
        text.push_str(word);
        width += word.len();
    }
    text
}

fn section(folder: &Folder, mistake: &Mistake) -> String {
    folder.write_json("wrong.json", &mistake.scene);
    let run = folder.run("localize wrong.json");
    assert_eq!(run.code, 3, "{}: {}{}", mistake.title, run.stdout, run.stderr);
    let result = folder.run("localize wrong.json --json").stdout;
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    let option = result["scenes"][0]["diagnosis"]["causes"][0]["option"].as_str().unwrap();
    let command = format!("localize wrong.json {option}");
    let mended = folder.succeed(&command);
    let summary = mended.lines().find(|line| line.contains("localised")).unwrap();
    let corrected = mended.lines().find(|line| line.starts_with("corrected: ")).unwrap();
    let mut text = format!("\n## {}\n\n{}\n\n", mistake.title, wrapped(mistake.story));
    writeln!(text, "```text\n$ quadlift localize wrong.json\n{}", wrapped(run.stderr.trim_end())).unwrap();
    writeln!(text, "$ quadlift {command}\n{summary}\n{corrected}\n```").unwrap();
    text
}

#[test]
fn the_page_is_what_the_program_says() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    folder.succeed("localize right.json");
    let mut page = INTRODUCTION.to_owned();
    for mistake in mistakes(&right) {
        page.push_str(&section(&folder, &mistake));
    }
    page.push_str(UNSEEN);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/troubleshooting.md");
    if std::env::var_os("QUADLIFT_UPDATE_DOCS").is_some() {
        std::fs::write(&path, &page).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default().replace("\r\n", "\n");
    for (line, (new, old)) in page.lines().zip(written.lines()).enumerate() {
        assert_eq!(new, old, "docs/troubleshooting.md:{} is out of date; run with QUADLIFT_UPDATE_DOCS=1", line + 1);
    }
    assert!(page == written, "docs/troubleshooting.md is out of date; run with QUADLIFT_UPDATE_DOCS=1");
}
