//! `quadlift import` from end to end: real data where they are at hand, images relative to the scene, wrong usage.

use crate::common::{Folder, real_scenes};
use serde_json::{Value, json};

/// Imports, localizes and evaluates; gives the evaluation.
fn score(import: &[&str], localize: &str) -> Value {
    let folder = Folder::new();
    let run = folder.run_list(&[&["import"], import, &["-o", "scene.json"]].concat());
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    let info = folder.succeed("info scene.json");
    assert!(!info.contains("other poses") && !info.contains("behind") && !info.contains("millimeters"), "{info}");
    folder.succeed(&format!("localize scene.json -o estimate.json {localize}"));
    serde_json::from_str(&folder.succeed("evaluate estimate.json scene.json --json")).unwrap()
}

fn mean(scores: &Value, name: &str) -> f64 {
    scores["mean"][name]["value"].as_f64().unwrap_or_else(|| panic!("no {name} in {scores:#}"))
}

#[test]
fn a_kitti_sequence_is_imported_localized_and_evaluated() {
    let Some(data) = real_scenes() else { return };
    let folder = data.parent().unwrap().join("kitti_tracking");
    let import = ["kitti", folder.to_str().unwrap(), "--sequence", "0001", "--frames", "90-106"];
    let options = "--source label --body cuboid --max-occluded 1 --max-truncated 0 --priors builtin";
    let scores = score(&import, options);
    println!("kitti: {:#}", scores["mean"]);
    assert!(mean(&scores, "center_error") < 1.5, "{scores:#}");
}

#[test]
fn a_bop_scene_is_imported_localized_and_evaluated() {
    let Some(data) = real_scenes() else { return };
    let folder = data.parent().unwrap().join("linemod/bop/test/000009");
    let scores = score(&["bop", folder.to_str().unwrap(), "--world-object", "9"], "--source bbox_obj");
    println!("bop: {:#}", scores["mean"]);
    assert_eq!(scores["failures"], 0);
    assert!(mean(&scores, "iou3d") > 0.6, "{scores:#}");
    // The boxes at hand are larger than the toolkit's, by a pixel on each side of a duck of 45 pixels.
    assert!(mean(&scores, "center_error") < 0.015, "{scores:#}");
}

