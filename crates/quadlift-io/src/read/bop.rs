//! A scene of a BOP data set: `scene_camera.json`, `scene_gt.json`, `scene_gt_info.json`, and `models_info.json` of the
//! data set.
//!
//! Lengths are millimeters and become meters. Intrinsics are center-based: half a pixel is added. Format: "BOP datasets
//! format" of the bop_toolkit.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::format::{Format, PoseFormat};
use super::import::{Import, camera_id};
use super::json::{Node, parse_json};
use super::options::ReadOptions;
use super::poses::{check_rigid, inverse, matrix4, rows};
use super::static_objects::LabelledObjects;
use crate::error::ReadError;
use crate::images::read_image_size;
use crate::input::read_bytes;
use crate::scene_file::{CameraRecord, DetectionRecord, FrameRecord, MaskRecord, ObjectRecord, SceneFile};
use crate::wording::count;

/// Meters in a millimeter.
const MM: f64 = 1e-3;

/// Folders and kinds of images.
const IMAGES: [(&str, &str); 4] = [("rgb", "png"), ("rgb", "jpg"), ("gray", "png"), ("gray", "tif")];

/// Number of parent folders in which the files of the data set are searched.
const LEVELS: usize = 4;

/// The files of a scene with their paths, which serve for messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct BopFiles<'a> {
    /// `scene_camera.json`.
    pub camera: (&'a Path, &'a [u8]),
    /// `scene_gt.json`: the poses of the objects.
    pub ground_truth: Option<(&'a Path, &'a [u8])>,
    /// `scene_gt_info.json`: their boxes.
    pub info: Option<(&'a Path, &'a [u8])>,
    /// `models_info.json`: the extents of their models.
    pub models: Option<(&'a Path, &'a [u8])>,
}

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "bop",
    title: "BOP",
    about: "A scene of a BOP data set",
    looks: "BOP (scene_camera.json)",
    options: &["world_object", "models", "image_size"],
    finds: |probe| {
        if probe.is_named(&["scene_camera.json"]) && probe.keys()?.are_of_object() {
            return Ok(Some(probe.path().parent().unwrap_or(Path::new("")).to_owned()));
        }
        probe.when(probe.has("scene_camera.json"))
    },
    read: read_bop,
};

/// Reads the scene in a folder such as `test/000002`. The boxes of `scene_gt_info.json` become detections of the sources
/// `bbox_obj` (of the whole object) and `bbox_visib` (of what is visible), the models' boxes the true objects.
///
/// # Errors
/// [`ReadError`] with the entry, what was found and what was expected.
fn read_bop(folder: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let above: Vec<&Path> = folder.ancestors().take(LEVELS).collect();
    let find_above = |name: &str| above.iter().map(|folder| folder.join(name)).find(|path| path.is_file());
    let in_folder = |name: &str| Some(folder.join(name)).filter(|path| path.is_file());
    let camera = OwnedFile::read(folder.join("scene_camera.json"))?;
    let ground_truth = in_folder("scene_gt.json").map(OwnedFile::read).transpose()?;
    let info = in_folder("scene_gt_info.json").map(OwnedFile::read).transpose()?;
    let models = options.models.clone().or_else(|| find_above("models/models_info.json"));
    let models = models.map(OwnedFile::read).transpose()?;
    let image_size = match (options.image_size, find_above("camera.json")) {
        (Some(size), _) => Some(size),
        (None, Some(path)) => Some(size_in_camera_file(&OwnedFile::read(path)?)?),
        (None, None) => None,
    };
    let files = BopFiles {
        camera: camera.borrow(),
        ground_truth: ground_truth.as_ref().map(OwnedFile::borrow),
        info: info.as_ref().map(OwnedFile::borrow),
        models: models.as_ref().map(OwnedFile::borrow),
    };
    let mut import = parse_bop(files, options.world_object, image_size)?;
    let name = folder.file_name().map(|name| name.to_string_lossy().into_owned());
    import.scene.name = name.map(|name| format!("bop_{name}"));
    add_images(&mut import, folder);
    Ok(import)
}

/// A file with its path.
struct OwnedFile {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl OwnedFile {
    fn read(path: PathBuf) -> Result<Self, ReadError> {
        Ok(Self { bytes: read_bytes(&path)?, path })
    }

