//! The real scenes, where they are at hand: they cannot be part of the project.

use quadlift_segment::PixelTerm;

use crate::scene_file::{parse_scene_file, read_scene_file, write_scene};
use crate::test_data::real_data;

#[test]
fn every_real_scene_is_read_checked_and_written_back() {
    let Some(scenes) = real_data("scenes") else { return };
    let folder = std::fs::read_dir(scenes).unwrap();
    let mut count = 0;
    for path in folder.map(|entry| entry.unwrap().path()).filter(|path| path.extension().is_some_and(|e| e == "json")) {
        let file = read_scene_file(&path).unwrap();
        let scene = file.to_scene().unwrap_or_else(|error| panic!("{}", error.in_file(&path)));
        let objects = file.to_objects().unwrap_or_else(|error| panic!("{}", error.in_file(&path)));
        assert_eq!(scene.frames.len(), file.frames.len());
        assert_eq!(scene.detections.len(), file.detections.len());
        assert!(!objects.is_empty() && objects.iter().all(|object| object.ellipsoid().is_some()));
        assert!(file.extra.is_empty(), "{:?}", file.extra);
        let mut bytes = Vec::new();
        write_scene(&file, &mut bytes).unwrap();
        assert_eq!(parse_scene_file(&path, &bytes).unwrap(), file);
        count += 1;
    }
    assert!(count > 0);
    println!("{count} scenes");
}

#[test]
fn the_masks_of_real_scenes_have_the_boxes_of_their_detections() {
    let Some(path) = real_data("scenes/lmo_A.json") else { return };
    let file = read_scene_file(&path).unwrap();
    let (scene, images) = (file.to_scene().unwrap(), file.to_images(&path).unwrap());
    assert_eq!(images.read_image(&scene, 0).unwrap().dimensions(), (640, 480));
    let masked = |index: &usize| images.masks[*index].is_some();
    let detections: Vec<usize> = (0..scene.detections.len()).filter(masked).take(40).collect();
    assert_eq!(detections.len(), 40);
    for (mask, &index) in images.read_masks(&scene, &detections).into_iter().zip(&detections) {
        let mask = mask.unwrap().unwrap();
        assert_eq!(mask.bounding_box(), scene.detections[index].bounding_box, "detections[{index}]");
        assert!(quadlift_segment::Moments::of_mask(&mask, PixelTerm::Centers).unwrap().ellipse().is_some());
    }
}
