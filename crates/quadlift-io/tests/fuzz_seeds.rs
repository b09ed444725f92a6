//! The seeds of the fuzz targets, and damaged copies of them, as ordinary tests: nothing panics, and what is read is a
//! valid scene that survives its file.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

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
    let target = target(name);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds").join(name);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut below = |n: usize| (rng.next_u64() % n.max(1) as u64) as usize;
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
        let seed = std::fs::read(entry.unwrap().path()).unwrap();
        assert!(target(&seed), "a seed of {name} is not read");
        for _ in 0..copies {
            let mut damaged = seed.clone();
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
        count += 1;
    }
    assert!(count > 0, "no seeds in {}", folder.display());
}

#[test]
fn colmap_text() {
    run("colmap_text", COPIES);
}

#[test]
fn colmap_binary() {
    run("colmap_binary", COPIES);
}

#[test]
fn nerfstudio() {
    run("nerfstudio", COPIES);
}

#[test]
fn opensfm() {
    run("opensfm", COPIES);
}

#[test]
fn arkit() {
    run("arkit", COPIES);
}

#[test]
fn nuscenes() {
    run("nuscenes", COPIES);
}

#[test]
fn tum() {
    run("tum", COPIES);
}

#[test]
fn kitti() {
    run("kitti", COPIES);
}

#[test]
fn kitti_raw() {
    run("kitti_raw", COPIES);
}

#[test]
fn bop() {
    run("bop", COPIES);
}

#[test]
fn projections() {
    run("projections", COPIES);
}

#[test]
fn coco() {
    run("coco", COPIES);
}

#[test]
fn mot() {
    run("mot", COPIES);
}

#[test]
fn yolo() {
    run("yolo", COPIES);
}

#[test]
fn kitti_labels() {
    run("kitti_labels", COPIES);
}

#[test]
fn csv() {
    run("csv", COPIES);
}

#[test]
fn supervision() {
    run("supervision", COPIES);
}

#[test]
fn labelme() {
    run("labelme", COPIES);
}

#[test]
fn voc() {
    run("voc", COPIES);
}

#[test]
fn boxer() {
    run("boxer", COPIES);
}

#[test]
fn cvat() {
    run("cvat", COPIES);
}

#[test]
fn label_studio() {
    run("label_studio", COPIES);
}

#[test]
fn scene() {
    run("scene", COPIES);
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

#[cfg(feature = "parquet")]
#[test]
fn parquet() {
    run("parquet", COPIES);
}

/// Every folder of seeds has a target, and every target a folder and a test here.
#[test]
fn every_target_has_seeds_and_a_test() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds");
    let mut folders: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| cfg!(feature = "parquet") || name != "parquet")
        .collect();
    folders.sort();
    let names: Vec<&str> = targets::TARGETS.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, folders);
    for name in names {
        assert!(include_str!("fuzz_seeds.rs").contains(&format!("run(\"{name}\", ")), "no test of {name}");
    }
}
