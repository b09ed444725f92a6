//! From images to masks, ellipses and objects, through the built program.

use crate::common::Folder;
use image::{DynamicImage, ImageBuffer, Luma};
use serde_json::{Value, json};

/// The ellipse of a detection: center, semi-axes, angle.
fn ellipse(detection: &Value) -> [f64; 5] {
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{detection}"));
    let e = &detection["ellipse"];
    [
        number(&e["center"][0]),
        number(&e["center"][1]),
        number(&e["semi_axes"][0]),
        number(&e["semi_axes"][1]),
        number(&e["angle"]),
    ]
}

fn detections(folder: &Folder, name: &str) -> Vec<Value> {
    folder.json(name)["detections"].as_array().unwrap().clone()
}

#[test]
fn the_whole_way_from_images_to_objects() {
    let folder = Folder::new();
    folder.rendered_scene("r/scene.json", 6);
    let text = folder.succeed("segment r/scene.json -o r/out.json --contact-sheets r/sheets");
    insta::assert_snapshot!("segment", text);
    let sheet = image::open(folder.path("r/sheets/object_000.png")).unwrap();
    assert!(sheet.width() > 900 && sheet.height() > 100);
    // The true masks give the ellipses to compare with.
    folder.succeed("segment r/scene.json -o r/true.json --method masks");
    for (found, truth) in detections(&folder, "r/out.json").iter().zip(&detections(&folder, "r/true.json")) {
        assert_eq!(found["segmentation"]["status"], "ok");
        assert!(found["segmentation"]["confidence"].as_f64().unwrap() > 0.5);
        // How certain a given mask is, nobody knows.
        assert!(truth["segmentation"]["status"] == "ok" && truth["segmentation"]["confidence"].is_null());
        let (a, b) = (ellipse(found), ellipse(truth));
        for k in 0..4 {
            assert!((a[k] - b[k]).abs() < 0.12 * b[2], "{a:?} {b:?}");
        }
    }
    folder.succeed("localize r/out.json -o r/objects.json");
    let scores: Value = serde_json::from_str(&folder.succeed("evaluate r/objects.json r/scene.json --json")).unwrap();
    assert!(scores["mean"]["iou3d"]["value"].as_f64().unwrap() > 0.6, "{scores}");
}

#[test]
fn images_from_a_video() {
    let folder = Folder::new();
    folder.rendered_scene("r/scene.json", 6);
    folder.succeed("segment r/scene.json -o images.json");
    let scene = folder.json("r/scene.json");
    let frames = scene["frames"].as_array().unwrap();
    // Without ffmpeg the message says what to install.
    folder.write("r/drive.mkv", "no video");
    let words = ["segment", "r/scene.json", "-o", "out.json", "--images", "r/drive.mkv"];
    let output = folder.command().env("PATH", "").args(words).output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        errors.contains("read with ffmpeg, which is not installed: install ffmpeg (apt install ffmpeg"),
        "{errors}"
    );
    let off = folder.command().env("QUADLIFT_FFMPEG", "off").args(words).output().unwrap();
    let errors = String::from_utf8(off.stderr).unwrap();
    assert!(errors.contains("frames of videos are not read, because QUADLIFT_FFMPEG is \"off\""), "{errors}");
    std::fs::remove_file(folder.path("r/drive.mkv")).unwrap();
    for (number, frame) in frames.iter().enumerate() {
        let image = folder.path(&format!("r/{}", frame["image"].as_str().unwrap()));
        std::fs::copy(image, folder.path(&format!("r/{number}.png"))).unwrap();
    }
    let made = std::process::Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-i", "%d.png", "-c:v", "ffv1", "drive.mkv"])
        .current_dir(folder.path("r"))
        .output();
    let Ok(made) = made else {
        eprintln!("skipped: ffmpeg is not installed");
        return;
    };
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let text = folder.succeed("segment r/scene.json -o video.json --images r/drive.mkv --report video.html");
    assert!(text.contains("note: images were taken from the video by"), "{text}");
    let result = folder.json("video.json");
    assert_eq!(result["frames"][2]["image"], "r/drive.mkv#frame=2");
    assert!(folder.read("video.html").contains("data:image/jpeg"));
    // The frames are compressed again: outlines differ by a few pixels.
    for (found, expected) in detections(&folder, "video.json").iter().zip(&detections(&folder, "images.json")) {
        let (a, b) = (ellipse(found), ellipse(expected));
        for k in 0..4 {
            assert!((a[k] - b[k]).abs() < 0.1 * b[2], "{a:?} {b:?}");
        }
    }
    // The result names the video: reports and pictures read it.
    folder.succeed("localize video.json -o objects.json --report objects.html");
    folder.succeed(&format!("render video.json --frame {} -o frame.png", frames[1]["id"].as_str().unwrap()));
}

