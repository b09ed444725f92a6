//! The cameras of a scene file as a rig.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use quadlift::calibrate_rig::{Rig, RigBox, RigCamera, RigCategory};
use quadlift::geometry::CamFromWorld;
use quadlift::nalgebra::{Matrix3x4, Unit, Vector3};
use quadlift::scene::{Scene, SourceError};
use quadlift::solve::CategoryPriors;
use serde_json::Value;

use crate::error::EntryError;
use crate::priors::builtin_priors;
use crate::relocalize::query::{ANY_POSE, box_alone};
use crate::scene_file::{DetectionRecord, FrameRecord, RIG_FRAME, SceneFile};

/// Poses of the frames of a camera that differ by more than this are those of a camera that moves: numbers of the matrix, relative to the
/// distance from the origin.
const SAME_POSE: f64 = 1e-6;

/// Categories whose bodies are upright, besides those that have an `upright_sd` in the table of priors.
const UPRIGHT: [&str; 2] = ["person", "pedestrian"];

/// Other names of people.
const PEOPLE: [&str; 4] = ["people", "persons", "human", "humans"];

/// The name of a category in tables: in small letters, and one for all names of people.
fn in_tables(name: &str) -> String {
    let name = name.trim().to_lowercase();
    if PEOPLE.contains(&name.as_str()) { UPRIGHT[0].to_owned() } else { name }
}

/// How the categories of a rig are taken.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RigOptions {
    /// Sizes of categories, in the unit of the world that is sought.
    pub sizes: CategoryPriors,
    /// Categories whose bodies are upright; without any, people, those with an `upright_sd` in the built-in table of priors, and boxes
    /// without a category.
    pub upright: Vec<String>,
    /// Categories whose objects stay where they are.
    pub still: Vec<String>,
}

impl RigOptions {
    /// What is known of categories, whose names are compared without case.
    pub fn categories(&self, names: &[String]) -> Vec<RigCategory> {
        let table = builtin_priors();
        let is_in = |list: &[String], name: &String| list.iter().any(|known| in_tables(known) == in_tables(name));
        let upright = |name: &String| {
            if self.upright.is_empty() {
                let name = in_tables(name);
                let of_table = table.by_category.get(&name).is_some_and(|prior| prior.upright_sd.is_some());
                of_table || UPRIGHT.contains(&name.as_str())
            } else {
                is_in(&self.upright, name)
            }
        };
        let size = |name: &String| {
            let own = self.sizes.by_category.get(name).or_else(|| self.sizes.of(&in_tables(name)));
            own.and_then(|prior| prior.size)
        };
        let category =
            |name: &String| RigCategory { upright: upright(name), still: is_in(&self.still, name), size: size(name) };
        names.iter().map(category).collect()
    }
}

/// A scene whose cameras are those of a rig, checked.
#[derive(Debug, Clone)]
pub struct RigScene {
    /// Frames and detections; poses that are sought mean nothing.
    scene: Scene,
    /// Index of the camera of each frame.
    pub(super) camera_of: Vec<usize>,
    /// Number of the time step of each frame.
    time_step_of: Vec<usize>,
    /// Poses that are given, by camera.
    given: Vec<Option<CamFromWorld>>,
    /// Upwards in their world.
    up: Option<Unit<Vector3<f64>>>,
    /// Ids of the cameras.
    pub ids: Vec<String>,
}

/// Something that orders time steps.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Key {
    RigFrame(u64),
    Time(f64),
}

impl Key {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        match (self, other) {
            (Self::RigFrame(a), Self::RigFrame(b)) => a.cmp(b),
            (Self::Time(a), Self::Time(b)) => a.total_cmp(b),
            (Self::RigFrame(_), Self::Time(_)) => std::cmp::Ordering::Less,
            (Self::Time(_), Self::RigFrame(_)) => std::cmp::Ordering::Greater,
        }
    }
}

/// Numbers of the time steps of frames: by `rig_frame` if all have one, else by `time`.
fn time_steps(frames: &[FrameRecord]) -> Result<Vec<usize>, EntryError> {
    let rig_frame = |frame: &FrameRecord| frame.extra.get(RIG_FRAME).and_then(Value::as_u64).map(Key::RigFrame);
    let time = |frame: &FrameRecord| frame.time.map(Key::Time);
    let keys: Vec<Key> = match frames.iter().map(rig_frame).collect() {
        Some(keys) => keys,
        None => frames
            .iter()
            .enumerate()
            .map(|(index, frame)| {
                time(frame).ok_or_else(|| {
                    let problem =
                        "there is no \"time\"; every frame of a rig needs one, or every frame a \"rig_frame\"";
                    EntryError::new(format!("frames[{index}]"), problem)
                })
            })
            .collect::<Result<_, _>>()?,
    };
    let mut ordered = keys.clone();
    ordered.sort_by(Key::cmp);
    ordered.dedup();
    Ok(keys.iter().map(|key| ordered.partition_point(|known| known.cmp(key).is_lt())).collect())
}

