//! Writing a scene file: one record per line, so that people can read it and tools can compare it.

use std::borrow::Borrow;
use std::io::{self, Write};
use std::path::Path;

use quadlift::Localization;
use quadlift::scene::Scene;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::object_records::ObjectRecord;
use super::records::{CameraRecord, DetectionRecord, FORMAT, FrameRecord, SceneFile, VERSION};
use super::results::{Detail, estimates_to_objects};
use crate::atomic::write_file;
use crate::error::WriteError;

/// Writes a scene file as a whole or not at all; an earlier file of this name survives a failure.
///
/// # Errors
/// [`WriteError`] if the system reports an error (see [`write_file`]), or if a record contains a non-finite number.
pub fn write_scene_file(path: &Path, scene: &SceneFile) -> Result<(), WriteError> {
    write_file(path, |out| write_scene(scene, out))
}

/// Writes a result with the objects of a localization, without all of them being in memory as records at once. `detail` says
/// how much of each object is written.
///
/// # Errors
/// As [`write_scene_file`].
pub(crate) fn write_localized_file(
    path: &Path,
    result: &SceneFile,
    scene: &Scene,
    localization: &Localization,
    detail: Detail,
) -> Result<(), WriteError> {
    let objects = estimates_to_objects(scene, localization).map(|mut object| {
        detail.apply(&mut object);
        object
    });
    write_file(path, |out| write_records(result, objects, out))
}

/// Writes a scene as JSON. The same scene gives the same bytes.
///
/// # Errors
/// What the writer reports; [`io::ErrorKind::InvalidData`] names a record that holds a number that is not finite.
pub fn write_scene(scene: &SceneFile, out: &mut dyn Write) -> io::Result<()> {
    write_records(scene, scene.objects.iter(), out)
}

/// Writes a scene with these objects instead of its own.
fn write_records(
    scene: &SceneFile,
    objects: impl Iterator<Item = impl Borrow<ObjectRecord>>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let mut members = Members { out, any: false, line: Vec::new() };
    members.value("format", &FORMAT.to_owned())?;
    members.value("version", &VERSION)?;
    members.optional("name", &scene.name)?;
    members.optional("length_unit", &scene.length_unit)?;
    members.optional("up", &scene.up)?;
    members.optional("notes", &scene.notes)?;
    members.optional("localization", &scene.localization)?;
    members.list::<CameraRecord>("cameras", scene.cameras.iter())?;
    members.list::<FrameRecord>("frames", scene.frames.iter())?;
    if !scene.cue_sources.is_empty() {
        members.value("cue_sources", &scene.cue_sources)?;
    }
    members.list::<[f64; 3]>("points", scene.points.iter())?;
    members.optional("point_cloud", &scene.point_cloud)?;
    members.list::<DetectionRecord>("detections", scene.detections.iter())?;
    members.list::<ObjectRecord>("objects", objects)?;
    for (key, value) in &scene.extra {
        members.value(key, value)?;
    }
    members.out.write_all(b"\n}\n")
}

/// Writes the members of the outer object.
struct Members<'a> {
    out: &'a mut dyn Write,
    any: bool,
    line: Vec<u8>,
}

