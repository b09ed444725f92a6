//! `quadlift stream` through the built program: replay, lines, ends of all kinds, going on.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::common::Folder;
use serde_json::{Value, json};

/// A scene of six objects whose detections have no ids, with its truth, and the same as lines.
pub(crate) fn folder_with_stream() -> Folder {
    let folder = Folder::new();
    folder.succeed(
        "synth -q -o scene.json --ground-truth truth.json --no-ids --objects 6 --views 20 --seed 2 --noise box:0.03",
    );
    let mut scene = folder.json("scene.json");
    // As detectors write them; the map keeps boxes in single precision.
    for detection in scene["detections"].as_array_mut().unwrap() {
        for edge in detection["box"].as_array_mut().unwrap() {
            *edge = json!((edge.as_f64().unwrap() * 100.0).round() / 100.0);
        }
    }
    folder.write_json("scene.json", &scene);
    folder.write("scene.jsonl", lines_of(&scene).join(""));
    folder
}

/// The lines of a scene: one with the cameras, and one for each frame.
pub(crate) fn lines_of(scene: &Value) -> Vec<String> {
    let about = json!({"name": scene["name"], "up": scene["up"], "cameras": scene["cameras"]});
    let mut lines = vec![format!("{about}\n")];
    for (index, frame) in scene["frames"].as_array().unwrap().iter().enumerate() {
        let of_frame = |d: &&Value| d["frame"] == frame["id"];
        let detections: Vec<&Value> = scene["detections"].as_array().unwrap().iter().filter(of_frame).collect();
        let detections: Vec<Value> = detections.iter().map(|d| json!({"box": d["box"]})).collect();
        let line = json!({
            "frame": frame["id"], "time": index, "camera": frame["camera"], "cam_from_world": frame["cam_from_world"],
            "detections": detections,
        });
        lines.push(format!("{line}\n"));
    }
    lines
}

