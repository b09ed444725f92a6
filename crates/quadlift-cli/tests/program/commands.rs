//! The commands from end to end, through the built program.

use crate::common::Folder;
use serde_json::{Value, json};

#[test]
fn the_demo_finds_what_is_on_the_desk() {
    let folder = Folder::new();
    insta::assert_snapshot!("demo", folder.succeed("demo"));
    for name in ["scene.json", "wrong-poses.json"] {
        let scene = folder.json(&format!("quadlift-demo/{name}"));
        assert!(scene["objects"].is_null(), "the scene must not hold the truth");
        let detections = scene["detections"].as_array().unwrap();
        let known = ["frame", "box", "category", "score"];
        let plain = |d: &Value| d.as_object().unwrap().keys().all(|key| known.contains(&key.as_str()));
        assert!(!detections.is_empty() && detections.iter().all(plain), "a detector gives boxes and nothing else");
    }
    for name in ["images/000015.jpg", "report.html"] {
        assert!(folder.path(&format!("quadlift-demo/{name}")).exists(), "{name}");
    }
    // What it proposes to do next works; `localize` gives what the demo has written.
    insta::assert_snapshot!("info_of_the_demo", folder.succeed("info quadlift-demo/scene.json"));
    folder.succeed("localize quadlift-demo/scene.json -o again.json");
    let again = folder.read("again.json").replace("quadlift-demo/images/", "images/");
    assert!(again == folder.read("quadlift-demo/estimate.json"));
    // `evaluate` counts as the demo does, and measures no axes of balls.
    insta::assert_snapshot!(
        "evaluate_the_demo",
        folder.succeed("evaluate quadlift-demo/estimate.json quadlift-demo/truth.json")
    );
    let scores = folder.succeed("evaluate quadlift-demo/estimate.json quadlift-demo/truth.json --json");
    let scores: Value = serde_json::from_str(&scores).unwrap();
    let wrong = folder.run("localize quadlift-demo/wrong-poses.json");
    assert!(wrong.code == 3 && wrong.stderr.contains("--assume poses=opengl"), "{} {}", wrong.code, wrong.stderr);
    folder.succeed("localize quadlift-demo/wrong-poses.json --fix");
    // The same for programs, over the files of the first run.
    let report: Value = serde_json::from_str(&folder.succeed("demo --json --report page.html")).unwrap();
    let desk = &report["desk"];
    assert_eq!((&scores["found"]["matched"], &scores["found"]["estimates"]), (&desk["found"], &desk["found"]));
    assert!(desk["found"].as_u64() == Some(13) && desk["true_objects"] == 13, "{desk}");
    let off: Vec<f64> = desk["objects"].as_array().unwrap().iter().filter_map(|o| o["off"].as_f64()).collect();
    // One book has three views and comes with a warning.
    assert!(off.len() == 13 && off.iter().filter(|off| **off < 0.02).count() >= 12, "{off:?}");
    assert!(off.iter().all(|off| *off < 0.04), "{off:?}");
    let boxes = &desk["boxes"];
    assert!(4 * boxes["wrong_refused"].as_u64().unwrap() >= 3 * boxes["wrong"].as_u64().unwrap(), "{boxes}");
    assert!(10 * boxes["right_refused"].as_u64().unwrap() <= boxes["all"].as_u64().unwrap(), "{boxes}");
    assert_eq!(report["wrong_poses"]["mended"]["found"], desk["found"]);
    // Its page shows photographs, objects, and what belongs to none.
    let page = folder.read("page.html");
    assert!(page.matches("data:image/jpeg").count() >= 16 && page.contains("\"title\":\"desk\""));
}