    fn borrow(&self) -> (&Path, &[u8]) {
        (&self.path, &self.bytes)
    }
}

/// Width and height in `camera.json` of a data set.
fn size_in_camera_file(file: &OwnedFile) -> Result<[f64; 2], ReadError> {
    let value = parse_json(&file.path, &file.bytes)?;
    let root = Node::root(&file.path, &value);
    Ok([root.member("width")?.number()?, root.member("height")?.number()?])
}

/// Refers to existing images and masks, and reads the image size from the first image if it is unknown.
fn add_images(import: &mut Import, folder: &Path) {
    let mut size = None;
    for frame in &mut import.scene.frames {
        let names = IMAGES.iter().map(|(kind, extension)| format!("{kind}/{}.{extension}", frame.id));
        frame.image = names.into_iter().find(|name| folder.join(name).is_file());
        if let (None, Some(image)) = (&size, &frame.image) {
            size = read_image_size(&folder.join(image)).ok();
        }
    }
    if let Some([width, height]) = size {
        for camera in import.scene.cameras.iter_mut().filter(|camera| camera.width.is_none()) {
            (camera.width, camera.height) = (Some(f64::from(width)), Some(f64::from(height)));
        }
    }
    for detection in &mut import.scene.detections {
        let path = detection.mask.as_ref().and_then(|mask| mask.path.clone());
        if !path.is_some_and(|path| folder.join(path).is_file()) {
            detection.mask = None;
        }
    }
    if import.scene.cameras.iter().any(|camera| camera.width.is_none()) {
        import.notes.push("the image size is unknown: box edges at the border are not treated as cut off".to_owned());
    }
    import.image_folder = Some(folder.to_owned());
}

/// The scene in the bytes of its files. Masks are named where BOP's layout has them, whether they are there or not.
///
/// # Errors
/// As [`read_bop`].
fn parse_bop(files: BopFiles, world_object: Option<u64>, image_size: Option<[f64; 2]>) -> Result<Import, ReadError> {
    let cameras = parse_json(files.camera.0, files.camera.1)?;
    let cameras = by_number(&Node::root(files.camera.0, &cameras))?;
    let poses = files.ground_truth.map(|(path, bytes)| object_poses(path, bytes)).transpose()?.unwrap_or_default();
    let mut notes = vec![
        "millimeters became meters; 0.5 was added to the center-based principal points".to_owned(),
        match world_object {
            Some(id) => format!("world: the model frame of object {id}"),
            None => "world: that of scene_camera.json (cam_R_w2c)".to_owned(),
        },
    ];
    let mut scene = SceneFile { length_unit: Some("m".to_owned()), ..SceneFile::default() };
    let mut world_from_cam = BTreeMap::new();
    let mut without_world = 0;
    for (&number, node) in &cameras {
        let camera = camera(node, image_size)?;
        let id = camera_id(&mut scene, camera);
        let pose = match world_object {
            Some(object) => {
                poses.get(&number).and_then(|poses| poses.iter().find(|p| p.object == object)).map(|p| p.cam_from_model)
            }
            None => Some(world_pose(node, &poses)?),
        };
        let Some(pose) = pose else {
            without_world += 1;
            continue;
        };
        let inverted = inverse(&pose).ok_or_else(|| node.error("the pose cannot be inverted"))?;
        world_from_cam.insert(number, inverted);
        scene.frames.push(FrameRecord {
            id: frame_id(number),
            camera: Some(id),
            cam_from_world: Some(rows(&pose)),
            ..FrameRecord::default()
        });
    }
    if let Some(object) = world_object {
        if world_from_cam.is_empty() {
            let problem = format!("no frame has a pose of object {object}; there are poses of {}", known(&poses));
            return Err(ReadError::new(files.ground_truth.map_or(files.camera.0, |file| file.0), problem));
        }
        if let Some((number, _)) = poses.iter().find(|(_, p)| p.iter().filter(|p| p.object == object).count() > 1) {
            let problem =
                format!("object {object} appears several times in frame {number}; the world frame must be unique");
            return Err(ReadError::new(files.ground_truth.map_or(files.camera.0, |file| file.0), problem));
        }
    }
    if without_world > 0 {
        let were = if without_world == 1 { "was" } else { "were" };
        notes.push(format!("{} without the world object {were} skipped", count(without_world, "frame")));
    }
    if let Some((path, bytes)) = files.info {
        scene.detections = detections(path, bytes, &poses, &world_from_cam)?;
    }
    if let Some((path, bytes)) = files.models {
        let (still, moving) = true_objects(path, bytes, &poses, &world_from_cam)?;
        if !moving.is_empty() {
            notes.push(format!(
                "{} objects move in the world and are not among the true objects: {}",
                moving.len(),
                moving.join(", ")
            ));
        }
        scene.objects = still;
    }
    Import { scene, notes, ..Import::default() }.checked(files.camera.0)
}

/// The members of an object whose keys are numbers, in their order.
fn by_number<'a>(root: &Node<'a>) -> Result<BTreeMap<u64, Node<'a>>, ReadError> {
    let numbered = |(key, node): (&str, Node<'a>)| match key.parse::<u64>() {
        Ok(number) => Ok((number, node)),
        Err(_) => Err(root.error(format!("found the key \"{key}\", expected a number"))),
    };
    root.members()?.into_iter().map(numbered).collect()
}

