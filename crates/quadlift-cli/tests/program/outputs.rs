//! Where results go: odd outputs, files that must not be overwritten, and ends by signals.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::common::Folder;
use serde_json::{Value, json};

fn program(folder: &Folder) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_quadlift"));
    command.current_dir(folder.path("")).stdin(Stdio::null());
    command
}

/// A folder with a scene and its result.
fn with_result() -> Folder {
    let folder = Folder::new();
    folder.write_json("scene.json", &folder.small_scene());
    folder.succeed("localize scene.json -o result.json --quiet");
    folder
}

#[test]
fn control_characters_in_the_unit_of_length_are_escaped() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    scene["length_unit"] = json!("m\n\u{1b}[31m");
    folder.write_json("scene.json", &scene);
    let run = folder.run("localize scene.json -o result.json");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.contains("[m\\n\\u{1b}[31m]"), "{}", run.stdout);
}

#[test]
fn results_are_appended_to_the_standard_output_by_any_of_its_names() {
    let folder = with_result();
    folder.succeed("export csv result.json -o plain.csv");
    let csv = folder.read("plain.csv");
    symlink("/dev/stdout", folder.path("link")).unwrap();
    for name in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "-", "link"] {
        folder.write("all.csv", "earlier\n");
        let all = OpenOptions::new().append(true).open(folder.path("all.csv")).unwrap();
        let run = program(&folder).args(["export", "csv", "result.json", "-o", name]).stdout(all).output().unwrap();
        let told = String::from_utf8(run.stderr).unwrap();
        assert!(run.status.success() && told.contains("wrote"), "{told}");
        assert_eq!(folder.read("all.csv"), format!("earlier\n{csv}"), "{name}");
        // To a pipe.
        assert_eq!(folder.run_list(&["export", "csv", "result.json", "-o", name]).stdout, csv, "{name}");
    }
    assert!(!folder.path("-").exists());
    let run = folder.run("localize scene.json -o - --json");
    assert_eq!(run.code, 2, "{}", run.stderr);
    let run = folder.run("localize scene.json -o -");
    assert_eq!(run.stdout, folder.read("result.json"));
}

#[test]
fn files_that_a_run_reads_or_that_its_scene_names_are_not_overwritten() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    folder.succeed("localize scene.json -o result.json --quiet");
    folder.write("priors.json", "[car]\nsize_mean = [4.0, 1.8, 1.5]\nsize_sd = [0.4, 0.1, 0.1]\n");
    std::fs::hard_link(folder.path("scene.json"), folder.path("hard.json")).unwrap();
    std::fs::hard_link(folder.path("images/000000.png"), folder.path("photo")).unwrap();
    symlink("images/000000.png", folder.path("link.png")).unwrap();
    folder.write("in/a.json", folder.read("scene.json"));
    folder.write("other/b.json", folder.read("scene.json"));
    std::fs::create_dir(folder.path("out")).unwrap();
    std::fs::hard_link(folder.path("other/b.json"), folder.path("out/a.json")).unwrap();
    std::fs::hard_link(folder.path("in/a.json"), folder.path("out/b.json")).unwrap();
    for (arguments, words) in [
        ("render scene.json --frame 000000 -o images/000000.png", "is an image or mask of a scene"),
        ("render scene.json --frame 000000 -o link.png", "is an image or mask of a scene"),
        ("localize scene.json -o photo", "is an image or mask of a scene"),
        ("localize scene.json -o hard.json", "overwrite the scene scene.json"),
        ("localize scene.json --report images/000001.png", "is an image or mask of a scene"),
        ("localize scene.json --report masks/000000.png", "is an image or mask of a scene"),
        ("localize scene.json --report hard.json", "overwrite the scene scene.json"),
        ("segment scene.json -o photo", "is an image or mask of a scene"),
        ("segment scene.json -o out.json --report photo", "is an image or mask of a scene"),
        ("associate scene.json -o photo", "is an image or mask of a scene"),
        ("localize scene.json --noise-model result.json -o result.json", "overwrite result.json, which is an input"),
        ("localize scene.json --priors priors.json -o priors.json", "overwrite priors.json, which is an input"),
        ("export csv result.json -o a.csv --views result.json", "overwrite the scene result.json"),
        ("evaluate result.json scene.json --report scene.json", "would overwrite"),
        ("localize in/a.json other/b.json -o out", "overwrite the scene"),
    ] {
        let names =
            ["scene.json", "result.json", "priors.json", "images/000000.png", "images/000001.png", "masks/000000.png"];
        let before: Vec<Vec<u8>> = names.iter().map(|name| std::fs::read(folder.path(name)).unwrap()).collect();
        let run = folder.run(arguments);
        assert!(run.code != 0 && run.stderr.contains(words), "{arguments}: {} {}", run.code, run.stderr);
        for (name, before) in names.iter().zip(before) {
            assert!(std::fs::read(folder.path(name)).unwrap() == before, "{arguments} has changed {name}");
        }
    }
    // What is meant to be changed in place.
    folder.write("boxes.csv", "image,x1,y1,x2,y2,label\n000000,10,10,60,60,car\n");
    folder.succeed("import csv boxes.csv --into scene.json -o scene.json");
    let run = folder.run("import csv boxes.csv --into scene.json -o boxes.csv");
    assert!(run.code == 2 && run.stderr.contains("which is an input"), "{}", run.stderr);
}