#[test]
fn a_brief_result_leaves_out_what_takes_space_and_its_page_nothing() {
    let folder = Folder::new();
    for ids in ["", "--no-ids"] {
        folder.succeed(&format!("synth -o scene.json --objects 3 --views 8 --seed 4 --noise box:0.03 {ids}"));
        folder.succeed("localize scene.json -o full.json --report full.html");
        folder.succeed("localize scene.json -o brief.json --report brief.html --compact");
        folder.succeed("localize scene.json -o alone.json --compact");
        assert_eq!(folder.read("brief.json"), folder.read("alone.json"));
        assert_eq!(folder.read("brief.html"), folder.read("full.html"));
        let (full, brief) = (folder.json("full.json"), folder.json("brief.json"));
        let mut expected = full.clone();
        if ids.is_empty() {
            // Those whose ids were given are in the scene.
            assert_eq!(
                expected.as_object_mut().unwrap().remove("detections"),
                Some(folder.json("scene.json")["detections"].take())
            );
        }
        for object in expected["objects"].as_array_mut().unwrap() {
            let object = object.as_object_mut().unwrap();
            assert!(object.remove("covariance").is_some() && object.remove("view_residuals_px").is_some());
        }
        assert_eq!(brief, expected);
    }
}

#[test]
fn a_result_alone_shows_and_locates_what_the_scene_does_with_it() {
    let folder = Folder::new();
    folder.succeed("synth -q -o scene.json --objects 8 --views 10 --seed 4 --noise box:0.03");
    folder.succeed("localize -q scene.json -o result.json");
    assert_eq!(folder.json("result.json")["detections"], folder.json("scene.json")["detections"]);
    folder.succeed("localize -q scene.json -o brief.json --compact");
    folder.succeed("relocalize -q result.json scene.json --include-posed -o both.json");
    folder.succeed("align -q result.json result.json -o merged.json");
    std::fs::remove_file(folder.path("scene.json")).unwrap();
    let lines = |result: &str| {
        folder.succeed(&format!("render {result} --frame 000003 -o frame.svg -q"));
        folder.read("frame.svg").matches("<polyline").count()
    };
    assert!(lines("result.json") >= lines("brief.json") + 8);
    folder.succeed("export rerun result.json -o recording");
    assert_eq!(folder.json("recording/recording.json")["frames"][3]["boxes"].as_array().unwrap().len(), 8);
    folder.succeed("relocalize -q result.json result.json --include-posed -o alone.json");
    assert_eq!(folder.json("alone.json")["frames"], folder.json("both.json")["frames"]);
    let merged = folder.json("merged.json");
    assert_eq!(merged["detections"].as_array().unwrap().len(), 2 * 8 * 10);
}

#[test]
fn a_small_scene_is_localized_and_scored() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 3 --views 8 --seed 4 --noise box:0.03");
    insta::assert_snapshot!("localize", folder.succeed("localize scene.json -o estimate.json"));
    // The names of the noise levels are for those who ask, and times are milliseconds or seconds.
    let details = folder.run("localize scene.json -v").stderr;
    assert!(details.contains("noise levels: edge_noise 0.0"), "{details}");
    assert!(details.contains("ms, localized in ") && !details.contains('µ'), "{details}");
    insta::assert_snapshot!("evaluate", folder.succeed("evaluate estimate.json scene.json"));
    let result = folder.json("estimate.json");
    insta::assert_snapshot!(
        "localization",
        serde_json::to_string_pretty(&json!({
            "settings": result["localization"]["settings"],
            "skipped": result["localization"]["skipped"],
            "status": result["localization"]["status"],
            "keys": result.as_object().unwrap().keys().collect::<Vec<_>>(),
        }))
        .unwrap()
    );
    assert_eq!(result["localization"]["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(result["objects"].as_array().unwrap().len(), 3);
    assert_eq!(result["objects"][0]["view_residuals_px"].as_array().unwrap().len(), 8);
}

#[test]
fn parts_of_a_scene_are_localized_apart_with_given_noise_levels() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 6 --views 10 --seed 5 --noise box:0.03 --outliers 0.1");
    folder.succeed("localize scene.json -o found.json");
    let found = folder.json("found.json");
    folder.succeed("localize scene.json -o whole.json --noise-model found.json --body ellipsoid");
    let whole = folder.json("whole.json");
    assert_eq!(whole["localization"]["noise"], found["localization"]["noise"]);
    assert_eq!(whole["localization"]["settings"]["noise_model"], found["localization"]["noise"]);
    // One object alone: the other boxes stay, without a name, because they may hide its edges.
    let mut scene = folder.json("scene.json");
    for detection in scene["detections"].as_array_mut().unwrap() {
        if detection["object"] != whole["objects"][4]["id"] {
            detection.as_object_mut().unwrap().remove("object");
        }
    }
    folder.write_json("part.json", &scene);
    folder
        .succeed("localize part.json -o part_result.json --noise-model found.json --body ellipsoid --associate never");
    let part = folder.json("part_result.json");
    assert_eq!(part["objects"].as_array().unwrap().len(), 1);
    assert_eq!(part["objects"][0], whole["objects"][4]);
    // By name, with blanks, and what is not given has its default.
    let levels = "edge_noise=0.02, edge_noise_px=1.5";
    let run = folder.run_list(&["localize", "scene.json", "-o", "given.json", "--noise-model", levels]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let given = folder.json("given.json");
    assert_eq!(given["localization"]["noise"], json!({ "edge_noise": 0.02, "edge_noise_px": 1.5 }));
}

#[test]
fn cuboids_are_localized_and_scored() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 3 --views 20 --seed 2 --body cuboid");
    folder.succeed("localize scene.json -o estimate.json --body cuboid");
    let scores: Value = serde_json::from_str(&folder.succeed("evaluate estimate.json scene.json --json")).unwrap();
    assert!(scores["mean"]["cuboid_iou3d"]["value"].as_f64().unwrap() > 0.8, "{scores}");
    assert_eq!(scores["failures"], 0);
}

