//! Cameras of nuScenes: the tables `scene`, `sample`, `sample_data`, `ego_pose`, `calibrated_sensor` and `sensor`.
//!
//! The world is that of the log's map, in meters, z up. Images come undistorted, cameras have OpenCV's axes and the pose
//! `world_from_ego ego_from_camera` of their own time; quaternions are w, x, y, z. Rows are read one by one, and those of other
//! scenes are dropped: `sample_data` of the whole data set has millions. Format: "nuScenes schema"
//! (`docs/schema_nuscenes.md` of nuscenes-devkit).

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use nalgebra::{Matrix4, Vector3};
use quadlift::geometry::CameraModel;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, SeqAccess, Visitor};

use super::format::{Format, PoseFormat};
use super::import::{Import, PixelCenters};
use super::options::ReadOptions;
use super::poses::{inverse, matrix4, rotation_of, rows};
use crate::error::ReadError;
use crate::input::{check_readable, read_error};
use crate::numbers;
use crate::scene_file::{CameraRecord, FrameRecord, RIG_FRAME, SceneFile};
use crate::wording::{count, plain_words, some_of};

/// The tables, in the order in which they are read.
const TABLES: [&str; 6] = ["scene", "sample", "sensor", "calibrated_sensor", "sample_data", "ego_pose"];

/// The folder of the tables: the given one, or the only one with tables in it, such as `v1.0-mini`.
fn tables_in(folder: &Path) -> Option<PathBuf> {
    let has = |place: &Path| TABLES.iter().all(|table| place.join(format!("{table}.json")).is_file());
    if has(folder) {
        return Some(folder.to_owned());
    }
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> = entries.filter(|path| path.is_dir() && has(path)).collect();
    if found.len() == 1 { found.pop() } else { None }
}

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "nuscenes",
    title: "nuScenes",
    about: "A scene of nuScenes, from its tables",
    looks: "nuScenes (sample_data.json)",
    options: &["sequence", "channels", "sweeps", "pixel_centers"],
    finds: |probe| probe.when(probe.folder().is_some_and(|folder| tables_in(folder).is_some())),
    read: read_nuscenes,
};

/// Reads the cameras of a scene, from the folder of the data set or of its tables. Frame ids are the names of the image files,
/// camera ids the channels, times the seconds of the images.
///
/// # Errors
/// [`ReadError`] with table and row, what was found and what was expected.
fn read_nuscenes(folder: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let Some(tables) = tables_in(folder) else {
        let problem = "expected the folder of nuScenes with one version (v1.0-mini or another), or the folder of the tables, with \
                       scene.json, sample.json, sensor.json, calibrated_sensor.json, sample_data.json and ego_pose.json";
        return Err(ReadError::new(folder, problem));
    };
    let paths = TABLES.map(|table| tables.join(format!("{table}.json")));
    let open = |index: usize| {
        let path = paths[index].as_path();
        check_readable(path)?;
        let file = File::open(path).map_err(|error| read_error(path, &error))?;
        Ok(Table { path, reader: Box::new(BufReader::new(file)) as Box<dyn Read> })
    };
    let mut import = read_scene(&tables, &open, options)?;
    let parent = tables.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let image_folder = if tables == folder { tables.join("..") } else { parent.to_owned() };
    import.image_folder = image_folder.is_dir().then_some(image_folder);
    Ok(import)
}

/// The cameras in the bytes of the six tables, in the order of [`read_nuscenes`]'s message; the paths are used in messages.
///
/// # Errors
/// As [`read_nuscenes`].
#[cfg(test)]
fn parse_nuscenes(files: [(&Path, &[u8]); 6], options: &ReadOptions) -> Result<Import, ReadError> {
    let [scene, sample, sensor, calibrated, data, pose] = files;
    let files = [scene, sample, sensor, calibrated, data, pose];
    let open = |index: usize| Ok(Table { path: files[index].0, reader: Box::new(files[index].1) as Box<dyn Read> });
    read_scene(scene.0, &open, options)
}

/// A file of rows.
struct Table<'a> {
    path: &'a Path,
    reader: Box<dyn Read + 'a>,
}

/// Keeps a row, or says what is wrong with it.
type Keep<'k, T> = &'k mut dyn FnMut(T) -> Result<(), String>;

impl Table<'_> {
    /// Reads the rows one by one.
    fn rows<T: DeserializeOwned>(self, keep: Keep<T>) -> Result<(), ReadError> {
        struct Rows<'k, T> {
            keep: Keep<'k, T>,
            index: &'k mut Option<usize>,
        }

        impl<'de, T: DeserializeOwned> Visitor<'de> for Rows<'_, T> {
            type Value = ();

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a list of rows")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
                *self.index = Some(0);
                while let Some(row) = seq.next_element::<T>()? {
                    (self.keep)(row).map_err(serde::de::Error::custom)?;
                    *self.index = self.index.map(|index| index + 1);
                }
                Ok(())
            }
        }

        // The row that is read, once there is a list.
        let mut index = None;
        let mut json = serde_json::Deserializer::from_reader(self.reader);
        let read = json.deserialize_seq(Rows { keep, index: &mut index }).and_then(|()| json.end());
        read.map_err(|error| {
            let (line, column) = (error.line(), error.column());
            let message = error.to_string();
            let message = message.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&message);
            match error.classify() {
                serde_json::error::Category::Data => {
                    let error = ReadError::new(self.path, plain_words(message));
                    index.map_or(error.clone(), |index| error.in_entry(format!("[{index}]")))
                }
                _ => ReadError::new(self.path, format!("this is not valid JSON: {}", plain_words(message)))
                    .at(line, column),
            }
        })
    }
}

