//! The real scenes, where they are at hand: they cannot be part of the project.

use std::path::PathBuf;

use crate::scene_file::{parse_scene_file, read_scene_file, write_scene};

#[test]
fn every_real_scene_is_read_checked_and_written_back() {
    let data = std::env::var_os("QUADLIFT_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")), PathBuf::from);
    let Ok(folder) = std::fs::read_dir(data.join("scenes")) else {
        println!("skipped: there is no {}; set QUADLIFT_DATA", data.join("scenes").display());
        return;
    };
    let mut count = 0;
    for path in folder.map(|entry| entry.unwrap().path()).filter(|path| path.extension().is_some_and(|e| e == "json")) {
        let file = read_scene_file(&path).unwrap();
        let scene = file.to_scene().unwrap_or_else(|error| panic!("{}", error.in_file(&path)));
        let objects = file.to_objects().unwrap_or_else(|error| panic!("{}", error.in_file(&path)));
        assert_eq!(scene.frames.len(), file.frames.len());
        assert_eq!(scene.detections.len(), file.detections.len());
        assert!(!objects.is_empty() && objects.iter().all(|object| object.ellipsoid.is_some()));
        assert!(file.extra.is_empty(), "{:?}", file.extra);
        let mut bytes = Vec::new();
        write_scene(&file, &mut bytes).unwrap();
        assert_eq!(parse_scene_file(&path, &bytes).unwrap(), file);
        count += 1;
    }
    assert!(count > 0);
    println!("{count} scenes");
}
