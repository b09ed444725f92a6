//! The object map as a Python object: frames with detections in, events out.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use nalgebra::Matrix3x4;
use numpy::{PyArray1, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use quadlift::geometry::{CamFromWorld, Projection, quaternion_from_rotation};
use quadlift::online::{FrameUpdate, MapObject, ObjectId, ObjectMap, OnlineOptions, Presence};
use quadlift::solve::PoseNoise;
use quadlift_io::options::MAP;
use quadlift_io::run::FileInput;
use quadlift_io::scene_file::FrameRecord;
use quadlift_io::stream::{
    AboutRecord, CameraOfFrame, FrameLine, OutputLine, PoseRecord, StoredPriors, StoredStream, StreamState,
    StreamedScene, lasting_options, parse_stored_stream, read_stored_stream, write_state,
};
use quadlift_io::{EntryError, SceneFile, write_file};
use serde_json::{Map, Value};

use crate::detections::DetectionArrays;
use crate::error::refuse;
use crate::live::Live;
use crate::loaded::Loaded;
use crate::localized::{PyLocalized, localized};
use crate::options::{Chosen, LocalizeKeywords, chosen, read_priors};
use crate::relocalize::{LocateQuery, location};
use crate::run::in_background;

/// The name of pickled bytes in messages.
const PICKLED: &str = "the pickled map";

/// A map of objects. Calls of several threads come one after another.
#[pyclass(name = "ObjectMap", module = "quadlift._core", frozen)]
pub struct PyObjectMap {
    /// The options that the map depends on, as a state has them.
    options: Map<String, Value>,
    /// Standard deviations of the poses of frames without their own.
    pose_noise: Option<PoseNoise>,
    state: Mutex<State>,
}

/// What changes.
struct State {
    stream: StreamState,
    live: Live,
}

impl From<StreamState> for State {
    fn from(stream: StreamState) -> Self {
        Self { stream, live: Live::default() }
    }
}

/// The keywords of an object map, as Python hands them over. Names are those of the program.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct MapKeywords {
    name: Option<String>,
    up: Option<[f64; 3]>,
    length_unit: Option<String>,
    /// Those of [`MAP`] that are given.
    chosen: Chosen,
    /// "builtin" or a path.
    priors: Option<String>,
    /// The text of a file of priors, in the place of a path.
    priors_text: Option<String>,
    pose_noise: Option<[f64; 2]>,
}

/// A posed frame: the dictionary `MapFrame` of `python/quadlift/_arrays.py`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct MapFrame {
    id: String,
    time: f64,
    /// Id of a camera that was given before.
    camera: Option<String>,
    /// Id, COLMAP's name of the model, and parameters of a camera.
    new_camera: Option<(Option<String>, String, Vec<f64>)>,
    cam_from_world: Option<Rows>,
    projection: Option<Rows>,
    /// Width and height.
    image_size: Option<[f64; 2]>,
    image: Option<String>,
    pose_noise: Option<[f64; 2]>,
}

/// The rows of a matrix.
type Rows = [[f64; 4]; 3];

fn matrix(rows: &Rows) -> Matrix3x4<f64> {
    Matrix3x4::from_fn(|i, j| rows[i][j])
}

fn noise(sds: [f64; 2]) -> PoseNoise {
    PoseNoise { rotation_sd: sds[0], translation_sd: sds[1] }
}

impl MapFrame {
    /// The frame with its detections as a line of a stream has them, or what is wrong.
    fn into_line(self, detections: &DetectionArrays) -> Result<FrameLine, String> {
        if let Some(rows) = &self.cam_from_world {
            CamFromWorld::new(matrix(rows)).map_err(|error| format!("cam_from_world: {error}"))?;
        }
        if let Some(rows) = &self.projection {
            Projection::from_matrix(matrix(rows)).map_err(|error| format!("projection: {error}"))?;
        }
        let detections = detections.records(&self.id)?;
        let [width, height] = [0, 1].map(|k| self.image_size.map(|size| size[k]));
        let camera = self.new_camera.map(|(id, model, params)| CameraOfFrame { id, model, width, height, params });
        // The size of a new camera is that of its images.
        let of_frame = |size: Option<f64>| size.filter(|_| camera.is_none());
        let record = FrameRecord {
            camera: self.camera,
            cam_from_world: self.cam_from_world,
            projection: self.projection,
            width: of_frame(width),
            height: of_frame(height),
            image: self.image,
            time: Some(self.time),
            id: self.id,
            ..Default::default()
        };
        Ok(FrameLine { record, camera, detections, pose_noise: self.pose_noise.map(noise) })
    }
}