#[derive(Deserialize)]
struct SceneRow {
    token: String,
    name: String,
}

#[derive(Deserialize)]
struct SampleRow {
    token: String,
    scene_token: String,
}

#[derive(Deserialize)]
struct SensorRow {
    token: String,
    channel: String,
    modality: String,
}

#[derive(Deserialize)]
struct CalibratedRow {
    token: String,
    sensor_token: String,
    #[serde(deserialize_with = "numbers::list")]
    translation: [f64; 3],
    #[serde(deserialize_with = "numbers::list")]
    rotation: [f64; 4],
    camera_intrinsic: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct DataRow {
    sample_token: String,
    ego_pose_token: String,
    calibrated_sensor_token: String,
    filename: String,
    width: Option<f64>,
    height: Option<f64>,
    timestamp: f64,
    is_key_frame: bool,
}

#[derive(Deserialize)]
struct PoseRow {
    token: String,
    #[serde(deserialize_with = "numbers::list")]
    translation: [f64; 3],
    #[serde(deserialize_with = "numbers::list")]
    rotation: [f64; 4],
}

/// A calibrated camera.
struct Calibrated {
    channel: String,
    ego_from_camera: Matrix4<f64>,
    params: Vec<f64>,
}

/// An image of the scene with the id of its camera.
struct Image {
    row: DataRow,
    camera: String,
    ego_from_camera: Matrix4<f64>,
}

fn read_scene<'a>(
    place: &Path,
    open: &dyn Fn(usize) -> Result<Table<'a>, ReadError>,
    options: &ReadOptions,
) -> Result<Import, ReadError> {
    let chosen = chosen_scene(open, options)?;
    let mut samples = BTreeMap::new();
    open(1)?.rows(&mut |row: SampleRow| {
        if row.scene_token == chosen.token {
            samples.insert(row.token, ());
        }
        Ok(())
    })?;
    let calibrated = calibrated_cameras(open, options)?;
    let mut scene = SceneFile {
        name: Some(chosen.name.clone()),
        length_unit: Some("m".to_owned()),
        up: Some([0.0, 0.0, 1.0]),
        ..SceneFile::default()
    };
    let mut camera_ids: BTreeMap<String, String> = BTreeMap::new();
    let mut images: Vec<Image> = Vec::new();
    let mut sweeps = 0;
    open(4)?.rows(&mut |row: DataRow| {
        let Some(of) = calibrated.get(&row.calibrated_sensor_token) else { return Ok(()) };
        if !samples.contains_key(&row.sample_token) {
            return Ok(());
        }
        if !row.is_key_frame && !options.sweeps {
            sweeps += 1;
            return Ok(());
        }
        let size = |length: Option<f64>| length.filter(|length| *length > 0.0);
        let (width, height) = (size(row.width), size(row.height));
        let id = match camera_ids.get(&row.calibrated_sensor_token) {
            Some(id) => id.clone(),
            None => {
                let known = scene.cameras.iter().filter(|camera| camera.id.starts_with(&of.channel)).count();
                let id = if known == 0 { of.channel.clone() } else { format!("{} {}", of.channel, known + 1) };
                camera_ids.insert(row.calibrated_sensor_token.clone(), id.clone());
                scene.cameras.push(CameraRecord {
                    id: id.clone(),
                    model: CameraModel::Pinhole.name().to_owned(),
                    width,
                    height,
                    params: of.params.clone(),
                    ..CameraRecord::default()
                });
                id
            }
        };
        images.push(Image { row, camera: id, ego_from_camera: of.ego_from_camera });
        Ok(())
    })?;
    let mut poses: BTreeMap<String, Option<Matrix4<f64>>> =
        images.iter().map(|image| (image.row.ego_pose_token.clone(), None)).collect();
    open(5)?.rows(&mut |row: PoseRow| {
        if let Some(known) = poses.get_mut(&row.token) {
            *known = Some(pose(row.rotation, row.translation)?);
        }
        Ok(())
    })?;
    images.sort_by(|a, b| {
        (a.row.timestamp.total_cmp(&b.row.timestamp)).then_with(|| a.row.filename.cmp(&b.row.filename))
    });
    // A key frame has an image of each camera; their poses come from the same vehicle.
    let is_rig = scene.cameras.len() > 1 && !options.sweeps;
    let mut time_steps: BTreeMap<String, usize> = BTreeMap::new();
    for Image { row, camera, ego_from_camera } in images {
        let next = time_steps.len();
        let time_step = *time_steps.entry(row.sample_token).or_insert(next);
        let Some(world_from_ego) = poses.get(&row.ego_pose_token).copied().flatten() else {
            let (file, token) = (row.filename, row.ego_pose_token);
            return Err(ReadError::new(open(5)?.path, format!("there is no pose \"{token}\", which \"{file}\" has")));
        };
        let cam_from_world = inverse(&(world_from_ego * ego_from_camera))
            .ok_or_else(|| ReadError::new(place, format!("the pose of \"{}\" cannot be inverted", row.filename)))?;
        scene.frames.push(FrameRecord {
            id: row.filename.clone(),
            camera: Some(camera),
            cam_from_world: Some(rows(&cam_from_world)),
            image: Some(row.filename),
            // Microseconds.
            time: Some(row.timestamp / 1e6),
            extra: is_rig.then(|| (RIG_FRAME.to_owned(), time_step.into())).into_iter().collect(),
            ..FrameRecord::default()
        });
    }
    scene.cameras.sort_by(|a, b| a.id.cmp(&b.id));
    let mut notes = vec![
        format!("nuScenes, {}: poses of the cameras from those of the vehicle and of the sensors", chosen.name),
        "the world is that of the log's map, in meters, z up".to_owned(),
        options.pixel_centers.note(),
    ];
    if sweeps > 0 {
        notes.push(format!("{} between the key frames left out", count(sweeps, "image")));
    }
    Import { scene, notes, ..Import::default() }.checked(place)
}

