use quadlift_segment::Rle;

use super::*;
use crate::read::detections::tests::added;
use crate::scene_file::{DetectionRecord, RleCounts};

fn read(text: &str) -> Result<DetectionFiles, ReadError> {
    parse_label_studio(Path::new("export.json"), text.as_bytes())
}

/// A result of the full form on an image of 64 x 48 pixels.
fn result(id: &str, kind: &str, value: &str) -> String {
    format!(
        r#"{{"id": "{id}", "type": "{kind}", "from_name": "label", "to_name": "image", "original_width": 64,
        "original_height": 48, "image_rotation": 0, "value": {{{value}}}, "origin": "manual"}}"#
    )
}

/// A task on an image.
fn task(image: &str, results: &[String]) -> String {
    format!(
        r#"{{"id": 1, "data": {{"text": "none", "image": "{image}"}}, "annotations": [{{"id": 2, "was_cancelled": false,
        "result": [{}]}}], "predictions": [7]}}"#,
        results.join(",")
    )
}

fn close(record: &DetectionRecord, expected: [f64; 4]) {
    let found = record.bounding_box.unwrap();
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {expected:?}");
}

#[test]
fn shapes_of_images() {
    let results = [
        result(
            "a",
            "rectanglelabels",
            r#""x": 25, "y": 50, "width": 12.5, "height": 25, "rotation": 0, "rectanglelabels": ["cup"]"#,
        ),
        // A right angle about the first corner (16, 24) of a box of 8 x 12 pixels.
        result(
            "b",
            "rectanglelabels",
            r#""x": 25, "y": 50, "width": 12.5, "height": 25, "rotation": 90, "rectanglelabels": ["kite"]"#,
        ),
        result(
            "c",
            "polygonlabels",
            r#""points": [[0, 0], [50, 0], [25, 50]], "closed": true, "polygonlabels": ["cat"]"#,
        ),
        result(
            "d",
            "ellipselabels",
            r#""x": 50, "y": 50, "radiusX": 12.5, "radiusY": 25, "rotation": 0, "ellipselabels": ["ball"]"#,
        ),
        // A region whose label is a result of its own.
        result("e", "rectangle", r#""x": 0, "y": 0, "width": 50, "height": 50, "rotation": 0"#),
        result("e", "labels", r#""x": 0, "y": 0, "width": 50, "height": 50, "rotation": 0, "labels": ["box"]"#),
        result("e", "choices", r#""x": 0, "y": 0, "width": 50, "height": 50, "rotation": 0, "choices": ["red"]"#),
        result("f", "keypointlabels", r#""x": 0, "y": 0, "width": 0.5, "keypointlabels": ["tip"]"#),
        r#"{"type": "relation", "from_id": "a", "to_id": "b"}"#.to_owned(),
    ];
    let text = format!("[{}]", task("/data/upload/3/0a1b2c3d-a.png", &results));
    let files = read(&text).unwrap();
    assert_eq!(files.notes, ["1 points were skipped"]);
    assert_eq!(files.images[0].key.size, Some([64.0, 48.0]));
    let records = added(files, &["a.png"]);
    assert_eq!(records.len(), 5);
    let categories: Vec<&str> = records.iter().map(|record| record.category.as_deref().unwrap()).collect();
    assert_eq!(categories, ["cup", "kite", "cat", "ball", "box"]);
    close(&records[0], [16.0, 24.0, 24.0, 36.0]);
    close(&records[1], [4.0, 24.0, 16.0, 32.0]);
    close(&records[2], [0.0, 0.0, 32.0, 24.0]);
    assert_eq!(**records[2].outline.as_ref().unwrap(), [[0.0, 0.0], [32.0, 0.0], [16.0, 24.0]]);
    assert!(records[2].mask.is_none());
    close(&records[3], [24.0, 12.0, 40.0, 36.0]);
    close(&records[4], [0.0, 0.0, 32.0, 24.0]);
    assert!(records.iter().all(|record| record.object.is_none() && record.score.is_none()));
}

#[test]
fn masks_of_brushes() {
    // Written by encode_rle of the package label-studio-sdk: 8 x 4 pixels, of which [3, 1], [4, 1], [2, 2], [6, 2].
    let rle = "[0,0,0,128,57,27,254,43,0,159,255,9,128,71,255,108,2,63,252,70,0]";
    let brush = |rle: &str, width: u32| {
        format!(
            r#"[{{"data": {{"image": "a.png"}}, "annotations": [{{"result": [{{"id": "a", "type": "brushlabels",
            "original_width": {width}, "original_height": 4,
            "value": {{"format": "rle", "rle": {rle}, "brushlabels": ["cup"]}}}}]}}]}}]"#
        )
    };
    let files = read(&brush(rle, 8)).unwrap();
    let detected = &files.images[0].detections[0];
    assert_eq!(detected.bounding_box, Some([2.0 / 8.0, 1.0 / 4.0, 7.0 / 8.0, 3.0 / 4.0]));
    let Outline::Rle(record) = &detected.outline else { panic!("{detected:?}") };
    let RleCounts::Compressed(text) = &record.counts else { panic!("{record:?}") };
    let mask = Rle::from_compressed(4, 8, text).unwrap().to_mask();
    assert_eq!(mask.pixels().collect::<Vec<_>>(), [[3, 1], [4, 1], [2, 2], [6, 2]]);
    let message = |rle: &str, width: u32| read(&brush(rle, width)).unwrap_err().to_string();
    insta::assert_snapshot!(message(rle, 9), @"export.json: [0].annotations[0].result[0].value.rle: the packed mask has 128 values; 9 x 4 pixels have 4 each");
    insta::assert_snapshot!(message("[0,0,0,128,57,27]", 8), @"export.json: [0].annotations[0].result[0].value.rle: the packed mask ends in the middle");
    insta::assert_snapshot!(message("[0,0,0,128,57,27,254,43,0,159,255,9,128,255,255,255]", 8), @"export.json: [0].annotations[0].result[0].value.rle: a run of the packed mask ends after the last pixel");
    insta::assert_snapshot!(message("[0,0,0,300]", 8), @"export.json: [0].annotations[0].result[0].value.rle[3]: found 300, expected a number from 0 to 255");
}

