//! Points as depths: of a COLMAP model, of sweeps, and damaged ones.

use std::fmt::Write;

use serde_json::{Value, json};

use crate::common::Folder;

/// A model of two images, the second one a unit to the right, with points on a ball of radius 1 at 10 and behind it.
fn model(folder: &Folder) {
    std::fs::create_dir_all(folder.path("model")).unwrap();
    folder.write("model/cameras.txt", "1 PINHOLE 640 480 500 500 320 240\n");
    folder.write("model/images.txt", "7 1 0 0 0 0 0 0 1 a.png\n\n4 1 0 0 0 -1 0 0 1 b.png\n\n");
    let mut points = String::new();
    for k in 0..60 {
        let (turn, radius) = (2.4 * f64::from(k), (f64::from(k) / 60.0).sqrt() * 0.95);
        let (x, y) = (radius * turn.cos(), radius * turn.sin());
        let (z, image) = if k % 5 == 4 { (25.0, 4) } else { (10.0 - (1.0 - x * x - y * y).sqrt(), 7) };
        let (x, y) = if k % 5 == 4 { (2.5 * x, 2.5 * y) } else { (x, y) };
        writeln!(points, "{k} {x} {y} {z} 0 0 0 0.5 {image} 0").unwrap();
    }
    folder.write("model/points3D.txt", points);
}

/// Detections of the ball in both images.
fn detections() -> Value {
    json!([
        {"frame": "a.png", "object": "ball", "box": [269.7, 189.7, 370.3, 290.3]},
        {"frame": "b.png", "object": "ball", "box": [219.4, 189.7, 320.3, 290.3]},
    ])
}

#[test]
fn points_of_a_colmap_model_tell_how_far_an_object_is() {
    let folder = Folder::new();
    model(&folder);
    folder.succeed("import colmap model -o scene.json");
    let mut scene = folder.json("scene.json");
    assert_eq!(scene["frames"][0]["observed_points"].as_array().unwrap().len(), 48);
    assert_eq!(scene["frames"][1]["observed_points"].as_array().unwrap().len(), 12);
    let info = folder.run("info scene.json").stdout;
    assert!(info.contains("points       60\nobservations 60\n"), "{info}");
    // One view of the object is enough; what the other image observed is behind it.
    scene["detections"] = json!([detections()[0]]);
    folder.write_json("one.json", &scene);
    let run = folder.run("localize one.json -o objects.json -v");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("points: 1 detection with a depth, 0 in other views"), "{}", run.stderr);
    let found = &folder.json("objects.json")["objects"][0];
    let depth = found["center"][2].as_f64().unwrap();
    assert!(found["status"] == "ok" && (depth - 10.0).abs() < 0.4, "{found}");
    // No scale is estimated: the points have the poses' lengths.
    assert!(folder.json("objects.json")["localization"].get("cue_scales").is_none_or(|scales| scales == &json!([])));
    let planes = folder.run("localize one.json --method planes -v");
    assert!(!planes.stderr.contains("points:"), "{}", planes.stderr);
    // Without the frames that observed them points are drawn only.
    for frame in scene["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("observed_points");
    }
    folder.write_json("plain.json", &scene);
    assert!(folder.run("localize plain.json -v").stdout.contains("too_few_views"));
}