fn program(folder: &Folder, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_quadlift"));
    command.current_dir(folder.path("")).args(arguments.split_whitespace());
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs the program with a text on its standard input; gives its output and exit code.
pub(crate) fn stream(folder: &Folder, arguments: &str, input: &str) -> (Vec<Value>, i32, String) {
    let mut child = program(folder, arguments).spawn().unwrap();
    let mut to_child = child.stdin.take().unwrap();
    let input = input.to_owned();
    // The program may end before it has read all.
    let writer = std::thread::spawn(move || drop(to_child.write_all(input.as_bytes())));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    let lines = String::from_utf8(output.stdout).unwrap();
    let lines = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    (lines, output.status.code().unwrap_or(-1), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_scene_is_replayed_and_its_map_is_a_result() {
    let folder = folder_with_stream();
    let events = folder.succeed("stream scene.json --map map.json --report map.html");
    assert_eq!(events.lines().filter(|line| line.contains("\"frame\":")).count(), 20);
    assert_eq!(events.matches("\"confirmed\"").count(), 6, "{events}");
    let scores: Value = serde_json::from_str(&folder.succeed("evaluate map.json truth.json --json")).unwrap();
    assert_eq!(scores["found"]["matched"], 6, "{scores}");
    let map = folder.json("map.json");
    let ids: Vec<&str> = map["objects"].as_array().unwrap().iter().map(|o| o["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["object_0001", "object_0002", "object_0003", "object_0004", "object_0005", "object_0006"]);
    let memory = &map["objects"][0]["memory"];
    assert_eq!((&memory["presence"], &memory["last_seen"]), (&json!("confirmed"), &json!(19.0)), "{memory}");
    // Frames and boxes are those of the scene.
    let scene = folder.json("scene.json");
    for (of_map, given) in map["frames"].as_array().unwrap().iter().zip(scene["frames"].as_array().unwrap()) {
        assert_eq!(of_map["cam_from_world"], given["cam_from_world"]);
    }
    let given = scene["detections"].as_array().unwrap();
    let is_given = |of_map: &Value| given.iter().any(|d| d["frame"] == of_map["frame"] && d["box"] == of_map["box"]);
    assert!(map["detections"].as_array().unwrap().iter().all(is_given));
    assert!(folder.read("map.html").contains("object_0006"));
    folder.succeed("export ply map.json -o map.ply");
    folder.succeed("view map.json truth.json --no-browser");
    folder.succeed("localize map.json -o again.json --quiet");
    assert_eq!(folder.json("again.json")["localization"]["localized"], 6);
}

#[test]
fn lines_give_what_the_scene_gives_and_writing_on_the_way_changes_nothing() {
    let folder = folder_with_stream();
    let replayed = folder.succeed("stream scene.json --map map.json -q");
    let text = folder.read("scene.jsonl");
    assert_eq!(folder.succeed("stream scene.jsonl --map lines.json -q"), replayed);
    let (lines, code, _) = stream(&folder, "stream --map input.json --state state --save-every 3", &text);
    assert_eq!(code, 0);
    let replayed: Vec<Value> = replayed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines, replayed);
    for name in ["lines.json", "input.json"] {
        assert_eq!(folder.read(name), folder.read("map.json"), "{name}");
    }
    // Both frames of a time step in one line, with the camera in one of them.
    let scene = folder.json("scene.json");
    let mut frames: Vec<Value> = text.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect();
    frames[0]["camera"] = scene["cameras"][0].clone();
    let pairs = frames.chunks(2).enumerate().map(|(k, pair)| {
        let mut pair = pair.to_vec();
        pair.iter_mut().for_each(|frame| drop(frame.as_object_mut().unwrap().remove("time")));
        format!("{}\n", json!({"time": k, "frames": pair}))
    });
    let (lines, code, _) = stream(&folder, "stream -", &pairs.collect::<String>());
    assert_eq!(code, 0);
    let objects = |lines: &[Value]| lines.iter().map(|line| line["objects"].clone()).collect::<Vec<_>>();
    assert_eq!(objects(&lines), objects(&replayed));
}

/// The lines of a scene with the depths and 3D boxes of its detections.
fn lines_with_cues(scene: &Value) -> Vec<String> {
    let mut lines = lines_of(scene);
    for (line, frame) in lines[1..].iter_mut().zip(scene["frames"].as_array().unwrap()) {
        let mut value: Value = serde_json::from_str(line).unwrap();
        let of_frame = scene["detections"].as_array().unwrap().iter().filter(|d| d["frame"] == frame["id"]);
        for (detection, given) in value["detections"].as_array_mut().unwrap().iter_mut().zip(of_frame) {
            (detection["depth"], detection["box3d"]) = (given["depth"].clone(), given["box3d"].clone());
        }
        *line = format!("{value}\n");
    }
    lines
}

#[test]
fn outlines_oriented_boxes_and_scales_of_frames_reach_the_map_and_the_estimates() {
    let folder = Folder::new();
    folder.succeed(
        "synth -q -o scene.json --ground-truth truth.json --no-ids --objects 6 --views 12 --seed 2 --noise box:0.03 \
         --cues outline,oriented_box,depth --cue-noise outline:0.02 --cue-noise angle:1",
    );
    let mut scene = folder.json("scene.json");
    scene["cue_sources"] = json!({"depth": {"scale": "frame"}});
    // An outline, an oriented box, or an outline beside a box.
    for (k, detection) in scene["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
        let dropped = [["box", "oriented_box"], ["box", "outline"], ["oriented_box", "oriented_box"]][k % 3];
        dropped.iter().for_each(|name| drop(detection.as_object_mut().unwrap().remove(*name)));
    }
    folder.write_json("scene.json", &scene);
    let mut lines = lines_of(&scene);
    let mut first: Value = serde_json::from_str(&lines[0]).unwrap();
    first["cue_sources"] = scene["cue_sources"].clone();
    lines[0] = format!("{first}\n");
    for (line, frame) in lines[1..].iter_mut().zip(scene["frames"].as_array().unwrap()) {
        let mut value: Value = serde_json::from_str(line).unwrap();
        let of_frame = scene["detections"].as_array().unwrap().iter().filter(|d| d["frame"] == frame["id"]);
        value["detections"] = of_frame.cloned().collect();
        *line = format!("{value}\n");
    }
    for line in &lines {
        assert_eq!(crate::stream_schema::forbidden("input", &serde_json::from_str(line).unwrap()), None, "{line}");
    }
    folder.write("scene.jsonl", lines.join(""));
    folder.succeed("stream scene.jsonl -q --map lines.json");
    folder.succeed("stream scene.json -q --map map.json");
    assert_eq!(folder.read("map.json"), folder.read("lines.json"));
    let map = folder.json("map.json");
    let kept = map["detections"].as_array().unwrap();
    assert!(kept.len() > 40, "{}", kept.len());
    let with = |fields: &[&str]| kept.iter().filter(|d| fields.iter().all(|name| !d[*name].is_null())).count();
    let without_box = kept.iter().filter(|d| d["box"].is_null()).count();
    assert!(with(&["outline", "box"]) > 10 && with(&["oriented_box"]) > 10 && without_box > 20, "{kept:?}");
    assert_eq!(map["cue_sources"], json!({"depth": {"scale": "frame"}}));
    let scales = map["localization"]["cue_scales"].as_array().unwrap();
    assert!(scales.iter().any(|scale| !scale["frame"].is_null()), "{scales:?}");
    // The kept views give the estimates of the map, without the means of forgotten views.
    folder.succeed("localize map.json -q -o again.json");
    for (a, b) in
        map["objects"].as_array().unwrap().iter().zip(folder.json("again.json")["objects"].as_array().unwrap())
    {
        for k in 0..3 {
            let [a, b] = [a, b].map(|o| o["center"][k].as_f64().unwrap());
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }
    // In two parts, from a state.
    folder.write("first.jsonl", lines[..8].join(""));
    folder.succeed("stream first.jsonl -q --state state.json");
    folder.succeed("stream scene.jsonl -q --state state.json --resume --map parts.json");
    assert_eq!(folder.read("parts.json"), folder.read("lines.json"));
}

#[test]
fn depths_and_3d_boxes_reach_the_map_the_state_and_the_estimates() {
    let folder = Folder::new();
    folder.succeed(
        "synth -q -o scene.json --ground-truth truth.json --no-ids --objects 6 --views 20 --seed 2 --noise box:0.03 \
         --cues depth,box3d",
    );
    let scene = folder.json("scene.json");
    let lines = lines_with_cues(&scene);
    folder.write("scene.jsonl", lines.join(""));
    for line in &lines {
        assert_eq!(crate::stream_schema::forbidden("input", &serde_json::from_str(line).unwrap()), None, "{line}");
    }
    folder.succeed("stream scene.jsonl -q --map lines.json");
    folder.succeed("stream scene.json -q --map map.json");
    assert_eq!(folder.read("map.json"), folder.read("lines.json"));
    let map = folder.json("map.json");
    let kept = map["detections"].as_array().unwrap();
    assert!(kept.len() > 100, "{}", kept.len());
    for detection in kept {
        let depth = |d: &&Value| d["frame"] == detection["frame"] && d["depth"] == detection["depth"];
        let given = scene["detections"].as_array().unwrap().iter().find(depth).unwrap();
        assert_eq!(given["box3d"]["center"], detection["box3d"]["center"]);
        assert_eq!(given["box3d"]["source"], detection["box3d"]["source"]);
    }
    let scales = map["localization"]["cue_scales"].as_array().unwrap();
    let of_depth = scales.iter().find(|scale| scale["quantity"] == "depth").unwrap();
    assert_eq!(of_depth["source"], "depth");
    // All objects are about 200 away, which tells what is measured there, not a factor apart from a shift.
    let [factor, shift, shift_sd] = ["factor", "shift", "shift_sd"].map(|key| of_depth[key].as_f64().unwrap());
    assert!((factor + shift / 200.0 - 1.1).abs() < 0.01 && shift.abs() < 2.0 * shift_sd, "{scales:?}");
    // In two parts, from a state.
    folder.write("first.jsonl", lines[..12].join(""));
    folder.succeed("stream first.jsonl -q --state state.json");
    folder.succeed("stream scene.jsonl -q --state state.json --resume --map again.json");
    assert_eq!(folder.read("again.json"), folder.read("lines.json"));
    // The corrected world is a hundred times smaller, and so are its lengths.
    folder.succeed("localize scene.json -q -o meters.json --assume pose_unit=cm");
    let sizes = |path: &str, factor: f64| -> Vec<i64> {
        let axes = folder.json(path)["objects"].as_array().unwrap().clone();
        let axes = axes.iter().map(|o| o["body"]["half_extents"][0].as_f64().unwrap() * factor * 1e3);
        let mut axes: Vec<i64> = axes.map(|x| x.round() as i64).collect();
        axes.sort_unstable();
        axes
    };
    folder.succeed("localize scene.json -q -o given.json");
    assert_eq!(sizes("meters.json", 100.0), sizes("given.json", 1.0));
}

#[test]
fn an_empty_input_gives_an_empty_map() {
    let folder = Folder::new();
    for input in ["", "\n  \n"] {
        let (lines, code, told) = stream(&folder, "stream --map map.json --state state --report map.html", input);
        assert_eq!((lines.len(), code), (0, 0), "{told}");
        assert!(folder.json("map.json")["objects"].is_null() && folder.path("map.html").exists());
    }
    let (_, code, _) = stream(&folder, "stream --state state --resume", "");
    assert_eq!(code, 0);
}

#[test]
fn new_poses_move_the_map() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let (_, _, _) = stream(&folder, "stream --map map.json", &lines.concat());
    // The whole world is moved by one unit along x, after all frames.
    let frames: Vec<Value> = lines[1..].iter().map(|line| serde_json::from_str(line).unwrap()).collect();
    let poses = frames.iter().map(|frame| {
        let mut pose = frame["cam_from_world"].clone();
        for row in pose.as_array_mut().unwrap() {
            row[3] = json!(row[3].as_f64().unwrap() - row[0].as_f64().unwrap());
        }
        json!({"frame": frame["frame"], "cam_from_world": pose})
    });
    let poses = format!("{}\n", json!({"poses": poses.collect::<Vec<_>>()}));
    let (events, code, _) = stream(&folder, "stream --map moved.json --state state", &(lines.concat() + &poses));
    assert_eq!(code, 0);
    assert!(events.iter().any(|line| line["poses"] == 20), "{events:?}");
    let [map, moved] = ["map.json", "moved.json"].map(|name| folder.json(name)["objects"].clone());
    for (before, after) in map.as_array().unwrap().iter().zip(moved.as_array().unwrap()) {
        let x = |object: &Value| object["center"][0].as_f64().unwrap();
        assert!((x(after) - x(before) - 1.0).abs() < 0.05, "{} {}", before["center"], after["center"]);
    }
    // Going on passes the poses over, too.
    let (events, _, _) = stream(&folder, "stream --map again.json --state state --resume", &(lines.concat() + &poses));
    assert!(events.iter().all(|line| line["frame"].is_null() && line["poses"].is_null()), "{events:?}");
    assert_eq!(folder.read("again.json"), folder.read("moved.json"));
}

/// A map whose frames were others, or whose numbers were changed, would be wrong from there on.
#[test]
fn a_state_goes_on_with_its_own_recording_only() {
    let folder = folder_with_stream();
    let scene = folder.json("scene.json");
    let lines = lines_of(&scene);
    folder.write("first.jsonl", lines[..12].concat());
    folder.succeed("stream first.jsonl -q --state state");
    let state = folder.read("state");
    let refused = |lines: &[String], expected: &str| {
        let (events, code, told) = stream(&folder, "stream --state state --resume", &lines.concat());
        assert!(code == 1 && events.is_empty() && told.contains(expected), "{code} {told}");
        assert_eq!(folder.read("state"), state, "{expected}");
    };
    let mut moved = scene.clone();
    moved["frames"][5]["cam_from_world"][0][3] = json!(0.5);
    let expected = format!("frame {} has another pose or other boxes", scene["frames"][5]["id"]);
    refused(&lines_of(&moved), &expected);
    let mut other = scene.clone();
    for frame in other["frames"].as_array_mut().unwrap() {
        frame["id"] = json!(format!("other {}", frame["id"]));
    }
    refused(&lines_of(&other), "the state knows none of the 11 frames up to its time 10");
    // What has not been observed may be anything.
    let (events, code, told) = stream(&folder, "stream --state state --resume", &lines[12..].concat());
    assert!(code == 0 && events.iter().filter(|line| !line["frame"].is_null()).count() == 9, "{told}");
}

#[test]
fn a_state_with_another_digit_is_damaged() {
    let folder = folder_with_stream();
    folder.succeed("stream scene.jsonl -q --state state");
    let state = folder.read("state");
    let digits: Vec<usize> =
        state.bytes().enumerate().filter(|(_, byte)| byte.is_ascii_digit()).map(|(k, _)| k).collect();
    for place in digits.iter().step_by(digits.len() / 20) {
        let digit = if state.as_bytes()[*place] == b'7' { "3" } else { "7" };
        folder.write("damaged", format!("{}{digit}{}", &state[..*place], &state[place + 1..]));
        let (_, code, told) = stream(&folder, "stream --state damaged --resume", "");
        assert!(code == 1 && told.contains("damaged") || told.contains("version"), "{place}: {code} {told}");
    }
}

/// Reads lines of the output until so many frames are done.
fn wait_for_frames(child: &mut Child, frames: usize) -> BufReader<std::process::ChildStdout> {
    let mut out = BufReader::new(child.stdout.take().unwrap());
    for _ in 0..frames {
        let mut line = String::new();
        assert!(out.read_line(&mut line).unwrap() > 0);
    }
    out
}

#[test]
fn a_closed_output_ends_the_stream_and_the_map_is_written() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let mut child = program(&folder, "stream --map map.json").spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    input.write_all(lines[..12].concat().as_bytes()).unwrap();
    drop(wait_for_frames(&mut child, 11));
    // Nobody reads any more; the input stays open.
    assert!((0..10_000).any(|_| input.write_all(lines[12].as_bytes()).is_err()), "the stream goes on");
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(folder.json("map.json")["localization"]["stream"]["frames"].as_u64().unwrap() >= 11);
}

#[cfg(unix)]
fn send(signal: &str, child: &Child) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

#[cfg(unix)]
#[test]
fn signals_end_the_stream_and_the_map_is_written() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    for signal in ["-INT", "-TERM", "-HUP"] {
        let mut child = program(&folder, "stream --map map.json --state state").spawn().unwrap();
        let mut input = child.stdin.take().unwrap();
        input.write_all(lines[..12].concat().as_bytes()).unwrap();
        let mut out = wait_for_frames(&mut child, 11);
        // The input stays open: the program waits for a line.
        send(signal, &child);
        let mut rest = String::new();
        out.read_to_string(&mut rest).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0), "{signal}");
        assert_eq!(folder.json("map.json")["localization"]["stream"]["frames"], 11, "{signal}");
        assert_eq!(folder.names(), ["map.json", "scene.json", "scene.jsonl", "state", "truth.json"]);
        std::fs::remove_file(folder.path("map.json")).unwrap();
    }
    stream(&folder, "stream --map map.json --state state --resume", &lines.concat());
    stream(&folder, "stream --map whole.json", &lines.concat());
    assert_eq!(folder.read("map.json"), folder.read("whole.json"));
}

