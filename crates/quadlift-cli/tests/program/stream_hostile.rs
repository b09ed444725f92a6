//! Streams that are wrong, or meant to do harm: a clear event, and the map goes on.

use crate::common::Folder;
use crate::stream::{folder_with_stream, lines_of, stream};
use serde_json::{Value, json};

/// The error of a line of the output.
fn message(line: &Value) -> &str {
    let event = &line["events"][0];
    assert_eq!(event["type"], "error", "{line}");
    event["message"].as_str().unwrap()
}

#[test]
fn bad_lines_are_told_with_their_numbers_and_change_nothing() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let (good, _, _) = stream(&folder, "stream --map map.json", &lines.concat());
    let frame: Value = serde_json::from_str(&lines[3]).unwrap();
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut frame = frame.clone();
        change(&mut frame);
        frame.to_string()
    };
    let text = frame.to_string();
    let bad = [
        ("not json".to_owned(), "expected a JSON object"),
        (text[..text.len() / 2].to_owned(), "the line ends too early"),
        ("{}".to_owned(), "expected \"frame\", \"frames\", \"poses\" or \"cameras\""),
        (text.replacen("\"time\":2", "\"time\":NaN", 1), "time: NaN is not JSON"),
        (text.replacen("\"box\":[", "\"box\":[Infinity,", 1), "box[0]: Infinity is not JSON"),
        (text.replacen("\"box\":[", "\"box\":[1e999,", 1), "number out of range"),
        (changed(&|f| drop(f.as_object_mut().unwrap().remove("time"))), "there is no \"time\""),
        (changed(&|f| drop(f.as_object_mut().unwrap().remove("frame"))), "there is no \"frame\""),
        (changed(&|f| drop(f.as_object_mut().unwrap().remove("camera"))), "expected \"camera\" and \"cam_from_world\""),
        (changed(&|f| f["camera"] = json!("kamera")), "unknown camera \"kamera\"; did you mean \"camera\"?"),
        (changed(&|f| f["camera"] = json!({"model": "PIN", "params": [1]})), "unknown camera model \"PIN\""),
        (changed(&|f| f["cam_from_world"][0][0] = json!(7)), "is not a rotation"),
        (
            changed(&|f| f["detections"][1]["box"] = json!([30, 20, 10, 40])),
            "detections[1].box: the box [30, 20, 10, 40]",
        ),
        (changed(&|f| f["detections"][1]["box"] = json!([30, 20, 10])), "detections[1].box: found 3 entries"),
        (
            changed(&|f| f["detections"][0] = json!({"category": "cup"})),
            "the detection has none of \"box\", \"outline\"",
        ),
        (
            changed(&|f| f["detections"][0] = json!({"box3d": {"center": [0, 0, 9]}})),
            "detections[0]: there is no \"box\"",
        ),
        (
            changed(&|f| f["detections"][0] = json!({"outline": [[1, 2], [3, 4]]})),
            "detections[0].outline: the outline has 2",
        ),
        (json!({"cue_sources": {"net": {"scale": "row"}}}).to_string(), "cue_sources.net.scale: found \"row\""),
        (changed(&|f| f["detections"][0]["object"] = json!(7)), "ids and names are text"),
        (changed(&|f| f["time"] = json!(-5)), "expected frames in the order of time"),
        (
            changed(&|f| f["pose_noise"] = json!({"rotation_sd": 0, "translation_sd": 1})),
            "expected two numbers above 0",
        ),
        (lines[2].trim_end().to_owned(), "was observed before"),
        (
            json!({"cameras": [{"id": "camera", "model": "PINHOLE", "params": [1, 1, 0, 0]}]}).to_string(),
            "given before",
        ),
        (json!({"poses": [{"frame": "000001"}]}).to_string(), "expected the \"cam_from_world\" of frame \"000001\""),
        ("[".repeat(100_000), "expected a JSON object"),
        (format!("{{\"mine\": {}}}", "[".repeat(100_000)), "mine: this is not valid JSON"),
    ];
    let bad_lines: String = bad.iter().map(|(line, _)| format!("{line}\n")).collect();
    let input = lines[..3].concat() + &bad_lines + &lines[3..].concat();
    let (events, code, told) = stream(&folder, "stream --map with_bad.json", &input);
    assert_eq!(code, 0, "{told}");
    let (errors, frames): (Vec<Value>, Vec<Value>) = events.into_iter().partition(|line| !line["line"].is_null());
    assert_eq!(frames, good);
    assert_eq!(errors.len(), bad.len(), "{errors:?}");
    for (k, (error, (line, words))) in errors.iter().zip(&bad).enumerate() {
        assert_eq!(error["line"], k + 4, "{error}");
        let line: String = line.chars().take(300).collect();
        assert!(message(error).contains(words), "{line}: {error}");
        assert!(message(error).len() < 1300 && !message(error).contains(char::is_control), "{error}");
    }
    assert_eq!(folder.read("with_bad.json"), folder.read("map.json"));
    assert!(told.contains(&format!("{} errors in the input", bad.len())), "{told}");
}

#[test]
fn an_input_without_a_frame_that_can_be_read_fails_and_keeps_the_map() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    stream(&folder, "stream --map map.json", &lines.concat());
    let before = folder.read("map.json");
    let without_time = |line: &String| {
        let mut line: Value = serde_json::from_str(line).unwrap();
        line.as_object_mut().unwrap().remove("time");
        format!("{line}\n")
    };
    let input: String = lines.iter().map(without_time).collect();
    let (events, code, told) = stream(&folder, "stream --map map.json", &input);
    assert_eq!((events.len(), code), (lines.len() - 1, 1), "{told}");
    let expected = format!("error: no frame could be read; {} errors in the input, the first: line 2: ", events.len());
    assert!(told.starts_with(&expected), "{told}");
    assert_eq!(folder.read("map.json"), before);
}

