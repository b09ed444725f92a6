//! What the fuzz targets do with their input; `crates/quadlift-io/tests/fuzz_seeds.rs` does the same with the seeds.
//!
//! Each tells whether the input was read. [`formats`] takes the files of any format.

use std::path::{Component, Path};

use quadlift::geometry::{BodyKind, BoundingBox};
use quadlift::online::{Frame, ObjectMap, OnlineOptions, PoseUpdate};
use quadlift::run::{AssociateWhen, RunOptions};
use quadlift::scene::NewDetection;
use quadlift::solve::{Method, Status};
use quadlift::{LocalizeOptions, Unobserved};
use quadlift_io::formats;
use quadlift_io::mcap::{LiveFrames, LiveOptions, McapOptions, Next, parse_mcap};
use quadlift_io::read::detections::{AddOptions, DetectionFiles, MatchBy, add_detections};
use quadlift_io::read::{Import, READ, ReadOptions};
use quadlift_io::run::{FileInput, FileOptions, FileRun, run_file};
use quadlift_io::scene_file::{CameraRecord, DetectionRecord, FrameRecord, SceneFile, parse_scene_file, write_scene};
use quadlift_io::stream::{FrameLine, StreamedScene, parse_line, parse_stored_stream};
use quadlift_io::{EntryError, ReadError};
use quadlift_segment::{ConvexHull, PixelTerm, Polygons, Rle};

/// A target: what it does with its input; true where it was read.
pub(crate) type Target = fn(&[u8]) -> bool;

/// Every target under the name of its folder in `fuzz/seeds`.
pub(crate) const TARGETS: &[(&str, Target)] = &[
    ("formats", formats),
    ("live", live),
    ("localize", localize),
    ("mcap", mcap),
    ("polygons", polygons),
    ("rle", rle),
    ("scene", scene),
    ("state", state),
    ("stream", stream),
];

/// Stands between the messages of one input.
const SEPARATOR: &[u8] = b"=====\n";

/// Stands before the path and the content of each file of a format.
const FILE: &[u8] = b"===== ";

/// An error has a message in one line.
fn check_error(error: ReadError) {
    assert!(!error.problem.is_empty() && !error.to_string().contains(char::is_control), "{error}");
}

/// What must hold for every answer: an error has a message in one line, a scene is valid and survives its file.
fn check(result: Result<Import, ReadError>) -> bool {
    match result {
        Err(error) => {
            check_error(error);
            false
        }
        Ok(import) => {
            import.scene.to_scene().unwrap();
            let mut bytes = Vec::new();
            write_scene(&import.scene, &mut bytes).unwrap();
            assert_eq!(parse_scene_file(Path::new("scene.json"), &bytes).unwrap(), import.scene);
            true
        }
    }
}

/// What must hold for every answer of a reader of detections: as [`check`], for a scene with the frames 0 to 3 to which
/// they are added.
fn check_detections(result: Result<DetectionFiles, ReadError>) -> bool {
    let Ok(files) = result.map_err(check_error) else { return false };
    for match_by in [MatchBy::Auto, MatchBy::Index, MatchBy::Time] {
        let mut scene = small_scene();
        let options = AddOptions { match_by, min_score: Some(0.1), ..AddOptions::default() };
        let Ok(added) = add_detections(&mut scene, files.clone(), &options).map_err(check_error) else { continue };
        assert_eq!(added.added, scene.detections.len());
        scene.to_scene().unwrap();
        scene.to_images(Path::new("scene.json")).unwrap();
        let mut bytes = Vec::new();
        write_scene(&scene, &mut bytes).unwrap();
        assert_eq!(parse_scene_file(Path::new("scene.json"), &bytes).unwrap(), scene);
    }
    true
}