#[test]
fn json_is_one_document_and_silence_is_silent() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 2 --views 6");
    for arguments in ["localize scene.json", "info scene.json", "evaluate scene.json scene.json", "synth -o b.json"] {
        let text = folder.succeed(&format!("{arguments} --json"));
        let document: Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{arguments}: {error}"));
        assert!(document.is_object());
        assert_eq!(folder.succeed(&format!("{arguments} -q")), "");
    }
    let run = folder.run("localize no.json scene.json --json");
    let document: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(document["scenes"][0]["error"], "no.json: there is no such file");
    assert_eq!(document["scenes"][1]["localized"], 2);
    assert_eq!(run.code, 1);
    let run = folder.run("info no.json --json");
    assert_eq!(serde_json::from_str::<Value>(&run.stdout).unwrap()["error"], "no.json: there is no such file");
}

#[test]
fn several_scenes_give_a_folder_of_results() {
    let folder = Folder::new();
    for (name, seed) in [("a", 1), ("b", 2)] {
        std::fs::create_dir_all(folder.path("scenes")).unwrap();
        folder.succeed(&format!("synth -o scenes/{name}.json --objects 2 --views 6 --seed {seed}"));
    }
    folder.write("scenes/bad.json", "{");
    folder.write("scenes/notes.txt", "no scene");
    // A folder, a pattern and single paths name the same files.
    for (index, arguments) in
        ["scenes", "scenes/*.json", "scenes/a.json scenes/b.json scenes/bad.json"].iter().enumerate()
    {
        let run = folder.run(&format!("localize {arguments} -o results{index}"));
        assert_eq!(run.code, 1);
        assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
        assert!(run.stderr.starts_with("error: scenes/bad.json:1:1: "), "{}", run.stderr);
        for name in ["a.json", "b.json"] {
            assert_eq!(folder.read(&format!("results{index}/{name}")), folder.read(&format!("results0/{name}")));
        }
        assert!(!folder.path(&format!("results{index}/bad.json")).exists());
    }
    folder.succeed("localize scenes/a.json -o single.json");
    assert_eq!(folder.read("single.json"), folder.read("results0/a.json"));
    assert_eq!(folder.run("localize scenes/a.json scenes/b.json -o results0").code, 0);
}

#[test]
fn the_number_of_threads_does_not_change_a_byte() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 40 --views 10 --noise box:0.05 --outliers 0.1");
    for body in ["ellipsoid", "cuboid"] {
        folder.succeed(&format!("localize scene.json -o one.json --threads 1 --body {body}"));
        folder.succeed(&format!("localize scene.json -o four.json --threads 4 --body {body}"));
        assert!(folder.read("one.json") == folder.read("four.json"), "{body}");
    }
}