#[test]
fn the_rest_of_the_scene_is_kept() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let mut scene = folder.json("scene.json");
    scene["mine"] = json!([1, 2]);
    scene["frames"][0]["exposure"] = json!(0.01);
    scene["detections"][0]["track"] = json!("t7");
    folder.write_json("scene.json", &scene);
    folder.succeed("segment scene.json -o out.json");
    let mut result = folder.json("out.json");
    for (index, detection) in result["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
        let record = detection.as_object_mut().unwrap();
        assert!(record.remove("ellipse").is_some() && record.remove("segmentation").is_some());
        let mask = record.insert("mask".to_owned(), scene["detections"][index]["mask"].clone()).unwrap();
        assert_eq!(mask["rle"]["size"], json!([180, 240]));
    }
    assert_eq!(result, scene);
}

/// Masks of one method, written in either form, give the same ellipses when they are read again, from another folder too.
#[test]
fn masks_are_read_as_they_were_written() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    std::fs::create_dir_all(folder.path("results/deep")).unwrap();
    folder.succeed("segment scene.json -o results/runs.json");
    folder.succeed("segment scene.json -o results/labels.json --out-masks results/masks");
    let runs = detections(&folder, "results/runs.json");
    assert_eq!(folder.json("results/labels.json")["frames"][1]["image"], "../images/000001.png");
    assert_eq!(folder.json("results/labels.json")["detections"][0]["mask"]["path"], "masks/000000.png");
    for (name, again) in [("runs", "results/a.json"), ("labels", "results/deep/b.json")] {
        let text = format!("segment results/{name}.json -o {again} --method masks --contact-sheets sheets");
        folder.succeed(&text);
        for (first, second) in runs.iter().zip(detections(&folder, again)) {
            let (a, b) = (ellipse(first), ellipse(&second));
            // Moments of the crop's grid and of the image's pixels differ a little.
            assert!((0..4).all(|k| (a[k] - b[k]).abs() < 0.3), "{a:?} {b:?}");
        }
    }
    assert_eq!(
        folder.json("results/deep/b.json")["detections"][0]["mask"]["path"],
        "../masks/000000.png",
        "masks move with the scene"
    );
}

#[test]
fn the_number_of_threads_does_not_change_a_byte() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    for method in ["graphcut", "sca", "masks"] {
        for threads in [1, 3] {
            folder.succeed(&format!(
                "segment scene.json -o {threads}.json --method {method} --threads {threads} --contact-sheets s{threads}"
            ));
        }
        assert_eq!(folder.read("1.json"), folder.read("3.json"), "{method}");
        let sheet = |threads: u32| std::fs::read(folder.path(&format!("s{threads}/object_001.png"))).unwrap();
        assert_eq!(sheet(1), sheet(3), "{method}");
    }
}

#[test]
fn detections_without_object_ids_are_segmented_alone() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let mut scene = folder.json("scene.json");
    for index in [0, 3] {
        scene["detections"][index].as_object_mut().unwrap().remove("object");
    }
    // One pixel, and nothing but an ellipse.
    scene["detections"][1]["box"] = json!([80, 60, 81, 61]);
    scene["detections"][2].as_object_mut().unwrap().remove("box");
    scene["detections"][2]["ellipse"] = json!({"center": [80.0, 60.0], "semi_axes": [9.0, 5.0], "angle": 0.0});
    folder.write_json("scene.json", &scene);
    let text = folder.succeed("segment scene.json -o out.json --contact-sheets sheets");
    assert!(text.contains("note: 2 detections without an object id: each was segmented alone"), "{text}");
    assert!(text.contains("note: skipped 1 detection without a box"), "{text}");
    let result = detections(&folder, "out.json");
    for index in [0, 1, 3] {
        ellipse(&result[index]);
    }
    assert_eq!(result[2], scene["detections"][2]);
    assert!(folder.path("sheets/without_object.png").exists());
    let report: Value = serde_json::from_str(&folder.succeed("segment scene.json -o out.json --json")).unwrap();
    assert_eq!((&report["without_box"], &report["objects"][2]["object"]), (&json!(1), &Value::Null));
    assert_eq!(report["problems"], json!([]));
}