#[test]
fn tracks_of_videos() {
    let sequence = r#""framesCount": 10, "duration": 0.4, "sequence": [
        {"frame": 1, "enabled": true, "rotation": 0, "x": 0, "y": 0, "width": 10, "height": 20, "time": 0.04},
        {"frame": 3, "enabled": false, "rotation": 0, "x": 20, "y": 10, "width": 10, "height": 40, "time": 0.12},
        {"frame": 5, "enabled": true, "rotation": 0, "x": 50, "y": 50, "width": 10, "height": 10, "time": 0.2}],
        "labels": ["car"]"#;
    let video = |name: &str| {
        format!(
            r#"{{"id": 1, "data": {{"video": "https://host/{name}?token=a.b"}}, "annotations": [{{"result": [
            {{"id": "tRk1", "type": "videorectangle", "value": {{{sequence}}}}}]}}]}}"#
        )
    };
    let files = read(&format!("[{}]", video("my%20drive.mp4"))).unwrap();
    assert_eq!(
        files.notes,
        ["frames of the video count from 1", "1 boxes between keyframes were interpolated linearly"]
    );
    let scene_frames = ["000000.png", "000001.png", "000002.png", "000003.png", "000004.png"];
    let records = added(files, &scene_frames);
    let frames: Vec<&str> = records.iter().map(|record| &*record.frame).collect();
    assert_eq!(frames, ["000000.png", "000001.png", "000002.png", "000004.png"]);
    close(&records[1], [6.4, 2.4, 12.8, 16.8]);
    let first = &records[0];
    assert_eq!((first.object.as_deref(), first.category.as_deref()), (Some("tRk1"), Some("car")));
    let message = |text: &str| read(text).unwrap_err().to_string();
    insta::assert_snapshot!(message(&format!("[{}, {}]", video("a.mp4"), video("b.mp4"))), @"export.json: the file has 2 videos and 4 images or frames; expected images, or the frames of one video: export its task");
    let far = sequence.replace("\"frame\": 3", "\"frame\": 4000000000");
    insta::assert_snapshot!(message(&format!("[{}]", video("a.mp4").replace(sequence, &far))), @"export.json: [0].annotations[0].result[0].value.sequence: the tracks have more than 1048576 boxes between keyframes; export parts of the video");
    insta::assert_snapshot!(message(&format!("[{}]", video("a.mp4").replace("\"frame\": 3", "\"frame\": 0"))), @"export.json: [0].annotations[0].result[0].value.sequence[1].frame: expected the number of a frame, from 1");
}