#[cfg(unix)]
#[test]
fn a_stream_that_was_killed_goes_on_to_the_same_bytes() {
    let folder = folder_with_stream();
    let lines = lines_of(&folder.json("scene.json"));
    let (whole, _, _) = stream(&folder, "stream --map whole.json --state whole.state", &lines.concat());
    for (round, frames) in [1, 2, 5, 9, 14, 19].into_iter().enumerate() {
        let arguments = "stream --map map.json --state state --save-every 1";
        let mut child = program(&folder, arguments).spawn().unwrap();
        let mut input = child.stdin.take().unwrap();
        input.write_all(lines.concat().as_bytes()).unwrap();
        let _out = wait_for_frames(&mut child, frames);
        // At different places between two lines: files may be half written.
        std::thread::sleep(Duration::from_millis(3 * round as u64));
        send("-KILL", &child);
        child.wait().unwrap();
        if folder.path("map.json").exists() {
            assert!(folder.json("map.json")["localization"]["stream"]["frames"].as_u64().unwrap() + 1 >= frames as u64);
        }
        let (rest, code, told) = stream(&folder, &format!("{arguments} --resume"), &lines.concat());
        assert_eq!(code, 0, "{told}");
        assert!(rest.len() <= whole.len() - frames + 1 && whole.ends_with(&rest), "{frames}: {rest:?}");
        assert_eq!(folder.read("map.json"), folder.read("whole.json"), "{frames}");
        assert_eq!(folder.read("state"), folder.read("whole.state"), "{frames}");
        for name in ["map.json", "state"] {
            std::fs::remove_file(folder.path(name)).unwrap();
        }
    }
    // Nothing else is left.
    assert_eq!(folder.names(), ["scene.json", "scene.jsonl", "truth.json", "whole.json", "whole.state"]);
}

