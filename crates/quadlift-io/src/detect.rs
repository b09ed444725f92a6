//! Detects the format of a file or folder of another program from the names in it and its first line.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::de::IgnoredAny;

use crate::error::ReadError;
use crate::input::paths_below;
use crate::input::{as_utf8, read_bytes};
use crate::read::json::parse_json;

/// A format of cameras and poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraFormat {
    /// A scene file of quadlift.
    Scene,
    /// A COLMAP model.
    Colmap,
    /// nerfstudio's or instant-ngp's `transforms.json`.
    Nerfstudio,
    /// OpenSfM's or OpenDroneMap's `reconstruction.json`.
    OpenSfm,
    /// A capture of Polycam, Record3D or 3D Scanner App.
    Arkit,
    /// A TUM trajectory.
    Tum,
    /// KITTI's tracking benchmark.
    Kitti,
    /// A drive of KITTI's raw data.
    KittiRaw,
    /// Tables of nuScenes.
    Nuscenes,
    /// A scene of a BOP data set.
    Bop,
    /// A list of projections.
    Projections,
    /// A log in MCAP, of ROS 2 or Foxglove.
    Mcap,
}

/// A format of detections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DetectionFormat {
    /// COCO.
    Coco,
    /// MOTChallenge.
    Mot,
    /// Ultralytics YOLO.
    Yolo,
    /// KITTI's labels.
    Kitti,
    /// A CSV table.
    Csv,
    /// supervision's sinks.
    Supervision,
    /// LabelMe.
    LabelMe,
    /// Pascal VOC.
    Voc,
    /// CVAT.
    Cvat,
    /// Label Studio.
    LabelStudio,
    /// Boxer's 3D boxes.
    Boxer,
}

impl CameraFormat {
    /// The name in the words of `quadlift import`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene file",
            Self::Colmap => "colmap",
            Self::Nerfstudio => "nerfstudio",
            Self::OpenSfm => "opensfm",
            Self::Arkit => "arkit",
            Self::Tum => "tum",
            Self::Kitti => "kitti",
            Self::KittiRaw => "kitti-raw",
            Self::Nuscenes => "nuscenes",
            Self::Bop => "bop",
            Self::Projections => "projections",
            Self::Mcap => "mcap",
        }
    }
}

impl DetectionFormat {
    /// The name in the words of `quadlift import-detections`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coco => "coco",
            Self::Mot => "mot",
            Self::Yolo => "yolo",
            Self::Kitti => "kitti",
            Self::Csv => "csv",
            Self::Supervision => "supervision",
            Self::LabelMe => "labelme",
            Self::Voc => "voc",
            Self::Cvat => "cvat",
            Self::LabelStudio => "label-studio",
            Self::Boxer => "boxer",
        }
    }

    /// The name in sentences.
    pub fn title(self) -> &'static str {
        match self {
            Self::Coco => "COCO",
            Self::Mot => "MOTChallenge",
            Self::Yolo => "YOLO",
            Self::Kitti => "KITTI labels",
            Self::Csv => "a CSV table",
            Self::Supervision => "supervision",
            Self::LabelMe => "LabelMe",
            Self::Voc => "Pascal VOC",
            Self::Cvat => "CVAT",
            Self::LabelStudio => "Label Studio",
            Self::Boxer => "Boxer's 3D boxes",
        }
    }
}

