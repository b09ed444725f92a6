//! `docs/troubleshooting.md`: the program's message for each input error. With QUADLIFT_UPDATE_DOCS=1 the test rewrites it.

use std::fmt::Write;
use std::path::Path;

use crate::bad_inputs;
use crate::common::Folder;
use crate::common::mistakes::{Mistake, inverse, mistakes, right_scene, with_boxes, with_poses};
use serde_json::Value;

const INTRODUCTION: &str = "\
# When it does not work

What to do when a command fails, or finds nothing. This command checks whether poses, cameras and boxes are consistent:

    quadlift info scene.json

`quadlift localize`, `associate` and `segment` run the same check. On an inconsistent scene they end with exit code 3, print the
cause and the option that corrects it, and no object has the status `ok`. Correct the file if you can. Otherwise add the option
that the message names, or `--fix`, which applies up to three corrections and prints each. `--allow-inconsistent` skips the
check ([options](cli.md#the-consistency-check)).

The tests of quadlift make each input error in a correct scene and write the message here. Do not edit this page; after a change,
run `QUADLIFT_UPDATE_DOCS=1 cargo test -p quadlift-cli --test program troubleshooting`.
";

const SYMPTOMS: &str = "
## No error, but poor objects

- **Few views.** Two views determine an object roughly, one view only with a [depth or a 3D box](cues.md). `quadlift localize -v`
  lists rejected views with reasons.
- **Some frames are wrong.** If boxes contradict those of the other frames, correct the poses of the frames that the message names, or
  leave them out; `--allow-inconsistent` localizes from the others.
- **Moving objects.** `quadlift associate` marks them as uncertain.
- **Bodies are too small.** They fit the boxes on average; `bounds` have the extents, `--enclosing` adds ellipsoids around the objects
  ([concepts](concepts.md#the-body-its-bounds-and-the-ellipsoid-around-it)).
- **All lengths are wrong by a factor.** A scene in millimeters is as consistent as one in meters. Only category sizes
  (`--priors`) or the camera height (`--camera-height`) show the difference.
- **The world is mirrored or rotated.** A transform of everything leaves a scene consistent.
- **An object of two views is wrong.** Some body fits nearly any two boxes; a third view shows which one is false.
- **Small errors** in scenes with few frames, few objects or very noisy boxes are not found.

## Messages about files

A message has the file, the line and column or the entry, what was found and what was expected. Lists count from zero:
`detections[2]` is the third one. Nothing is written when a file is rejected.
";

/// Input errors that are common, by the files that have them.
const MESSAGES: [(&str, &[&str]); 4] = [
    (
        "Scene files",
        &[
            "no \"format\"",
            "an unknown frame",
            "an unknown camera model",
            "a camera model with too few parameters",
            "a pose that is not a rotation",
            "a frame with neither pose nor projection",
            "NaN",
            "neither a box nor an ellipse",
            "an object twice in one frame",
            "an id that is a number",
            "several sources and none chosen",
        ],
    ),
    (
        "Nothing is found",
        &[
            "an empty scene",
            "no detection has an object id",
            "objects that are seen once",
            "all views from one point",
            "all detections in one frame",
            "scores that are all too low",
        ],
    ),
    (
        "Cameras and detections of other programs",
        &[
            "no image is a frame",
            "images of another size",
            "a track twice in one image",
            "no column for the image",
            "columns without names",
            "pixels in a YOLO file",
            "a score or a track id",
            "a trajectory without intrinsics",
            "cameras of another program in place of a scene",
            "a bag of ROS 1",
            "a log without the world's frame",
        ],
    ),
    (
        "Images, outputs, evaluation",
        &[
            "an image of another size than the camera's",
            "masks as measurements where there are none",
            "an output that is the scene",
            "a result in another format",
            "a truth without objects",
            "no common object",
            "objects without a body",
        ],
    ),
];

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
        "\n## With COLMAP and a detector\n\nThe check also works without object ids, as in the files of [the tutorial](tutorial.md). A few frames with poses of their own may
then become objects of their own instead; `quadlift localize -v` lists rejected views.\n".to_owned();
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
    let summary = mended.lines().find(|line| line.contains("localized")).unwrap();
    // Where detections are matched with cameras, options work on them before there is a scene to correct.
    let corrected = mended.lines().any(|line| line.starts_with("corrected: "));
    assert!(summary.contains("objects localized") && (corrected || wrong.contains("--cameras")), "{title}: {mended}");
    let mut text = format!("\n{title}\n\n{}\n\n", wrapped(story));
    writeln!(text, "```text\n{}\n```", wrapped(run.stderr.trim_end())).unwrap();
    text
}

/// Tables of messages about files.
fn messages() -> String {
    let mut text = String::new();
    for (heading, titles) in MESSAGES {
        writeln!(text, "\n### {heading}\n\n| Input error | Message |\n| --- | --- |").unwrap();
        for title in titles {
            writeln!(text, "{}", bad_inputs::row(title)).unwrap();
        }
    }
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
    page.push_str(SYMPTOMS);
    page.push_str(&messages());
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