impl SceneFile {
    /// The cameras of the file as those of a rig: each stays where it is, and frames with the same `rig_frame`, or with equal `time`, were
    /// taken at one time step. With `all` given poses are not used.
    ///
    /// # Errors
    /// [`EntryError`], as of [`SceneFile::to_scene`], names the first invalid entry; also a frame without a camera or a time step, two
    /// frames of a camera at one time step, and a camera whose frames have different poses.
    pub fn to_rig(&self, all: bool) -> Result<RigScene, EntryError> {
        let time_step_of = time_steps(&self.frames)?;
        let numbers: HashMap<&str, usize> = self.cameras.iter().enumerate().map(|(k, c)| (c.id.as_str(), k)).collect();
        let mut posed = Self {
            name: self.name.clone(),
            cameras: self.cameras.clone(),
            frames: self.frames.clone(),
            up: self.up.filter(|_| !all),
            ..Self::default()
        };
        let mut seen = BTreeMap::new();
        let mut given: Vec<Option<([[f64; 4]; 3], usize)>> = vec![None; self.cameras.len()];
        let mut camera_of = Vec::with_capacity(self.frames.len());
        for (index, frame) in posed.frames.iter_mut().enumerate() {
            let wrong = |problem: String| Err(EntryError::new(format!("frames[{index}]"), problem));
            let Some(id) = frame.camera.as_deref() else {
                return wrong("there is no \"camera\"; every frame of a rig needs one".to_owned());
            };
            // Cameras that do not exist are named when the scene is read.
            let camera = numbers.get(id).copied().unwrap_or(0);
            if let Some(other) = seen.insert((camera, time_step_of[index]), index) {
                return wrong(format!(
                    "camera \"{id}\" has another frame at this time step: frames[{other}]; expected one frame of each camera"
                ));
            }
            if all {
                frame.cam_from_world = None;
            }
            match (frame.cam_from_world, given.get(camera).copied().flatten()) {
                (Some(pose), Some((known, of))) if differs(&pose, &known) => {
                    return wrong(format!(
                        "camera \"{id}\" has another pose than in frames[{of}]; expected fixed cameras"
                    ));
                }
                (Some(pose), None) => {
                    if let Some(of_camera) = given.get_mut(camera) {
                        *of_camera = Some((pose, index));
                    }
                }
                _ => {}
            }
            frame.cam_from_world.get_or_insert(ANY_POSE);
            camera_of.push(camera);
        }
        posed.detections = self.detections.iter().map(box_and_object).collect();
        let scene = posed.to_scene()?;
        let given = given.into_iter().map(|of_camera| {
            let (rows, index) = of_camera?;
            let matrix = Matrix3x4::from_fn(|i, j| rows[i][j]);
            Some(
                CamFromWorld::new(matrix)
                    .map_err(|error| EntryError::new(format!("frames[{index}].cam_from_world"), error.to_string())),
            )
        });
        let given = given.map(Option::transpose).collect::<Result<_, _>>()?;
        let ids = self.cameras.iter().map(|camera| camera.id.clone()).collect();
        Ok(RigScene { up: scene.up, scene, camera_of, time_step_of, given, ids })
    }
}

fn differs(a: &[[f64; 4]; 3], b: &[[f64; 4]; 3]) -> bool {
    let size = b.iter().map(|row| row[3].abs()).fold(1.0, f64::max);
    a.iter().flatten().zip(b.iter().flatten()).any(|(a, b)| (a - b).abs() > SAME_POSE * size)
}

/// What is needed of a detection.
fn box_and_object(detection: &DetectionRecord) -> DetectionRecord {
    DetectionRecord { object: detection.object.clone(), ..box_alone(detection) }
}

impl RigScene {
    /// Number of time steps.
    pub fn time_steps(&self) -> usize {
        self.time_step_of.iter().collect::<BTreeSet<_>>().len()
    }

    /// Whether the pose of a camera is given.
    pub fn any_given(&self) -> bool {
        self.given.iter().any(Option::is_some)
    }

    /// Index of a camera.
    pub fn camera(&self, id: &str) -> Option<usize> {
        self.ids.iter().position(|known| known == id)
    }

    /// Categories of the detections.
    pub fn categories(&self) -> &[String] {
        &self.scene.categories
    }

    /// The cameras and the boxes of a source that have at least a score (those without a score count).
    ///
    /// # Errors
    /// [`SourceError`] if the source does not exist, or if none is chosen of several.
    pub fn rig(&self, source: Option<&str>, min_score: Option<f64>, options: &RigOptions) -> Result<Rig, SourceError> {
        let source = self.scene.source_index(source)?;
        let mut categories = options.categories(&self.scene.categories);
        // Boxes without a category are those of people, unless it is said who is upright.
        let without = categories.len();
        categories.push(RigCategory { upright: options.upright.is_empty(), ..RigCategory::default() });
        let mut cameras: Vec<Option<RigCamera>> = vec![None; self.ids.len()];
        for (frame, &camera) in self.scene.frames.iter().zip(&self.camera_of) {
            if let (None, Some(intrinsics)) = (&cameras[camera], frame.projection.intrinsics()) {
                let cam_from_world = self.given[camera];
                cameras[camera] = Some(RigCamera { intrinsics, image_size: frame.image_size, cam_from_world });
            }
        }
        let mut boxes = Vec::new();
        for detection in &self.scene.detections {
            let is_chosen = source.is_none() || detection.source_index == source;
            let is_scored = min_score.is_none_or(|least| detection.score.is_none_or(|score| score >= least));
            let frame = detection.frame_index as usize;
            let view = self.scene.view(detection);
            let Some(bounding_box) = view.measured_box().filter(|_| is_chosen && is_scored) else { continue };
            boxes.push(RigBox {
                camera: self.camera_of[frame],
                time_step: self.time_step_of[frame],
                object: detection.object_index.map(|k| k as usize),
                category: Some(detection.category_index.map_or(without, |k| k as usize)),
                bounding_box,
                box_in_image: view.box_in_image,
            });
        }
        // A camera without frames has no boxes: its intrinsics do not matter.
        let unused = || RigCamera {
            intrinsics: quadlift::geometry::Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
            image_size: None,
            cam_from_world: None,
        };
        let cameras = cameras.into_iter().map(|camera| camera.unwrap_or_else(unused)).collect();
        Ok(Rig { cameras, categories, boxes, up: self.up })
    }
}