#[test]
fn strict_ends_at_the_first_bad_line_and_writes_the_map() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let input = lines[..13].concat() + "{\"frame\": 7}\n" + &lines[13..].concat();
    let (events, code, told) = stream(&folder, "stream --strict --map map.json", &input);
    assert_eq!(code, 1);
    assert_eq!(events.iter().filter(|line| !line["objects"].is_null()).count(), 12);
    assert!(told.starts_with("error: line 14: frame: found the number `7`"), "{told}");
    assert_eq!(folder.json("map.json")["localization"]["stream"]["frames"], 12);
}

#[test]
fn crowded_frames_and_ids_that_change_meaning_are_taken() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let mut crowded: Value = serde_json::from_str(&lines[5]).unwrap();
    let boxes = (0..5000).map(|k| {
        let (x, y) = (f64::from(k % 100) * 12.0, f64::from(k / 100) * 18.0);
        json!({"box": [x, y, x + 10.0, y + 15.0], "object": "one id for all", "category": format!("c{}", k % 3)})
    });
    crowded["detections"] = Value::Array(boxes.collect());
    let input = lines[..5].concat() + &format!("{crowded}\n") + &lines[6..].concat();
    let (events, code, told) = stream(&folder, "stream --map map.json", &input);
    assert_eq!(code, 0, "{told}");
    let of_crowd = events.iter().find(|line| line["frame"] == crowded["frame"]).unwrap();
    assert_eq!(of_crowd["objects"].as_array().unwrap().len(), 5000);
    // Every frame numbers its boxes anew.
    let mut numbered = vec![lines[0].clone()];
    for (k, line) in lines[1..].iter().enumerate() {
        let mut frame: Value = serde_json::from_str(line).unwrap();
        let detections = frame["detections"].as_array_mut().unwrap();
        let count = detections.len();
        for (i, detection) in detections.iter_mut().enumerate() {
            detection["object"] = json!(((i + k) % count).to_string());
        }
        numbered.push(format!("{frame}\n"));
    }
    let (events, code, _) = stream(&folder, "stream --map numbered.json", &numbered.concat());
    assert_eq!((code, events.iter().filter(|line| !line["line"].is_null()).count()), (0, 0));
    let scores: Value = serde_json::from_str(&folder.succeed("evaluate numbered.json truth.json --json")).unwrap();
    assert!(scores["found"]["matched"].as_u64().unwrap() >= 5, "{scores}");
}

#[test]
fn poses_that_jump_do_not_poison_the_map() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let mut jumped: Value = serde_json::from_str(&lines[15]).unwrap();
    for row in jumped["cam_from_world"].as_array_mut().unwrap() {
        row[3] = json!(row[3].as_f64().unwrap() + 1e6);
    }
    let input = lines[..15].concat() + &format!("{jumped}\n") + &lines[16..].concat();
    let (_, code, told) = stream(&folder, "stream --map map.json", &input);
    assert_eq!(code, 0, "{told}");
    let scores: Value = serde_json::from_str(&folder.succeed("evaluate map.json truth.json --json")).unwrap();
    assert_eq!(scores["found"]["matched"], 6, "{scores}");
}

/// `quadlift stream --map lines.jsonl < lines.jsonl` would lose the recording.
#[test]
fn the_standard_input_is_not_overwritten() {
    let folder = Folder::new();
    folder.write("lines.jsonl", "{}\n");
    let path = folder.path("lines.jsonl");
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_quadlift"))
        .args(["stream", "--map"])
        .arg(&path)
        .stdin(std::fs::File::open(&path).unwrap())
        .output()
        .unwrap();
    let told = String::from_utf8(run.stderr).unwrap();
    assert!(run.status.code() == Some(2) && told.contains("lines.jsonl, the standard input"), "{told}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "{}\n");
}

#[test]
fn wrong_usage_is_refused_before_anything_is_read() {
    let folder = Folder::new();
    folder.write_json("scene.json", &folder.small_scene());
    for (arguments, words) in [
        ("stream scene.json --map scene.json", "would overwrite the scene scene.json"),
        ("stream scene.json --map -", "events go to the standard output"),
        ("stream scene.json --map map.ply", "the result is a JSON file"),
        ("stream scene.json --map map.json --state map.json", "would overwrite map.json"),
        ("stream scene.json --save-every 10", "neither is given"),
        ("stream scene.json --resume", "--state"),
        ("stream scene.json --min-views 1", "views"),
        ("stream scene.json --max-views 2", "a whole number of at least 4"),
        ("stream scene.json --save-every 0 --map map.json", "invalid value '0'"),
    ] {
        let run = folder.run(arguments);
        assert!(run.code == 2 && run.stderr.contains(words), "{arguments}: {} {}", run.code, run.stderr);
        assert_eq!((run.stdout.as_str(), folder.names()), ("", vec!["scene.json".to_owned()]), "{arguments}");
    }
    for (arguments, words) in [
        ("stream no.jsonl", "no.jsonl: there is no such file"),
        ("stream no.json", "no.json: there is no such file"),
        ("stream scene.json --map no/map.json", "the folder no does not exist"),
        ("stream scene.json --priors builtin --map map.json", "the length unit of the scene is not given"),
    ] {
        let run = folder.run(arguments);
        assert!(run.code == 1 && run.stderr.contains(words), "{arguments}: {} {}", run.code, run.stderr);
    }
}