#[test]
fn a_state_goes_on_with_the_same_options_and_must_be_whole() {
    let folder = folder_with_stream();
    folder.succeed("stream scene.json --state state -q");
    let refused = folder.run("stream scene.json --state state --resume --min-views 4");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("the state was made with --min-views 3, and now it is 4"), "{}", refused.stderr);
    let text = folder.read("state");
    for cut in (1..text.len()).step_by(text.len() / 20) {
        folder.write("cut", &text[..cut]);
        let run = folder.run("stream scene.json --state cut --resume");
        assert!(run.code == 1 && run.stderr.starts_with("error: cut: "), "{cut}: {}", run.stderr);
        assert_eq!(folder.read("cut").len(), cut);
    }
    let run = folder.run("stream scene.json --state scene.json --resume");
    assert!(run.code == 2 && run.stderr.contains("would overwrite the scene"), "{}", run.stderr);
}

/// `--rerun` with programs in the place of Python; examples/test_stream_rerun.py has the real one.
#[cfg(unix)]
#[test]
fn what_happens_to_rerun_does_not_change_the_stream() {
    use std::os::unix::fs::PermissionsExt;

    let folder = folder_with_stream();
    let plain = folder.succeed("stream scene.jsonl -q");
    let run = |script: &str| {
        folder.write("python", format!("#!/bin/sh\n{script}\n"));
        std::fs::set_permissions(folder.path("python"), std::fs::Permissions::from_mode(0o755)).unwrap();
        let mut command = program(&folder, "stream scene.jsonl --rerun=out.rrd");
        let output = command.env("QUADLIFT_PYTHON", folder.path("python")).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (text(output.stdout), output.status.code(), text(output.stderr))
    };
    let (events, code, told) = run("head -c 10 > taken; echo done");
    assert_eq!((events.as_str(), code), ("", Some(1)), "{told}");
    let (events, code, told) = run("echo ready; cat > taken; echo done");
    assert_eq!((&events, code), (&plain, Some(0)), "{told}");
    assert!(!told.contains("warning"), "{told}");
    // What it is told: the script, the target, and a record for each frame and for the end.
    let taken = folder.read("taken");
    let records: Vec<Value> = taken.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    assert_eq!(records[0], json!({"name": "scene.jsonl", "file": "out.rrd", "address": null}));
    assert_eq!(records.iter().filter(|record| record["frame"].is_object()).count(), 20);
    for (script, reason) in [
        ("echo ready", "the Python process has ended"),
        ("echo ready; cat > taken", "the Python process has ended"),
        ("echo ready; echo 'error: the viewer has gone'", "the viewer has gone"),
        ("echo ready; cat > taken; echo 'error: the viewer has gone'", "the viewer has gone"),
    ] {
        let (events, code, told) = run(script);
        assert_eq!((&events, code), (&plain, Some(0)), "{script}: {told}");
        let warning = format!("warning: Rerun shows no more of the stream, which goes on without it: {reason}\n");
        assert_eq!(told.matches(&warning).count(), 1, "{script}: {told}");
    }
    for (script, problem) in [("echo 'error: no module'", "--rerun: no module"), ("exit 3", "it needs Rerun's SDK")] {
        let (events, code, told) = run(script);
        assert_eq!((events.as_str(), code), ("", Some(1)), "{script}");
        assert!(told.contains(problem), "{script}: {told}");
    }
    let mut command = program(&folder, "stream scene.jsonl --rerun");
    let output = command.env("QUADLIFT_PYTHON", "no-python").output().unwrap();
    assert!(
        String::from_utf8(output.stderr).unwrap().contains("cannot start no-python (QUADLIFT_PYTHON names another)")
    );
}

