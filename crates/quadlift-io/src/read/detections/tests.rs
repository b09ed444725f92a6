//! Files written by pycocotools and supervision against what these packages make of them; small files by hand.

use std::path::{Path, PathBuf};

use quadlift_segment::Rle;
use serde_json::Value;

use super::coco::{parse_coco, read_coco};
use super::csv::{parse_csv, table_of};
use super::files::LabelFile;
use super::kitti_labels::parse_kitti_labels;
use super::labelme::parse_labelme;
use super::mot::{MotKind, MotOptions, parse_mot};
use super::names::parse_names;
use super::table::TableOptions;
use super::voc::parse_voc;
use super::yolo::{ExtraColumns, YoloKind, YoloOptions, parse_yolo, read_yolo};
use super::*;
use crate::error::ReadError;
use crate::read::ReadOptions;
use crate::read::json::{Node, parse_json};
use crate::scene_file::{CameraRecord, DetectionRecord, FrameRecord, RleCounts, SceneFile};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/detections").join(name)
}

fn expected() -> Value {
    serde_json::from_slice(&std::fs::read(fixture("expected.json")).unwrap()).unwrap()
}

/// A scene of frames with these ids, 64 x 48 pixels.
fn scene(ids: &[&str]) -> SceneFile {
    let camera = CameraRecord {
        id: "c".to_owned(),
        model: "PINHOLE".to_owned(),
        width: Some(64.0),
        height: Some(48.0),
        params: vec![50.0, 50.0, 32.0, 24.0],
        ..CameraRecord::default()
    };
    let frame = |id: &&str| FrameRecord {
        id: (*id).to_owned(),
        camera: Some("c".to_owned()),
        cam_from_world: Some([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
        ..FrameRecord::default()
    };
    SceneFile { cameras: vec![camera], frames: ids.iter().map(frame).collect(), ..SceneFile::default() }
}

/// The detections as records of a scene with these frames, which is valid with them.
pub(super) fn added(files: DetectionFiles, ids: &[&str]) -> Vec<DetectionRecord> {
    let mut scene = scene(ids);
    add_detections(&mut scene, files, &AddOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    scene.to_scene().unwrap();
    scene.to_images(Path::new("scene.json")).unwrap();
    scene.detections
}

fn close(found: Option<[f64; 4]>, expected: &Value, tolerance: f64) {
    let found = found.unwrap();
    let expected: [f64; 4] = serde_json::from_value(expected.clone()).unwrap();
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() <= tolerance), "{found:?} {expected:?}");
}

#[test]
fn coco_agrees_with_pycocotools() {
    let files = read_coco(&fixture("instances.json"), None).unwrap();
    assert!(files.notes.iter().any(|note| note.starts_with("1 crowd annotations")), "{:?}", files.notes);
    let records = added(files, &["images/left/0001.png", "images/left/0002.png", "images/left/0003.png"]);
    assert_eq!(records.len(), 13);
    let mut of_image = [0; 3];
    for expected in expected()["coco"].as_array().unwrap() {
        let image = expected["image"].as_u64().unwrap() as usize / 10;
        let frame = format!("images/left/{image:04}.png");
        let record = records.iter().filter(|record| *record.frame == *frame).nth(of_image[image - 1]).unwrap();
        of_image[image - 1] += 1;
        close(record.bounding_box, &expected["xyxy"], 0.0);
        let rle = record.mask.as_ref().unwrap().rle.as_ref().unwrap();
        let rle = match &rle.counts {
            RleCounts::Runs(runs) => Rle::new(rle.size[0], rle.size[1], runs.clone()),
            RleCounts::Compressed(text) => Rle::from_compressed(rle.size[0], rle.size[1], text),
        };
        let rle = rle.unwrap();
        assert_eq!(rle.counts(), serde_json::from_value::<Vec<u32>>(expected["runs"].clone()).unwrap());
        assert_eq!(rle.to_mask().count() as u64, expected["area"].as_u64().unwrap());
    }
    // Several polygons stay a mask.
    let polygon = records.iter().find(|record| record.mask.as_ref().unwrap().polygons.is_some()).unwrap();
    assert_eq!(polygon.bounding_box, Some([5.25, 2.0, 50.0, 40.75]));
    assert_eq!(polygon.category.as_deref(), Some("cup"));
    // Results have their names in the data set; without it only the numbers are known.
    let results = read_coco(&fixture("results.json"), Some(&fixture("instances.json"))).unwrap();
    let records = added(results, &["0001.png", "0002.png"]);
    assert_eq!((&*records[0].frame, records[0].category.as_deref()), ("0002.png", Some("cat")));
    assert_eq!((records[0].bounding_box, records[0].score), (Some([10.5, 11.25, 15.5, 18.75]), Some(0.75)));
    let results = read_coco(&fixture("results.json"), None).unwrap();
    assert_eq!(results.images[0].key, ImageKey { number: Some(20), ..ImageKey::default() });
    assert_eq!(added(results, &["frame_19.png", "frame_20.png"])[0].category.as_deref(), Some("17"));
}

#[test]
fn the_sinks_of_supervision_are_read() {
    for name in ["sink.csv", "sink.json"] {
        let files = (super::csv::FORMAT.read)(&fixture(name), &ReadOptions::default()).unwrap();
        let records = added(files, &["000000", "000001", "000002"]);
        let expected = expected();
        let expected = expected["sinks"].as_array().unwrap();
        assert_eq!(records.len(), expected.len());
        for (record, expected) in records.iter().zip(expected) {
            // The CSV has the digits of 32-bit numbers.
            close(record.bounding_box, &expected["xyxy"], 2e-6);
            assert!((record.score.unwrap() - expected["score"].as_f64().unwrap()).abs() < 1e-7);
            assert_eq!(*record.frame, format!("{:06}", expected["frame"].as_u64().unwrap()));
            assert_eq!(record.object.as_deref(), expected["track"].as_u64().map(|id| format!("t{id}")).as_deref());
            assert_eq!(record.category.as_deref(), expected["category"].as_str());
        }
    }
    let turned = (super::csv::FORMAT.read)(&fixture("turned.csv"), &ReadOptions::default()).unwrap();
    let record = &added(turned, &["a.png"])[0];
    let square = record.oriented_box.as_ref().unwrap();
    assert_eq!(square.center, [20.0, 20.0]);
    // A square that stands on its corner; the box is that around the circle in it.
    let radius = 50_f64.sqrt();
    assert!(square.size.iter().all(|side| (side - 2.0 * radius).abs() < 1e-12), "{square:?}");
    assert!(record.ellipse.is_none());
    close(record.bounding_box, &serde_json::json!([20.0 - radius, 20.0 - radius, 20.0 + radius, 20.0 + radius]), 1e-12);
    let error = parse_csv(Path::new("a.csv"), b"x_min,y_min,x_max,y_max,note\n1,2,3,4,x\n", &TableOptions::default());
    insta::assert_snapshot!(error.unwrap_err(), @r#"a.csv:1: no column identifies the image of a row ("frame", "image" or "time"; --frame-column NAME); the columns are x_min, y_min, x_max, y_max, note"#);
}

#[test]
fn yolo_files_of_supervision_are_read() {
    let expected = expected();
    for (folder, tolerance) in [("yolo", 5e-4), ("yolo_seg", 5e-4)] {
        let files = read_yolo(&fixture(folder), &YoloOptions::default()).unwrap();
        assert!(files.notes.iter().any(|note| note.contains("data.yaml")), "{:?}", files.notes);
        let records = added(files, &["0000.png", "0001.png", "0002.png"]);
        for (name, boxes) in expected[folder].as_object().unwrap() {
            let found: Vec<&DetectionRecord> = records.iter().filter(|record| *record.frame == **name).collect();
            assert_eq!(found.len(), boxes.as_array().unwrap().len());
            for (record, expected) in found.iter().zip(boxes.as_array().unwrap()) {
                // Five digits of a width of 64 pixels.
                close(record.bounding_box, expected, tolerance);
                assert_eq!(record.outline.is_some(), folder == "yolo_seg");
                assert!(record.mask.is_none());
            }
        }
        if folder == "yolo" {
            assert_eq!(records[0].category.as_deref(), Some("traffic light"));
        }
    }
}

fn yolo(lines: &[&str], kind: YoloKind, extra: ExtraColumns) -> Result<DetectionFiles, String> {
    let file = |(index, line): (usize, &&str)| LabelFile {
        name: format!("{index}.txt"),
        path: PathBuf::from(format!("{index}.txt")),
        bytes: line.as_bytes().to_vec(),
    };
    let files: Vec<LabelFile> = lines.iter().enumerate().map(file).collect();
    let options = YoloOptions { kind, extra, names: None };
    parse_yolo(Path::new("labels"), &files, &options).map_err(|error| error.to_string())
}

#[test]
fn the_columns_of_yolo_are_told_by_all_files() {
    let read = |lines: &[&str]| {
        let files = yolo(lines, YoloKind::Auto, ExtraColumns::Auto).unwrap();
        let of_image = |image: &DetectedImage| {
            let detected = image.detections.first()?;
            Some((detected.score, detected.track.clone()))
        };
        (files.images.iter().map(of_image).collect::<Vec<_>>(), files.notes[0].clone())
    };
    let id = |id: &str| Some(id.to_owned());
    let (found, note) = read(&["0 0.5 0.5 0.2 0.2 0.91\n", "", "0 0.5 0.5 0.2 0.2 1\n"]);
    assert_eq!(found, [Some((Some(0.91), None)), None, Some((Some(1.0), None))]);
    assert_eq!(note, "each line has a class, a box and a score (--kind, --columns)");
    // The first file alone could be a score of 1.
    assert_eq!(
        read(&["0 0.5 0.5 0.2 0.2 1\n", "0 0.5 0.5 0.2 0.2 2\n"]).0,
        [Some((None, id("1"))), Some((None, id("2")))]
    );
    // A tracker with scores leaves the id out where it has none.
    assert_eq!(
        read(&["0 0.5 0.5 0.2 0.2 1\n", "0 0.5 0.5 0.2 0.2 0.5 1\n"]).0,
        [Some((Some(1.0), None)), Some((Some(0.5), id("1")))]
    );
    let triangle = "0 0.1 0.1 0.4 0.1 0.4 0.4 0.3 0.5 0.2 0.4";
    assert_eq!(read(&[triangle]).0, [Some((None, None))]);
    assert_eq!(read(&[&format!("{triangle} 0.8")]).0, [Some((Some(0.8), None))]);
    assert_eq!(read(&[&format!("{triangle} 3")]).0, [Some((None, id("3")))]);
    let (found, note) = read(&[&format!("{triangle} 0.8 1"), &format!("{triangle} 0.7 2")]);
    assert_eq!(found, [Some((Some(0.8), id("1"))), Some((Some(0.7), id("2")))]);
    assert_eq!(note, "each line has a class, a polygon, a score and a track id (--kind, --columns)");
    let turned = "0 0.5 0.4 0.6 0.5 0.5 0.6 0.4 0.5";
    assert_eq!(read(&[&format!("{turned} 0.8 4")]).0, [Some((Some(0.8), id("4")))]);
    let files = yolo(&[turned], YoloKind::Auto, ExtraColumns::Auto).unwrap();
    assert!(matches!(files.images[0].detections[0].outline, Outline::OrientedBox(_)));
    let files = yolo(&[turned], YoloKind::Polygon, ExtraColumns::None).unwrap();
    assert!(matches!(files.images[0].detections[0].outline, Outline::Polygons(_)));
    // Repeated lines of a second run.
    let twice = yolo(&["1 0.5 0.5 0.2 0.2\n1 0.5 0.5 0.2 0.2\n"], YoloKind::Auto, ExtraColumns::Auto).unwrap();
    assert_eq!((twice.images[0].detections.len(), twice.notes[1].starts_with("1 duplicate lines")), (1, true));
    // Written by numpy: classes and tracks are whole numbers in any notation.
    let floats = yolo(&["2.0 0.5 0.5 0.2 0.2\n"], YoloKind::Auto, ExtraColumns::Auto).unwrap();
    assert_eq!(floats.images[0].detections[0].category.as_deref(), Some("2"));
    assert!(yolo(&["2.5 0.5 0.5 0.2 0.2\n"], YoloKind::Auto, ExtraColumns::Auto).is_err());
}

#[test]
fn what_is_wrong_with_yolo_files_is_named() {
    let message = |lines: &[&str]| yolo(lines, YoloKind::Auto, ExtraColumns::Auto).unwrap_err();
    insta::assert_snapshot!(message(&["0 0.5 0.5 0.2 0.2 1\n"]), @"0.txt:1: the last number of every line is 0 or 1: a score, or the id of the only track? Choose with --columns score or --columns track");
    insta::assert_snapshot!(message(&["0 345.2 120 20 20\n"]), @"0.txt:1: coordinate 1 is 345.2; expected a fraction of image width or height, from 0 to 1");
    insta::assert_snapshot!(message(&["cup 0.5 0.5 0.2 0.2\n"]), @r#"0.txt:1: field 1 is "cup"; expected the number of a class"#);
    insta::assert_snapshot!(message(&["0 0.5 0.5 0.2 0.2\n1 0.5 0.5\n"]), @"0.txt:2: found 2 numbers after the class; but each line has a class, a box (--kind, --columns)");
    insta::assert_snapshot!(message(&["0 0.5 0.5 0.2 0.2 3.5\n"]), @"0.txt:1: the track id is 3.5; expected a whole number");
    let with_both = "45 0.1 0.2 0.5 0.4 0.45 0.1 0.4 0.45 0 0.6 0.4 0.5 0.8 4\n2\n";
    insta::assert_snapshot!(message(&[with_both]), @"0.txt:2: found 0 numbers after the class; but each line has a class, a polygon, a score and a track id (--kind, --columns)");
    // Three keypoints with visibility after each box.
    let pose = "0 0.5 0.5 0.2 0.2 0.4 0.4 1 0.5 0.5 1 0.6 0.6 0.5\n";
    insta::assert_snapshot!(message(&[pose, pose, pose]), @"0.txt:1: every line has 13 numbers after the class, which looks like a box and keypoints; keypoints are not supported (--kind polygon if the lines are polygons)");
    let files = yolo(&["0 0.5 0.5 0.2 0.2"], YoloKind::Auto, ExtraColumns::Auto).unwrap();
    let mut scene = scene(&["0.png"]);
    (scene.cameras[0].width, scene.cameras[0].height) = (None, None);
    let error = add_detections(&mut scene, files.clone(), &AddOptions::default()).unwrap_err();
    insta::assert_snapshot!(error, @r#"labels: the coordinates of 0.txt are fractions of image width and height, which are unknown: the camera has no "width" and "height" (--assume image_size=WxH)"#);
    let options = AddOptions { image_size: Some([100.0, 50.0]), ..AddOptions::default() };
    add_detections(&mut scene, files, &options).unwrap();
    close(scene.detections[0].bounding_box, &serde_json::json!([40.0, 20.0, 60.0, 30.0]), 1e-12);
}

#[test]
fn shares_are_of_the_frames_own_image_where_its_camera_has_another_size() {
    let files = yolo(&["0 0.5 0.5 0.2 0.2"], YoloKind::Auto, ExtraColumns::Auto).unwrap();
    let mut scene = scene(&["0.png"]);
    (scene.frames[0].width, scene.frames[0].height) = (Some(200.0), Some(100.0));
    assert_ne!(scene.cameras[0].width, Some(200.0));
    add_detections(&mut scene, files, &AddOptions::default()).unwrap();
    close(scene.detections[0].bounding_box, &serde_json::json!([80.0, 40.0, 120.0, 60.0]), 1e-12);
}

fn mot(text: &str, options: &MotOptions) -> Result<DetectionFiles, ReadError> {
    parse_mot(Path::new("mot.txt"), text.as_bytes(), options)
}

#[test]
fn mot_counts_frames_ids_and_pixels_from_one() {
    let auto = MotOptions::default();
    let text = "1,-1,794.27,47.5,71.2,174.8,67.5,-1,-1,-1\n2,3,164.1,19.6,66.5,163.2,-1,-1,-1,-1\n";
    let records = added(mot(text, &auto).unwrap(), &["a", "b"]);
    assert_eq!((&*records[0].frame, &*records[1].frame), ("a", "b"));
    close(records[0].bounding_box, &serde_json::json!([793.27, 46.5, 864.47, 221.3]), 1e-9);
    assert_eq!((records[0].score, records[1].score), (Some(67.5), None));
    assert_eq!((records[0].object.as_deref(), records[1].object.as_deref()), (None, Some("t3")));
    let from_zero = MotOptions { boxes_from_zero: true, ..auto };
    assert_eq!(added(mot(text, &from_zero).unwrap(), &["a", "b"])[0].bounding_box.unwrap()[0], 794.27);
    // Ground truth: flag, class, visibility.
    let gt = "1,1,11,21,30,40,1,3,0.25\n1,2,11,21,30,40,0,1,1\n";
    let files = mot(gt, &auto).unwrap();
    assert_eq!(files.notes[2], "1 boxes with the flag 0 were skipped");
    let records = added(files, &["a"]);
    assert_eq!((records.len(), records[0].category.as_deref()), (1, Some("car")));
    assert_eq!((records[0].visible_fraction, records[0].score), (Some(0.25), None));
    // boxmot: confidence, class, index; blanks between the columns.
    let names = parse_names(Path::new("names.txt"), b"cup\ncat\n").unwrap();
    let with_names = MotOptions { names: Some(&names), ..auto };
    let records = added(mot("1 7 11 21 30 40 0.9 1 -1\n", &with_names).unwrap(), &["a"]);
    assert_eq!((records[0].category.as_deref(), records[0].score), (Some("cat"), Some(0.9)));
    let as_truth = MotOptions { kind: MotKind::GroundTruth, ..auto };
    assert_eq!(added(mot("1 7 11 21 30 40 0.9 1 -1\n", &as_truth).unwrap(), &["a"])[0].score, None);
    // Files that count frames from 0 are recognized by the frame 0.
    assert_eq!(mot("0,1,2,3,4,5\n1,1,2,3,4,5\n", &auto).unwrap().numbering, Numbering::From(0));
    let message = |text: &str| mot(text, &auto).unwrap_err().to_string();
    insta::assert_snapshot!(message("1,2,3\n"), @"mot.txt:1: found 3 columns; expected 6 to 10: frame, id, left, top, width, height, confidence, ...");
    insta::assert_snapshot!(message("1,2,3,4,5,x\n"), @r#"mot.txt:1: column 6 is "x"; expected a number"#);
    insta::assert_snapshot!(message("1,1,3,4,5,6\n1.5,2,3,4,5,6\n"), @"mot.txt:2: column 1 is 1.5; expected the number of a frame, a whole number");
    insta::assert_snapshot!(message("1,2,3,4,-5,6\n"), @"mot.txt:1: the box has the width -5 and the height 6; expected positive numbers");
}

#[test]
fn kitti_labels_of_both_benchmarks() {
    let file = |name: &str, text: &str| LabelFile {
        name: name.to_owned(),
        path: PathBuf::from(name),
        bytes: text.as_bytes().to_vec(),
    };
    let tracking = "90 3 Car 0 1 -1.5 10 20 30 40 1.5 1.6 4 1 2 9 0.1\n91 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n";
    let files = parse_kitti_labels(Path::new("0001.txt"), &[file("0001.txt", tracking)]).unwrap();
    assert_eq!(files.notes[1], "skipped: 1 DontCare region");
    let records = added(files, &["000090", "000091"]);
    let record = &records[0];
    assert_eq!((records.len(), &*record.frame, record.object.as_deref()), (1, "000090", Some("t3")));
    assert_eq!((record.category.as_deref(), record.occluded, record.truncated), (Some("car"), Some(1.0), Some(0.0)));
    assert_eq!(record.bounding_box, Some([10.0, 20.0, 30.0, 40.0]));
    let object = "Car 0.25 1 -1.5 10 20 30 40 1.5 1.6 4 1 2 9 0.1 0.75\n";
    let files = [file("000001.txt", object), file("000002.txt", "")];
    let records = added(parse_kitti_labels(Path::new("label_2"), &files).unwrap(), &["000001.png", "000002.png"]);
    assert_eq!((records.len(), records[0].object.as_deref(), records[0].score), (1, None, Some(0.75)));
    let message = |text: &str| parse_kitti_labels(Path::new("l"), &[file("0001.txt", text)]).unwrap_err().to_string();
    insta::assert_snapshot!(message("90 3 Car 0\n"), @"0001.txt:1: found 4 fields; expected 17 or 18 (tracking: frame, id, type, ...) or 15 or 16 (objects: type, ...)");
    insta::assert_snapshot!(message(&tracking.replace("10 20 30 40", "30 20 10 40")), @"0001.txt:1: the box [30.0, 20.0, 10.0, 40.0] is reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1");
}

#[test]
fn csv_tables_with_and_without_names() {
    let read = |text: &str, options: &TableOptions| parse_csv(Path::new("a.csv"), text.as_bytes(), options);
    let auto = TableOptions::default();
    // As the detector RRC has them on KITTI.
    let records = added(
        read("0,296.02,160.17,452.29,288.37,0.53\n2,1,2,3,4,1\n", &auto).unwrap(),
        &["000000", "000001", "000002"],
    );
    assert_eq!((&*records[0].frame, records[0].score, &*records[1].frame), ("000000", Some(0.53), "000002"));
    assert_eq!(records[0].bounding_box, Some([296.02, 160.17, 452.29, 288.37]));
    for text in [
        "image,x0,y0,x1,y1,track_id,class\na.png,1,2,4,6,7,cup\n",
        "Class,W,H,X,Y,Track_ID,Image\ncup,3,4,1,2,7.0,left/a.png\n",
        "# mine\nfilename,xmin,ymin,xmax,ymax,label,object\nx\\a.png,1,2,4,6,cup,7\n",
    ] {
        let records = added(read(text, &auto).unwrap(), &["b.png", "a.png"]);
        assert_eq!(records[0].bounding_box, Some([1.0, 2.0, 4.0, 6.0]), "{text}");
        assert_eq!((records[0].object.as_deref(), records[0].category.as_deref()), (Some("t7"), Some("cup")), "{text}");
        assert_eq!(&*records[0].frame, "a.png");
    }
    let names = parse_names(Path::new("n.txt"), b"cup\ncat\n").unwrap();
    let options = TableOptions { frame_column: Some("where"), names: Some(&names), boxes_follow: false };
    let records = added(read("x,y,width,height,class_id,where\n1,2,3,4,1,5\n", &options).unwrap(), &["4", "5"]);
    assert_eq!((&*records[0].frame, records[0].category.as_deref()), ("5", Some("cat")));
    let records = added(read("time,x0,y0,x1,y1\n12.52,1,2,3,4\n", &auto).unwrap(), &["12.5", "12.53"]);
    assert_eq!(&*records[0].frame, "12.53");
    let message = |text: &str| read(text, &auto).unwrap_err().to_string();
    insta::assert_snapshot!(message("1,2,3,4\n"), @"a.csv:1: found 4 columns without names; expected names in the first line, or 5 or 6 columns: frame, x0, y0, x1, y1, score");
    insta::assert_snapshot!(message("frame,a,b\n1,2,3\n"), @"a.csv:1: no columns contain a box (x0, y0, x1, y1, or x, y, width, height); the columns are frame, a, b");
    insta::assert_snapshot!(message("frame,x0,y0,x1,y1\n1,2,3,4,5\n1,2,x,4,5\n"), @r#"a.csv:3: the column "y0" is "x"; expected a number"#);
    insta::assert_snapshot!(message("frame,x0,y0,x1,y1\n1,2,3,4\n"), @"a.csv:2: found 4 columns; expected 5");
    insta::assert_snapshot!(message("frame,x0,y0,x1,y1\n,2,3,4,5\n"), @r#"a.csv:2: the column "frame" is empty; expected the image of the row"#);
}

#[test]
fn shapes_of_labelme() {
    let file = |text: &str| LabelFile {
        name: "a.json".to_owned(),
        path: PathBuf::from("a.json"),
        bytes: text.as_bytes().to_vec(),
    };
    let text = r#"{"version": "5.5.0", "flags": {}, "imagePath": "../images/a.png", "imageHeight": 48, "imageWidth": 64,
        "imageData": null, "shapes": [
        {"label": "cup", "points": [[30, 5], [10.5, 25]], "group_id": null, "shape_type": "rectangle"},
        {"label": "cat", "points": [[1, 2], [5, 2], [3, 9]], "group_id": 1, "shape_type": "polygon"},
        {"label": "cat", "points": [[11, 2], [15, 2], [13, 4]], "group_id": 1, "shape_type": "polygon"},
        {"label": "ball", "points": [[20, 20], [23, 24]], "group_id": null, "shape_type": "circle"},
        {"label": "cup", "points": [[1, 1]], "group_id": null, "shape_type": "point"}]}"#;
    let files = parse_labelme(Path::new("a.json"), &[file(text)]).unwrap();
    assert_eq!(files.notes, ["1 shapes of the kind point were skipped"]);
    let records = added(files, &["a.png"]);
    assert_eq!(records.len(), 3);
    assert_eq!(records[0].bounding_box, Some([10.5, 5.0, 30.0, 25.0]));
    assert_eq!(records[1].bounding_box, Some([1.0, 2.0, 15.0, 9.0]));
    assert_eq!(records[1].mask.as_ref().unwrap().polygons.as_ref().unwrap().len(), 2);
    assert_eq!(records[2].bounding_box, Some([15.0, 15.0, 25.0, 25.0]));
    assert_eq!(records[2].ellipse.as_ref().unwrap().semi_axes, [5.0, 5.0]);
    let message = |text: &str| parse_labelme(Path::new("a"), &[file(text)]).unwrap_err().to_string();
    insta::assert_snapshot!(message(r#"{"shapes": [{"label": "a", "points": [[1, 2]], "shape_type": "polygon"}]}"#), @"a.json: shapes[0].points: found 1 points; expected 3 or more of a polygon");
    insta::assert_snapshot!(message(r#"{"shapes": [{"label": "a", "points": [[1, "b\n"]]}]}"#), @r#"a.json: shapes[0].points[0][1]: found the text "b\n", expected a number"#);
    insta::assert_snapshot!(message("{}"), @r#"a.json: there is no "shapes""#);
}

#[test]
fn boxes_of_pascal_voc() {
    let file = |text: &str| LabelFile {
        name: "labels/a.xml".to_owned(),
        path: PathBuf::from("a.xml"),
        bytes: text.as_bytes().to_vec(),
    };
    let object = |name: &str, more: &str| format!("<object><name>{name}</name>{more}</object>");
    let bounds = "<bndbox><xmin>11</xmin><ymin>5.5</ymin><xmax>30</xmax><ymax>25</ymax></bndbox>";
    // As labelImg writes it.
    let text = format!(
        "<annotation verified=\"yes\">\n\t<folder>images</folder>\n\t<filename>a.png</filename><path>/home/me/a.png</path>\
         <source><database>Unknown</database></source>\
         <size><width>64</width><height>48</height><depth>3</depth></size><segmented>0</segmented>{}{}</annotation>",
        object("cup", &format!("<pose>Unspecified</pose><truncated>1</truncated><difficult>0</difficult>{bounds}")),
        object("kite", "<robndbox><cx>5</cx></robndbox>"),
    );
    let files = parse_voc(Path::new("labels"), &[file(&text)]).unwrap();
    assert_eq!(files.notes, ["1 objects without <bndbox> were skipped"]);
    let records = added(files, &["a.png"]);
    assert_eq!(records.len(), 1);
    assert_eq!(records[0].bounding_box, Some([11.0, 5.5, 30.0, 25.0]));
    assert_eq!(
        (records[0].category.as_deref(), records[0].truncated, records[0].occluded),
        (Some("cup"), Some(1.0), None)
    );
    // As the challenge writes it: a declaration, pixels from 1, parts of objects with boxes of their own.
    let part =
        "<part><name>head</name><bndbox><xmin>12</xmin><ymin>6</ymin><xmax>14</xmax><ymax>7</ymax></bndbox></part>";
    let text = format!(
        "<?xml version=\"1.0\"?>\n<annotation><source><database>The VOC2007 Database</database><annotation>PASCAL VOC2007\
         </annotation></source>{}</annotation>",
        object("person", &format!("{bounds}{part}<occluded>1</occluded>"))
    );
    let files = parse_voc(Path::new("labels"), &[file(&text)]).unwrap();
    let records = added(files, &["a.png"]);
    assert_eq!(records.len(), 1);
    assert_eq!((records[0].bounding_box, records[0].occluded), (Some([10.0, 4.5, 30.0, 25.0]), Some(1.0)));
    let message = |text: &str| parse_voc(Path::new("a"), &[file(text)]).unwrap_err().to_string();
    insta::assert_snapshot!(message("<annotations/>"), @"a.xml:1:1: the file holds <annotations>; expected <annotation>");
    insta::assert_snapshot!(message("<annotation>\n<object><bndbox/></object></annotation>"), @"a.xml:2:9: there is no <xmin> in <bndbox>");
    insta::assert_snapshot!(message(&format!("<annotation>\n<object>{bounds}</object></annotation>")), @"a.xml:2:1: there is no <name> in <object>");
    insta::assert_snapshot!(message(&format!("<annotation>{}</annotation>", object("a", &bounds.replace("11", "wide")))), @r#"a.xml:1:43: <xmin> is "wide"; expected a number"#);
    insta::assert_snapshot!(message(&format!("<annotation>{}</annotation>", object("a", &bounds.replace("11", "40")))), @"a.xml:1:35: the box [40.0, 5.5, 30.0, 25.0] is reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1");
    insta::assert_snapshot!(message("<annotation><object>"), @"a.xml:1:1: this is not valid XML: the root node was opened but never closed");
    let deep = format!("<annotation>{}{}</annotation>", "<a>".repeat(200), "</a>".repeat(200));
    insta::assert_snapshot!(message(&deep), @"a.xml:1:310: elements are nested more than 100 levels deep");
}

#[test]
fn exports_of_roboflow() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let name = |stem: &str| format!("{stem}_png.rf.0123456789abcdef0123456789abcdef");
    let (first, second) = (name("a-1"), name("a-2"));
    let check = |files: DetectionFiles| {
        let records = added(files, &["images/a-1.png", "images/a-2.png"]);
        let found: Vec<_> =
            records.iter().map(|record| (&*record.frame, record.category.as_deref(), record.bounding_box)).collect();
        let edges = Some([16.0, 12.0, 32.0, 36.0]);
        assert_eq!(found, [("images/a-1.png", Some("cup"), edges), ("images/a-2.png", Some("cup"), edges)]);
    };
    // YOLO: texts about the data set beside the folders, names of classes in YAML.
    for (file, text) in [
        ("README.dataset.txt", "# cups > 2026-01-01\nhttps://universe.roboflow.com/me/cups\n\nLicense: CC BY 4.0\n"),
        ("README.roboflow.txt", "\ncups - v1\n=====\n\nThe dataset includes 2 images.\n"),
        ("data.yaml", "train: ../train/images\nnc: 1\nnames: ['cup']\n\nroboflow:\n  workspace: me\n  version: 1\n"),
        (&format!("train/labels/{first}.txt"), "0 0.375 0.5 0.25 0.5\n"),
        (&format!("valid/labels/{second}.txt"), "0 0.375 0.5 0.25 0.5"),
    ] {
        make(&format!("yolo/{file}"), text);
    }
    check(read_yolo(&folder.path().join("yolo"), &YoloOptions::default()).unwrap());
    // COCO: a file for each part of the data set, ids from 0 in each, the category 0 is above the others.
    let coco = |image: &str| {
        format!(
            r#"{{"info": {{"description": "Exported from roboflow.com"}}, "categories": [
            {{"id": 0, "name": "cups", "supercategory": "none"}}, {{"id": 1, "name": "cup", "supercategory": "cups"}}],
            "images": [{{"id": 0, "license": 1, "file_name": "{image}.jpg", "height": 48, "width": 64,
            "extra": {{"name": "a.png"}}}}],
            "annotations": [{{"id": 0, "image_id": 0, "category_id": 1, "bbox": [16, 12, 16, 24], "area": 384,
            "segmentation": [], "iscrowd": 0}}]}}"#
        )
    };
    make("coco/README.dataset.txt", "# cups\n");
    make("coco/train/_annotations.coco.json", &coco(&first));
    make("coco/valid/_annotations.coco.json", &coco(&second));
    check(read_coco(&folder.path().join("coco"), None).unwrap());
    let empty = folder.path().join("yolo");
    assert!(read_coco(&empty, None).unwrap_err().problem.starts_with("there is no _annotations.coco.json"));
    // Pascal VOC.
    for image in [&first, &second] {
        let text = format!(
            "<annotation><folder></folder><filename>{image}.jpg</filename><path>{image}.jpg</path><source><database>\
             roboflow.com</database></source><size><width>64</width><height>48</height><depth>3</depth></size><object>\
             <name>cup</name><bndbox><xmin>16</xmin><xmax>32</xmax><ymin>12</ymin><ymax>36</ymax></bndbox></object>\
             </annotation>"
        );
        make(&format!("voc/train/{image}.xml"), &text);
    }
    check((voc::FORMAT.read)(&folder.path().join("voc"), &ReadOptions::default()).unwrap());
    // TensorFlow's table.
    let rows = [&first, &second].map(|image| format!("{image}.jpg,64,48,cup,16,12,32,36\n")).concat();
    make("_annotations.csv", &format!("filename,width,height,class,xmin,ymin,xmax,ymax\n{rows}"));
    let table = std::fs::read(folder.path().join("_annotations.csv")).unwrap();
    check(parse_csv(Path::new("_annotations.csv"), &table, &TableOptions::default()).unwrap());
}

/// A category that the list of categories lacks is told, with the number of its annotations.
#[test]
fn categories_without_a_name_are_counted() {
    let annotation = |category: u32| format!(r#"{{"image_id": 1, "category_id": {category}, "bbox": [1, 2, 3, 4]}}"#);
    let annotations = [7, 1, 7].map(annotation).join(", ");
    let text = format!(
        r#"{{"images": [{{"id": 1, "file_name": "a.png"}}], "categories": [{{"id": 1, "name": "cup"}}], "annotations": [{annotations}]}}"#
    );
    let found = parse_coco((Path::new("a.json"), text.as_bytes()), None).unwrap();
    assert_eq!(found.notes, ["2 annotations of the category 7, which the file does not list: its number is the name"]);
}

#[test]
fn what_is_wrong_with_coco_files_is_named() {
    let message = |text: &str| parse_coco((Path::new("a.json"), text.as_bytes()), None).unwrap_err().to_string();
    let images = r#""images": [{"id": 1, "file_name": "a.png", "width": 64, "height": 48}]"#;
    let annotated = |fields: &str| format!("{{{images}, \"annotations\": [{{{fields}}}]}}");
    insta::assert_snapshot!(message("{}"), @r#"a.json: there is no "images""#);
    insta::assert_snapshot!(message(&annotated(r#""image_id": 7, "bbox": [1, 2, 3, 4]"#)), @"a.json: annotations[0].image_id: there is no image with the id 7 among the images of the data set");
    insta::assert_snapshot!(message(&annotated(r#""image_id": 1, "bbox": [1, 2, 3]"#)), @"a.json: annotations[0].bbox: found a list of 3, expected a list of 4 numbers");
    insta::assert_snapshot!(message(&annotated(r#""image_id": 1"#)), @r#"a.json: annotations[0]: there is neither a "bbox" nor a "segmentation""#);
    insta::assert_snapshot!(message(&annotated(r#""image_id": 1, "segmentation": [[1, 2, 3]]"#)), @"a.json: annotations[0].segmentation: polygon 0 has 3 numbers; expected an even number [x, y, x, y, ...]");
    insta::assert_snapshot!(message(&annotated(r#""image_id": 1, "segmentation": {"size": [4, 4], "counts": [3, 4]}"#)), @"a.json: annotations[0].segmentation: the runs cover 7 pixels; the size [4, 4] has 16");
    insta::assert_snapshot!(message(&annotated(r#""image_id": 1, "segmentation": {"size": [4], "counts": [3, 4]}"#)), @"a.json: annotations[0].segmentation.size: found 1 entry, expected a list of 2 whole numbers");
    insta::assert_snapshot!(message(&annotated(r#""image_id": 1, "segmentation": {"size": [4, 4], "counts": [16]}"#)), @"a.json: annotations[0].segmentation: the mask has 4 x 4 pixels, its image has 64 x 48");
}

#[test]
fn adding_keeps_what_is_there_and_tells_what_is_left_out() {
    let files = || {
        parse_csv(Path::new("a.csv"), b"image,x0,y0,x1,y1,score,track\na.png,1,2,3,4,0.9,1\nb.png,1,2,3,4,0.2,1\nc.png,1,2,3,4,0.9,1\na.png,1,2,1,4,0.9,2\n", &TableOptions::default()).unwrap()
    };
    let mut scene = scene(&["a.png", "b.png", "d.png"]);
    scene.detections.push(DetectionRecord {
        frame: "a.png".into(),
        source: Some("old".into()),
        bounding_box: Some([0.0, 0.0, 9.0, 9.0]),
        ..DetectionRecord::default()
    });
    let options = AddOptions { source: "new", min_score: Some(0.5), ..AddOptions::default() };
    let report = add_detections(&mut scene, files(), &options).unwrap();
    assert_eq!(
        report,
        AddedDetections {
            added: 1,
            with_object: 1,
            matched_by: MatchBy::Name,
            frame_offset: 0,
            matched_images: 2,
            images_without_frame: vec!["c.png".to_owned()],
            frames_without_image: vec!["d.png".to_owned()],
            in_no_frame: 1,
            low_score: 1,
            empty: 1,
            removed: 0,
            notes: vec![],
        }
    );
    let sources: Vec<_> = scene.detections.iter().map(|d| d.source.as_deref().unwrap()).collect();
    assert_eq!(sources, ["old", "new"]);
    let error = add_detections(&mut scene, files(), &options).unwrap_err();
    insta::assert_snapshot!(error, @r#"a.csv: the scene already has detections of the source "new"; choose another name (--source SOURCE) or replace all (--replace)"#);
    let report = add_detections(&mut scene, files(), &AddOptions { replace: true, ..options.clone() }).unwrap();
    assert_eq!((report.removed, scene.detections.len()), (2, 1));
    // Integer pixel centers move everything by half a pixel.
    let shifted = AddOptions { replace: true, pixel_centers: crate::read::PixelCenters::Integer, ..options.clone() };
    add_detections(&mut scene, files(), &shifted).unwrap();
    assert_eq!(scene.detections[0].bounding_box, Some([1.5, 2.5, 3.5, 4.5]));
    let twice = b"image,x0,y0,x1,y1,track\na.png,1,2,3,4,1\na.png,2,2,3,4,1\n";
    let twice = parse_csv(Path::new("a.csv"), twice, &TableOptions::default()).unwrap();
    let options = AddOptions { source: "twice", ..options };
    let error = add_detections(&mut scene, twice, &options).unwrap_err();
    insta::assert_snapshot!(error, @"a.csv: the track 1 has two detections in the image a.png");
    let other = read_coco(&fixture("instances.json"), None).unwrap();
    let error = add_detections(&mut scene, other.clone(), &options).unwrap_err();
    insta::assert_snapshot!(error.problem, @r#"no image of the detections matches a frame of the scene: the detections have the images "left/0001.png", "left/0002.png", "left/0003.png", the scene has the frames "a.png", "b.png", "d.png"; --match index compares the numbers in the names"#);
    scene.frames[0].id = "0001.png".to_owned();
    scene.cameras[0].width = Some(128.0);
    let error = add_detections(&mut scene, other.clone(), &options).unwrap_err();
    insta::assert_snapshot!(error.problem, @r#"the image left/0001.png has 64 x 48 pixels, the camera of frame "0001.png" has 128 x 48; the detections must come from images of the camera's size (--assume image_size=64x48 scales them)"#);
    // Told so, they are scaled: here the camera's images are twice as wide.
    let scaled = AddOptions { image_size: Some([64.0, 48.0]), replace: true, ..options };
    scene.cameras[0].width = Some(64.0);
    add_detections(&mut scene, other.clone(), &scaled).unwrap();
    let small: Vec<[f64; 4]> = scene.detections.iter().map(|d| d.bounding_box.unwrap()).collect();
    scene.cameras[0].width = Some(128.0);
    let report = add_detections(&mut scene, other, &scaled).unwrap();
    assert!(report.notes.iter().any(|note| note.contains("scaled from 64 x 48 pixels")), "{report:?}");
    assert!(!small.is_empty());
    for (found, [x0, y0, x1, y1]) in scene.detections.iter().zip(small) {
        assert_eq!(found.bounding_box, Some([2.0 * x0, y0, 2.0 * x1, y1]));
    }
}

#[test]
fn detections_that_are_matched_by_name_may_be_moved_to_other_frames() {
    let mut scene = scene(&["a.png", "b.png", "d.png"]);
    let table = b"image,x0,y0,x1,y1\na.png,1,2,3,4\nb.png,5,6,7,8\n";
    let files = parse_csv(Path::new("a.csv"), table, &TableOptions::default()).unwrap();
    let options = AddOptions { frame_offset: Some(-1), ..AddOptions::default() };
    let report = add_detections(&mut scene, files, &options).unwrap();
    let frames: Vec<&str> = scene.detections.iter().map(|d| &*d.frame).collect();
    assert_eq!((frames, report.frame_offset), (vec!["b.png", "d.png"], -1));
}

#[test]
fn tables_in_json_may_have_many_columns() {
    let many: String = (0..5000).map(|k| format!("\"c{k}\": 1, ")).collect();
    let row = "\"x_min\": 1, \"y_min\": 2, \"x_max\": 3, \"y_max\": 4, \"frame_number\": 0";
    let text = format!("[{{{many}{row}}}, {{{row}}}, {{{many}{row}}}]");
    let files = parse_csv(Path::new("a.json"), text.as_bytes(), &TableOptions::default()).unwrap();
    assert_eq!(files.images.iter().map(|image| image.detections.len()).sum::<usize>(), 3);
    // Of those that are not read only the first are kept: each is looked up in every row.
    let path = Path::new("a.json");
    let value = parse_json(path, text.as_bytes()).unwrap();
    let table = table_of(path, &Node::root(path, &value), &TableOptions::default()).unwrap();
    assert_eq!(table.columns.len(), 20 + 5);
    assert!(table.rows.iter().all(|row| row.cells.len() <= 25));
    // Other names are as they were, also with blanks and capitals.
    let text = text.replace("x_min", " X_Min ");
    assert!(parse_csv(Path::new("a.json"), text.as_bytes(), &TableOptions::default()).is_ok());
}

#[test]
fn a_category_has_one_name() {
    let text = r#"{"images": [{"id": 1, "file_name": "a.png"}], "annotations": [{"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]}],
        "categories": [{"id": 1, "name": "cup"}, {"id": 1, "name": "plate"}]}"#;
    let read = |text: &str| parse_coco((Path::new("a.json"), text.as_bytes()), None).map(drop);
    let error = read(text).unwrap_err().to_string();
    assert_eq!(error, "a.json: categories[1].id: two categories have this id: \"cup\" and \"plate\"");
    assert_eq!(read(&text.replace("plate", "cup")), Ok(()));
}
