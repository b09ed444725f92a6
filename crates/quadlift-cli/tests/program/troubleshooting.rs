//! `docs/troubleshooting.md`: what one sees of each mistake, from the program's real output. With QUADLIFT_UPDATE_DOCS=1 the
//! test rewrites it.

use std::fmt::Write;
use std::path::Path;

use crate::common::Folder;
use crate::common::mistakes::{Mistake, inverse, mistakes, right_scene, with_boxes, with_poses};
use serde_json::Value;

const INTRODUCTION: &str = "\
# When it does not work

This page lists common input mistakes and the message that quadlift prints for each. `quadlift localize`, `associate` and
`segment` check whether poses, cameras and boxes fit together. If they do not, the command ends with exit code 3, says why,
and names the option that corrects it; no object has the status `ok`. `quadlift info scene.json` runs the same check and
computes nothing else.

Correct the file if you can. Otherwise add the option that the message names, or `--fix`, which applies up to three
corrections and prints each. `--accept-inconsistent` skips the check. The options are described in
[the program](cli.md#the-self-check).

The tests of quadlift make each mistake in a correct scene (8 objects, 12 frames), run the program, and write its output
here. Do not edit this page; after a change, run `QUADLIFT_UPDATE_DOCS=1 cargo test -p quadlift-cli --test
troubleshooting`.
";

const UNSEEN: &str = "
## What cannot be detected

- The unit of length. A scene in millimetres looks like a scene in metres that is a thousand times as large. Only category
  sizes (`--priors`) or the camera height (`--camera-height`) can distinguish them.
- A mistake that transforms everything in the same way, such as a mirrored or rotated world: the scene stays consistent.
- Small mistakes in scenes with few frames, few objects or very noisy boxes.
- A false box of an object with only two views. Some body fits nearly any two boxes; a third view is needed to detect that
  one of them is wrong.

## Other causes

- Few views: two views determine an object roughly, one view only with a [depth or a 3D box](cues.md). `quadlift localize -v`
  lists rejected views with reasons.
- Moving objects. `quadlift associate` marks them as doubtful.
- Bodies that seem too small: see tangent and enclosing bodies in [concepts](concepts.md#tangent-or-enclosing).
- Messages about files: see [errors](errors.md).
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
    recorded(folder, &format!("## {}", mistake.title), mistake.story, "localize wrong.json")
}

/// Two mistakes that only show together.
fn two_mistakes(folder: &Folder, right: &Value) -> String {
    folder.write_json("wrong.json", &with_boxes(&with_poses(right, inverse), |b| b.map(|x| x * 0.5)));
    let story = "If no single mistake explains the inconsistency and the detections have ids, pairs of mistakes are tried. `--fix` applies both \
                 corrections.";
    recorded(folder, "## Two mistakes at once", story, "localize wrong.json")
}

/// What one types with the files of the tutorial: a model of COLMAP, and boxes that name no object.
fn tutorial() -> String {
    let folder = Folder::new();
    folder.copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/data/tutorial-colmap-yolo"));
    folder.succeed("localize --cameras sparse/0 --detections labels");
    let mut labels: Vec<String> = std::fs::read_dir(folder.path("labels"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    labels.sort();
    // The width and height of the photos.
    let [w, h] = [960.0, 720.0];
    let mut resized = "image,x0,y0,x1,y1,score,class\n".to_owned();
    let mut letterboxed = resized.clone();
    for (name, next) in labels.iter().zip(labels.iter().skip(1).map(Some).chain([None])) {
        let text = folder.read(&format!("labels/{name}"));
        if let Some(next) = next {
            folder.write(&format!("late/{next}"), &text);
        }
        for line in text.lines() {
            let numbers: Vec<f64> = line.split_whitespace().map(|x| x.parse().unwrap()).collect();
            let [class, x, y, width, height, score] = numbers[..] else { panic!("{line}") };
            let edges = [x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height];
            let image = name.replace(".txt", ".jpg");
            for (table, margin) in [(&mut resized, 0.0), (&mut letterboxed, 80.0)] {
                let [x0, y0, x1, y1] = [0, 1, 2, 3].map(|k| match k % 2 {
                    0 => edges[k] * 640.0,
                    _ => edges[k] * 640.0 * h / w + margin,
                });
                writeln!(table, "{image},{x0:.2},{y0:.2},{x1:.2},{y1:.2},{score},{class}").unwrap();
            }
        }
    }
    folder.write("resized.csv", resized);
    folder.write("letterboxed.csv", letterboxed);
    let mut text =
        "\n## With COLMAP and a detector\n\nThe same mistakes in the files of [the tutorial](tutorial-colmap-yolo.md): \
        a COLMAP model and boxes without\nobject ids.\n"
            .to_owned();
    for (title, story, detections) in [
        (
            "### Boxes of resized images",
            "The photos have 960 x 720 pixels, but the detector ran on copies of 640 x 480 pixels.",
            "resized.csv",
        ),
        (
            "### Boxes of letterboxed images",
            "The detector ran on copies that were padded to squares.",
            "letterboxed.csv",
        ),
        (
            "### Labels off by one image",
            "Each label file has the name of the next image, for example because the first image of a video was dropped.",
            "late",
        ),
    ] {
        text.push_str(&recorded(
            &folder,
            title,
            story,
            &format!("localize --cameras sparse/0 --detections {detections}"),
        ));
    }
    text
}

/// A command that fails because of a mistake, what it says, and the same with the option that mends it.
fn recorded(folder: &Folder, title: &str, story: &str, wrong: &str) -> String {
    let run = folder.run(wrong);
    assert_eq!(run.code, 3, "{title}: {}{}", run.stdout, run.stderr);
    let result = folder.run(&format!("{wrong} --json")).stdout;
    let result: Value = serde_json::from_str(&result).unwrap();
    let diagnosis = &result["scenes"][0]["diagnosis"];
    let causes = diagnosis["together"].as_array().cloned().unwrap_or_else(|| vec![diagnosis["causes"][0].clone()]);
    let options: Vec<&str> = causes.iter().map(|cause| cause["option"].as_str().unwrap()).collect();
    let command = format!("{wrong} {}", options.join(" "));
    let mended = folder.succeed(&command);
    let summary = mended.lines().find(|line| line.contains("localised")).unwrap();
    // Where detections are matched with cameras, options work on them before there is a scene to correct.
    let mut lines = vec![summary];
    lines.extend(mended.lines().filter(|line| line.starts_with("corrected: ")));
    assert!(lines.len() > 1 || wrong.contains("--cameras"), "{title}: {mended}");
    let mut text = format!("\n{title}\n\n{}\n\n", wrapped(story));
    writeln!(text, "```text\n$ quadlift {wrong}\n{}", wrapped(run.stderr.trim_end())).unwrap();
    writeln!(text, "$ quadlift {command}\n{}\n```", lines.join("\n")).unwrap();
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
    page.push_str(&two_mistakes(&folder, &right));
    page.push_str(&tutorial());
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