/// The scene that was asked for, or the only one.
fn chosen_scene<'a>(
    open: &dyn Fn(usize) -> Result<Table<'a>, ReadError>,
    options: &ReadOptions,
) -> Result<SceneRow, ReadError> {
    let mut scenes = Vec::new();
    open(0)?.rows(&mut |row: SceneRow| {
        scenes.push(row);
        Ok(())
    })?;
    let chosen = match &options.sequence {
        Some(name) => scenes.iter().position(|scene| scene.name == *name),
        None => (scenes.len() == 1).then_some(0),
    };
    let Some(chosen) = chosen else {
        let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        let found = format!("{}: {}", count(names.len(), "scene"), some_of(&names));
        return Err(ReadError::new(
            open(0)?.path,
            match &options.sequence {
                Some(name) => format!("there is no scene \"{name}\"; the tables have {found}"),
                None => format!("choose a scene; the tables have {found}"),
            },
        ));
    };
    Ok(scenes.swap_remove(chosen))
}

/// The cameras that were asked for, or all, by the tokens of their calibrations.
fn calibrated_cameras<'a>(
    open: &dyn Fn(usize) -> Result<Table<'a>, ReadError>,
    options: &ReadOptions,
) -> Result<BTreeMap<String, Calibrated>, ReadError> {
    let mut channels = BTreeMap::new();
    open(2)?.rows(&mut |row: SensorRow| {
        if row.modality == "camera" {
            channels.insert(row.token, row.channel);
        }
        Ok(())
    })?;
    if let Some(name) = options.channels.iter().find(|name| !channels.values().any(|channel| channel == *name)) {
        let mut names: Vec<&String> = channels.values().collect();
        names.sort();
        return Err(ReadError::new(
            open(2)?.path,
            format!("there is no camera \"{name}\"; there are {}", some_of(&names)),
        ));
    }
    let mut calibrated = BTreeMap::new();
    open(3)?.rows(&mut |row: CalibratedRow| {
        let Some(channel) = channels.get(&row.sensor_token) else { return Ok(()) };
        if options.channels.is_empty() || options.channels.contains(channel) {
            let params = pinhole(&row.camera_intrinsic, options.pixel_centers)?;
            let ego_from_camera = pose(row.rotation, row.translation)?;
            calibrated.insert(row.token, Calibrated { channel: channel.clone(), ego_from_camera, params });
        }
        Ok(())
    })?;
    Ok(calibrated)
}

fn pose([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<Matrix4<f64>, String> {
    let rotation = rotation_of([w, x, y, z]);
    let rotation = rotation.ok_or_else(|| format!("the rotation {:?} is not a quaternion w, x, y, z", [w, x, y, z]))?;
    Ok(matrix4(&rotation, &Vector3::from(translation)))
}

/// The parameters of a pinhole camera.
fn pinhole(matrix: &[Vec<f64>], pixel_centers: PixelCenters) -> Result<Vec<f64>, String> {
    let shift = pixel_centers.shift();
    match matrix.iter().map(Vec::as_slice).collect::<Vec<_>>()[..] {
        [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]] if *fx > 0.0 && *fy > 0.0 => {
            Ok(vec![*fx, *fy, cx + shift, cy + shift])
        }
        _ => Err(format!("camera_intrinsic is {matrix:?}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")),
    }
}

#[cfg(test)]
#[path = "nuscenes/tests.rs"]
mod tests;
