//! Images and masks of a scene: found, read, and named when they are wrong.

use std::path::Path;

use image::{GrayImage, RgbImage};
use insta::assert_snapshot;
use quadlift_segment::{LabelImage, Mask};

use crate::scene_file::{MaskSource, SceneFile, SceneImages, parse_scene_file};
use crate::{write_label_image, write_png};

/// A scene of two frames of 8 x 6 pixels and one of unknown size, with the masks of its detections.
fn scene_file(masks: &[&str]) -> Result<SceneFile, String> {
    let detections: Vec<String> = masks
        .iter()
        .enumerate()
        .map(|(k, mask)| format!(r#"{{"frame": "a", "object": "{k}", "box": [0, 0, 4, 4], "mask": {mask}}}"#))
        .collect();
    let text = format!(
        r#"{{"format": "quadlift.scene", "version": 1,
 "cameras": [{{"id": "cam", "model": "PINHOLE", "width": 8, "height": 6, "params": [5, 5, 4, 3]}}],
 "frames": [
  {{"id": "a", "camera": "cam", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4]], "image": "rgb/a.png"}},
  {{"id": "b", "camera": "cam", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4]]}}],
 "detections": [
  {}
 ]}}"#,
        detections.join(",\n  ")
    );
    parse_scene_file(Path::new("scene.json"), text.as_bytes()).map_err(|error| error.to_string())
}

/// The message about a mask before any file is read.
fn message(mask: &str) -> String {
    match scene_file(&[mask]).map(|file| file.to_images(Path::new("scene.json"))) {
        Err(text) => text,
        Ok(Err(error)) => error.in_file(Path::new("scene.json")).to_string(),
        Ok(Ok(_)) => "no error".to_owned(),
    }
}

