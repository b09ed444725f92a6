//! Pictures of frames: of one, and of every frame.

use serde_json::{Value, json};

use crate::common::Folder;

#[test]
fn pictures_have_the_size_of_the_frame_and_show_what_is_asked_for() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    folder.succeed("localize scene.json -o objects.json -q");
    for name in ["frame.png", "frame.svg"] {
        folder.succeed(&format!("render scene.json objects.json --frame 000001 -o {name} --labels"));
    }
    let drawn = quadlift_io::read_image(&folder.path("frame.png")).unwrap();
    let plain = quadlift_io::read_image(&folder.path("images/000001.png")).unwrap();
    assert_eq!(drawn.dimensions(), plain.dimensions());
    let changed = drawn.pixels().zip(plain.pixels()).filter(|(a, b)| a != b).count();
    let pixels = plain.pixels().len();
    assert!(changed > pixels / 50 && changed < pixels * 9 / 10, "{changed} of {pixels}");
    let svg = folder.read("frame.svg");
    assert!(svg.contains("width=\"240\" height=\"180\"") && svg.contains("data:image/png;base64,"), "{svg:.300}");
    assert_eq!(svg.matches("<text ").count(), 2, "two objects have labels");
    // Bodies, truth and boxes.
    assert!(svg.matches("<polygon ").count() >= 2 && svg.matches("<polyline ").count() >= 8);
    // Without an image the sheet is blank.
    folder.succeed("synth -o blank.json --objects 2 --views 4");
    folder.succeed("render blank.json --frame 000003 -o blank.png");
    assert_eq!(quadlift_io::read_image(&folder.path("blank.png")).unwrap().dimensions(), (1280, 960));
}

#[test]
fn a_picture_has_the_detections_of_the_source_that_is_asked_for() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    let detections = scene["detections"].as_array_mut().unwrap();
    for detection in detections.iter_mut() {
        detection["source"] = "yolo".into();
    }
    let mut other = detections[0].clone();
    other["source"] = "label".into();
    detections.push(other);
    folder.write_json("scene.json", &scene);
    let lines = |options: &str| {
        folder.succeed(&format!("render scene.json --frame 000000 -o frame.svg --labels {options}"));
        folder.read("frame.svg").matches("<text").count()
    };
    assert_eq!((lines(""), lines("--source yolo"), lines("--source label")), (3, 2, 1));
    let run = folder.run("render scene.json --frame 000000 -o frame.svg --source coco");
    assert!(run.code == 2 && run.stderr.contains("\"coco\"; there are"), "{}", run.stderr);
}

/// The text of each label of an SVG picture, and its sheet: x0, y0, x1, y1.
fn labels(svg: &str) -> Vec<(String, [f64; 4])> {
    let lines: Vec<&str> = svg.lines().collect();
    let is_text = |k: &usize| lines[*k].starts_with("<text ");
    let label = |k: usize| {
        let text = lines[k].split(['>', '<']).nth(2).unwrap().to_owned();
        // The sheet comes two lines before, then the bar in the color of the object.
        let points = lines[k - 2].split('"').nth(1).unwrap();
        let numbers: Vec<f64> = points.split([' ', ',']).map(|x| x.parse().unwrap()).collect();
        (text, [numbers[0], numbers[1], numbers[4], numbers[5]])
    };
    (0..lines.len()).filter(is_text).map(label).collect()
}

#[test]
fn every_frame_gets_a_picture() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 4);
    folder.succeed("localize scene.json -o objects.json -q");
    let mut scene = folder.json("scene.json");
    // A frame without an image, one whose image is none, and ids that give one name.
    scene["frames"][1].as_object_mut().unwrap().remove("image");
    folder.write("images/000002.png", "a cup on a table");
    for (k, id) in [(0, "left/1"), (3, "left_1")] {
        let before = scene["frames"][k]["id"].clone();
        scene["frames"][k]["id"] = id.into();
        for detection in scene["detections"].as_array_mut().unwrap() {
            if detection["frame"] == before {
                detection["frame"] = id.into();
            }
        }
    }
    scene.as_object_mut().unwrap().remove("objects");
    folder.write_json("changed.json", &scene);
    let text = folder.succeed("render changed.json objects.json --all -o new/pictures --labels");
    let expected = "wrote 4 pictures to new/pictures\n- 1 frame without an image: blank\n- 1 of 3 images could not be read, blank: ";
    assert!(text.starts_with(expected), "{text}");
    let names = ["left_1", "000001", "000002", "left_1_2"];
    let mut found: Vec<_> =
        std::fs::read_dir(folder.path("new/pictures")).unwrap().map(|e| e.unwrap().file_name()).collect();
    found.sort();
    assert_eq!(found, ["000001.png", "000002.png", "left_1.png", "left_1_2.png"], "nothing else");
    let picture = |name: &str| quadlift_io::read_image(&folder.path(&format!("new/pictures/{name}.png"))).unwrap();
    for name in names {
        assert_eq!(picture(name).dimensions(), (240, 180));
    }
    // A corner shows the image or the blank sheet.
    assert_ne!(picture("left_1").get_pixel(0, 179).0, [0xf2, 0xf3, 0xf5]);
    assert_eq!(picture("000001").get_pixel(0, 179).0, [0xf2, 0xf3, 0xf5]);
    // The same pictures as those of single frames; and others into the same folder.
    folder.succeed("render changed.json objects.json --frame left_1 -o one.png --labels");
    assert_eq!(
        std::fs::read(folder.path("one.png")).unwrap(),
        std::fs::read(folder.path("new/pictures/left_1_2.png")).unwrap()
    );
    let document: Value =
        serde_json::from_str(&folder.succeed("render changed.json objects.json --all --svg -o new/pictures --json"))
            .unwrap();
    assert_eq!(
        document["pictures"][3],
        json!({ "frame": "left_1", "output": "new/pictures/left_1_2.svg", "image": true })
    );
    assert_eq!((&document["pictures"][1]["image"], document["notes"].as_array().unwrap().len()), (&json!(false), 2));
    assert!(folder.read("new/pictures/left_1_2.svg").contains("data:image/png;base64,"));
}

