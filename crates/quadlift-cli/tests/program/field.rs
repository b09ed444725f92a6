//! Files as people have them, made after public reports of users of other tools (`tests/fixtures/field`), through the built
//! program: each is read rightly, or refused with a sentence that says what it is.

use std::path::Path;

use serde_json::{Value, json};

use crate::common::{Folder, Run};

/// A folder with the files of a report.
fn files_of(name: &str) -> Folder {
    let folder = Folder::new();
    folder.copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/field").join(name));
    folder
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn distance(a: &Value, b: &Value) -> f64 {
    numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Localizes, and checks that each true object is found within a distance, and no other.
fn localized(folder: &Folder, arguments: &str, truth: &str, most: f64) -> (Run, Value) {
    let run = folder.run(&format!("localize {arguments} -o found.json"));
    assert_eq!(run.code, 0, "{arguments}\n{}{}", run.stdout, run.stderr);
    let found = folder.json("found.json");
    let (objects, truth) = (found["objects"].as_array().unwrap().clone(), folder.json(truth));
    let truth = truth.get("objects").unwrap_or(&truth).as_array().unwrap().clone();
    assert_eq!(objects.len(), truth.len(), "{arguments}");
    for object in &objects {
        assert_eq!(object["status"], "ok", "{arguments}: {object}");
        let nearest = truth.iter().map(|one| distance(&one["center"], &object["center"])).fold(f64::INFINITY, f64::min);
        assert!(nearest < most, "{arguments}: {} is {nearest} away", object["id"]);
    }
    (run, found)
}

/// The message of a command that fails.
fn refused(folder: &Folder, arguments: &str) -> String {
    let run = folder.run(arguments);
    assert_eq!(run.code, 1, "{arguments}\n{}{}", run.stdout, run.stderr);
    run.stderr
}

#[test]
fn archives_are_named() {
    let folder = files_of("archives");
    folder.write("boxes.csv.gz", b"\x1f\x8b\x08\x00\x00\x00\x00\x00");
    for arguments in [
        "localize --cameras capture.r3d --detections boxes.csv",
        "localize --cameras polycam.zip --detections boxes.csv",
        "localize polycam.zip",
        "import arkit polycam.zip -o scene.json",
    ] {
        let text = refused(&folder, arguments);
        assert!(text.contains("this is a zip archive; unpack it and give its folder"), "{arguments}: {text}");
    }
    folder.write_json("cameras.json", &json!({"format": "quadlift.scene", "version": 1, "cameras": [], "frames": []}));
    for (file, kind) in [("cvat_export.zip", "zip"), ("boxes.csv.gz", "gzip")] {
        let text = refused(&folder, &format!("localize --cameras cameras.json --detections {file}"));
        assert!(text.contains(&format!("{file}: this is a {kind} archive; unpack it")), "{text}");
    }
}

#[test]
fn programs_whose_files_are_not_read_are_named() {
    let folder = files_of("realitycapture-csv");
    for (file, program) in [
        ("with_tangential.csv", "RealityCapture"),
        ("zero_tangential.csv", "RealityCapture"),
        ("sfm_data.json", "OpenMVG"),
        ("cameras.sfm", "Meshroom"),
    ] {
        let text = refused(&folder, &format!("localize --cameras {file} --detections boxes.csv"));
        assert!(text.contains(&format!("{file}: this is a file of {program}, which is not read; ")), "{text}");
        assert!(refused(&folder, &format!("localize {file}")).contains(program));
    }
    // A given format does not guess either.
    let text = refused(&folder, "import projections with_tangential.csv -o scene.json");
    assert!(text.contains("there is no column \"p11\"; expected p11 to p34"), "{text}");
}

#[test]
fn matrices_without_a_name_are_no_projections() {
    let folder = files_of("poses-without-intrinsics");
    let text = refused(&folder, "localize --cameras synthetic_w2c.json --detections labels --image-size 1280x960");
    assert!(text.contains("if they are poses [R | t], the intrinsics are missing"), "{text}");
    let text = refused(&folder, "import projections synthetic_w2c.json -o scene.json");
    assert!(text.contains("there is no \"frames\""), "{text}");
}

#[test]
fn polycams_sizes_are_found_elsewhere() {
    let folder = files_of("polycam-without-size");
    localized(&folder, "--cameras . --detections boxes.csv", "truth.json", 1e-3);
    assert_eq!(folder.json("found.json")["cameras"][0]["width"], 1024.0);
    std::fs::remove_dir_all(folder.path("keyframes/cameras")).unwrap();
    localized(&folder, "--cameras . --detections boxes.csv --image-size 1024x768", "truth.json", 1e-3);
    assert_eq!(folder.json("found.json")["cameras"][0]["height"], 768.0);
}

#[test]
fn poses_relative_to_the_first_image_have_no_up() {
    let folder = files_of("record3d-first-pose");
    for pitch in ["pitch_25", "pitch_39"] {
        let arguments = format!("--cameras {pitch} --detections {pitch}/boxes.csv");
        let (run, found) = localized(&folder, &arguments, &format!("{pitch}/truth.json"), 1e-3);
        assert_eq!(found.get("up"), None);
        assert!(run.stdout.contains("its direction against gravity is unknown"), "{}", run.stdout);
    }
    let text = refused(&folder, "localize --cameras no_poses --detections no_poses/boxes.csv");
    assert!(text.contains("all poses are the same"), "{text}");
}

#[test]
fn stamps_and_types_of_logs_are_named() {
    let folder = files_of("mcap-times-and-types");
    localized(&folder, "outer_zero.mcap", "truth.json", 2e-3);
    assert!(refused(&folder, "localize zero.mcap").contains("the stamps of its messages are not set"));
    let run = folder.run("localize yolo_msgs.mcap");
    assert_eq!(run.code, 1);
    let note = "/detections is not read: its type is yolo_msgs/msg/DetectionArray";
    assert!(run.stdout.contains(note), "{}{}", run.stdout, run.stderr);
}

#[test]
fn masks_that_do_not_meet_their_boxes_are_left_out() {
    let folder = files_of("mask-beside-its-box");
    for (file, reason) in [
        ("row_major.json", "its runs go along the rows of the image, not its columns"),
        ("of_another_object.json", "masks and boxes are in different orders"),
    ] {
        let (run, _) = localized(&folder, &format!("{file} --measurement mask"), "truth.json", 1e-3);
        assert!(run.stderr.contains("of 60 masks do not meet the boxes of their detections"), "{}", run.stderr);
        assert!(run.stderr.contains(reason), "{}", run.stderr);
        let run = folder.run(&format!("segment {file} --method masks -o segmented.json"));
        assert_ne!(run.code, 0, "{}", run.stdout);
        assert!(run.stderr.contains(&format!("the mask does not meet its box: {reason}")) || file.starts_with("of"));
        assert!(run.stderr.contains("the mask does not meet its box"), "{}", run.stderr);
    }
    let text = refused(&folder, "localize --cameras cameras.json --detections coco_row_major_without_bbox.json");
    assert!(text.contains("the runs of 60 of 60 masks go along the rows of the image"), "{text}");
}

#[test]
fn a_world_on_earth_is_placed_or_refused() {
    let folder = files_of("geojson-of-a-utm-world");
    // By other series and geodesy.
    let truth = [16.370_229, 48.199_714, 170.1];
    for (file, crs, truth) in [("utm33", "EPSG:32633", truth), ("ecef", "EPSG:4978", [16.369_996, 48.200_001, 170.1])] {
        let run = folder.run(&format!("localize {file}.json -o objects.json"));
        assert_eq!((run.code, run.stderr.as_str()), (0, ""));
        let text = refused(&folder, "export geojson objects.json -o no.geojson --origin 48.2,16.37,170");
        assert!(text.contains("km away from the origin") && text.contains("--crs"), "{text}");
        folder.succeed(&format!("export geojson objects.json -o objects.geojson --crs {crs}"));
        let found = folder.json("objects.geojson");
        let found = numbers(&found["features"][0]["geometry"]["coordinates"]);
        for (k, most) in [1e-6, 1e-6, 0.05].into_iter().enumerate() {
            assert!((found[k] - truth[k]).abs() < most, "{file}: {found:?}");
        }
    }
    // The unit may be given for a result that lacks it.
    let mut objects = folder.json("objects.json");
    objects.as_object_mut().unwrap().remove("length_unit");
    folder.write_json("objects.json", &objects);
    assert!(refused(&folder, "export geojson objects.json -o no.geojson --crs EPSG:4978").contains("length_unit"));
    folder.succeed("export geojson objects.json -o again.geojson --crs EPSG:4978 --length-unit m");
    assert_eq!(folder.json("again.geojson"), folder.json("objects.geojson"));
}

#[test]
fn people_of_a_rig_have_many_names() {
    let folder = files_of("rig-category-in-capitals");
    let hall = folder.json("hall.json");
    let named = |name: &str| {
        let mut hall = hall.clone();
        for detection in hall["detections"].as_array_mut().unwrap() {
            detection["category"] = name.into();
        }
        folder.write_json("named.json", &hall);
        folder.run("calibrate-rig named.json -o rig.json")
    };
    for name in ["Person", "PERSON", "Pedestrian", "people", "human"] {
        let run = named(name);
        assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{name}: {}", run.stdout);
        assert!(run.stdout.contains("calibrated 4 of 4 cameras"), "{name}: {}", run.stdout);
    }
    // A number tells nothing, and no camera is blamed for it.
    let run = named("0");
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(run.stderr.contains("no prior for: 0"), "{}", run.stderr);
    assert!(!run.stderr.contains("inconsistent"), "{}", run.stderr);
}

#[test]
fn a_late_camera_and_two_cameras_alone_are_named() {
    let folder = files_of("rig-category-in-capitals");
    let hall = folder.json("hall.json");
    let step = 0.5;
    for (camera, steps, words) in [("cam1", 3, "3 time steps late"), ("cam3", -2, "2 time steps early")] {
        let mut late = hall.clone();
        for frame in late["frames"].as_array_mut().unwrap().iter_mut().filter(|frame| frame["camera"] == camera) {
            frame["time"] = (frame["time"].as_f64().unwrap() + step * f64::from(steps)).into();
        }
        folder.write_json("late.json", &late);
        let run = folder.run("calibrate-rig late.json -o rig.json");
        assert_eq!(run.code, 3, "{}", run.stdout);
        assert!(
            run.stderr.contains(&format!("camera {camera}: it is {words} against the other cameras")),
            "{}",
            run.stderr
        );
    }
    let mut two = hall.clone();
    let is_kept = |id: &Value| ["cam0", "cam1"].contains(&id.as_str().unwrap().split('/').next().unwrap());
    two["frames"].as_array_mut().unwrap().retain(|frame| is_kept(&frame["id"]));
    two["detections"].as_array_mut().unwrap().retain(|detection| is_kept(&detection["frame"]));
    two["cameras"].as_array_mut().unwrap().retain(|camera| is_kept(&camera["id"]));
    folder.write_json("two.json", &two);
    let run = folder.run("calibrate-rig two.json -o rig.json");
    assert_eq!(run.code, 1, "{}", run.stdout);
    assert!(run.stderr.contains("two cameras alone"), "{}{}", run.stdout, run.stderr);
    assert!(folder.succeed("calibrate-rig two.json -o rig.json --baseline cam0,cam1,8").contains("calibrated 2 of 2"));
}

#[test]
fn a_stream_that_fails_ends_with_a_line() {
    let folder = files_of("stream-json-error");
    let run = folder.run("stream --json frames.jsonl");
    assert_eq!(run.code, 1);
    let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.last().unwrap()["error"].as_str().unwrap().starts_with("no frame could be read"));
}

/// Writes a synthetic scene, its cameras alone, and its boxes as a table, changed by a function of their edges.
fn table_of_boxes(folder: &Folder, change: impl Fn([f64; 4]) -> [f64; 4]) {
    folder.succeed("synth -q -o scene.json --objects 4 --views 12 --noise box:0.02 --seed 5");
    let scene = folder.json("scene.json");
    let mut cameras = scene.clone();
    cameras["detections"] = json!([]);
    cameras.as_object_mut().unwrap().remove("objects");
    folder.write_json("cameras.json", &cameras);
    let row = |detection: &Value| {
        let [a, b, c, d] = change(numbers(&detection["box"]).try_into().unwrap());
        let text = |key: &str| detection[key].as_str().unwrap_or("").to_owned();
        format!("{},{a},{b},{c},{d},{},{}\n", text("frame"), text("category"), text("object"))
    };
    let rows: String = scene["detections"].as_array().unwrap().iter().map(row).collect();
    folder.write("boxes.csv", format!("frame_name,x0,y0,x1,y1,category,track_id\n{rows}"));
}

#[test]
fn reversed_boxes_are_refused_after_their_format_is_known() {
    let folder = Folder::new();
    table_of_boxes(&folder, |[x0, y0, x1, y1]| [x0, y0, x1 - x0, y1 - y0]);
    let arguments = "localize --cameras cameras.json --detections boxes.csv";
    let text = refused(&folder, arguments);
    assert!(text.contains("is reversed; expected [x0, y0, x1, y1]"), "{text}");
    let text = folder.succeed(&format!("{arguments} --assume boxes=xywh"));
    assert!(text.contains("4 of 4 objects localized"), "{text}");
    // What is reversed after that is refused.
    table_of_boxes(&folder, |[x0, y0, x1, y1]| [x1, y0, x0 - x1, y1 - y0]);
    let text = refused(&folder, &format!("{arguments} --assume boxes=xywh"));
    assert!(text.contains("is empty or reversed"), "{text}");
}

#[test]
fn labels_of_yolo_say_what_is_wrong_with_them() {
    let folder = Folder::new();
    table_of_boxes(&folder, |edges| edges);
    let scene = folder.json("scene.json");
    let (width, height) =
        (scene["cameras"][0]["width"].as_f64().unwrap(), scene["cameras"][0]["height"].as_f64().unwrap());
    let write = |[across, down]: [f64; 2]| {
        for frame in scene["frames"].as_array().unwrap() {
            let mut lines = String::new();
            for detection in scene["detections"].as_array().unwrap().iter().filter(|d| d["frame"] == frame["id"]) {
                let [x0, y0, x1, y1]: [f64; 4] = numbers(&detection["box"]).try_into().unwrap();
                let class = detection["object"].as_str().unwrap().len() % 2 + 1;
                let row = [(x0 + x1) / 2.0 / across, (y0 + y1) / 2.0 / down, (x1 - x0) / across, (y1 - y0) / down];
                lines += &format!("{class} {} {} {} {}\n", row[0], row[1], row[2], row[3]);
            }
            folder.write(&format!("labels/{}.txt", frame["id"].as_str().unwrap()), lines);
        }
    };
    let arguments = "localize --cameras cameras.json --detections labels";
    write([1.0, 1.0]);
    let text = refused(&folder, arguments);
    assert!(text.contains("expected a fraction of image width or height, from 0 to 1"), "{text}");
    write([width, height]);
    folder.write("labels/classes.txt", "cup\n");
    let run = folder.run(arguments);
    assert!(run.stdout.contains("which the class names lack: its number is the name"), "{}{}", run.stdout, run.stderr);
}

#[test]
fn boxes_outside_of_the_image_are_named_by_both_commands() {
    let folder = files_of("camera-size-halved");
    let mut scene = folder.json("half.json");
    for camera in scene["cameras"].as_array_mut().unwrap() {
        (camera["width"], camera["height"]) = (720.into(), 1280.into());
    }
    folder.write_json("swapped.json", &scene);
    for (file, hint) in
        [("half.json", "is the size of the cameras' images right?"), ("swapped.json", "are width and height swapped?")]
    {
        for command in ["info", "localize"] {
            let run = folder.run(&format!("{command} {file}"));
            let text = run.stdout + &run.stderr;
            let line = text.lines().find(|line| line.contains("entirely outside the image"));
            assert!(line.is_some_and(|line| line.contains(hint)), "{command} {file}: {text}");
        }
    }
}

#[test]
fn fractions_of_a_distorted_image_are_named() {
    let folder = Folder::new();
    table_of_boxes(&folder, |edges| edges);
    let mut scene = folder.json("scene.json");
    let camera = &mut scene["cameras"][0];
    camera["model"] = "OPENCV".into();
    camera["params"].as_array_mut().unwrap().extend([-0.2, 0.05, 0.0, 0.0].map(Value::from));
    let [width, height] = ["width", "height"].map(|side| scene["cameras"][0][side].as_f64().unwrap());
    for detection in scene["detections"].as_array_mut().unwrap() {
        let edges = numbers(&detection["box"]);
        detection["box"] = json!([edges[0] / width, edges[1] / height, edges[2] / width, edges[3] / height]);
    }
    folder.write_json("fractions.json", &scene);
    let run = folder.run("localize fractions.json");
    assert_eq!(run.code, 3, "{}", run.stdout);
    assert!(run.stderr.contains("are they fractions of the image (--assume box_scale=normalized)?"), "{}", run.stderr);
    folder
        .run("localize fractions.json --assume box_scale=normalized")
        .stderr
        .contains("fractions")
        .then(|| panic!("again"));
}

#[test]
fn photographs_of_another_size_than_the_camera_are_named() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 8);
    let mut scene = folder.json("scene.json");
    for camera in scene["cameras"].as_array_mut().unwrap() {
        for side in ["width", "height"] {
            camera[side] = (2.0 * camera[side].as_f64().unwrap()).into();
        }
        camera["params"] = numbers(&camera["params"]).iter().map(|x| 2.0 * x).collect::<Vec<f64>>().into();
    }
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["box"] = numbers(&detection["box"]).iter().map(|x| 2.0 * x).collect::<Vec<f64>>().into();
        detection.as_object_mut().unwrap().remove("mask");
    }
    folder.write_json("scene.json", &scene);
    let run = folder.run("localize scene.json --report scene.html");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("warning: scene.html: 8 of 8 images could not be read"), "{}", run.stderr);
    assert!(run.stderr.contains("the image has 240 x 180 pixels; the camera of frame"), "{}", run.stderr);
}