/// A scene of twelve objects seen once around, without ids; `change` is made to each pose.
fn around(folder: &Folder, name: &str, change: impl Fn(usize, &mut [Vec<f64>])) {
    folder.succeed(
        "synth -q -o right.json --no-ids --trajectory orbit --cube 40 --objects 12 --views 60 --noise box:0.05 --seed 1",
    );
    let mut scene = folder.json("right.json");
    for (index, frame) in scene["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
        let mut rows: Vec<Vec<f64>> = serde_json::from_value(frame["cam_from_world"].clone()).unwrap();
        change(index, &mut rows);
        frame["cam_from_world"] = json!(rows);
    }
    folder.write_json(name, &scene);
}

/// OpenGL's axes.
fn to_opengl(rows: &mut [Vec<f64>]) {
    rows[1..].iter_mut().flatten().for_each(|x| *x = -*x);
}

#[test]
fn poses_in_other_axes_are_told_once_and_no_object_is_ok() {
    let folder = Folder::new();
    around(&folder, "all.json", |_, rows| to_opengl(rows));
    around(&folder, "half.json", |k, rows| {
        if k % 2 == 1 {
            to_opengl(rows)
        }
    });
    for (name, words) in
        [("all.json", "the cameras have OpenGL axes"), ("half.json", "% of the frames (000001, 000003")]
    {
        for files in ["", " --map map.json"] {
            let (lines, code, told) = stream(&folder, &format!("stream {name}{files}"), "");
            assert_eq!(code, 3, "{name}{files}: {told}");
            let events = lines.iter().flat_map(|line| line["events"].as_array().unwrap());
            let found: Vec<&Value> = events.filter(|event| event["type"] == "inconsistent").collect();
            assert_eq!(found.len(), 1, "{name}: {found:?}");
            assert_eq!(found[0]["causes"][0], "opengl_axes");
            assert!(found[0]["message"].as_str().unwrap().contains(words), "{name}: {found:?}");
            assert!(
                told.contains(&format!("error: {name}: the scene is inconsistent: ")) && told.contains(words),
                "{told}"
            );
            // `stream` has no option that corrects it.
            assert!(!told.contains("--assume"), "{told}");
            assert!(lines.iter().all(|line| super::stream_schema::forbidden("output", line).is_none()));
        }
        let map = folder.json("map.json");
        assert_eq!(map["localization"]["diagnosis"]["consistent"], false);
        assert_eq!(map["localization"]["localized"], 0);
        let mut objects = map["objects"].as_array().into_iter().flatten();
        assert!(objects.all(|object| object["status"] != "ok"), "{map}");
    }
}

