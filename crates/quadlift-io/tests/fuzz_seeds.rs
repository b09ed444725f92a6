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

fn run(name: &str, target: fn(&[u8]) -> bool) {
    run_copies(name, target, COPIES);
}

fn run_copies(name: &str, target: fn(&[u8]) -> bool, copies: usize) {
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
    run("colmap_text", targets::colmap_text);
}

#[test]
fn colmap_binary() {
    run("colmap_binary", targets::colmap_binary);
}

#[test]
fn nerfstudio() {
    run("nerfstudio", targets::nerfstudio);
}

#[test]
fn opensfm() {
    run("opensfm", targets::opensfm);
}

#[test]
fn arkit() {
    run("arkit", targets::arkit);
}

#[test]
fn nuscenes() {
    run("nuscenes", targets::nuscenes);
}

#[test]
fn tum() {
    run("tum", targets::tum);
}

#[test]
fn kitti() {
    run("kitti", targets::kitti);
}

#[test]
fn kitti_raw() {
    run("kitti_raw", targets::kitti_raw);
}

#[test]
fn bop() {
    run("bop", targets::bop);
}

#[test]
fn projections() {
    run("projections", targets::projections);
}

#[test]
fn coco() {
    run("coco", targets::coco);
}

#[test]
fn mot() {
    run("mot", targets::mot);
}

#[test]
fn yolo() {
    run("yolo", targets::yolo);
}

#[test]
fn kitti_labels() {
    run("kitti_labels", targets::kitti_labels);
}

#[test]
fn csv() {
    run("csv", targets::csv);
}

#[test]
fn supervision() {
    run("supervision", targets::supervision);
}

#[test]
fn labelme() {
    run("labelme", targets::labelme);
}

#[test]
fn voc() {
    run("voc", targets::voc);
}

#[test]
fn boxer() {
    run("boxer", targets::boxer);
}

#[test]
fn cvat() {
    run("cvat", targets::cvat);
}

#[test]
fn label_studio() {
    run("label_studio", targets::label_studio);
}

#[test]
fn scene() {
    run("scene", targets::scene);
}

#[test]
fn stream() {
    run("stream", targets::stream);
}

#[test]
fn mcap() {
    run("mcap", targets::mcap);
}

#[test]
fn live() {
    run("live", targets::live);
}

#[test]
fn rle() {
    run("rle", targets::rle);
}

#[test]
fn polygons() {
    run("polygons", targets::polygons);
}

#[test]
fn localize() {
    run_copies("localize", targets::localize, 40);
}

#[cfg(feature = "parquet")]
#[test]
fn parquet() {
    run("parquet", targets::parquet);
}