/// The id of a frame by its number, as BOP names its images.
fn frame_id(number: u64) -> String {
    format!("{number:06}")
}

/// The camera of a frame, without an id.
fn camera(node: &Node, image_size: Option<[f64; 2]>) -> Result<CameraRecord, ReadError> {
    let entry = node.member("cam_K")?;
    let k: [f64; 9] = entry.numbers()?;
    if [k[1], k[3], k[6], k[7]] != [0.0; 4] || k[8] != 1.0 {
        return Err(entry.error("expected [fx, 0, cx, 0, fy, cy, 0, 0, 1]"));
    }
    Ok(CameraRecord {
        model: "PINHOLE".to_owned(),
        width: image_size.map(|size| size[0]),
        height: image_size.map(|size| size[1]),
        // BOP's pixels have their centers at integers.
        params: vec![k[0], k[4], k[2] + 0.5, k[5] + 0.5],
        ..CameraRecord::default()
    })
}

/// A rotation and a translation in millimeters, as meters.
fn pose(node: &Node, rotation: &str, translation: &str) -> Result<Matrix4<f64>, ReadError> {
    let r: [f64; 9] = node.member(rotation)?.numbers()?;
    let t: [f64; 3] = node.member(translation)?.numbers()?;
    let pose = matrix4(&Matrix3::from_row_slice(&r), &(Vector3::from(t) * MM));
    check_rigid(&pose, rotation).map_err(|problem| node.error(problem))?;
    Ok(pose)
}

/// `cam_from_world` of a frame whose camera file has it.
fn world_pose(node: &Node, poses: &BTreeMap<u64, Vec<ObjectPose>>) -> Result<Matrix4<f64>, ReadError> {
    if node.optional("cam_R_w2c")?.is_none() {
        let problem = format!(
            "there is no world pose (\"cam_R_w2c\"); choose the object whose model frame is the world \
             (--world-object ID): {}",
            known(poses)
        );
        return Err(node.error(problem));
    }
    pose(node, "cam_R_w2c", "cam_t_w2c")
}

/// The numbers of the objects with poses, for messages.
fn known(poses: &BTreeMap<u64, Vec<ObjectPose>>) -> String {
    let objects: std::collections::BTreeSet<u64> = poses.values().flatten().map(|pose| pose.object).collect();
    if objects.is_empty() {
        return "none, because there is no scene_gt.json with poses".to_owned();
    }
    objects.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
}

/// An object in a frame.
#[derive(Debug, Clone)]
struct ObjectPose {
    object: u64,
    /// Id in the scene: that of the object, with a number where a frame shows it several times.
    id: String,
    cam_from_model: Matrix4<f64>,
}