/// The error of an entry of a frame.
fn in_frame(id: &str, error: &EntryError) -> String {
    match error.entry.as_str() {
        "" => error.problem.clone(),
        entry => format!("frame \"{id}\": {entry}: {}", error.problem),
    }
}

/// The object with an id as files and events have it.
fn object_id(text: &str) -> Option<ObjectId> {
    let id = ObjectId(text.strip_prefix("object_")?.parse().ok()?);
    (id.to_string() == text).then_some(id)
}

/// The object that an id means now; an error if the map has none.
fn known(map: &ObjectMap, text: &str) -> Result<MapObject, String> {
    object_id(text).and_then(|id| map.object(id)).ok_or_else(|| format!("there is no object \"{text}\" in the map"))
}

impl PyObjectMap {
    fn of_stored(stored: StoredStream) -> Self {
        let StoredStream { state, options, pose_noise } = stored;
        Self { options, pose_noise, state: Mutex::new(state.into()) }
    }

    /// The map, where no other thread is at work on it.
    fn lock(&self) -> Result<MutexGuard<'_, State>, String> {
        // A thread that had the map has failed on the way.
        self.state.lock().map_err(|_| "an internal error has damaged this map; load it again".to_owned())
    }

    /// Works on the map without Python's lock.
    fn with<T: Send>(
        &self,
        py: Python,
        work: impl FnOnce(&mut StreamState) -> Result<T, String> + Send,
    ) -> PyResult<T> {
        self.with_live(py, |state| work(&mut state.stream))
    }

    /// The same with what is shown.
    fn with_live<T: Send>(&self, py: Python, work: impl FnOnce(&mut State) -> Result<T, String> + Send) -> PyResult<T> {
        py.detach(|| work(&mut *self.lock()?)).map_err(refuse)
    }

    fn read<T: Send>(&self, py: Python, work: impl FnOnce(&ObjectMap) -> T + Send) -> PyResult<T> {
        self.with(py, |stream| Ok(work(&stream.map)))
    }
}

#[pymethods]
impl PyObjectMap {
    #[new]
    fn new(keywords: MapKeywords) -> PyResult<Self> {
        let unit = keywords.length_unit.as_deref();
        let priors = read_priors(keywords.priors.as_deref(), keywords.priors_text.as_deref(), unit)?;
        let stored = match (&keywords.priors, &keywords.priors_text) {
            (_, Some(text)) => Some(StoredPriors::Text { text: text.clone() }),
            (name, None) => name.clone().map(StoredPriors::Name),
        };
        let options = OnlineOptions { priors, ..chosen(MAP, &keywords.chosen)? };
        let pose_noise = keywords.pose_noise.map(noise);
        if let Some([rotation, translation]) = keywords.pose_noise.filter(|sds| !sds.iter().all(|sd| *sd > 0.0)) {
            return Err(refuse(format!("pose_noise is ({rotation}, {translation}); expected two numbers above 0")));
        }
        let lasting = lasting_options(&options, stored.as_ref(), pose_noise, None);
        let map = ObjectMap::new(options).map_err(refuse)?;
        let mut scene = StreamedScene::default();
        let MapKeywords { name, up, length_unit, .. } = keywords;
        let about = AboutRecord { name, length_unit, up, ..AboutRecord::default() };
        scene.take_in(&about).map_err(|error| refuse(format!("{}: {}", error.entry, error.problem)))?;
        let state = Mutex::new(StreamState { map, scene, poses_since: 0 }.into());
        Ok(Self { options: lasting, pose_noise, state })
    }

    /// Reads a state.
    #[staticmethod]
    fn load(py: Python, path: PathBuf) -> PyResult<Self> {
        py.detach(|| read_stored_stream(&path)).map(Self::of_stored).map_err(refuse)
    }

    /// The map of the bytes of a state.
    #[staticmethod]
    fn parse(py: Python, bytes: &[u8]) -> PyResult<Self> {
        py.detach(|| parse_stored_stream(Path::new(PICKLED), bytes)).map(Self::of_stored).map_err(refuse)
    }

