//! Reports and pictures: what is in them. How the page behaves in a browser is tested in `viewer/tests`.

use crate::common::Folder;
use serde_json::Value;

/// The data in a page.
fn data(page: &str) -> Value {
    let place = "id=\"report-data\">";
    let start = page.find(place).unwrap() + place.len();
    let end = start + page[start..].find("</script>").unwrap();
    serde_json::from_str(&page[start..end]).unwrap()
}

/// The data in the page that `view` makes of files.
fn view(folder: &Folder, files: &str) -> Value {
    let text = folder.succeed(&format!("view {files} --no-browser"));
    let path = std::path::Path::new(text.trim());
    assert!(path.file_name().unwrap().to_str().unwrap().starts_with("quadlift-"), "{text}");
    let page = std::fs::read_to_string(path).unwrap();
    std::fs::remove_file(path).unwrap();
    data(&page)
}

#[test]
fn a_report_has_estimates_truth_scores_and_rejected_boxes() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 8 --views 20 --scale 0.05 --noise box:0.05 --outliers 0.05");
    folder.succeed("localize scene.json -o estimate.json -q --enclosing");
    folder.succeed("evaluate estimate.json scene.json --report scores.html");
    let report = data(&folder.read("scores.html"));
    let objects = report["objects"].as_array().unwrap();
    assert_eq!((objects.len(), report["frames"].as_array().unwrap().len()), (8, 20));
    for object in objects {
        assert_eq!(object["status"], "ok");
        assert!(object["truth"].is_object() && object["enclosing"].is_object(), "{object}");
        // The shell holds 95 %: its mean semi-axis is about 2.8 standard deviations.
        let axes: Vec<f64> = (0..3).map(|k| object["centerShell"]["half"][k].as_f64().unwrap()).collect();
        let mean = (axes.iter().map(|a| a * a).sum::<f64>() / 3.0).sqrt();
        assert!((mean / object["centerSd"].as_f64().unwrap() - 7.8147f64.sqrt()).abs() < 1e-3, "{object}");
    }
    let states: Vec<&Value> = report["frames"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|f| f["detections"]["state"].as_array().unwrap())
        .collect();
    let rejected = objects.iter().map(|o| o["viewsRejected"].as_u64().unwrap()).sum::<u64>();
    assert!(rejected > 0);
    assert_eq!(states.iter().filter(|state| **state == 2).count() as u64, rejected);
    assert_eq!(report["scores"]["rows"].as_array().unwrap().len(), 8);
    let settings = report["settings"].to_string();
    assert!(settings.contains("[\"method\",\"posterior\"]") && settings.contains("noise, edge"), "{settings}");
}

#[test]
fn images_are_embedded_and_missing_ones_are_told() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    std::fs::remove_file(folder.path("images/000001.png")).unwrap();
    folder.succeed("localize scene.json --report objects.html");
    let report = data(&folder.read("objects.html"));
    let images: Vec<bool> =
        report["frames"].as_array().unwrap().iter().map(|f| f["image"].to_string().contains("jpeg;base64,")).collect();
    assert_eq!(images, [true, false, true]);
    let notes = report["notes"].to_string();
    assert!(notes.contains("1 of 3 images could not be read") && notes.contains("000001.png"), "{notes}");
    // The truth of a scene is not shown as a result of localize.
    assert!(report["objects"].as_array().unwrap().iter().all(|object| object["truth"].is_null()));
}

#[test]
fn several_scenes_have_several_reports() {
    let folder = Folder::new();
    for name in ["a", "b"] {
        folder.write_json(&format!("scenes/{name}.json"), &folder.small_scene());
    }
    folder.succeed("localize scenes --report pages");
    assert!(folder.path("pages/a.html").exists() && folder.path("pages/b.html").exists());
}

#[test]
fn segment_shows_ellipses() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    folder.succeed("segment scene.json -o out.json --method masks --report out.html");
    let report = data(&folder.read("out.html"));
    let ellipses: usize = report["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f["detections"]["ellipses"].as_array().unwrap().len())
        .sum();
    assert_eq!(ellipses, folder.json("out.json")["detections"].as_array().unwrap().len());
}

#[test]
fn view_shows_files_together_in_any_order() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 3 --views 6");
    folder.succeed("localize scene.json -o estimate.json -q --enclosing");
    let report = view(&folder, "estimate.json scene.json");
    assert_eq!(report["scores"]["rows"].as_array().unwrap().len(), 3);
    assert_eq!(report["frames"][0]["detections"]["object"].as_array().unwrap().len(), 3);
    assert_eq!(report, view(&folder, "scene.json estimate.json"));
    // Without estimates the objects of a scene are its truth.
    let plain = view(&folder, "scene.json");
    assert!(plain["objects"].as_array().unwrap().iter().all(|o| o["status"].is_null() && o["truth"].is_object()));
}

#[test]
fn identities_that_were_found_are_shown_on_the_scene_that_names_none() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 4 --views 10 --scale 0.05 --noise box:0.03 --seed 3");
    let mut scene = folder.json("scene.json");
    scene.as_object_mut().unwrap().remove("objects");
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection.as_object_mut().unwrap().remove("object");
    }
    folder.write_json("scene.json", &scene);
    folder.succeed("localize scene.json -o estimate.json");
    let path = folder.succeed("view scene.json estimate.json --no-browser");
    let page = data(&std::fs::read_to_string(path.trim()).unwrap());
    std::fs::remove_file(path.trim()).unwrap();
    let detections = &page["frames"][0]["detections"];
    assert!(detections["object"].as_array().unwrap().iter().all(|object| object.as_i64() >= Some(0)), "{detections}");
    assert!(detections["box"].as_array().unwrap().iter().all(Value::is_number), "{detections}");
    assert!(detections["residual"].as_array().unwrap().iter().all(Value::is_number), "{detections}");
}

#[test]
fn the_tutorial_with_photographs_is_true() {
    let folder = Folder::new();
    folder.succeed("demo --out desk");
    folder.succeed("import colmap desk/sparse/0 --images desk/images -o scene.json");
    folder.succeed("import yolo desk/labels --into scene.json -o detected.json");
    let text = folder.succeed("localize detected.json -o objects.json --up z --report objects.html");
    assert!(text.contains("183 detections assigned to 13 objects; 18 unassigned"), "{text}");
    let page = data(&folder.read("objects.html"));
    let frames = page["frames"].as_array().unwrap();
    assert_eq!((frames.len(), page["categories"].as_array().unwrap().len()), (16, 9));
    assert!(frames.iter().all(|frame| frame["image"].is_string()), "images, no blank sheets");
    let scores: Value = serde_json::from_str(&folder.succeed("evaluate objects.json desk/truth.json --json")).unwrap();
    assert_eq!((&scores["found"]["matched"], &scores["failures"]), (&13.into(), &0.into()), "{}", scores["found"]);
    let center = scores["mean"]["center_error"]["value"].as_f64().unwrap();
    assert!((0.004..0.0065).contains(&center), "{center}");
}