/// The objects of every frame, in the order of the file.
fn object_poses(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u64, Vec<ObjectPose>>, ReadError> {
    let value = parse_json(path, bytes)?;
    let mut frames = BTreeMap::new();
    // Maximum number of instances of an object in a frame: they are distinguished by their order.
    let mut most: BTreeMap<u64, usize> = BTreeMap::new();
    for (number, node) in by_number(&Node::root(path, &value))? {
        let mut poses = Vec::new();
        let mut count: BTreeMap<u64, usize> = BTreeMap::new();
        for node in node.items()? {
            let object = node.member("obj_id")?.whole()?;
            let instance = count.entry(object).or_default();
            *instance += 1;
            let highest = most.entry(object).or_default();
            *highest = (*highest).max(*instance);
            let id = format!("{}_{instance}", model_name(object));
            poses.push(ObjectPose { object, id, cam_from_model: pose(&node, "cam_R_m2c", "cam_t_m2c")? });
        }
        frames.insert(number, poses);
    }
    for pose in frames.values_mut().flatten().filter(|pose| most.get(&pose.object) == Some(&1)) {
        pose.id = model_name(pose.object);
    }
    Ok(frames)
}

/// The name of a model, as BOP's files have it.
fn model_name(object: u64) -> String {
    format!("obj_{object:06}")
}

/// The boxes of `scene_gt_info.json`, whose entries stand in the order of the poses.
fn detections(
    path: &Path,
    bytes: &[u8],
    poses: &BTreeMap<u64, Vec<ObjectPose>>,
    frames: &BTreeMap<u64, Matrix4<f64>>,
) -> Result<Vec<DetectionRecord>, ReadError> {
    let value = parse_json(path, bytes)?;
    let mut detections = Vec::new();
    for (number, node) in by_number(&Node::root(path, &value))? {
        if !frames.contains_key(&number) {
            continue;
        }
        let (items, poses) = (node.items()?, poses.get(&number).map(Vec::as_slice).unwrap_or_default());
        if items.len() != poses.len() {
            return Err(node.error(format!("found {} entries, and scene_gt.json has {}", items.len(), poses.len())));
        }
        for (index, (item, pose)) in items.iter().zip(poses).enumerate() {
            let visible = item.optional("visib_fract")?.map(|node| node.number()).transpose()?;
            for (source, mask_folder) in [("bbox_obj", "mask"), ("bbox_visib", "mask_visib")] {
                let Some(entry) = item.optional(source)? else { continue };
                let [x, y, w, h] = entry.numbers::<4>()?;
                // Nothing is visible: [-1, -1, -1, -1].
                if w <= 0.0 || h <= 0.0 {
                    continue;
                }
                detections.push(DetectionRecord {
                    frame: frame_id(number).into(),
                    object: Some(pose.id.clone().into()),
                    category: Some(model_name(pose.object).into()),
                    source: Some(source.into()),
                    // From the first to the last pixel; the last one has a width as well.
                    bounding_box: Some([x, y, x + w + 1.0, y + h + 1.0]),
                    mask: Some(Box::new(MaskRecord {
                        path: Some(format!("{mask_folder}/{number:06}_{index:06}.png")),
                        ..MaskRecord::default()
                    })),
                    visible_fraction: visible,
                    ..DetectionRecord::default()
                });
            }
        }
    }
    Ok(detections)
}

/// The model boxes in the world of the static objects; and the ids of the others.
fn true_objects(
    path: &Path,
    bytes: &[u8],
    poses: &BTreeMap<u64, Vec<ObjectPose>>,
    world_from_cam: &BTreeMap<u64, Matrix4<f64>>,
) -> Result<(Vec<ObjectRecord>, Vec<String>), ReadError> {
    let value = parse_json(path, bytes)?;
    let models = by_number(&Node::root(path, &value))?;
    let mut objects = LabelledObjects::default();
    for (number, world_from_cam) in world_from_cam {
        for pose in poses.get(number).map(Vec::as_slice).unwrap_or_default() {
            let Some(model) = models.get(&pose.object) else { continue };
            let three = |kind: &str| -> Result<Vector3<f64>, ReadError> {
                let axis = |axis: &str| model.member(&format!("{kind}_{axis}"))?.number();
                Ok(Vector3::new(axis("x")?, axis("y")?, axis("z")?) * MM)
            };
            let half = three("size")? * 0.5;
            let middle = matrix4(&Matrix3::identity(), &(three("min")? + half));
            let pose_in_world = world_from_cam * pose.cam_from_model * middle;
            objects.add(&pose.id, Some(&model_name(pose.object)), &pose_in_world, half);
        }
    }
    Ok(objects.objects())
}

#[cfg(test)]
#[path = "bop/tests.rs"]
mod tests;