/// The format of cameras and poses, and the path at which its reader finds them.
///
/// # Errors
/// [`ReadError`] if the path cannot be read, or if it matches no format; the message lists the formats.
pub fn detect_cameras(path: &Path) -> Result<(CameraFormat, PathBuf), ReadError> {
    let format = if path.is_dir() { cameras_in_folder(path) } else { cameras_in_file(path)? };
    let folder = || path.parent().unwrap_or(Path::new("")).to_owned();
    match format {
        Some(format @ (CameraFormat::Colmap | CameraFormat::Bop)) if !path.is_dir() => Ok((format, folder())),
        Some(format) => Ok((format, path.to_owned())),
        None => Err(ReadError::new(
            path,
            "unknown camera format: looked for a scene file, a COLMAP model (cameras.bin or cameras.txt), \
             transforms.json, OpenSfM (reconstruction.json), captures of Polycam, Record3D or 3D Scanner App, a TUM trajectory (lines of 8 numbers), KITTI (folders \
             calib and oxts), KITTI raw (oxts/data), nuScenes (sample_data.json), BOP (scene_camera.json), logs in MCAP and projections (12 to \
             16 columns, or JSON); `quadlift import FORMAT` reads a given format",
        )),
    }
}

/// Whether a file begins as logs in MCAP do.
pub fn is_mcap(path: &Path) -> bool {
    const START: &[u8] = b"\x89MCAP";
    let mut start = Vec::new();
    let read = |file: File| file.take(START.len() as u64).read_to_end(&mut start);
    path.is_file() && File::open(path).and_then(read).is_ok() && start == START
}

fn cameras_in_folder(folder: &Path) -> Option<CameraFormat> {
    let has = |name: &str| folder.join(name).exists();
    if crate::read::colmap::is_model(folder) {
        Some(CameraFormat::Colmap)
    } else if has("transforms.json") {
        Some(CameraFormat::Nerfstudio)
    } else if crate::read::opensfm::file_in(folder).is_some() {
        Some(CameraFormat::OpenSfm)
    } else if has("scene_camera.json") {
        Some(CameraFormat::Bop)
    } else if crate::read::nuscenes::tables_in(folder).is_some() {
        Some(CameraFormat::Nuscenes)
    } else if crate::read::arkit::is_capture(folder) {
        Some(CameraFormat::Arkit)
    } else if has("oxts/data") {
        Some(CameraFormat::KittiRaw)
    } else if has("oxts") && has("calib") {
        Some(CameraFormat::Kitti)
    } else {
        None
    }
}

fn cameras_in_file(path: &Path) -> Result<Option<CameraFormat>, ReadError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if ["cameras.bin", "cameras.txt", "images.bin", "images.txt"].contains(&&*name) {
        return Ok(Some(CameraFormat::Colmap));
    }
    if is_mcap(path) {
        return Ok(Some(CameraFormat::Mcap));
    }
    let bytes = read_bytes(path)?;
    let text = as_utf8(path, &bytes)?;
    Ok(match Start::of(text) {
        Start::Object(keys) if keys.contains_key("format") => Some(CameraFormat::Scene),
        Start::Object(_) if name == "scene_camera.json" => Some(CameraFormat::Bop),
        Start::Object(_) if text.contains("\"transform_matrix\"") => Some(CameraFormat::Nerfstudio),
        Start::Object(keys) if keys.contains_key("poses") && keys.contains_key("K") => Some(CameraFormat::Arkit),
        Start::List(keys) if keys.contains_key("shots") => Some(CameraFormat::OpenSfm),
        Start::Object(_) | Start::List(_) => Some(CameraFormat::Projections),
        Start::Line(fields) if fields.commas && fields.words.len() >= 12 => Some(CameraFormat::Projections),
        Start::Line(fields) if !fields.commas && fields.words.len() == 8 && fields.all_numbers() => {
            Some(CameraFormat::Tum)
        }
        Start::Xml(_) | Start::Line(_) => None,
    })
}