/// Four frames of one camera.
fn small_scene() -> SceneFile {
    let camera = CameraRecord {
        id: "c".to_owned(),
        model: "PINHOLE".to_owned(),
        width: Some(640.0),
        height: Some(480.0),
        params: vec![500.0, 500.0, 320.0, 240.0],
        ..CameraRecord::default()
    };
    let frame = |number: u8| FrameRecord {
        id: format!("{number}.png"),
        camera: Some("c".to_owned()),
        cam_from_world: Some([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
        time: Some(f64::from(number)),
        ..FrameRecord::default()
    };
    SceneFile { cameras: vec![camera], frames: (0..4).map(frame).collect(), ..SceneFile::default() }
}

/// An example of a format: the words behind `quadlift import`, and files.
pub(crate) struct Example {
    /// The name of the format, a path, and options with their values.
    pub words: Vec<String>,
    /// Paths and contents.
    pub files: Vec<(String, Vec<u8>)>,
}

impl Example {
    /// The example as the input of the target [`formats`].
    #[allow(dead_code, reason = "the tests write the seeds, the targets read them")]
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = format!("{}\n", self.words.join(" ")).into_bytes();
        for (path, content) in &self.files {
            bytes.extend([FILE, path.as_bytes(), b"\n", content].concat());
        }
        bytes
    }

    /// The example in an input; `None` where the first line or a path is none.
    pub(crate) fn of(data: &[u8]) -> Option<Self> {
        let end_of_line = |data: &[u8]| data.iter().position(|&byte| byte == b'\n');
        let text = |data: &[u8]| std::str::from_utf8(data).ok().map(str::to_owned);
        let (head, mut rest) = data.split_at(end_of_line(data)? + 1);
        let words: Vec<String> = text(head)?.split_whitespace().map(str::to_owned).collect();
        let mut files: Vec<(String, Vec<u8>)> = Vec::new();
        while let Some(file) = rest.strip_prefix(FILE) {
            let (path, content) = file.split_at(end_of_line(file)?);
            let next = content.windows(FILE.len()).position(|window| window == FILE).unwrap_or(content.len());
            files.push((text(path)?, content[1..next.max(1)].to_vec()));
            rest = &content[next.max(1)..];
        }
        let is_inside = |path: &str| Path::new(path).components().all(|part| matches!(part, Component::Normal(_)));
        let are_inside = words.len() > 1 && files.iter().all(|(path, _)| is_inside(path) && path.len() < 100);
        (are_inside && (words[1] == "." || is_inside(&words[1]))).then_some(Self { words, files })
    }

    /// Writes the files into a folder.
    pub(crate) fn write(&self, folder: &Path) -> std::io::Result<()> {
        for (path, content) in &self.files {
            let path = folder.join(path);
            std::fs::create_dir_all(path.parent().unwrap())?;
            std::fs::write(path, content)?;
        }
        Ok(())
    }

    /// The options among the words; paths are those of files in a folder.
    pub(crate) fn options(&self, folder: &Path) -> Result<ReadOptions, String> {
        let mut options = ReadOptions::default();
        let mut words = self.words[2..].iter();
        while let Some(word) = words.next() {
            let name = word.strip_prefix("--").ok_or_else(|| format!("{word} is no option"))?.replace('-', "_");
            let row = READ.iter().find(|row| row.name == name).ok_or_else(|| format!("there is no option {word}"))?;
            let value = if row.value.is_empty() { "" } else { words.next().ok_or("a value is missing")? };
            let is_path = row.value.starts_with("FILE") || row.value == "DIR";
            let place = folder.join(value);
            let value = if is_path { place.to_str().ok_or("a path is not UTF-8")? } else { value };
            (row.set)(&mut options, value)?;
        }
        options.write_images = None;
        Ok(options)
    }
}

/// Any format of cameras or detections: an [`Example`].
fn formats(data: &[u8]) -> bool {
    let Some(example) = Example::of(data) else { return false };
    let folder = tempfile::tempdir().unwrap();
    let written = example.write(folder.path());
    let (Ok(()), Ok(options)) = (written, example.options(folder.path())) else { return false };
    let path = folder.path().join(&example.words[1]);
    if let Some(format) = formats::detections().find(|format| format.name == example.words[0]) {
        return check_detections((format.read)(&path, &options));
    }
    let format = formats::poses().find(|format| format.name == example.words[0]);
    format.is_some_and(|format| check((format.read)(&path, &options)))
}

/// A scene file: what is read is written and read back as it was, and its scene, objects and masks are valid or refused in
/// words.
fn scene(data: &[u8]) -> bool {
    let path = Path::new("scene.json");
    let Ok(file) = parse_scene_file(path, data).map_err(check_error) else { return false };
    let mut bytes = Vec::new();
    if write_scene(&file, &mut bytes).is_ok() {
        assert_eq!(parse_scene_file(path, &bytes).unwrap(), file);
    }
    let in_words = |error: EntryError| check_error(error.in_file(path));
    let scene = file.to_scene().map_err(in_words);
    let objects = file.to_objects().map_err(in_words);
    let images = file.to_images(path).map_err(in_words);
    if let (Ok(scene), Ok(images)) = (&scene, &images) {
        // Masks that lie in the file itself; others name files that are not there.
        let all: Vec<usize> = (0..scene.detections.len()).collect();
        images.read_masks(scene, &all).into_iter().filter_map(Result::err).for_each(check_error);
    }
    scene.is_ok() && objects.is_ok() && images.is_ok()
}

/// Sizes of the images of masks: one byte each.
fn small_size(data: &[u8]) -> Option<([u32; 2], &[u8])> {
    let [height, width, rest @ ..] = data else { return None };
    Some(([u32::from(*height), u32::from(*width)], rest))
}

/// COCO's compressed runs: the mask has the pixels of the runs, and encoding gives the runs back.
fn rle(data: &[u8]) -> bool {
    let Some(([height, width], rest)) = small_size(data) else { return false };
    let Ok(text) = std::str::from_utf8(rest) else { return false };
    let Ok(rle) = Rle::from_compressed(height, width, text) else { return false };
    let mask = rle.to_mask();
    let inside: u64 = rle.counts().iter().skip(1).step_by(2).map(|&run| u64::from(run)).sum();
    assert_eq!(mask.count() as u64, inside);
    assert_eq!(Rle::from_compressed(height, width, &rle.to_compressed()).unwrap(), rle);
    assert_eq!(Rle::of_mask(&mask, height, width).unwrap().to_mask(), mask);
    let _ = (rle.moments(PixelTerm::Centers), ConvexHull::of_mask(&mask));
    true
}

/// Polygons, a line of numbers each: their pixels lie in the window.
fn polygons(data: &[u8]) -> bool {
    let Some(([height, width], rest)) = small_size(data) else { return false };
    let Ok(text) = std::str::from_utf8(rest) else { return false };
    let numbers = |line: &str| line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let Ok(polygons) = Polygons::new(&text.lines().map(numbers).collect::<Vec<Vec<f64>>>()) else { return false };
    let [x0, y0, x1, y1] = polygons.window(width, height);
    let Ok(mask) = polygons.to_mask(width, height) else { return false };
    if let Some([left, top, right, bottom]) = mask.extent() {
        assert!(x0 <= left && y0 <= top && right <= x1 && bottom <= y1);
    }
    let _ = (polygons.moments(), polygons.hull());
    true
}

/// A log as a scene, with and without what is damaged.
fn mcap(data: &[u8]) -> bool {
    let parse = |skip_errors| {
        let options = McapOptions { skip_errors, ..McapOptions::default() };
        parse_mcap(Path::new("log.mcap"), data.to_vec(), options)
    };
    let (strict, lenient) = (parse(false), parse(true));
    if let Ok(strict) = &strict {
        // Where nothing is wrong, nothing is left out.
        assert_eq!(Ok(strict), lenient.as_ref());
    }
    check(lenient);
    check(strict)
}

/// Messages of a robot: `t` transforms, `s` fixed ones, `c` a calibration, `d` detections, each before its bytes. Problems are told, and
/// what the map keeps is a valid scene.
fn live(data: &[u8]) -> bool {
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    let mut scene = StreamedScene::default();
    let mut live = LiveFrames::new(LiveOptions { most_waiting: 4, ..LiveOptions::default() }).unwrap();
    let (mut rest, mut now, mut all_read) = (data, 0.0, true);
    loop {
        let end = rest.windows(SEPARATOR.len()).position(|window| window == SEPARATOR);
        let (message, after) = end.map_or((rest, &[][..]), |end| (&rest[..end], &rest[end + SEPARATOR.len()..]));
        match message.split_first() {
            Some((b't', bytes)) => live.transforms("/tf", bytes, false),
            Some((b's', bytes)) => live.transforms("/tf_static", bytes, true),
            Some((b'c', bytes)) => live.calibration("/camera_info", bytes),
            Some((_, bytes)) => live.detections("/detections", bytes, now),
            None => {}
        }
        if end.is_none() {
            live.make_all();
        }
        while let Some(next) = live.next_frame(now) {
            match next {
                Next::Frame(frame) => all_read &= observe(*frame, &mut scene, &mut map),
                Next::Problem(problem) | Next::Outside(problem) => {
                    assert!(!problem.text.is_empty());
                    all_read = false;
                }
            }
        }
        if end.is_none() {
            break;
        }
        (rest, now) = (after, now + 0.3);
    }
    map.settle();
    scene.to_file(&map).to_scene().unwrap();
    all_read && map.frames() > 0
}

/// Checks a frame, observes it and keeps it; false where it is refused.
fn observe(frame: FrameLine, scene: &mut StreamedScene, map: &mut ObjectMap) -> bool {
    let Ok(checked) = scene.check(frame, map) else { return false };
    let observed = map.observe(&checked.frame, &checked.detections()).is_ok();
    if observed {
        scene.keep(checked, map);
    }
    observed
}

/// Observes the frames of JSON Lines: an error has a message in one line, what is kept is a valid scene.
fn stream(data: &[u8]) -> bool {
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    let mut scene = StreamedScene::default();
    let mut all_read = true;
    for line in data.split(|&byte| byte == b'\n').filter(|line| !line.is_empty()) {
        let line = match parse_line(line) {
            Ok(line) => line,
            Err(error) => {
                assert!(!error.message.is_empty() && !error.message.contains(char::is_control), "{error:?}");
                all_read = false;
                continue;
            }
        };
        all_read &= scene.take_in(&line.about).is_ok();
        for frame in line.frames {
            all_read &= observe(frame, &mut scene, &mut map);
        }
        match line.poses.map(|poses| scene.take_in_poses(&poses)) {
            Some(Ok(updates)) => drop(map.update_poses(&updates)),
            Some(Err(_)) => all_read = false,
            None => {}
        }
    }
    map.settle();
    scene.to_file(&map).to_scene().unwrap();
    all_read
}

/// Goes on with the state of a stream after its checksum was made right: whatever its numbers are, nothing panics.
fn state(data: &[u8]) -> bool {
    let Some(rest) = std::str::from_utf8(data).ok().and_then(|text| Some(text.split_once(',')?.1)) else {
        return false;
    };
    let checksum = crc32fast::hash(rest.trim_end_matches('\n').as_bytes());
    let text = format!("{{\"checksum\":\"{checksum:08x}\",{rest}");
    let Ok(stored) = parse_stored_stream(Path::new("state"), text.as_bytes()).map_err(check_error) else {
        return false;
    };
    let (mut map, scene) = (stored.state.map, stored.state.scene);
    let time = map.last_frame().map_or(0.0, |(_, time)| time);
    let kept: Vec<Frame> = map.kept_frames().cloned().collect();
    for (k, frame) in kept.iter().rev().take(3).enumerate() {
        let x = 40.0 * k as f64;
        let boxes = [[50.0 + x, 60.0, 150.0 + x, 140.0], [300.0, 200.0 + x, 330.0, 260.0 + x]];
        let detections = boxes.map(|edges| NewDetection::from_box(BoundingBox::new(edges).unwrap()));
        let _ = map.observe(&Frame { id: format!("new {k}"), time, ..frame.clone() }, &detections);
    }
    let moved = kept.iter().map(|frame| PoseUpdate { frame: frame.id.clone(), projection: kept[0].projection });
    map.update_poses(&moved.collect::<Vec<_>>());
    map.settle();
    scene.to_file(&map).to_scene().unwrap();
    true
}

/// Localizes boxes whose corners are the bytes, in frames on a circle: estimates are finite or have a status that says why
/// not.
fn localize(data: &[u8]) -> bool {
    let [views, objects, method, body, rest @ ..] = data else { return false };
    let (views, objects) = (2 + usize::from(views % 7), 1 + usize::from(objects % 3));
    let mut file = small_scene();
    file.frames = (0..views).map(|k| frame_on_circle(k, views)).collect();
    for (k, bytes) in rest.chunks_exact(8).take(views * objects).enumerate() {
        let number = |i: usize| f64::from(i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])) / 32.0;
        let [x, y, w, h] = [0, 1, 2, 3].map(number);
        file.detections.push(DetectionRecord {
            frame: (k % views).to_string().as_str().into(),
            object: Some((k / views).to_string().as_str().into()),
            bounding_box: Some([x, y, x + w.abs(), y + h.abs()]),
            ..DetectionRecord::default()
        });
    }
    let named: Method = Method::NAMES[usize::from(*method) % Method::NAMES.len()].parse().unwrap();
    let mut options = LocalizeOptions { allow_inconsistent: method & 64 != 0, ..LocalizeOptions::from(named) };
    let kinds = [None, Some(BodyKind::Ellipsoid), Some(BodyKind::Cuboid), Some(BodyKind::Cylinder)];
    if let Some(map) = options.method.posterior_options_mut() {
        map.body = kinds[usize::from(*body) % kinds.len()];
    }
    let Some(found) = localized(file, options) else { return false };
    for estimate in &found.run.localization.estimates {
        let center = estimate.center.iter().flat_map(|center| center.iter()).all(|x| x.is_finite());
        assert!(center, "{estimate:?}");
        assert!(estimate.status != Status::Ok || estimate.body.is_some(), "{estimate:?}");
    }
    let mut bytes = Vec::new();
    write_scene(&found.result(), &mut bytes).unwrap();
    parse_scene_file(Path::new("result.json"), &bytes).unwrap().to_objects().unwrap();
    true
}

/// A run on a file, if it has a result.
fn localized(file: SceneFile, localize: LocalizeOptions) -> Option<FileRun> {
    let run = RunOptions { localize, associate: AssociateWhen::Never, ..RunOptions::default() };
    let input = FileInput::from_file(file, Path::new("scene.json"), &[]).ok()?;
    run_file(input, &FileOptions { run, ..FileOptions::default() }, &Unobserved).ok()
}

/// A camera at a distance of 10 that looks at the origin.
fn frame_on_circle(k: usize, views: usize) -> FrameRecord {
    let (sin, cos) = (std::f64::consts::TAU * k as f64 / views as f64).sin_cos();
    FrameRecord {
        id: k.to_string(),
        camera: Some("c".to_owned()),
        cam_from_world: Some([[cos, 0.0, -sin, 0.0], [0.0, 1.0, 0.0, 0.0], [sin, 0.0, cos, 10.0]]),
        ..FrameRecord::default()
    }
}
