//! Makes a scene file of a COLMAP model and a folder of YOLO label files.
//!
//!     cargo run --example colmap_and_yolo -p quadlift-io -- sparse/0 labels scene.json

#![allow(clippy::print_stdout, reason = "an example")]

use std::path::PathBuf;

use quadlift_io::formats::{read_cameras, read_detections};
use quadlift_io::read::ReadOptions;
use quadlift_io::read::detections::{AddOptions, add_detections};
use quadlift_io::write_scene_file;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [model, labels, output] = arguments.as_slice() else {
        return Err("usage: colmap_and_yolo MODEL LABELS OUT.json".into());
    };
    let import = read_cameras(model, &ReadOptions::default())?;
    let mut scene = import.scene;
    let detections = read_detections(labels, &ReadOptions::default())?;
    // Label files and images are matched by their names.
    let added = add_detections(&mut scene, detections, &AddOptions { source: "yolo", ..Default::default() })?;
    println!("{} frames, {} detections in {} of them", scene.frames.len(), added.added, added.matched_images);
    // What was converted, assumed or left out.
    for note in import.notes.iter().chain(&added.notes) {
        println!("- {note}");
    }
    write_scene_file(output, &scene)?;
    Ok(())
}