/// The format of detections.
///
/// # Errors
/// [`ReadError`] if the path cannot be read, or if it matches no format; the message lists the formats.
pub fn detect_detections(path: &Path) -> Result<DetectionFormat, ReadError> {
    let format = if path.is_dir() { detections_in_folder(path)? } else { detections_in_file(path)? };
    if format.is_none() && path.is_file() {
        check_json(path)?;
    }
    format.ok_or_else(|| {
        ReadError::new(
            path,
            "unknown detection format: looked for COCO (annotations, or a list with \"image_id\"), MOTChallenge (7 to \
             10 numbers between commas, or gt/gt.txt), YOLO (a folder of .txt with a class and numbers from 0 to 1), \
             KITTI (15 to 18 fields), CSV (names of columns, or 5 or 6 numbers), supervision (a column x_min), \
             LabelMe (\"shapes\"), Pascal VOC (<annotation>), CVAT (<annotations>), Label Studio (tasks with \
             \"data\") and Boxer (a column time_ns and 3D boxes); `quadlift import-detections FORMAT` reads a given format",
        )
    })
}

/// Names the place where a file that begins as JSON does is none: that hides its format.
fn check_json(path: &Path) -> Result<(), ReadError> {
    let bytes = read_bytes(path)?;
    match bytes.trim_ascii_start().first() {
        Some(b'{' | b'[') => parse_json(path, &bytes).map(|_| ()),
        _ => Ok(()),
    }
}

fn detections_in_folder(folder: &Path) -> Result<Option<DetectionFormat>, ReadError> {
    if folder.join("gt/gt.txt").is_file() || folder.join("det/det.txt").is_file() {
        return Ok(Some(DetectionFormat::Mot));
    }
    if crate::read::detections::coco::files_of_roboflow(folder)?.is_some() {
        return Ok(Some(DetectionFormat::Coco));
    }
    // The first file with content decides.
    for (extension, formats) in [
        ("txt", [DetectionFormat::Yolo, DetectionFormat::Kitti].as_slice()),
        ("json", &[DetectionFormat::LabelMe]),
        ("xml", &[DetectionFormat::Voc, DetectionFormat::Cvat]),
    ] {
        for (name, path) in paths_below(folder, extension)? {
            if is_beside_labels(&name) || std::fs::metadata(&path).is_ok_and(|data| data.len() < 2) {
                continue;
            }
            match detections_in_file(&path)? {
                Some(format) if formats.contains(&format) => return Ok(Some(format)),
                _ => break,
            }
        }
    }
    Ok(None)
}

/// Whether a text file is no label file: names of classes, Roboflow's description of a data set.
fn is_beside_labels(name: &str) -> bool {
    name.ends_with("classes.txt") || crate::read::detections::yolo::is_description(Path::new(name))
}

fn detections_in_file(path: &Path) -> Result<Option<DetectionFormat>, ReadError> {
    let bytes = read_bytes(path)?;
    let fields = match Start::of(as_utf8(path, &bytes)?) {
        Start::Object(keys) | Start::List(keys) => {
            let has = |key: &str| keys.contains_key(key);
            return Ok(match () {
                () if has("shapes") => Some(DetectionFormat::LabelMe),
                () if has("x_min") => Some(DetectionFormat::Supervision),
                // The full form, and JSON-MIN.
                () if has("data") && (has("annotations") || has("predictions")) => Some(DetectionFormat::LabelStudio),
                () if has("annotation_id") && has("annotator") => Some(DetectionFormat::LabelStudio),
                () if has("annotations") || has("image_id") => Some(DetectionFormat::Coco),
                () => None,
            });
        }
        Start::Xml("annotation") => return Ok(Some(DetectionFormat::Voc)),
        Start::Xml("annotations") => return Ok(Some(DetectionFormat::Cvat)),
        Start::Xml(_) => return Ok(None),
        Start::Line(fields) => fields,
    };
    let (count, numbers) = (fields.words.len(), fields.numbers());
    let is_number = |index: usize| numbers.get(index).is_some_and(Option::is_some);
    let named = fields.words.iter().skip(1).all(|word| word.parse::<f64>().is_err());
    Ok(match count {
        _ if fields.commas && named && fields.words.contains(&"x_min") => Some(DetectionFormat::Supervision),
        _ if fields.commas && crate::read::detections::boxer::is_header(&fields.words) => Some(DetectionFormat::Boxer),
        5.. if fields.commas && named => Some(DetectionFormat::Csv),
        5 if fields.commas => Some(DetectionFormat::Csv),
        6 if fields.commas && numbers[5].is_some_and(|score| (0.0..=1.0).contains(&score)) => {
            Some(DetectionFormat::Csv)
        }
        7..=10 if fields.commas && fields.all_numbers() => Some(DetectionFormat::Mot),
        17 | 18 if !fields.commas && is_number(0) && !is_number(2) => Some(DetectionFormat::Kitti),
        15 | 16 if !fields.commas && !is_number(0) => Some(DetectionFormat::Kitti),
        5.. if !fields.commas && fields.all_numbers() => {
            // Coordinates come before a score or an id.
            let share = |number: &Option<f64>| number.is_some_and(|x| (-0.5..=1.5).contains(&x));
            if numbers[1..5].iter().all(share) {
                Some(DetectionFormat::Yolo)
            } else {
                (7..=10).contains(&count).then_some(DetectionFormat::Mot)
            }
        }
        _ => None,
    })
}