#[test]
fn an_output_may_have_the_name_of_an_option() {
    let folder = with_result();
    folder.write("output", "earlier");
    folder.succeed("localize scene.json -o output");
    assert_eq!(folder.read("output"), folder.read("result.json"));
}

#[test]
fn a_demo_does_not_overwrite_files() {
    let folder = Folder::new();
    folder.write("d/scene.json", "mine");
    let run = folder.run("demo --out d");
    assert!(run.code == 1 && run.stderr.contains("d/scene.json exists already"), "{}", run.stderr);
    assert_eq!(folder.read("d/scene.json"), "mine");
    assert_eq!(std::fs::read_dir(folder.path("d")).unwrap().count(), 1);
}

#[test]
fn image_paths_lead_to_the_images_from_wherever_the_result_is() {
    let folder = Folder::new();
    folder.rendered_scene("in/scene.json", 4);
    folder.succeed("synth -o in/hall.json --pedestrians 2 --cameras 4 --time-steps 40 --noise box:0.03 --seed 1");
    let mut hall = folder.json("in/hall.json");
    hall["frames"][0]["image"] = json!("images/000000.jpg");
    folder.write_json("in/hall.json", &hall);
    folder.succeed("localize in/scene.json -o in/map.json --body ellipsoid");
    let mut query = folder.json("in/scene.json");
    query["frames"][0].as_object_mut().unwrap().remove("cam_from_world");
    folder.write_json("in/query.json", &query);
    std::fs::create_dir_all(folder.path("far/away")).unwrap();
    folder.succeed("synth -o in/desk.json --objects 12 --views 6 --noise box:0.02 --seed 5");
    let mut desk = folder.json("in/desk.json");
    desk["frames"][0]["image"] = json!("images/000000.jpg");
    folder.write_json("in/desk.json", &desk);
    folder.succeed("localize in/desk.json -o in/desk_map.json --body ellipsoid");
    for command in [
        "localize in/scene.json -o",
        "associate in/scene.json --ids ignore --min-views 2 -o",
        "stream in/scene.json --map",
        "relocalize in/map.json in/query.json -o",
        "calibrate-rig in/hall.json -o",
        "align in/desk_map.json in/desk_map.json -o",
    ] {
        for to in ["far/away/result.json", "in/result.json", "result.json"] {
            let run = folder.run(&format!("{command} {to}"));
            assert!(folder.path(to).exists(), "{command} {to}: {}", run.stderr);
            let result = folder.json(to);
            let image = result["frames"][0]["image"].as_str().unwrap();
            let found = folder.path(to).parent().unwrap().join(image).parent().unwrap().canonicalize().unwrap();
            assert_eq!(found, folder.path("in/images").canonicalize().unwrap(), "{command} {to}: {image}");
            std::fs::remove_file(folder.path(to)).unwrap();
        }
    }
    // The result of another folder shows its images.
    folder.succeed("localize in/scene.json -o far/away/result.json --body ellipsoid");
    folder.succeed("render far/away/result.json --frame 000001 -o picture.png");
    let report: serde_json::Value =
        serde_json::from_str(&folder.succeed("render far/away/result.json --frame 000001 -o picture.png --json"))
            .unwrap();
    assert_eq!(report["image"], true, "{report}");
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    let folder = with_result();
    for arguments in [
        "synth -o -",
        "localize scene.json -o -",
        "associate scene.json --ids ignore -o -",
        "export csv result.json -o -",
        "localize scene.json",
        "localize scene.json --json",
        "info scene.json",
        "stream scene.json",
        "evaluate result.json result.json --json",
        "localize --help",
        "completions zsh",
        "man localize",
    ] {
        let mut command = program(&folder);
        command.args(arguments.split(' ')).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(0) && !told.lines().any(|line| line.starts_with("error")),
            "{arguments}: {told}"
        );
    }
}