#[test]
fn detections_without_object_ids_are_given_to_their_objects_or_counted() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    let first = scene["detections"][0]["object"].clone();
    for detection in scene["detections"].as_array_mut().unwrap().iter_mut().skip(9) {
        detection.as_object_mut().unwrap().remove("object");
    }
    folder.write_json("scene.json", &scene);
    let text = folder.succeed("localize scene.json -o out.json");
    let expected = "detections were associated (3 detections without an object id; the ids of the others are trusted): 12 \
                    detections assigned to 2 objects; 0 unassigned";
    assert!(text.contains(expected), "{text}");
    let found = folder.json("out.json");
    assert_eq!(found["detections"].as_array().unwrap().len(), 12);
    assert_eq!((&found["detections"][0]["object"], &found["detections"][11]["object"]), (&first, &json!("object_001")));
    assert_eq!(found["localization"]["skipped"]["without_object"], 0);
    // Not where it is not wanted.
    let text = folder.succeed("localize scene.json --associate never");
    assert!(text.contains("warning: skipped 3 detections without an object id"), "{text}");
    let document: Value =
        serde_json::from_str(&folder.succeed("localize scene.json --associate never --json")).unwrap();
    assert_eq!(document["scenes"][0]["skipped"]["without_object"], 3);
}

#[test]
fn occluded_and_truncated_detections_can_be_left_out() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    scene["detections"][0]["occluded"] = json!(2);
    scene["detections"][7]["truncated"] = json!(0.5);
    folder.write_json("scene.json", &scene);
    let text = folder.succeed("localize scene.json --max-occluded 1 --max-truncated 0");
    assert!(text.contains("skipped 2 detections as too occluded or truncated"), "{text}");
    assert_eq!(text.matches(" 5/5 ").count(), 2, "{text}");
}

#[test]
fn sizes_are_learned_from_the_scene() {
    let folder = Folder::new();
    folder.succeed("synth -q -o scene.json --objects 8 --views 4 --noise box:0.02");
    let mut scene = folder.json("scene.json");
    for detection in scene["detections"].as_array_mut().unwrap() {
        let is_last = detection["object"] == "object_007";
        detection["category"] = if is_last { "lamp" } else { "stone" }.into();
    }
    folder.write_json("scene.json", &scene);
    // Stones of any size: whether they teach anything is up to them.
    let run = folder.run("localize scene.json --learn-sizes --body ellipsoid -o out.json -v");
    assert_eq!(run.code, 0, "{}", run.stderr);
    let result = folder.json("out.json");
    assert_eq!(result["localization"]["settings"]["learn_sizes"], true);
    let learned = result["localization"]["learned_sizes"].as_array().unwrap();
    assert_eq!(learned.len(), 2, "{learned:?}");
    let of = |category: &str| learned.iter().find(|found| found["category"] == category).unwrap();
    assert_eq!((&of("stone")["objects"], &of("lamp")["objects"]), (&7.into(), &1.into()));
    assert!(of("lamp")["size"].is_null() && of("lamp")["well_determined"].as_f64().unwrap() <= 1.0);
    let text = format!("{}{}", run.stdout, run.stderr);
    assert!(text.contains("lamp: no size is learned from 1 object (ellipsoid)"), "{text}");
    // A size that is given is not learned.
    folder.write("priors.toml", "[stone]\nsize = [5.0, 4.0, 3.0]\nsize_sd = [2.0, 2.0, 2.0]\n");
    folder.succeed("localize scene.json --priors priors.toml --learn-sizes --body ellipsoid -o both.json");
    let both = folder.json("both.json");
    let learned = both["localization"]["learned_sizes"].as_array().unwrap();
    assert_eq!(learned.len(), 1, "{learned:?}");
    assert_eq!(
        (&learned[0]["category"], &both["localization"]["settings"]["priors"]),
        (&"lamp".into(), &"priors.toml".into())
    );
}