#[test]
fn images_are_not_overwritten_by_their_pictures() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let before = std::fs::read(folder.path("images/000001.png")).unwrap();
    // Not even a picture that would take no image's place is written.
    let mut scene = folder.json("scene.json");
    scene["frames"][0]["id"] = "first".into();
    scene["detections"].as_array_mut().unwrap().drain(..2);
    folder.write_json("scene.json", &scene);
    let run = folder.run("render scene.json --all -o images");
    assert!(run.code == 1 && run.stderr.contains("is an image or mask of a scene"), "{}", run.stderr);
    assert_eq!(std::fs::read(folder.path("images/000001.png")).unwrap(), before);
    assert!(!folder.path("images/first.png").exists());
}

#[test]
fn bodies_that_were_not_detected_are_thin_and_labels_do_not_cover_each_other() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 20 --views 8 --noise box:0.02 --seed 2");
    folder.succeed("localize scene.json -o objects.json -q");
    let mut scene = folder.json("scene.json");
    scene.as_object_mut().unwrap().remove("objects");
    let frame = scene["frames"][3]["id"].clone();
    let detections = scene["detections"].as_array_mut().unwrap();
    let missing = detections.iter().find(|d| d["frame"] == frame).unwrap()["object"].clone();
    detections.retain(|d| d["frame"] != frame || d["object"] != missing);
    folder.write_json("missed.json", &scene);
    let mut result = folder.json("objects.json");
    for object in result["objects"].as_array_mut().unwrap() {
        if object["id"] == missing {
            object["view_residuals_px"].as_array_mut().unwrap().retain(|view| view["frame"] != frame);
        }
    }
    folder.write_json("result.json", &result);
    let svg = |scene: &str, result: &str| {
        folder.succeed(&format!("render {scene} {result} --frame {} -o frame.svg --labels", frame.as_str().unwrap()));
        folder.read("frame.svg")
    };
    let thin = "stroke-width=\"1.6\"";
    let (all, missed) = (svg("scene.json", "objects.json"), svg("missed.json", "result.json"));
    assert_eq!((all.matches(thin).count(), missed.matches(thin).count()), (0, 1));
    for picture in [&all, &missed] {
        let labels = labels(picture);
        assert_eq!(labels.len(), 20, "every object has a label");
        for (k, (text, a)) in labels.iter().enumerate() {
            assert!(a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= 1280.0 && a[3] <= 960.0, "{text}: {a:?}");
            let covers =
                |b: &[f64; 4]| a[0] < b[2] - 0.02 && b[0] < a[2] - 0.02 && a[1] < b[3] - 0.02 && b[1] < a[3] - 0.02;
            assert!(labels[..k].iter().all(|(_, b)| !covers(b)), "{text}: {labels:?}");
        }
    }
}

#[test]
fn images_are_found_by_the_ids_of_frames() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let scene = folder.json("scene.json");
    folder.write("photos/.keep", "");
    let rows: Vec<String> = (0..3)
        .map(|k| {
            let image = format!("images/{}.png", scene["frames"][k]["id"].as_str().unwrap());
            image::open(folder.path(&image)).unwrap().save(folder.path(&format!("photos/img_00{k}.jpg"))).unwrap();
            format!("img_00{k},200,0,120,0,0,200,90,0,0,0,1,2,240,180")
        })
        .collect();
    folder.write("cameras.csv", rows.join("\n"));
    folder.succeed("import projections cameras.csv --images photos -o cameras.json");
    assert_eq!(folder.json("cameras.json")["frames"][1]["image"], "photos/img_001.jpg");
    let text = folder.succeed("render cameras.json --all -o pictures");
    assert_eq!(text, "wrote 3 pictures to pictures\n");
}

#[test]
fn wrong_usage_says_what_to_do() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    folder.write("file", "");
    for (options, code, expected) in [
        ("--all", 2, "--all needs the folder of the pictures: add -o FOLDER"),
        ("--all --frame 000000 -o pictures", 2, "--frame draws one frame, --all every frame: remove one of them"),
        ("-o pictures", 2, "--all -o FOLDER every frame"),
        ("--frame 000000", 2, "add -o FILE"),
        ("--frame 000000 --svg -o frame.png", 2, "one picture is SVG if the name after -o ends in .svg"),
        ("--all -o frame.png", 2, "give -o the name of a folder"),
        ("--all -o file", 1, "it is a file; expected a folder"),
        ("--all -o pictures --source coco", 2, "\"coco\"; there are"),
    ] {
        let run = folder.run(&format!("render scene.json {options}"));
        assert!(run.code == code && run.stderr.contains(expected), "{options}: {} {}", run.code, run.stderr);
    }
    assert!(!folder.path("pictures").exists());
}