#[test]
fn sweeps_are_read_where_they_are_and_damaged_ones_are_named() {
    let folder = Folder::new();
    model(&folder);
    folder.succeed("import colmap model --points 0 -o scene.json");
    let mut scene = folder.json("scene.json");
    scene["detections"] = detections();
    std::fs::create_dir(folder.path("velodyne")).unwrap();
    // The ball in the axes of the sensor: x forwards, y to the left, z up.
    let mut bytes = Vec::new();
    for k in 0..200 {
        let (turn, radius) = (2.4 * f64::from(k), (f64::from(k) / 200.0).sqrt() * 0.95);
        let (x, y) = (radius * turn.cos(), radius * turn.sin());
        let point = [10.0 - (1.0 - x * x - y * y).sqrt(), -x, -y, 0.3];
        point.iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
    }
    folder.write("velodyne/a.bin", &bytes);
    folder.write("velodyne/cut.bin", &bytes[..30]);
    let cloud = json!({
        "path": "velodyne/a.bin", "transform": [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0]], "source": "velodyne",
    });
    let told = |cloud: Value| {
        let mut scene = scene.clone();
        scene["frames"][0]["point_cloud"] = cloud;
        folder.write_json("sweep.json", &scene);
        let run = folder.run("localize sweep.json -o objects.json -v");
        let line = run.stderr.lines().find(|line| line.contains("points: ") || line.starts_with("error"));
        format!("{}: {}", run.code, line.unwrap_or_default())
    };
    assert_eq!(
        told(cloud.clone()),
        "0: points: 1 detection with a depth, 0 in other views of their objects, 0 without"
    );
    assert_eq!(folder.json("objects.json")["frames"][0]["point_cloud"], cloud);
    // Without a depth the two views alone do not determine the object.
    let wrong = |key: &str, value: Value| {
        let mut cloud = cloud.clone();
        cloud[key] = value;
        told(cloud)
    };
    assert_eq!(
        wrong("transform", Value::Null),
        "1: points: 0 detections with a depth, 0 in other views of their objects, 1 without"
    );
    let first = |path: &str| {
        let mut scene = scene.clone();
        scene["frames"][0]["point_cloud"] = json!({"path": path});
        folder.write_json("damaged.json", &scene);
        let run = folder.run("localize damaged.json");
        format!("{}: {}", run.code, run.stderr.lines().next().unwrap_or_default())
    };
    assert_eq!(first("velodyne/b.bin"), "1: error: velodyne/b.bin: there is no such file");
    let cut = "1: error: velodyne/cut.bin: the file has 30 bytes; expected a multiple of 16, 4 32-bit floats a point";
    assert_eq!(first("velodyne/cut.bin"), cut);
    assert!(first("scene.json").contains("this is no point cloud: expected .ply"), "{}", first("scene.json"));
    // A cloud that the scene names is not overwritten.
    folder.write_json("sweep.json", &{
        let mut scene = scene.clone();
        scene["frames"][0]["point_cloud"] = cloud.clone();
        scene
    });
    assert_ne!(folder.run("localize sweep.json -o velodyne/a.bin").code, 0);
    assert_eq!(std::fs::read(folder.path("velodyne/a.bin")).unwrap(), bytes);
}

#[test]
fn points_with_their_pixels_tell_errors_of_poses() {
    let folder = Folder::new();
    folder.succeed(
        "synth -q -o scene.json --trajectory street --views 24 --objects 12 --noise box:0.02 --points 600 --pose-noise 0.3",
    );
    let scene = folder.json("scene.json");
    let frame = &scene["frames"][3];
    let lists = ["observed_points", "observed_pixels"].map(|name| frame[name].as_array().unwrap().len());
    assert!(lists[0] > 20 && lists[0] == lists[1], "{lists:?}");
    let run = folder.run("localize scene.json --refine-poses -o out.json -v --allow-inconsistent");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("poses: ") && run.stderr.contains("median error"), "{}", run.stderr);
    let found = folder.json("out.json");
    let points = &found["localization"]["pose_points"];
    let number = |name: &str| points[name].as_f64().unwrap();
    assert!(number("given_error_px") > 1.0 && number("error_px") < 0.8, "{points}");
    assert!((0.3..0.7).contains(&number("noise_px")) && points.get("problem").is_none(), "{points}");
    // Frames keep their points and pixels.
    assert_eq!(found["frames"][3]["observed_pixels"], frame["observed_pixels"]);
    // Pixels of images half as large are no pixels of these points.
    let mut wrong = scene.clone();
    for frame in wrong["frames"].as_array_mut().unwrap() {
        for pixel in frame["observed_pixels"].as_array_mut().unwrap() {
            pixel.as_array_mut().unwrap().iter_mut().for_each(|x| *x = json!(0.5 * x.as_f64().unwrap()));
        }
    }
    folder.write_json("wrong.json", &wrong);
    let run = folder.run("localize wrong.json --refine-poses --allow-inconsistent --json");
    assert!(run.stderr.contains("warning: points were not used for the poses: "), "{}", run.stderr);
    let document: Value = serde_json::from_str(&run.stdout).unwrap();
    assert!(document["scenes"][0]["pose_points"]["problem"].is_string(), "{document}");
    // As many pixels as points.
    wrong["frames"][3]["observed_pixels"] = json!([[1, 2]]);
    folder.write_json("wrong.json", &wrong);
    let run = folder.run("localize wrong.json");
    let expected =
        format!("frames[3].observed_pixels: found 1 pixel; expected one for each of the {} points", lists[0]);
    assert!(run.code == 1 && run.stderr.contains(&expected), "{}", run.stderr);
}