#[test]
fn refined_poses_are_in_the_result_beside_the_given_ones() {
    let folder = Folder::new();
    folder.succeed("synth -q -o scene.json --objects 12 --views 8 --noise box:0.01 --pose-noise 0.3");
    let scene = folder.json("scene.json");
    for (option, motion) in [("--refine-poses", "auto"), ("--refine-poses=slow", "slow")] {
        folder.succeed(&format!("localize scene.json {option} -o out.json"));
        let result = folder.json("out.json");
        assert_eq!(result["localization"]["settings"]["refine_poses"], motion);
        assert!(result["localization"]["noise"]["pose_rotation"].as_f64().unwrap() > 1e-4);
        assert_eq!(
            result["localization"]["noise"]["pose_correlation_length"],
            if motion == "slow" { 100.0 } else { 0.0 }
        );
        let frames = result["frames"].as_array().unwrap();
        for (frame, given) in frames.iter().zip(scene["frames"].as_array().unwrap()) {
            assert_eq!(frame["given_cam_from_world"], given["cam_from_world"]);
            assert_ne!(frame["cam_from_world"], given["cam_from_world"]);
            let covariance = frame["pose_covariance"].as_array().unwrap();
            assert!(covariance.len() == 6 && covariance[0][0].as_f64().unwrap() > 0.0);
        }
    }
    // The refined poses leave as a trajectory and as a model, which come back.
    folder.succeed("export tum out.json -o trajectory.txt");
    folder.succeed("export colmap out.json -o sparse");
    folder.succeed("import colmap sparse -o model.json");
    folder.write("camera.txt", "500 500 320 240\n");
    folder.succeed("import tum trajectory.txt --intrinsics camera.txt --image-size 640x480 -o poses.json");
    let numbers = |frame: &Value| -> Vec<f64> {
        let rows = frame["cam_from_world"].as_array().unwrap();
        rows.iter().flat_map(|row| row.as_array().unwrap()).map(|x| x.as_f64().unwrap()).collect()
    };
    let refined = folder.json("out.json");
    for read in ["model.json", "poses.json"] {
        let read = folder.json(read);
        let (read, refined) = (read["frames"].as_array().unwrap(), refined["frames"].as_array().unwrap());
        assert_eq!(read.len(), refined.len());
        for (a, b) in read.iter().zip(refined) {
            assert!(numbers(a).iter().zip(numbers(b)).all(|(a, b)| (a - b).abs() < 1e-9), "{a} {b}");
        }
    }
    assert!(folder.run("export tum out.json -o t.txt --camera other").stderr.contains("no frame has the camera"));
    folder.succeed("localize scene.json --refine-poses --fixed-extrinsics -o out.json");
    assert_eq!(folder.json("out.json")["localization"]["settings"]["fixed_extrinsics"], true);
    let refused = folder.run("localize scene.json --fixed-extrinsics");
    assert!(
        refused.code == 2 && refused.stderr.contains("--fixed-extrinsics needs --refine-poses"),
        "{}",
        refused.stderr
    );
    assert_eq!(folder.run("localize scene.json --refine-poses=fast").code, 2);
    assert!(folder.run("localize scene.json --refine-poses --method lfd").stderr.contains("--method posterior only"));
}

#[test]
fn poses_that_contradict_the_boxes_can_be_refined_and_a_wrong_image_size_cannot() {
    let folder = Folder::new();
    let synth = "synth -q --objects 12 --views 20 --trajectory arc:100 --noise box:0.03";
    folder.succeed(&format!("{synth} --pose-noise 0.7 -o scene.json"));
    assert_eq!(folder.run("localize scene.json -o out.json").code, 3);
    let run = folder.run("localize scene.json --refine-poses -o out.json");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stderr.contains("the poses as given contradict the boxes, which miss their object by"),
        "{}",
        run.stderr
    );
    let about = &folder.json("out.json")["localization"];
    assert!(about["diagnosis"]["consistent"] == true && about["localized"] == 12, "{about}");
    folder.succeed(&format!("{synth} -o scene.json"));
    let mut scene = folder.json("scene.json");
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["box"].as_array_mut().unwrap().iter_mut().for_each(|x| *x = (0.9 * x.as_f64().unwrap()).into());
    }
    folder.write_json("scene.json", &scene);
    for option in ["", "--refine-poses", "--refine-poses=independent"] {
        let run = folder.run(&format!("localize scene.json -o out.json {option}"));
        assert!(run.code == 3 && run.stderr.contains("--assume image_size="), "{option}: {}", run.stderr);
    }
}