#[test]
fn one_source_is_segmented() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let mut scene = folder.json("scene.json");
    for index in 0..6 {
        scene["detections"][index]["source"] = json!(if index < 4 { "yolo" } else { "label" });
    }
    folder.write_json("scene.json", &scene);
    let run = folder.run("segment scene.json -o out.json");
    assert!(run.code == 1 && run.stderr.contains("--source SOURCE"), "{}", run.stderr);
    folder.succeed("segment scene.json -o out.json --source yolo");
    let result = detections(&folder, "out.json");
    assert!(result[3]["ellipse"].is_object());
    assert_eq!(result[4..], scene["detections"].as_array().unwrap()[4..]);
}

/// Gray images and images of 16 bits are segmented like others.
#[test]
fn images_of_all_kinds_are_taken() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let path = folder.path("images/000001.png");
    let image = image::open(&path).unwrap();
    let deep: ImageBuffer<Luma<u16>, Vec<u16>> = image.to_luma16();
    for variant in [DynamicImage::ImageLuma8(image.to_luma8()), DynamicImage::ImageLuma16(deep)] {
        variant.save(&path).unwrap();
        folder.succeed("segment scene.json -o out.json --method sca");
    }
}

/// The boxes of a scene are undistorted; crops are cut where the object is in the image.
#[test]
fn distorted_images_are_cropped_as_they_are() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let mut scene = folder.json("scene.json");
    folder.succeed("segment scene.json -o pinhole.json");
    let params = scene["cameras"][0]["params"].as_array().unwrap().clone();
    scene["cameras"][0]["model"] = json!("SIMPLE_RADIAL");
    scene["cameras"][0]["params"] = json!([params[0], params[2], params[3], -0.25]);
    folder.write_json("scene.json", &scene);
    folder.succeed("segment scene.json -o distorted.json");
    assert_eq!(detections(&folder, "pinhole.json"), detections(&folder, "distorted.json"));
}

#[test]
fn masks_are_an_observation_of_their_own() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 8);
    folder.succeed("segment scene.json -o runs.json --method masks --out-masks masks2");
    let score = |arguments: &str| {
        folder.succeed(&format!("localize {arguments} -o objects.json"));
        let scores = folder.succeed("evaluate objects.json scene.json --json");
        serde_json::from_str::<Value>(&scores).unwrap()["mean"]["iou3d"]["value"].as_f64().unwrap()
    };
    for method in ["posterior", "planes"] {
        // True masks, from label images, of ellipsoids that stand free.
        let [masks, again, boxes] = ["scene.json --measurement mask", "runs.json --measurement mask", "scene.json"]
            .map(|what| score(&format!("{what} --method {method}")));
        assert!(masks > boxes && masks > 0.85, "{method}: {masks} {boxes}");
        assert_eq!(masks, again, "{method}");
    }
    // One that cannot be read is named; its object has seven other views.
    let mut scene = folder.json("scene.json");
    scene["detections"][3]["mask"]["value"] = json!(9);
    folder.write_json("wrong.json", &scene);
    let run = folder.run("localize wrong.json -o objects.json --measurement mask");
    assert!(run.code == 1 && run.stderr.contains("masks/000001.png: no pixel has the value 9"), "{}", run.stderr);
    assert!(run.stdout.contains(": 2 of 2 objects localized"), "{}", run.stdout);
    assert_eq!(folder.json("objects.json")["objects"][1]["view_residuals_px"].as_array().map(Vec::len), Some(7));
}

/// Masks that were not trusted say nothing; what is cut or touched counts less.
#[test]
fn what_the_segmentation_says_of_masks_is_heard() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 8);
    folder.succeed("segment scene.json -o segmented.json --method masks");
    let mut scene = folder.json("segmented.json");
    let noise = |name: &str| {
        folder.succeed(&format!("localize {name} -o objects.json"));
        folder.json("objects.json")["localization"]["noise"].clone()
    };
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["segmentation"] = json!({"method": "masks", "status": "ok"});
    }
    folder.write_json("whole.json", &scene);
    assert!(noise("whole.json")["partial_ellipse"].is_null());
    for index in [0, 3, 11] {
        scene["detections"][index]["segmentation"]["touches_other_masks"] = json!(0.2);
    }
    folder.write_json("partial.json", &scene);
    assert!(noise("partial.json")["partial_ellipse"].is_number());
    for index in 0..16 {
        scene["detections"][index]["segmentation"] = json!({"method": "sca", "status": "fallback"});
    }
    folder.write_json("fallen.json", &scene);
    let fallen = noise("fallen.json");
    assert!(fallen["shape"].is_null() && fallen["edge_noise"].is_number(), "{fallen}");
    let run = folder.run("localize fallen.json --measurement mask");
    assert!(run.code == 1 && run.stderr.contains("no object could be localized"), "{}", run.stderr);
}
