//! The seeds of the fuzz targets and the examples on the pages of formats, and damaged copies of them, as ordinary tests:
//! nothing panics, and what is read is a valid scene that survives its file.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use quadlift_io::formats::{detections, find_cameras, find_detections, poses};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

#[path = "../../../fuzz/targets.rs"]
mod targets;

/// Damaged copies of each seed.
const COPIES: usize = 300;

/// What the target of a folder of seeds does.
fn target(name: &str) -> targets::Target {
    targets::TARGETS.iter().find(|(known, _)| *known == name).unwrap_or_else(|| panic!("no target {name}")).1
}

fn run(name: &str, copies: usize) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds").join(name);
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
        let path = entry.unwrap().path();
        damage(target(name), &std::fs::read(&path).unwrap(), copies, &path.display().to_string());
        count += 1;
    }
    assert!(count > 0, "no seeds in {}", folder.display());
}

/// Runs a target on a seed, which must be read, and on damaged copies.
fn damage(target: targets::Target, seed: &[u8], copies: usize, name: &str) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut below = |n: usize| (rng.next_u64() % n.max(1) as u64) as usize;
    assert!(target(seed), "{name} is not read");
    for _ in 0..copies {
        let mut damaged = seed.to_vec();
        for _ in 0..1 + below(3) {
            let at = below(damaged.len());
            match below(4) {
                0 => damaged.truncate(at),
                1 if !damaged.is_empty() => damaged[at] = below(256) as u8,
                2 if !damaged.is_empty() => drop(damaged.remove(at)),
                _ => damaged.insert(at.min(damaged.len()), b"0-9.e \n\"[{"[below(10)]),
            }
        }
        target(&damaged);
    }
}

#[test]
fn formats() {
    // Others are made of the examples.
    run("formats", 60);
}

#[test]
fn scene() {
    run("scene", COPIES);
}

#[test]
fn state() {
    run("state", COPIES);
}

#[test]
fn stream() {
    run("stream", COPIES);
}

#[test]
fn mcap() {
    run("mcap", COPIES);
}

#[test]
fn live() {
    run("live", COPIES);
}

#[test]
fn rle() {
    run("rle", COPIES);
}

#[test]
fn polygons() {
    run("polygons", COPIES);
}

#[test]
fn localize() {
    run("localize", 40);
}

/// The examples of a page of formats: the files of each section, and its commands that import them.
fn examples(page: &str) -> Vec<targets::Example> {
    let mut found = Vec::new();
    for section in page.split("\n## ").skip(1) {
        let mut files = Vec::new();
        for block in section.split("\n```").skip(1).step_by(2) {
            let (kind, text) = block.split_once('\n').unwrap_or((block, ""));
            if let Some(name) = kind.strip_prefix("text ") {
                files.push((name.to_owned(), format!("{text}\n").into_bytes()));
            }
        }
        let commands = section.lines().filter_map(|line| line.strip_prefix("quadlift import "));
        for command in commands {
            let (mut words, mut skipped) = (Vec::new(), false);
            for word in command.split_whitespace() {
                let skip = std::mem::replace(&mut skipped, ["-o", "--into"].contains(&word)) || skipped;
                if !skip {
                    words.push(word.to_owned());
                }
            }
            found.push(targets::Example { words, files: files.clone() });
        }
    }
    found
}

/// Every format has an example on its page: it is read, no other format claims it, and damaged copies do no harm. With
/// `QUADLIFT_WRITE_SEEDS` the examples become the first corpus of the fuzz target.
#[test]
fn examples_of_formats() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = |name: &str| std::fs::read_to_string(root.join("docs/formats").join(name));
    let mut left: Vec<&str> = poses().map(|format| format.name).chain(detections().map(|format| format.name)).collect();
    // Binary files have pages without files.
    left.retain(|name| page(&format!("{name}.md")).is_err());
    for (kind, name) in [("cameras", "cameras.md"), ("detections", "detections.md")] {
        for (index, example) in examples(&page(name).unwrap()).iter().enumerate() {
            let [format, path] = [0, 1].map(|index| example.words[index].as_str());
            let is_here = if kind == "cameras" {
                poses().any(|row| row.name == format)
            } else {
                detections().any(|row| row.name == format)
            };
            if !is_here {
                continue;
            }
            let folder = tempfile::tempdir().unwrap();
            example.write(folder.path()).unwrap();
            let path = folder.path().join(path);
            let recognized = match kind {
                "cameras" => find_cameras(&path).map(|(format, _)| format.name),
                _ => find_detections(&path).map(|format| format.name),
            };
            assert_eq!(recognized.unwrap(), format, "{name}");
            left.retain(|name| *name != format);
            let seed = example.to_bytes();
            damage(target("formats"), &seed, COPIES, &format!("{name}: the example of {format}"));
            if std::env::var_os("QUADLIFT_WRITE_SEEDS").is_some() {
                let corpus = root.join("fuzz/corpus/formats");
                std::fs::create_dir_all(&corpus).unwrap();
                std::fs::write(corpus.join(format!("{format}-{index}")), seed).unwrap();
            }
        }
    }
    assert!(left.is_empty(), "docs/formats has no example of {left:?}");
}

/// Every folder of seeds has a target, and every target a folder and a test here.
#[test]
fn every_target_has_seeds_and_a_test() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds");
    let mut folders: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    folders.sort();
    let names: Vec<&str> = targets::TARGETS.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, folders);
    for name in names {
        assert!(include_str!("fuzz_seeds.rs").contains(&format!("run(\"{name}\", ")), "no test of {name}");
    }
}