#[test]
fn priors_act_where_the_unit_is_known() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    scene["length_unit"] = json!("m");
    for (index, detection) in scene["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
        detection["category"] = json!(if index < 6 { "truck" } else { "spaceship" });
    }
    folder.write_json("scene.json", &scene);
    let text = folder.succeed("localize scene.json --priors builtin -o out.json");
    assert!(text.contains("warning: no prior for: spaceship"), "{text}");
    assert!(text.contains("size [m]"), "{text}");
    assert_eq!(folder.json("out.json")["localization"]["settings"]["priors"], "builtin");
    folder.write("priors.toml", "[truck]\nsize = [4.0, 1.0, 1.0]\nsize_sd = [0.01, 0.01, 0.01]\n");
    folder.succeed("localize scene.json --priors priors.toml -o small.json");
    assert_ne!(folder.json("out.json")["objects"][0], folder.json("small.json")["objects"][0]);
    assert_eq!(folder.json("small.json")["localization"]["settings"]["priors"], "priors.toml");
}

#[test]
fn sizes_that_things_do_not_have_are_named_where_lengths_are_meters() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["category"] = json!("cup");
    }
    let warnings = |scene: &Value| {
        folder.write_json("cups.json", scene);
        folder.succeed("localize cups.json -o cups-out.json");
        let objects = folder.json("cups-out.json")["objects"].as_array().unwrap().clone();
        objects.iter().filter(|o| o["warnings"].to_string().contains("implausible size: ")).count()
    };
    assert_eq!(warnings(&scene), 0);
    // Cups of several meters.
    scene["length_unit"] = json!("m");
    assert_eq!(warnings(&scene), 2);
}

#[test]
fn info_tells_what_looks_wrong() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    let detections = scene["detections"].as_array_mut().unwrap();
    detections.truncate(7);
    detections[0]["box"] = json!([-50, 10, 20, 40]);
    detections[1]["box"] = json!([1300, 10, 1400, 40]);
    detections[2].as_object_mut().unwrap().remove("object");
    detections[3]["category"] = json!("cup");
    detections[4]["category"] = json!("mug");
    detections[5]["source"] = json!("yolo");
    detections[6]["source"] = json!("yolo");
    let pose = scene["frames"][0]["cam_from_world"].clone();
    scene["frames"][3] = json!({"id": "bare", "projection": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5]]});
    scene["frames"].as_array_mut().unwrap().push(json!({"id": "last", "camera": "camera", "cam_from_world": pose}));
    scene["cameras"]
        .as_array_mut()
        .unwrap()
        .push(json!({"id": "spare", "model": "SIMPLE_PINHOLE", "params": [100, 50, 50]}));
    scene["detections"][3]["frame"] = json!("bare");
    folder.write_json("scene.json", &scene);
    insta::assert_snapshot!("info", folder.succeed("info scene.json"));
    let report: Value = serde_json::from_str(&folder.succeed("info scene.json --json")).unwrap();
    assert_eq!(report["oddities"].as_array().unwrap().len(), 8, "{report:#}");
    // That detections have no ids is a fact, not a mistake.
    assert_eq!(report["sources"][1]["without_object"], 1);
}

#[test]
fn help_and_completions() {
    let folder = Folder::new();
    assert!(folder.succeed("--help").contains("Exit codes:"));
    assert_eq!(folder.succeed("--version"), format!("quadlift {}\n", env!("CARGO_PKG_VERSION")));
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        assert!(folder.succeed(&format!("completions {shell}")).contains("max-occluded"), "{shell}");
    }
    assert_eq!(folder.run("").code, 2);
    // The other spelling has a hint.
    let run = folder.run("localise scene.json");
    assert!(run.code == 2 && run.stderr.contains("'localize'"), "{}", run.stderr);
    // Options that the help leaves out work.
    folder.write_json("scene.json", &folder.small_scene());
    assert!(!folder.succeed("localize --help").contains("--method"));
    folder.succeed("localize scene.json --method planes");
}