    /// Writes the state.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        self.with(py, |stream| {
            write_file(&path, |out| write_state(out, stream, &self.options)).map_err(|error| error.to_string())
        })
    }

    /// The state as bytes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.with(py, |stream| {
            let mut bytes = Vec::new();
            write_state(&mut bytes, stream, &self.options).map_err(|error| error.to_string())?;
            Ok(bytes)
        })?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn copy(&self, py: Python) -> PyResult<Self> {
        let state = Mutex::new(self.with(py, |stream| Ok(stream.clone()))?.into());
        Ok(Self { options: self.options.clone(), pose_noise: self.pose_noise, state })
    }

    /// The camera of an image in the map, and the ids that its objects are indices into.
    fn relocalize<'py>(&self, py: Python<'py>, query: LocateQuery) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
        let (boxes, of_map) = (query.query()?, self.read(py, ObjectMap::locate_options)?);
        let options = query.options(of_map)?;
        let found = self.read(py, |map| map.relocalize(&boxes, &options))?;
        let rows: Vec<usize> = (0..found.ids.len()).collect();
        let ids = found.ids.iter().map(ToString::to_string).collect();
        Ok((location(py, &found.located, boxes.boxes.len(), &rows)?, ids))
    }

    /// Observes a frame; its line of the output of `quadlift stream`.
    fn observe(&self, py: Python, frame: MapFrame, detections: DetectionArrays) -> PyResult<String> {
        let id = frame.id.clone();
        let line = frame.into_line(&detections).map_err(|problem| refuse(format!("frame \"{id}\": {problem}")))?;
        self.with_live(py, |State { stream: StreamState { map, scene, poses_since }, live }| {
            let mut checked = scene.check(line, map).map_err(|error| in_frame(&id, &error))?;
            checked.frame.pose_noise = checked.frame.pose_noise.or(self.pose_noise);
            let update = map.observe(&checked.frame, &checked.detections()).map_err(|error| error.to_string())?;
            live.frame(map, &checked, &update);
            scene.keep(checked, map);
            *poses_since = 0;
            Ok(OutputLine::of_frame(&id, &update).to_text())
        })
    }

    /// Moves frames; the line of the output of `quadlift stream`.
    fn update_poses(
        &self,
        py: Python,
        frame_ids: Vec<String>,
        cam_from_world: Option<PyReadonlyArray3<f64>>,
        projections: Option<PyReadonlyArray3<f64>>,
    ) -> PyResult<String> {
        let rows = |matrices: &Option<PyReadonlyArray3<f64>>, k: usize| -> Option<Rows> {
            let matrices = matrices.as_ref()?.as_array();
            Some(std::array::from_fn(|i| std::array::from_fn(|j| matrices[[k, i, j]])))
        };
        let record = |(k, frame): (usize, &String)| PoseRecord {
            frame: frame.clone(),
            cam_from_world: rows(&cam_from_world, k),
            projection: rows(&projections, k),
        };
        let poses: Vec<PoseRecord> = frame_ids.iter().enumerate().map(record).collect();
        self.with_live(py, |State { stream: StreamState { map, scene, poses_since }, live }| {
            let updates = scene.take_in_poses(&poses).map_err(|error| in_poses(&frame_ids, &error))?;
            let update = map.update_poses(&updates);
            *poses_since += 1;
            live.others(map, &update);
            Ok(OutputLine::of_poses(updates.len(), &update).to_text())
        })
    }

    /// Assigns the last frames once more; the line of the output of `quadlift stream`.
    fn settle(&self, py: Python) -> PyResult<String> {
        self.with_live(py, |State { stream: StreamState { map, .. }, live }| {
            let update = map.settle();
            live.others(map, &update);
            Ok(OutputLine::of_end(map.frames(), &update).to_text())
        })
    }

    /// Merges two objects; the id that stays.
    fn merge(&self, py: Python, first: &str, second: &str) -> PyResult<String> {
        self.with_live(py, |State { stream: StreamState { map, .. }, live }| {
            let (a, b) = (known(map, first)?.id, known(map, second)?.id);
            if a == b {
                return Err(format!("\"{first}\" and \"{second}\" are the same object already"));
            }
            let merged = map.merge(a, b).map(|id| id.to_string());
            live.others(map, &FrameUpdate::default());
            merged
                .ok_or_else(|| format!("\"{first}\" and \"{second}\" cannot be merged: no body fits the views of both"))
        })
    }

    /// Removes an object.
    fn remove(&self, py: Python, id: &str) -> PyResult<()> {
        self.with_live(py, |State { stream: StreamState { map, .. }, live }| {
            let id = known(map, id)?.id;
            map.remove(id);
            live.others(map, &FrameUpdate::default());
            Ok(())
        })
    }

    /// The object that an id means now, if there is one.
    fn resolve(&self, py: Python, id: &str) -> PyResult<Option<String>> {
        self.read(py, |map| known(map, id).ok().map(|object| object.id.to_string()))
    }

    /// What the map knows of its objects by name, N rows: of those with these ids, or of all.
    fn memory<'py>(&self, py: Python<'py>, ids: Option<Vec<String>>, tentative: bool) -> PyResult<Bound<'py, PyDict>> {
        let objects = self.with(py, |StreamState { map, .. }| match ids {
            Some(ids) => ids.iter().map(|id| known(map, id)).collect(),
            None => {
                let mut objects: Vec<MapObject> = map.objects().collect();
                if tentative {
                    objects.extend(map.tentative_objects());
                    objects.sort_by_key(|object| object.id);
                }
                Ok(objects)
            }
        })?;
        memory_arrays(py, &objects)
    }

    /// What has changed for a viewer since the last call, as JSON.
    fn live(&self, py: Python) -> PyResult<String> {
        let record =
            self.with_live(py, |State { stream, live }| Ok(live.take(&stream.map, stream.scene.about().up)))?;
        serde_json::to_string(&record).map_err(refuse)
    }

    /// Localizes the objects.
    fn localize(
        &self,
        py: Python,
        keywords: LocalizeKeywords,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PyLocalized> {
        let input = self.with(py, |StreamState { map, scene, .. }| {
            FileInput::of_map(scene, map, Path::new("")).map_err(|error| error.to_string())
        })?;
        let loaded = Arc::new(Loaded::new(SceneFile::clone(&input.file), PathBuf::new())?);
        let options = keywords.options()?;
        in_background(py, threads, progress, move |ticker| localized(loaded, input, &options, ticker))
    }

    /// The options by the names of the program, as JSON.
    #[getter]
    fn options_json(&self) -> String {
        Value::from(self.options.clone()).to_string()
    }

    /// Numbers of confirmed and of gone objects, and of frames.
    #[getter]
    fn counts(&self, py: Python) -> PyResult<(usize, usize, u64)> {
        self.read(py, |map| {
            let gone = map.objects().filter(|object| object.presence == Presence::Gone).count();
            (map.objects().count() - gone, gone, map.frames())
        })
    }

    /// Id and time of the last frame.
    #[getter]
    fn last_frame(&self, py: Python) -> PyResult<Option<(String, f64)>> {
        self.read(py, |map| map.last_frame().map(|(id, time)| (id.to_owned(), time)))
    }

    /// Whether poses, cameras and boxes are consistent, if that is known.
    #[getter]
    fn consistent(&self, py: Python) -> PyResult<Option<bool>> {
        self.read(py, ObjectMap::consistent)
    }

    /// Ids of the frames that the map keeps.
    #[getter]
    fn kept_frames(&self, py: Python) -> PyResult<Vec<String>> {
        self.read(py, |map| map.kept_frames().map(|frame| frame.id.clone()).collect())
    }

    #[getter]
    fn length_unit(&self, py: Python) -> PyResult<Option<String>> {
        self.with(py, |stream| Ok(stream.scene.about().length_unit.clone()))
    }
}