#[test]
fn the_short_form() {
    let text = r#"[{"image": "/data/local-files/?d=left/a.png", "id": 1, "annotator": 1, "annotation_id": 5,
        "created_at": "2026-01-01T00:00:00.000000Z", "lead_time": 12.5,
        "box": [{"x": 25, "y": 50, "width": 12.5, "height": 25, "rotation": 0, "original_width": 64, "original_height": 48}],
        "label": [{"x": 25, "y": 50, "width": 12.5, "height": 25, "rotation": 0, "labels": ["cup"], "original_width": 64,
        "original_height": 48}], "quality": "good"},
        {"image": "b.png", "id": 2, "annotator": 1, "annotation_id": 6}]"#;
    let files = read(text).unwrap();
    assert_eq!(files.images[0].key.name.as_deref(), Some("left/a.png"));
    assert_eq!(files.images.len(), 2);
    let records = added(files, &["a.png", "b.png"]);
    assert_eq!(records.len(), 1);
    close(&records[0], [16.0, 24.0, 24.0, 36.0]);
    assert_eq!(records[0].category.as_deref(), Some("cup"));
}

#[test]
fn which_results_of_a_task_are_read() {
    let box_of = |label: &str| {
        result(
            "a",
            "rectanglelabels",
            &format!(r#""x": 1, "y": 1, "width": 5, "height": 5, "rectanglelabels": ["{label}"]"#),
        )
    };
    let text = format!(
        r#"[{{"data": {{"image": "a.png"}}, "annotations": [
            {{"was_cancelled": true, "result": [{}]}}, {{"result": [{}]}}, {{"result": [{}]}}]}},
        {{"data": {{"image": "b.png"}}, "annotations": [], "predictions": [{{"score": 0.7, "result": [{}]}}]}},
        {{"data": {{"image": "c.png"}}, "annotations": []}}]"#,
        box_of("canceled"),
        box_of("first"),
        box_of("second"),
        box_of("predicted")
    );
    let files = read(&text).unwrap();
    assert_eq!(
        files.notes,
        [
            "1 tasks have several annotations: the first of each was read",
            "1 tasks have no annotation: their predictions were read"
        ]
    );
    // The image without annotations is not known to be empty.
    assert_eq!(files.images.len(), 2);
    let found: Vec<_> = files.images.iter().map(|image| &image.detections[0]).collect();
    assert_eq!((found[0].category.as_deref(), found[0].score), (Some("first"), None));
    assert_eq!((found[1].category.as_deref(), found[1].score), (Some("predicted"), Some(0.7)));
}

#[test]
fn what_is_wrong_with_exports_is_named() {
    let message = |text: &str| read(text).unwrap_err().to_string();
    let shape = |kind: &str, value: &str| message(&format!("[{}]", task("a.png", &[result("a", kind, value)])));
    insta::assert_snapshot!(message("{}"), @"export.json: found an object {...}, expected a list");
    insta::assert_snapshot!(message(r#"[{"data": {"text": "hello"}}]"#), @r#"export.json: [0].data: there is no name of an image or video; expected one in "image" or "video""#);
    insta::assert_snapshot!(message(r#"[{"data": {"image": "a.png"}, "annotations": [{}]}]"#), @r#"export.json: [0].annotations[0]: there is no "result""#);
    insta::assert_snapshot!(shape("rectanglelabels", r#""x": "left", "y": 1, "width": 5, "height": 5"#), @r#"export.json: [0].annotations[0].result[0].value.x: found the text "left", expected a number"#);
    insta::assert_snapshot!(shape("rectanglelabels", r#""x": 1, "y": 1, "width": -5, "height": 5"#), @"export.json: [0].annotations[0].result[0].value: the box has the width -5 and the height 5; expected positive numbers");
    insta::assert_snapshot!(shape("polygonlabels", r#""points": [[1, 2], [3, 4]]"#), @"export.json: [0].annotations[0].result[0].value.points: the polygon has 2 points; expected 3 or more");
}