/// `script` of util-linux makes a terminal.
#[cfg(target_os = "linux")]
#[test]
fn a_stream_is_text_on_a_terminal() {
    let folder = with_result();
    let printed = |options: &str| {
        let command = format!("{} stream scene.json {options}", env!("CARGO_BIN_EXE_quadlift"));
        let mut script = Command::new("script");
        let script = script.args(["-qec", &command, "/dev/null"]).current_dir(folder.path("")).stdin(Stdio::null());
        String::from_utf8(script.output().unwrap().stdout).unwrap()
    };
    let text = printed("");
    assert!(text.contains("frame 000003: ") && text.contains("; confirmed object_") && !text.contains('{'), "{text}");
    assert!(printed("--json").contains(r#"{"frame":"000003""#), "{}", printed("--json"));
    assert!(folder.succeed("stream scene.json").contains(r#"{"frame":"000003""#));
}

#[test]
fn a_scene_is_read_from_the_standard_input() {
    let folder = with_result();
    for arguments in ["localize - -o piped.json", "localize - -o piped.json --report page.html"] {
        let mut command = program(&folder);
        let scene = File::open(folder.path("scene.json")).unwrap();
        let output = command.args(arguments.split(' ')).stdin(scene).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(folder.read("piped.json"), folder.read("result.json"));
    }
    let scene = folder.read("scene.json");
    let run = folder.command().args(["localize", "-", "--json"]).write_stdin(scene.clone()).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let run = folder.command().args(["info", "-"]).write_stdin(&scene[..scene.len() / 2]).output().unwrap();
    assert!(run.status.code() == Some(1) && String::from_utf8_lossy(&run.stderr).starts_with("error: -:"));
    // The scene itself is not overwritten.
    let scene = File::open(folder.path("scene.json")).unwrap();
    let output = program(&folder).args(["localize", "-", "-o", "scene.json"]).stdin(scene).output().unwrap();
    assert!(!output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
}

/// A scene whose export takes minutes: the images of a thousand frames are written into a temporary folder.
fn many_images() -> Folder {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("r")).unwrap();
    folder.succeed("synth -o r/scene.json --objects 1 --views 2");
    let mut scene = folder.json("r/scene.json");
    let [width, height] = ["width", "height"].map(|side| scene["cameras"][0][side].as_u64().unwrap() as u32);
    // Noise, which takes long to read and to compress.
    let mut state = 1u32;
    let image = image::RgbImage::from_fn(width, height, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let [_, a, b, c] = state.to_le_bytes();
        image::Rgb([a, b, c])
    });
    image.save(folder.path("r/noise.png")).unwrap();
    let frames = scene["frames"].as_array_mut().unwrap();
    frames.iter_mut().for_each(|frame| frame["image"] = json!("noise.png"));
    let first = frames[0].clone();
    for k in 0..1000 {
        let mut copy = first.clone();
        copy["id"] = json!(format!("copy {k}"));
        frames.push(copy);
    }
    folder.write_json("r/scene.json", &scene);
    folder
}

/// Exports a scene, sends the program a signal once it has something temporary, and gives the names that are left.
fn left_after(signal: &str, folder: &Folder) -> Vec<String> {
    let mut child = program(folder)
        .args(["export", "rerun", "r/scene.json", "-o", "recording"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !folder.names().iter().any(|name| name.starts_with(".quadlift-")) {
        assert!(child.try_wait().unwrap().is_none(), "nothing temporary");
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    assert!(!child.wait().unwrap().success(), "{signal} came too late");
    folder.names()
}

#[test]
fn signals_leave_no_temporary_files() {
    let folder = many_images();
    for signal in ["-INT", "-TERM", "-HUP"] {
        assert_eq!(left_after(signal, &folder), ["r"], "{signal}");
    }
    // A process that is killed can remove nothing: the next one that writes into the folder does.
    assert_eq!(left_after("-KILL", &folder).len(), 2);
    folder.succeed("export ply r/scene.json -o scene.ply");
    assert_eq!(folder.names(), ["r", "scene.ply"]);
}

#[test]
fn ignored_signals_stay_ignored() {
    let folder = Folder::new();
    folder.write_json("scene.json", &folder.small_scene());
    let script = format!(
        "trap '' HUP; {} localize scene.json -o result.json & pid=$!; kill -HUP $pid; wait $pid",
        env!("CARGO_BIN_EXE_quadlift")
    );
    let status = Command::new("sh").args(["-c", &script]).current_dir(folder.path("")).stdout(Stdio::null()).status();
    assert!(status.unwrap().success() && folder.path("result.json").exists());
}

#[test]
fn a_full_disk_is_named_without_the_temporary_file() {
    let Ok(mut full) = File::options().write(true).open("/dev/full") else { return };
    assert!(full.write_all(b"x").is_err());
    let folder = with_result();
    let run = folder.run("export csv result.json -o /dev/full");
    assert!(run.code == 1 && run.stderr.contains("cannot write /dev/full: No space left"), "{}", run.stderr);
}

#[test]
fn patterns_do_not_follow_links_to_folders() {
    let folder = Folder::new();
    let scene = folder.small_scene();
    folder.write_json("scenes/a.json", &scene);
    folder.write_json("scenes/deep/er/b.json", &scene);
    folder.write_json("elsewhere/c.json", &scene);
    for name in ["scenes/loop", "scenes/deep/loop", "scenes/deep/er/loop", "scenes/deep/second"] {
        symlink(".", folder.path(name)).unwrap();
    }
    symlink("../elsewhere/c.json", folder.path("scenes/c.json")).unwrap();
    let document: Value = serde_json::from_str(&folder.succeed("localize scenes/**/*.json -o out --json")).unwrap();
    assert_eq!(document["scenes"].as_array().unwrap().len(), 3, "each file is read once: {document}");
    for name in ["a.json", "b.json", "c.json"] {
        assert!(folder.path("out").join(name).is_file(), "{name}");
    }
}

#[test]
fn what_has_no_end_is_not_read() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    assert!(Command::new("mkfifo").arg(folder.path("pipe")).status().unwrap().success());
    for path in ["pipe", "/dev/zero"] {
        let run = folder.run_list(&["info", path]);
        assert!(run.code == 1 && run.stderr.contains("expected a file"), "{}", run.stderr);
        let mut scene = folder.json("scene.json");
        scene["frames"][0]["image"] = json!(path);
        scene["detections"][0]["mask"] = json!({"path": path, "value": 1});
        folder.write_json("hostile.json", &scene);
        for arguments in [
            "segment hostile.json -o out.json",
            "segment hostile.json -o out.json --method masks",
            "render hostile.json --frame 000000 -o out.png",
            "localize hostile.json --measurement mask",
            "localize hostile.json --report out.html",
            "info hostile.json",
        ] {
            let run = folder.run(arguments);
            assert!(run.code <= 1, "{arguments}: {}", run.stderr);
        }
    }
}

#[test]
fn options_have_an_effect_or_are_refused() {
    let folder = Folder::new();
    let mut scene = folder.small_scene();
    for (k, detection) in scene["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
        detection["score"] = json!(if k % 4 == 0 { 0.1 } else { 0.9 });
    }
    folder.write_json("scene.json", &scene);
    let kept: Vec<_> = scene["detections"].as_array().unwrap().iter().filter(|d| d["score"] == 0.9).cloned().collect();
    let mut better = scene.clone();
    better["detections"] = json!(kept);
    folder.write_json("better.json", &better);
    let said = folder.succeed("localize scene.json -o some.json --min-score 0.5");
    assert!(said.contains("skipped 3 detections with a score below 0.5"), "{said}");
    folder.succeed("localize better.json -o kept.json");
    assert_eq!(folder.json("some.json")["objects"], folder.json("kept.json")["objects"]);
    for option in [
        "--match name",
        "--time-tolerance 1",
        "--sequence 1",
        "--frames 1-2",
        "--world-object 1",
        "--pixel-centers half",
    ] {
        let run = folder.run(&format!("localize scene.json {option}"));
        assert!(run.code == 2 && run.stderr.contains("--cameras"), "{option}: {}", run.stderr);
    }
}

#[test]
fn imports_without_frames_fail() {
    let folder = Folder::new();
    folder.write("model/cameras.txt", "1 PINHOLE 640 480 500 500 320 240\n");
    folder.write("model/images.txt", "# no image\n");
    let run = folder.run("import colmap model -o scene.json");
    assert!(run.code == 1 && run.stderr.contains("model: no frames found"), "{}", run.stderr);
    assert!(!folder.path("scene.json").exists());
}
