//! What the fuzz targets do with their input; `crates/quadlift-io/tests/fuzz_seeds.rs` does the same with the seeds.
//!
//! Each tells whether the input was read. Formats of several files have them one after another, separated by [`SEPARATOR`].

use std::path::Path;

use quadlift_io::ReadError;
use quadlift_io::read::bop::{BopFiles, parse_bop};
use quadlift_io::read::kitti::{KittiFiles, KittiOptions, parse_kitti};
use quadlift_io::read::kitti_raw::parse_tracklets;
use quadlift_io::read::nerfstudio::parse_nerfstudio;
use quadlift_io::read::projections::parse_projections;
use quadlift_io::read::tum::{TumOptions, parse_tum};
use quadlift_io::read::{Import, PixelCenters, colmap};
use quadlift_io::scene_file::{parse_scene_file, write_scene};

/// Stands between the files of one input.
pub const SEPARATOR: &[u8] = b"=====\n";

/// A file with its name.
type File<'a> = (&'a Path, &'a [u8]);

/// The files of an input; those that are missing are empty.
fn files<'a, const N: usize>(data: &'a [u8], names: [&'static str; N]) -> [File<'a>; N] {
    let mut rest = data;
    names.map(|name| {
        let end = rest.windows(SEPARATOR.len()).position(|window| window == SEPARATOR);
        let (file, after) = match end {
            Some(end) => (&rest[..end], &rest[end + SEPARATOR.len()..]),
            None => (rest, &[][..]),
        };
        rest = after;
        (Path::new(name), file)
    })
}

/// What must hold for every answer: an error has a message in one line, a scene is valid and survives its file.
fn check(result: Result<Import, ReadError>) -> bool {
    match result {
        Err(error) => {
            assert!(!error.problem.is_empty() && !error.problem.contains('\n'), "{error}");
            false
        }
        Ok(import) => {
            import.scene.to_scene().unwrap();
            let mut bytes = Vec::new();
            write_scene(&import.scene, &mut bytes).unwrap();
            assert_eq!(parse_scene_file(Path::new("scene.json"), &bytes).unwrap(), import.scene);
            true
        }
    }
}

pub fn colmap_text(data: &[u8]) -> bool {
    let [cameras, images] = files(data, ["cameras.txt", "images.txt"]);
    check(colmap::parse_text(cameras, images))
}

pub fn colmap_binary(data: &[u8]) -> bool {
    let [cameras, images] = files(data, ["cameras.bin", "images.bin"]);
    check(colmap::parse_binary(cameras, images))
}

pub fn nerfstudio(data: &[u8]) -> bool {
    let exists = |name: &str| name.ends_with(".jpg");
    let size_of = |name: &str| name.starts_with('s').then_some([640.0, 480.0]);
    check(parse_nerfstudio(Path::new("transforms.json"), data, PixelCenters::Integer, &exists, &size_of))
}

pub fn tum(data: &[u8]) -> bool {
    let [trajectory, intrinsics, images] = files(data, ["trajectory.txt", "camera.txt", "rgb.txt"]);
    let with_images = !images.1.is_empty();
    let options = TumOptions {
        intrinsics: intrinsics.0,
        image_size: Some([640.0, 480.0]),
        image_list: with_images.then_some(images.0),
        time_tolerance: 0.02,
        pixel_centers: PixelCenters::Half,
    };
    check(parse_tum(trajectory, intrinsics.1, with_images.then_some(images.1), &options))
}

pub fn kitti(data: &[u8]) -> bool {
    let [calib, oxts, labels] = files(data, ["calib.txt", "oxts.txt", "label.txt"]);
    let options =
        KittiOptions { sequence: "0000".to_owned(), frames: None, image_size: None, pixel_centers: PixelCenters::Half };
    check(parse_kitti(KittiFiles { calib, oxts, labels: Some(labels).filter(|file| !file.1.is_empty()) }, &options))
}

pub fn kitti_raw(data: &[u8]) -> bool {
    // The rest of a drive goes through the same readers as the tracking benchmark.
    match parse_tracklets(Path::new("tracklet_labels.xml"), data) {
        Err(error) => {
            assert!(!error.problem.is_empty());
            false
        }
        Ok(_) => true,
    }
}

pub fn bop(data: &[u8]) -> bool {
    let [camera, ground_truth, info, models] =
        files(data, ["scene_camera.json", "scene_gt.json", "scene_gt_info.json", "models_info.json"]);
    let there = |file: &File| !file.1.is_empty();
    let files = BopFiles {
        camera,
        ground_truth: Some(ground_truth).filter(there),
        info: Some(info).filter(there),
        models: Some(models).filter(there),
    };
    let with_object = check(parse_bop(files, Some(5), None));
    check(parse_bop(files, None, None)) || with_object
}

pub fn projections(data: &[u8]) -> bool {
    check(parse_projections(Path::new("projections.csv"), data, None, PixelCenters::Integer))
}