#[test]
fn a_limit_of_pixels_that_no_memory_has_is_refused() {
    let folder = Folder::new();
    folder.write_json("scene.json", &folder.small_scene());
    for pixels in ["1099511627776", "18446744073709551615", "0"] {
        let run = folder.run(&format!("info scene.json --max-pixels {pixels}"));
        assert!(run.code == 2 && run.stderr.contains("is not in 1..=4294967296"), "{}", run.stderr);
    }
    folder.succeed("info scene.json --max-pixels 4294967296");
}

#[test]
fn fixed_cameras_repeat_their_poses_on_purpose() {
    let folder = Folder::new();
    folder.succeed("synth -o hall.json --pedestrians 2 --cameras 4 --time-steps 60 --noise box:0.03 --seed 1");
    let told = folder.succeed("info hall.json");
    assert!(!told.contains("repeat") && told.contains("- the objects move: the cameras are fixed"), "{told}");
    // One camera whose poses were repeated is another thing.
    let mut scene = folder.json("hall.json");
    for frame in scene["frames"].as_array_mut().unwrap() {
        frame["camera"] = json!("cam0");
    }
    folder.write_json("one.json", &scene);
    assert!(folder.succeed("info one.json").contains("repeat the pose of another frame"));
}

/// The commands below "Next".
#[cfg(unix)]
fn next_commands(text: &str) -> Vec<String> {
    let next = text.split_once("Next\n").map_or("", |(_, next)| next);
    next.lines().filter_map(|line| line.find("quadlift ").map(|at| line[at..].to_owned())).collect()
}

#[cfg(unix)]
#[test]
fn what_is_printed_to_be_done_next_works_as_printed() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("my scenes")).unwrap();
    let program = assert_cmd::cargo::cargo_bin("quadlift");
    let path = format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    let shell = |command: &str| {
        let command = command.replace("quadlift view", "quadlift view --no-browser");
        let mut shell = std::process::Command::new("sh");
        let output = shell.args(["-c", &command]).current_dir(folder.path("")).env("PATH", &path).output().unwrap();
        let [stdout, stderr] =
            [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        assert!(output.status.success(), "{command}\n{stdout}{stderr}");
        stdout
    };
    let mut commands = vec![
        "quadlift synth -o 'my scenes/one.json' --objects 3 --views 8 --noise box:0.02".to_owned(),
        "quadlift info 'my scenes/one.json'".to_owned(),
        "quadlift associate 'my scenes/one.json' --ids ignore -o 'my scenes/two.json'".to_owned(),
        "quadlift localize 'my scenes/one.json' --body ellipsoid".to_owned(),
        "quadlift localize 'my scenes/one.json' -o objects.json".to_owned(),
        "quadlift evaluate objects.json 'my scenes/one.json'".to_owned(),
    ];
    let (mut seen, mut done) = (std::collections::BTreeSet::new(), 0);
    while done < commands.len() {
        for next in next_commands(&shell(&commands[done].clone())) {
            if seen.insert(next.clone()) {
                commands.push(next);
            }
        }
        done += 1;
    }
    assert!(seen.len() >= 7, "{seen:?}");
    for kind in ["view", "localize", "export ply"] {
        assert!(seen.iter().any(|command| command.starts_with(&format!("quadlift {kind} "))), "{kind} in {seen:?}");
    }
    assert!(seen.iter().any(|command| command.contains("--body ellipsoid -o objects.json")), "{seen:?}");
}

#[test]
fn tables_fit_a_hundred_columns() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 3 --views 8 --noise box:0.02 --body cuboid --scale 0.05");
    let mut scene = folder.json("scene.json");
    scene["length_unit"] = "m".into();
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["category"] = "car".into();
    }
    folder.write_json("scene.json", &scene);
    folder.succeed("localize scene.json -o estimate.json --body cuboid");
    for command in ["localize scene.json --body cuboid --cross-validate -o e.json", "evaluate estimate.json scene.json"]
    {
        for line in folder.succeed(command).lines() {
            assert!(line.chars().count() <= 100, "{command}: {line}");
        }
    }
}