impl Members<'_> {
    fn key(&mut self, key: &str) -> io::Result<()> {
        self.out.write_all(if self.any { b",\n  " } else { b"{\n  " })?;
        self.any = true;
        serde_json::to_writer(&mut self.out, key)?;
        self.out.write_all(b": ")
    }

    fn value<T: Serialize + DeserializeOwned + PartialEq>(&mut self, key: &str, value: &T) -> io::Result<()> {
        self.key(key)?;
        self.checked(value, || key.to_owned())
    }

    fn optional<T: Serialize + DeserializeOwned + PartialEq>(
        &mut self,
        key: &str,
        value: &Option<T>,
    ) -> io::Result<()> {
        value.as_ref().map_or(Ok(()), |value| self.value(key, value))
    }

    /// A list of records; nothing if it is empty.
    fn list<T: Serialize + DeserializeOwned + PartialEq>(
        &mut self,
        key: &str,
        records: impl Iterator<Item = impl Borrow<T>>,
    ) -> io::Result<()> {
        let mut any = false;
        for (index, record) in records.enumerate() {
            if !any {
                self.key(key)?;
            }
            self.out.write_all(if any { b",\n    " } else { b"[\n    " })?;
            any = true;
            self.checked::<T>(record.borrow(), || format!("{key}[{index}]"))?;
        }
        if any { self.out.write_all(b"\n  ]") } else { Ok(()) }
    }

    /// Writes a value. JSON writers turn NaN and infinity into `null` silently; where there is a `null`, the text is
    /// read back to see whether it still says the same.
    fn checked<T: Serialize + DeserializeOwned + PartialEq>(
        &mut self,
        value: &T,
        place: impl Fn() -> String,
    ) -> io::Result<()> {
        self.line.clear();
        serde_json::to_writer(&mut self.line, value)?;
        let has_null = self.line.windows(4).any(|four| four == b"null");
        // As text, not bytes, like the files that are read: the readers of all records are built once.
        let is_same = |line| serde_json::from_str::<T>(line).is_ok_and(|back| back == *value);
        if has_null && !std::str::from_utf8(&self.line).is_ok_and(is_same) {
            let problem = format!("{} holds a number that is not finite, which JSON cannot express", place());
            return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
        }
        self.out.write_all(&self.line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::parse_scene_file;

    fn small() -> SceneFile {
        let camera = CameraRecord {
            id: "cam".into(),
            model: "PINHOLE".into(),
            width: Some(640.0),
            height: Some(480.0),
            params: vec![500.0, 500.5, 320.0, 240.0],
            ..Default::default()
        };
        let detection = |frame: &str| DetectionRecord {
            frame: frame.into(),
            bounding_box: Some([0.1, 1e-7, 2.0, 3.0]),
            occluded: Some(1.0),
            ..Default::default()
        };
        let mut scene = SceneFile {
            name: Some("small".into()),
            up: Some([0.0, -1.0, 0.0]),
            points: vec![[0.5, -1.0, 2.0], [1e-7, 3.0, 0.25]],
            cameras: vec![camera],
            detections: vec![detection("a"), detection("null")],
            ..Default::default()
        };
        scene.extra.insert("mine".into(), serde_json::json!({"deep": [1, null]}));
        scene
    }

    #[test]
    fn one_record_per_line() {
        let mut bytes = Vec::new();
        write_scene(&small(), &mut bytes).unwrap();
        insta::assert_snapshot!(std::str::from_utf8(&bytes).unwrap(), @r#"
{
  "format": "quadlift.scene",
  "version": 1,
  "name": "small",
  "up": [0.0,-1.0,0.0],
  "cameras": [
    {"id":"cam","model":"PINHOLE","width":640,"height":480,"params":[500.0,500.5,320.0,240.0]}
  ],
  "points": [
    [0.5,-1.0,2.0],
    [1e-7,3.0,0.25]
  ],
  "detections": [
    {"frame":"a","box":[0.1,1e-7,2.0,3.0],"occluded":1},
    {"frame":"null","box":[0.1,1e-7,2.0,3.0],"occluded":1}
  ],
  "mine": {"deep":[1,null]}
}
"#);
        assert_eq!(parse_scene_file("a.json".as_ref(), &bytes).unwrap(), small());
        let mut again = Vec::new();
        write_scene(&small(), &mut again).unwrap();
        assert_eq!(bytes, again);
    }

    #[test]
    fn numbers_that_json_cannot_hold_are_refused_and_the_earlier_file_survives() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        write_scene_file(&path, &small()).unwrap();
        let before = std::fs::read(&path).unwrap();
        let mut scene = small();
        scene.detections[1].score = Some(f64::NAN);
        let error = write_scene_file(&path, &scene).unwrap_err();
        assert_eq!(error.problem, "detections[1] holds a number that is not finite, which JSON cannot express");
        let mut scene = small();
        scene.up = Some([f64::INFINITY, 0.0, 0.0]);
        assert!(write_scene_file(&path, &scene).unwrap_err().problem.starts_with("up holds"));
        assert_eq!(std::fs::read(&path).unwrap(), before);
    }

    #[test]
    fn objects_written_one_by_one_give_the_same_bytes() {
        use crate::run::{FileInput, FileOptions, run_file};
        use quadlift::synthetic::{Observations, SyntheticOptions, generate};

        let made = SyntheticOptions { objects: 5, views: 6, observations: Observations::Boxes, ..Default::default() };
        let input = FileInput::of(small().into(), generate(&made).unwrap().scene.into(), Path::new(""));
        let run = run_file(input, &FileOptions::default(), &quadlift::Unobserved).unwrap();
        let mut at_once = Vec::new();
        write_scene(&run.result(), &mut at_once).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        run.write(&path, Detail::Full, None).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), at_once);
        let full = parse_scene_file(&path, &at_once).unwrap();
        assert_eq!(full.objects.len(), 5);
        run.write(&path, Detail::Compact, None).unwrap();
        let brief = parse_scene_file(&path, &std::fs::read(&path).unwrap()).unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() < at_once.len() as u64 / 2);
        for (brief, full) in brief.objects.iter().zip(full.objects) {
            assert!(full.covariance.is_some() && full.view_residuals_px.len() == 6);
            let expected = ObjectRecord { covariance: None, view_residuals_px: Vec::new(), ..full };
            assert_eq!(*brief, expected);
        }
    }
}