#[test]
fn wrong_masks_are_named() {
    assert_snapshot!(message(r#"{}"#), @r#"scene.json: detections[0].mask: expected one of "path", "rle" and "polygons"; found none of them"#);
    assert_snapshot!(message(r#"{"value": 3}"#), @r#"scene.json: detections[0].mask: a "value" belongs to the "path" of a label image; there is none"#);
    assert_snapshot!(message(r#"{"path": "a.png", "value": 70000}"#), @"scene.json: detections[0].mask.value: 70000 is above 65535, the largest value of a label image");
    assert_snapshot!(message(r#"{"path": "a.png", "value": -1}"#), @"scene.json:7:90: detections[0].mask.value: found the number `-1`, expected a whole number");
    assert_snapshot!(message(r#"{"path": "a.png", "polygons": [[0, 0, 1, 0, 0, 1]]}"#), @r#"scene.json: detections[0].mask: expected one of "path", "rle" and "polygons"; found "path" and "polygons""#);
    assert_snapshot!(message(r#""a.png""#), @r#"scene.json:7:68: detections[0].mask: found the text "a.png", expected an object {...} ("mask": {"path": "...", "value": a whole number}, {"rle": {...}} or {"polygons": [[x, y, ...]]})"#);
    assert_snapshot!(message(r#"{"path": 3}"#), @"scene.json:7:71: detections[0].mask.path: found the number `3`, expected text in quotes");
    assert_snapshot!(message(r#"{"rle": [1, 2]}"#), @r#"scene.json:7:69: detections[0].mask.rle: found a list, expected an object {...} ("rle": {"size": [height, width], "counts": ...} as in COCO)"#);
    assert_snapshot!(message(r#"{"rle": {"counts": [48]}}"#), @r#"scene.json:7:85: detections[0].mask.rle: missing field `size` ("rle": {"size": [height, width], "counts": ...} as in COCO)"#);
    assert_snapshot!(message(r#"{"rle": {"size": [6], "counts": [48]}}"#), @"scene.json:7:81: detections[0].mask.rle.size: found 1 entry, expected a list of 2 whole numbers");
    assert_snapshot!(message(r#"{"rle": {"size": [6, 8], "counts": 48}}"#), @"scene.json:7:98: detections[0].mask.rle.counts: found the number `48`, expected a list of whole numbers, or the text of the compressed form");
    assert_snapshot!(message(r#"{"rle": {"size": [6, 8], "counts": [40, -3]}}"#), @"scene.json:7:103: detections[0].mask.rle.counts[1]: found the number `-3`, expected a whole number");
    assert_snapshot!(message(r#"{"rle": {"size": [6, 8], "counts": [40, 3]}}"#), @"scene.json: detections[0].mask.rle: the runs cover 43 pixels; the size [6, 8] has 48");
    assert_snapshot!(message(r#"{"rle": {"size": [6, 8], "counts": "a b"}}"#), @"scene.json: detections[0].mask.rle: the character ' ' at position 1 is not valid in COCO's compressed runs");
    assert_snapshot!(message(r#"{"polygons": []}"#), @"scene.json: detections[0].mask.polygons: there are no polygons; expected one or more");
    assert_snapshot!(message(r#"{"polygons": [[0, 0, 1, 0, 0]]}"#), @"scene.json: detections[0].mask.polygons: polygon 0 has 5 numbers; expected an even number [x, y, x, y, ...]");
    assert_snapshot!(message(r#"{"polygons": [0, 0, 1, 0, 0, 1]}"#), @r#"scene.json:7:76: detections[0].mask.polygons[0]: found the number `0`, expected a list ("polygons": [[x, y, x, y, ...], ...] in pixels)"#);
    for good in [
        "null",
        r#"{"path": "a.png"}"#,
        r#"{"rle": {"size": [6, 8], "counts": [48]}}"#,
        r#"{"rle": {"size": [6, 8], "counts": "`1"}, "from": "SAM"}"#,
        r#"{"polygons": [[0, 0, 1, 0, 0, 1]]}"#,
    ] {
        assert_eq!(message(good), "no error", "{good}");
    }
}

/// A folder with a scene and its files; the last detection is in frame "a" too.
struct Folder {
    folder: tempfile::TempDir,
    images: SceneImages,
    scene: quadlift::scene::Scene,
}

fn folder(masks: &[&str]) -> Folder {
    let folder = tempfile::tempdir().unwrap();
    for sub in ["rgb", "masks"] {
        std::fs::create_dir(folder.path().join(sub)).unwrap();
    }
    write_png(&folder.path().join("rgb/a.png"), &RgbImage::new(8, 6)).unwrap();
    let labels = LabelImage::new(8, 6, (0..48).map(|k| if k < 3 { 9 } else { u16::from(k == 20) * 300 }).collect());
    write_label_image(&folder.path().join("masks/a.png"), &labels.unwrap()).unwrap();
    write_png(&folder.path().join("masks/empty.png"), &GrayImage::new(8, 6)).unwrap();
    write_png(&folder.path().join("masks/small.png"), &GrayImage::new(4, 3)).unwrap();
    let file = scene_file(masks).unwrap();
    let images = file.to_images(&folder.path().join("scene.json")).unwrap();
    Folder { folder, images, scene: file.to_scene().unwrap() }
}

impl Folder {
    fn masks(&self) -> Vec<Result<Option<Mask>, String>> {
        let all: Vec<usize> = (0..self.images.masks.len()).collect();
        let place = self.folder.path().display().to_string() + "/";
        let masks = self.images.read_masks(&self.scene, &all);
        masks.into_iter().map(|mask| mask.map_err(|error| error.to_string().replace(&place, ""))).collect()
    }
}

#[test]
fn every_form_of_a_mask_is_read() {
    let folder = folder(&[
        r#"{"path": "masks/a.png", "value": 9}"#,
        r#"{"path": "masks/a.png", "value": 300}"#,
        r#"{"path": "masks/a.png"}"#,
        r#"{"rle": {"size": [6, 8], "counts": [0, 1, 5, 1, 5, 1, 35]}}"#,
        r#"{"polygons": [[0, 0, 3, 0, 3, 1, 0, 1]]}"#,
        "null",
    ]);
    let row = Mask { origin: [0, 0], width: 3, height: 1, inside: vec![true; 3] };
    let masks = folder.masks();
    assert_eq!(masks[0], Ok(Some(row.clone())));
    assert_eq!(masks[1], Ok(Some(Mask { origin: [4, 2], width: 1, height: 1, inside: vec![true] })));
    assert_eq!(masks[2].as_ref().unwrap().as_ref().unwrap().count(), 4);
    assert_eq!(masks[3], Ok(Some(row.clone())));
    assert_eq!(masks[4], Ok(Some(row)));
    assert_eq!(masks[5], Ok(None));
    assert!(matches!(&folder.images.masks[0], Some(MaskSource::Labels { value: Some(9), .. })));
    assert_eq!(folder.images.read_masks(&folder.scene, &[99]), [Ok(None)]);
}

#[test]
fn masks_that_cannot_be_read_are_named_and_the_others_are_read() {
    let folder = folder(&[
        r#"{"path": "masks/no.png", "value": 9}"#,
        r#"{"path": "masks/a.png", "value": 8}"#,
        r#"{"path": "masks/empty.png"}"#,
        r#"{"path": "masks/empty.png", "value": 8}"#,
        r#"{"path": "masks/small.png"}"#,
        r#"{"rle": {"size": [8, 6], "counts": [0, 48]}}"#,
        r#"{"rle": {"size": [6, 8], "counts": [48]}}"#,
        r#"{"polygons": [[20, 0, 23, 0, 23, 1]]}"#,
        r#"{"path": "masks/a.png", "value": 9}"#,
    ]);
    let masks = folder.masks();
    let error = |k: usize| masks[k].clone().unwrap_err();
    assert_snapshot!(error(0), @"masks/no.png: there is no such file");
    assert_snapshot!(error(1), @"masks/a.png: no pixel has the value 8 of detections[1].mask; its values are 9, 300");
    assert_snapshot!(error(2), @"masks/empty.png: every pixel is 0; expected the mask of detections[2]");
    assert_snapshot!(error(3), @"masks/empty.png: no pixel has the value 8 of detections[3].mask; every pixel is 0");
    assert_snapshot!(error(4), @r#"masks/small.png: the image has 4 x 3 pixels; the camera of frame "a" has 8 x 6"#);
    assert!(
        error(5).ends_with(
            "scene.json: detections[5].mask: the image has 6 x 8 pixels; the camera of frame \"a\" has 8 x 6"
        ),
        "{}",
        error(5)
    );
    assert!(
        error(6).ends_with("scene.json: detections[6].mask: no pixel of the image lies in the mask"),
        "{}",
        error(6)
    );
    assert!(
        error(7).ends_with("scene.json: detections[7].mask: no pixel of the image lies in the mask"),
        "{}",
        error(7)
    );
    assert!(masks[8].is_ok());
}

#[test]
fn images_of_frames_are_read_and_checked() {
    let folder = folder(&["null"]);
    assert_eq!(folder.images.read_image(&folder.scene, 0).unwrap().dimensions(), (8, 6));
    let error = folder.images.read_image(&folder.scene, 1).unwrap_err();
    assert!(error.to_string().ends_with("scene.json: frames[1]: the frame \"b\" has no \"image\""), "{error}");
    write_png(&folder.folder.path().join("rgb/a.png"), &RgbImage::new(16, 12)).unwrap();
    let error = folder.images.read_image(&folder.scene, 0).unwrap_err();
    assert_eq!(error.path, folder.folder.path().join("rgb/a.png"));
    assert_eq!(error.problem, "the image has 16 x 12 pixels; the camera of frame \"a\" has 8 x 6");
    // A frame whose size is not known takes any image.
    let mut scene = folder.scene.clone();
    scene.edit(|parts| parts.frames[0].image_size = None).unwrap();
    assert_eq!(folder.images.read_image(&scene, 0).unwrap().dimensions(), (16, 12));
}