#[test]
fn right_poses_are_not_told() {
    let folder = Folder::new();
    around(&folder, "scene.json", |_, _| {});
    for files in ["", " --map map.json --report map.html"] {
        let (lines, code, told) = stream(&folder, &format!("stream scene.json{files}"), "");
        assert_eq!(code, 0, "{told}");
        assert!(!lines.iter().any(|line| line.to_string().contains("inconsistent")));
        assert!(!told.contains("error") && !told.contains("warning"), "{told}");
    }
    assert_eq!(folder.json("map.json")["localization"]["diagnosis"]["consistent"], true);
}

#[test]
fn a_stream_that_goes_on_tells_an_inconsistency_no_second_time() {
    let folder = Folder::new();
    around(&folder, "scene.json", |_, rows| to_opengl(rows));
    let lines = lines_of(&folder.json("scene.json"));
    let part = |range: std::ops::Range<usize>| lines[..1].iter().chain(&lines[range]).cloned().collect::<String>();
    let told = |lines: &[Value]| lines.iter().filter(|line| line.to_string().contains("\"inconsistent\"")).count();
    let arguments = "stream --state state --resume --map parts.json";
    let (first, code, _) = stream(&folder, arguments, &part(1..41));
    assert_eq!((told(&first), code), (1, 3));
    let (second, code, _) = stream(&folder, arguments, &part(41..61));
    assert_eq!((told(&second), code), (0, 3));
    assert_eq!(stream(&folder, "stream --map whole.json", &part(1..61)).1, 3);
    assert_eq!(folder.read("parts.json"), folder.read("whole.json"));
}