/// The points of a COLMAP model: from its file through scene and result into the page; none where none are asked for.
#[test]
fn points_of_a_colmap_model_are_shown_in_the_page() {
    let folder = Folder::new();
    let tutorial = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/data/tutorial-colmap-yolo");
    folder.copy(&tutorial);
    let points = |name: &str| folder.json(name)["points"].as_array().map_or(0, Vec::len);
    let imported = folder.succeed("import colmap sparse/0 -o scene.json");
    assert!(imported.contains("- 300 sparse points of the model\n"), "{imported}");
    assert!(folder.succeed("info scene.json").contains("\npoints       300\n"));
    let fewer = folder.succeed("import colmap sparse/0 -o few.json --points 100");
    assert!(fewer.contains("- 100 of 300 sparse points, evenly spread\n"), "{fewer}");
    folder.succeed("import colmap sparse/0 -o none.json --points 0");
    assert_eq!([points("scene.json"), points("few.json"), points("none.json")], [300, 100, 0]);
    assert!(folder.json("none.json").get("points").is_none());

    folder.succeed("localize --cameras sparse/0 --detections labels -o objects.json --report objects.html");
    assert_eq!(folder.json("objects.json")["points"], folder.json("scene.json")["points"]);
    let path = folder.succeed("view scene.json --no-browser");
    let viewed = std::fs::read_to_string(path.trim()).unwrap();
    std::fs::remove_file(path.trim()).unwrap();
    for (page, html) in [("objects.html", folder.read("objects.html")), ("view", viewed)] {
        let start = html.find("id=\"report-data\">").unwrap() + "id=\"report-data\">".len();
        let data: Value = serde_json::from_str(html[start..].split("</script>").next().unwrap()).unwrap();
        let shown: Vec<f64> = data["points"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        let given = folder.json("scene.json");
        let given = given["points"].as_array().unwrap().iter().flat_map(|point| point.as_array().unwrap());
        assert_eq!(shown.len(), 900, "{page}");
        // Rounded to five digits of the extent: the table is a meter wide.
        for (a, b) in shown.iter().zip(given) {
            assert!((a - b.as_f64().unwrap()).abs() <= 5.1e-6, "{page}: {a} {b}");
        }
        assert!(data["points"].to_string().len() < 900 * 9, "{page}");
    }
    // In millimeters everything is a thousand times as large.
    folder.succeed("import yolo labels --into scene.json -o detected.json");
    folder.succeed("localize detected.json -o meters.json --assume pose_unit=mm --allow-inconsistent");
    let first = |name: &str| folder.json(name)["points"][0][0].as_f64().unwrap();
    assert!((first("meters.json") / first("scene.json") - 1e-3).abs() < 1e-12);

    folder.write("wrong.json", r#"{"format": "quadlift.scene", "version": 1, "points": [[0, 0, 1], [1, 2]]}"#);
    let run = folder.run("info wrong.json");
    assert_eq!(run.code, 1);
    assert_eq!(
        run.stderr,
        "error: wrong.json:1:71: points[1]: found 2 entries, expected a list of 3 numbers (\"points\": a list of \
         [x, y, z] in the world)\n"
    );
}

#[test]
fn images_are_named_relative_to_the_scene() {
    let folder = Folder::new();
    folder.write("project/sparse/0/cameras.txt", "1 PINHOLE 640 480 500 500 320 240\n");
    folder.write("project/sparse/0/images.txt", "1 1 0 0 0 0 0 2 1 left/a.png\n\n");
    folder.write("project/images/left/a.png", "");
    folder.write("photos/left/a.png", "");
    std::fs::create_dir(folder.path("out")).unwrap();
    let document: Value =
        serde_json::from_str(&folder.succeed("import colmap project -o out/scene.json --json")).unwrap();
    assert_eq!((&document["cameras"], &document["frames"]), (&json!(1), &json!(1)));
    let scene = folder.json("out/scene.json");
    assert_eq!(scene["frames"][0]["image"], "../project/images/left/a.png");
    assert_eq!(scene["frames"][0]["id"], "left/a.png");
    assert!(scene["notes"].as_str().unwrap().starts_with("Imported from COLMAP: COLMAP model in text form"), "{scene}");
    folder.succeed("import colmap project --images photos -o scene.json");
    assert_eq!(folder.json("scene.json")["frames"][0]["image"], "photos/left/a.png");
    // The name of the scene is that of the file; the same input gives the same bytes.
    assert_eq!(folder.json("scene.json")["name"], "scene");
    let first = folder.read("scene.json");
    folder.succeed("import colmap project --images photos -o scene.json");
    assert_eq!(folder.read("scene.json"), first);
}

#[test]
fn wrong_usage_and_wrong_files() {
    let folder = Folder::new();
    folder.write("p.csv", "a,1,2,3\n");
    let message = |arguments: &str| {
        let run = folder.run(arguments);
        assert_ne!(run.code, 0, "{arguments}");
        (run.code, run.stderr.lines().next().unwrap_or_default().to_owned())
    };
    assert_eq!(message("import kitti x -o s.json").0, 2, "no sequence");
    assert_eq!(message("import bundler x -o s.json").0, 2);
    assert_eq!(message("import projections p.csv --image-size 640 -o s.json").0, 2);
    let (code, text) = message("import projections p.csv -o s.json");
    assert_eq!(code, 1);
    assert!(text.starts_with("error: p.csv:1: found 4 columns without names; expected"), "{text}");
    assert!(message("import colmap nowhere -o s.json").1.contains("expected the folder of a COLMAP model"));
    assert!(message("import projections p.csv -o no/s.json").1.contains("the folder no does not exist"));
    assert!(!folder.path("s.json").exists());
}