/// The error of an entry of new poses, with the arguments of Python.
fn in_poses(frame_ids: &[String], error: &EntryError) -> String {
    let place = error.entry.strip_prefix("poses[").and_then(|rest| {
        let (index, field) = rest.split_once(']')?;
        Some((frame_ids.get(index.parse::<usize>().ok()?)?, field.trim_start_matches('.')))
    });
    match place {
        Some((id, "")) => format!("frame \"{id}\": {}", error.problem),
        Some((id, field)) => format!("frame \"{id}\": {field}: {}", error.problem),
        None => error.problem.clone(),
    }
}

/// Objects of a map as arrays by name.
fn memory_arrays<'py>(py: Python<'py>, objects: &[MapObject]) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let texts =
        |name: &str, of: &dyn Fn(&MapObject) -> String| dict.set_item(name, objects.iter().map(of).collect::<Vec<_>>());
    texts("object_ids", &|o| o.id.to_string())?;
    texts("presence", &|o| o.presence.name().to_owned())?;
    let numbers = |name: &str, of: &dyn Fn(&MapObject) -> Vec<f64>| {
        dict.set_item(name, PyArray1::from_vec(py, objects.iter().flat_map(of).collect()))
    };
    numbers("existence", &|o| vec![o.existence])?;
    numbers("evidence", &|o| vec![o.evidence])?;
    numbers("centers", &|o| o.ellipsoid.center.iter().copied().collect())?;
    numbers("half_extents", &|o| o.ellipsoid.semi_axes.iter().copied().collect())?;
    numbers("quaternions", &|o| quaternion_from_rotation(&o.ellipsoid.rotation).to_vec())?;
    numbers("first_seen", &|o| vec![o.first_seen])?;
    numbers("last_seen", &|o| vec![o.last_seen])?;
    let counts = |name: &str, of: &dyn Fn(&MapObject) -> usize| {
        dict.set_item(name, PyArray1::from_vec(py, objects.iter().map(|o| of(o) as i64).collect()))
    };
    counts("detections", &|o| o.detections)?;
    counts("expected_views", &|o| o.expected_views)?;
    counts("kept_views", &|o| o.kept_views)?;
    dict.set_item("categories", objects.iter().map(|o| o.categories.clone()).collect::<Vec<_>>())?;
    Ok(dict)
}
