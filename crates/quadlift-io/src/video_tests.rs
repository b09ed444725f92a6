use super::*;
use crate::scene_file::{SceneFile, parse_scene_file};

#[test]
fn paths_of_frames() {
    let found = |path: &'static str| frame_of_video(Path::new(path));
    assert_eq!(found("a/drive.mp4#frame=12"), Some((Path::new("a/drive.mp4"), VideoTime::Frame(12))));
    assert_eq!(found("drive.mp4#t=0.5"), Some((Path::new("drive.mp4"), VideoTime::Seconds(0.5))));
    for path in ["a#1.png", "a.png", "a.mp4#frame=x", "a.mp4#frame=-1", "a.mp4#t=-1", "a.mp4#t=inf", "#frame=1"] {
        assert_eq!(found(path), None, "{path}");
    }
}

#[test]
fn few_ranges_cover_all_frames() {
    assert_eq!(ranges(&[0, 1, 2, 5, 7, 8].into()), [[0, 2], [5, 5], [7, 8]]);
    // Far more than one filter selects, with gaps of different widths.
    let frames: BTreeSet<u64> = (0..2000).map(|k| 3 * k + 10 * (k / 7)).collect();
    let found = ranges(&frames);
    assert!(found.len() <= MAX_RANGES, "{}", found.len());
    assert!(frames.iter().all(|frame| found.iter().any(|[first, last]| (first..=last).contains(&frame))));
    assert!(found.windows(2).all(|pair| pair[0][1] < pair[1][0]));
}

#[test]
fn frames_near_a_time() {
    let starts = [0.0, 0.04, 0.08, 0.2];
    let at = |seconds| nearest(&starts, seconds);
    assert_eq!([at(0.0), at(0.03), at(0.1), at(0.15), at(0.21)], [Ok(0), Ok(1), Ok(2), Ok(3), Ok(3)]);
    assert_eq!(at(0.5), Err("there is no frame at 0.5 s: the last one is at 0.2 s".to_owned()));
}

/// Red of the frame with this number.
fn red(number: u32) -> u8 {
    (20 * number + 10) as u8
}

/// A video of twelve frames of one color each, ten in a second; `None`, and the test says so, without ffmpeg.
fn video(folder: &Path) -> Option<PathBuf> {
    let image = |number: u32| quadlift_segment::image::RgbImage::from_pixel(64, 48, [red(number), 128, 64].into());
    for number in 0..12 {
        crate::write_png(&folder.join(format!("{number}.png")), &image(number)).unwrap();
    }
    let video = folder.join("-drive 1.mkv");
    let made = Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-framerate", "10", "-i", "%d.png", "-c:v", "mpeg4", "-q:v", "1", "-bf", "2"])
        .arg(format!("file:{}", video.display()))
        .current_dir(folder)
        .output();
    match made {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            Some(video)
        }
        Err(_) => {
            eprintln!("skipped: ffmpeg is not installed");
            None
        }
    }
}

/// A scene with these images, in the folder.
fn scene(images: &[&str]) -> SceneFile {
    let frame = |(index, image): (usize, &&str)| {
        format!(
            r#"{{"id": "{index}", "camera": "c", "image": "{image}", "cam_from_world": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}}"#
        )
    };
    let frames: Vec<String> = images.iter().enumerate().map(frame).collect();
    let text = format!(
        r#"{{"format": "quadlift.scene", "version": 1, "cameras": [{{"id": "c", "model": "PINHOLE", "width": 64, "height": 48,
        "params": [50, 50, 32, 24]}}], "frames": [{}]}}"#,
        frames.join(",")
    );
    parse_scene_file(Path::new("scene.json"), text.as_bytes()).unwrap()
}

#[test]
fn frames_of_a_video_are_read_in_one_process() {
    let folder = tempfile::tempdir().unwrap();
    if video(folder.path()).is_none() {
        return;
    }
    let name = "-drive 1.mkv";
    let wanted: Vec<String> = ["frame=11", "frame=3", "t=0.52", "frame=0", "t=1.1", "frame=12", "t=9"]
        .map(|fragment| format!("{name}#{fragment}"))
        .into();
    let file = scene(&wanted.iter().map(String::as_str).collect::<Vec<_>>());
    let (scene, path) = (file.to_scene().unwrap(), folder.path().join("scene.json"));
    let images = file.to_images(&path).unwrap();
    assert_eq!(file.named_files(&path).next().unwrap(), folder.path().join(name));
    let place = folder.path().display().to_string() + "/";
    let message = |images: &crate::scene_file::SceneImages, frame: usize| {
        images.read_image(&scene, frame).unwrap_err().to_string().replace(&place, "")
    };
    for (frame, number) in [11, 3, 5, 0, 11].into_iter().enumerate() {
        let image = images.read_image(&scene, frame).unwrap();
        let found = image.get_pixel(30, 20).0;
        assert!(found[0].abs_diff(red(number)) <= 3, "frame {frame}: {found:?}, expected red {}", red(number));
    }
    insta::assert_snapshot!(message(&images, 5), @"-drive 1.mkv: the video ends before frame 12 (numbers count from 0)");
    insta::assert_snapshot!(message(&images, 6), @"-drive 1.mkv: there is no frame at 9 s: the last one is at 1.1 s");
    // One process has decoded all of them, or those that are wanted: the video is not needed any more.
    let again = images.clone();
    let few = file.to_images(&path).unwrap();
    few.videos.want([3]);
    assert!(few.read_image(&scene, 3).is_ok());
    std::fs::remove_file(folder.path().join(name)).unwrap();
    assert!(again.read_image(&scene, 1).is_ok() && few.read_image(&scene, 3).is_ok());
    assert!(few.read_image(&scene, 1).is_err());
    insta::assert_snapshot!(message(&file.to_images(&path).unwrap(), 0), @"-drive 1.mkv: there is no such file");
}

#[test]
fn files_that_are_no_videos_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    if video(folder.path()).is_none() {
        return;
    }
    let read = |name: &str, content: &str| {
        std::fs::write(folder.path().join(name), content).unwrap();
        let file = scene(&[&format!("{name}#frame=0")]);
        let images = file.to_images(&folder.path().join("scene.json")).unwrap();
        images.read_image(&file.to_scene().unwrap(), 0).unwrap_err().problem
    };
    assert!(read("a.mp4", "no video").starts_with("ffmpeg cannot read the video: "));
    // A list of other files, as far as addresses, is not followed.
    assert!(read("a.m3u8", "#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n").starts_with("ffmpeg cannot read"));
}