/// How a text begins.
enum Start<'a> {
    /// A JSON object, with its keys.
    Object(BTreeMap<String, IgnoredAny>),
    /// A JSON list, with the keys of its first entry.
    List(BTreeMap<String, IgnoredAny>),
    /// XML, with the name of its outermost element.
    Xml(&'a str),
    /// The first line that is neither empty nor a comment.
    Line(Fields<'a>),
}

/// The fields of a line.
struct Fields<'a> {
    /// Whether they stand between commas.
    commas: bool,
    words: Vec<&'a str>,
}

impl Fields<'_> {
    fn numbers(&self) -> Vec<Option<f64>> {
        self.words.iter().map(|word| word.parse().ok()).collect()
    }

    fn all_numbers(&self) -> bool {
        self.numbers().iter().all(Option::is_some)
    }
}

impl<'a> Start<'a> {
    fn of(text: &'a str) -> Self {
        let text = text.trim_start();
        if text.starts_with('{') {
            return Self::Object(serde_json::from_str(text).unwrap_or_default());
        }
        if let Some(rest) = text.strip_prefix('[') {
            let first = serde_json::Deserializer::from_str(rest).into_iter().next();
            return Self::List(first.and_then(Result::ok).unwrap_or_default());
        }
        if text.starts_with('<') {
            // Before it there may be a declaration, comments and a document type.
            let is_name = |part: &&str| part.starts_with(|c: char| c.is_alphabetic());
            let root = text.split('<').find(is_name).unwrap_or_default();
            return Self::Xml(root.split(|c: char| c.is_whitespace() || "/>".contains(c)).next().unwrap_or_default());
        }
        let line = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
        let line = line.unwrap_or_default();
        let commas = line.contains(',');
        let words = if commas {
            line.trim_end_matches(',').split(',').map(str::trim).collect()
        } else {
            line.split_whitespace().collect()
        };
        Self::Line(Fields { commas, words })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        for name in ["c/sparse/0/cameras.txt", "n/transforms.json", "b/scene_camera.json", "r/oxts/data/0.txt"] {
            make(name, "x");
        }
        make("k/oxts/0000.txt", "x");
        make("k/calib/0000.txt", "x");
        make("t.json", r#"{"frames": [{"transform_matrix": [], "file_path": "a"}]}"#);
        make("p.json", r#"{"a": [1, 2]}"#);
        make("o/reconstruction.json", "x");
        make("d/opensfm/reconstruction.json", "x");
        make("o.json", r#"[{"cameras": {}, "shots": {"a.jpg": {}}}]"#);
        make("a/keyframes/cameras/1.json", r#"{"t_00": 1}"#);
        make("g/frame_00000.json", r#"{"cameraPoseARFrame": []}"#);
        make("m/metadata", r#"{"K": [], "poses": []}"#);
        for table in ["scene", "sample", "sensor", "calibrated_sensor", "sample_data", "ego_pose"] {
            make(&format!("v/v1.0-mini/{table}.json"), "[]");
        }
        make("p.csv", "# mine\n1,2,3,4,5,6,7,8,9,10,11,12\n");
        make("t.txt", "# time\n\n1.5 0 0 0 0 0 0 1\n");
        make("s.json", r#"{"format": "quadlift.scene", "version": 1}"#);
        std::fs::write(folder.path().join("l.bag"), b"\x89MCAP0\r\n").unwrap();
        for (name, format) in [
            ("l.bag", CameraFormat::Mcap),
            ("c", CameraFormat::Colmap),
            ("o", CameraFormat::OpenSfm),
            ("d", CameraFormat::OpenSfm),
            ("o.json", CameraFormat::OpenSfm),
            ("n", CameraFormat::Nerfstudio),
            ("v", CameraFormat::Nuscenes),
            ("v/v1.0-mini", CameraFormat::Nuscenes),
            ("a", CameraFormat::Arkit),
            ("g", CameraFormat::Arkit),
            ("m", CameraFormat::Arkit),
            ("m/metadata", CameraFormat::Arkit),
            ("b", CameraFormat::Bop),
            ("r", CameraFormat::KittiRaw),
            ("k", CameraFormat::Kitti),
            ("t.json", CameraFormat::Nerfstudio),
            ("p.json", CameraFormat::Projections),
            ("p.csv", CameraFormat::Projections),
            ("t.txt", CameraFormat::Tum),
            ("s.json", CameraFormat::Scene),
        ] {
            assert_eq!(detect_cameras(&folder.path().join(name)).unwrap().0, format, "{name}");
        }
        let model = folder.path().join("c/sparse/0");
        assert_eq!(detect_cameras(&model.join("cameras.txt")).unwrap(), (CameraFormat::Colmap, model));
        make("u.txt", "hello\n");
        let error = detect_cameras(&folder.path().join("u.txt")).unwrap_err();
        assert!(error.problem.contains("looked for a scene file, a COLMAP model"), "{error}");
        assert!(detect_cameras(&folder.path().join("no")).unwrap_err().problem.contains("no such file"));
    }

    #[test]
    fn detections_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let cases = [
            ("a.json", r#"{"images": [], "annotations": []}"#, Some(DetectionFormat::Coco)),
            ("b.json", r#"[{"image_id": 1, "bbox": [1, 2, 3, 4]}, {"x"#, Some(DetectionFormat::Coco)),
            ("f.json", r#"[{"id": 1, "annotations": [], "data": {"image": "a"}}]"#, Some(DetectionFormat::LabelStudio)),
            (
                "g.json",
                r#"[{"image": "a", "id": 1, "annotator": 1, "annotation_id": 2}]"#,
                Some(DetectionFormat::LabelStudio),
            ),
            ("c.json", r#"[{"x_min": 1, "tracker_id": 4}]"#, Some(DetectionFormat::Supervision)),
            ("d.json", r#"{"version": "5", "shapes": []}"#, Some(DetectionFormat::LabelMe)),
            ("e.json", r#"{"format": "quadlift.scene"}"#, None),
            ("a.csv", "x_min,y_min,x_max,y_max,class_id\n", Some(DetectionFormat::Supervision)),
            ("b.csv", "image,x0,y0,x1,y1\n", Some(DetectionFormat::Csv)),
            (
                "boxer_3dbbs.csv",
                "time_ns,tx_world_object,ty_world_object,tz_world_object,qw_world_object,qx_world_object,qy_world_object,\
                 qz_world_object,scale_x,scale_y,scale_z,name,instance,sem_id,prob\n",
                Some(DetectionFormat::Boxer),
            ),
            ("c.csv", "0,296.02,160.17,452.29,288.37,0.529\n", Some(DetectionFormat::Csv)),
            ("d.csv", "a.png,296.02,160.17,452.29,288.37\n", Some(DetectionFormat::Csv)),
            ("e.csv", "1,2,296.02,160.17,452.29,288.37\n", None),
            ("a.txt", "1,-1,794.2,47.5,71.2,174.8,67.5,-1,-1,-1\n", Some(DetectionFormat::Mot)),
            ("b.txt", "1 3 794.2 47.5 71.2 174.8 0.9 0 -1\n", Some(DetectionFormat::Mot)),
            ("c.txt", "45 0.479492 0.688771 0.955609 0.5955 0.91 7\n", Some(DetectionFormat::Yolo)),
            ("d.txt", "0 1 Car 0 0 -1.9 1 2 3 4 1 2 3 4 5 6 1\n", Some(DetectionFormat::Kitti)),
            ("e.txt", "Car 0 0 -1.9 1 2 3 4 1 2 3 4 5 6 1 0.9\n", Some(DetectionFormat::Kitti)),
            ("f.txt", "hello world\n", None),
            (
                "a.xml",
                "<?xml version=\"1.0\"?>\n<!-- a < b -->\n<annotation verified=\"yes\">",
                Some(DetectionFormat::Voc),
            ),
            ("b.xml", "<annotations><version>1.1</version>", Some(DetectionFormat::Cvat)),
            ("c.xml", "<annotated/>", None),
        ];
        for (name, text, format) in cases {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert_eq!(detect_detections(&path).ok(), format, "{name}");
        }
        let path = folder.path().join("n.json");
        for (text, place) in
            [("{\"annotations\": [NaN]}", "1:18"), ("[{\"image_id\": 1,}]", "1:17"), ("{\n\"ima", "2:4")]
        {
            std::fs::write(&path, text).unwrap();
            let error = detect_detections(&path).unwrap_err().to_string();
            assert!(error.contains(&format!("n.json:{place}: this is not valid JSON")), "{error}");
        }
        let make = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
            path.parent().unwrap().to_owned()
        };
        make("yolo/labels/a.txt", "");
        make("yolo/labels/classes.txt", "cup\n");
        make("yolo/labels/b.txt", "0 0.5 0.5 0.1 0.1\n");
        assert_eq!(detect_detections(&folder.path().join("yolo")), Ok(DetectionFormat::Yolo));
        make("roboflow/README.dataset.txt", "# cups\n");
        make("roboflow/README.roboflow.txt", "cups - v1\n\nThis dataset was exported via roboflow.com\n");
        make("roboflow/train/labels/a_jpg.rf.0123456789abcdef.txt", "0 0.5 0.5 0.1 0.1\n");
        assert_eq!(detect_detections(&folder.path().join("roboflow")), Ok(DetectionFormat::Yolo));
        make("coco/README.dataset.txt", "# cups\n");
        make("coco/valid/_annotations.coco.json", "{}");
        assert_eq!(detect_detections(&folder.path().join("coco")), Ok(DetectionFormat::Coco));
        let labelme = make("labelme/a.json", r#"{"shapes": []}"#);
        assert_eq!(detect_detections(&labelme), Ok(DetectionFormat::LabelMe));
        let voc = make("voc/Annotations/a.xml", "<annotation/>");
        assert_eq!(detect_detections(&voc), Ok(DetectionFormat::Voc));
        let cvat = make("cvat/annotations.xml", "<annotations/>");
        assert_eq!(detect_detections(&cvat), Ok(DetectionFormat::Cvat));
        make("mot/det/det.txt", "");
        assert_eq!(detect_detections(&folder.path().join("mot")), Ok(DetectionFormat::Mot));
        let error = detect_detections(&make("other/a.txt", "hello\n")).unwrap_err();
        assert!(error.problem.contains("looked for COCO"), "{error}");
    }
}
