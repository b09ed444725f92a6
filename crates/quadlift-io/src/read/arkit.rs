//! Captures of apps that record ARKit's camera poses on iPhones and iPads: Polycam, Record3D and 3D Scanner App.
//!
//! ARKit's world is in meters with y against gravity. Poses are camera-to-world with OpenGL's axes (x right, y up, z backwards)
//! for the images as they are stored; they become world-to-camera with OpenCV's axes. Formats: Polycam's `polyform` (README,
//! "Polycam's data format"), `record3d2nerf.py` of instant-ngp and `record3d_utils.py` of nerfstudio; the files of 3D Scanner App
//! have no public description but programs that read them (see docs/formats/cameras.md).

use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use quadlift::geometry::{Camera, CameraModel};

use super::format::{Format, PoseFormat};
use super::image_names::image_of_stem;
use super::import::{Import, camera_id};
use super::json::{Node, parse_json};
use super::options::ReadOptions;
use super::poses::{check_rigid, from_rows, inverse, matrix4, rotation_of, rows};
use crate::error::ReadError;
use crate::images::read_image_size;
use crate::input::{as_utf8, paths_below, read_bytes};
use crate::scene_file::{CameraRecord, DepthImageRecord, FrameRecord, SceneFile};
use crate::wording::count;

/// Folders of Polycam's cameras and the images that belong to them, the better ones first, below `keyframes`.
const POLYCAM: [[&str; 2]; 2] = [["corrected_cameras", "corrected_images"], ["cameras", "images"]];

/// The folder of Polycam's depth images, beside those of the images, and the meters of one count.
const POLYCAM_DEPTH: &str = "depth";
const POLYCAM_DEPTH_SCALE: f64 = 0.001;

/// A rotation that differs from none by less is none.
const LEVEL: f64 = 1e-6;

/// Names of Record3D's metadata, and of the folders with its images.
const RECORD3D: [&str; 4] = ["metadata", "metadata.json", "EXR_RGBD/metadata.json", "EXR_RGBD/metadata"];
const RECORD3D_IMAGES: [&str; 2] = ["rgbd", "rgb"];

/// The app that wrote a capture, and where its files are.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Capture {
    /// Folders of the cameras and of the images.
    Polycam { cameras: PathBuf, images: PathBuf },
    /// The file of the metadata.
    Record3d { metadata: PathBuf },
    /// The folder with `frame_00000.json` and so on.
    Scanner { folder: PathBuf },
}

/// The JSON file of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameFile<'a> {
    /// The name without extension.
    pub stem: &'a str,
    /// The path, for messages.
    pub path: &'a Path,
    /// Its content.
    pub bytes: &'a [u8],
}

/// The images of a capture.
pub(super) struct CaptureImages<'a> {
    /// The name of the image of a frame, by the name without extension.
    pub named: &'a dyn Fn(&str) -> Option<String>,
    /// Width and height of an image, if known.
    pub size_of: &'a dyn Fn(&str) -> Option<[f64; 2]>,
}

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "arkit",
    title: "an ARKit capture",
    about: "A capture of an iPhone or iPad (ARKit): Polycam, Record3D or 3D Scanner App",
    looks: "captures of Polycam, Record3D or 3D Scanner App",
    options: &["image_size", "pixel_centers"],
    finds: |probe| {
        if let Some(folder) = probe.folder() {
            return probe.when(capture_at(folder).is_some());
        }
        let keys = probe.keys()?;
        probe.when(keys.object_has("poses") && keys.object_has("K"))
    },
    read: read_arkit,
};

/// Reads the folder of a capture, or its `metadata` (Record3D). Frame ids are the names of the images; frames without an image
/// are left out if others have one.
///
/// # Errors
/// [`ReadError`] with file and entry, what was found and what was expected.
fn read_arkit(path: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let Some(capture) = capture_at(path) else {
        if path.is_file() {
            as_utf8(path, &read_bytes(path)?)?;
        }
        let problem = "expected the folder of a capture: of Polycam (keyframes/cameras), Record3D (metadata) or 3D Scanner App \
                       (frame_00000.json)";
        return Err(ReadError::new(path, problem));
    };
    let image_folder = match &capture {
        Capture::Polycam { images, .. } => images.clone(),
        Capture::Scanner { folder } => folder.clone(),
        Capture::Record3d { metadata } => {
            let folder = metadata.parent().unwrap_or(Path::new(""));
            let places = RECORD3D_IMAGES.map(|name| folder.join(name));
            places.iter().find(|place| place.is_dir()).unwrap_or(&places[0]).clone()
        }
    };
    let named = |stem: &str| image_of_stem(stem, &|name| image_folder.join(name).is_file());
    // Polycam left the sizes of corrected images out of their files.
    let of_original = |image: &str| match &capture {
        Capture::Polycam { cameras, .. } => {
            let path = cameras.join("..").join(POLYCAM[1][0]).join(image).with_extension("json");
            let value = parse_json(&path, &read_bytes(&path).ok()?).ok()?;
            size(&Node::root(&path, &value), ["width", "height"]).ok()?
        }
        _ => None,
    };
    let of_file = |image: &str| Some(read_image_size(&image_folder.join(image)).ok()?.map(f64::from));
    let size_of = |image: &str| of_file(image).or_else(|| of_original(image));
    let images = CaptureImages { named: &named, size_of: &size_of };
    let mut import = match &capture {
        Capture::Record3d { metadata } => parse_record3d(metadata, &read_bytes(metadata)?, &images, options)?,
        Capture::Polycam { cameras: folder, .. } | Capture::Scanner { folder } => {
            let mut files = Vec::new();
            for (name, path) in paths_below(folder, "json")? {
                let stem = name.trim_end_matches(".json").to_owned();
                if matches!(capture, Capture::Polycam { .. }) || stem.starts_with("frame_") {
                    files.push((stem, read_bytes(&path)?, path));
                }
            }
            let files: Vec<FrameFile> =
                files.iter().map(|(stem, bytes, path)| FrameFile { stem, path, bytes }).collect();
            match capture {
                Capture::Polycam { .. } => parse_polycam(folder, &files, &images, options)?,
                _ => parse_scanner(folder, &files, &images, options)?,
            }
        }
    };
    if let Capture::Polycam { cameras, images } = &capture {
        let with_depth = add_depth_images(&mut import.scene, &cameras.join("..").join(POLYCAM_DEPTH));
        if with_depth > 0 {
            import.notes.push(format!("{} with a depth image", count(with_depth, "frame")));
        }
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        import.notes.push(format!("{} were read: boxes must be those of {}", name(cameras), name(images)));
    }
    import.image_folder = image_folder.is_dir().then_some(image_folder);
    Ok(import)
}

/// Gives frames the depth images of a folder that have their names; how many.
fn add_depth_images(scene: &mut SceneFile, folder: &Path) -> usize {
    let mut found = 0;
    for frame in &mut scene.frames {
        let Some(stem) = frame.image.as_deref().and_then(|image| Path::new(image).file_stem()) else { continue };
        let name = format!("{}.png", stem.to_string_lossy());
        if folder.join(&name).is_file() {
            let (path, source) = (format!("../{POLYCAM_DEPTH}/{name}"), Some("lidar".into()));
            frame.depth =
                Some(Box::new(DepthImageRecord { path, scale: POLYCAM_DEPTH_SCALE, source, ..Default::default() }));
            found += 1;
        }
    }
    found
}

/// Whether there is a capture at a path.
fn capture_at(path: &Path) -> Option<Capture> {
    let polycam = |base: &Path| {
        let folders = POLYCAM.map(|pair| pair.map(|name| base.join(name)));
        folders.into_iter().find(|[cameras, _]| has_key(cameras, |_| true, "\"t_00\""))
    };
    for base in [path.join("keyframes"), path.to_owned()] {
        if let Some([cameras, images]) = polycam(&base) {
            return Some(Capture::Polycam { cameras, images });
        }
    }
    // One of the folders of the cameras itself.
    if let Some([_, images]) = POLYCAM.iter().find(|[cameras, _]| path.ends_with(cameras))
        && has_key(path, |_| true, "\"t_00\"")
    {
        return Some(Capture::Polycam { cameras: path.to_owned(), images: path.join("..").join(images) });
    }
    if has_key(path, |name| name.starts_with("frame_"), "\"cameraPoseARFrame\"") {
        return Some(Capture::Scanner { folder: path.to_owned() });
    }
    let is_metadata = |file: &PathBuf| {
        file.is_file() && read_bytes(file).is_ok_and(|bytes| contains(&bytes, "\"poses\"") && contains(&bytes, "\"K\""))
    };
    let places = RECORD3D.map(|name| path.join(name));
    let found = [path.to_owned()].into_iter().filter(|path| path.is_file()).chain(places).find(is_metadata);
    found.map(|metadata| Capture::Record3d { metadata })
}

/// Whether the first JSON file of a folder has a key.
fn has_key(folder: &Path, is_name: impl Fn(&str) -> bool, key: &str) -> bool {
    let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_frame = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "json")
            && path.file_name().is_some_and(|name| is_name(&name.to_string_lossy()))
    };
    names.filter(is_frame).min().is_some_and(|path| read_bytes(&path).is_ok_and(|bytes| contains(&bytes, key)))
}

fn contains(bytes: &[u8], text: &str) -> bool {
    bytes.windows(text.len()).any(|window| window == text.as_bytes())
}

/// Polycam's camera files of a folder.
///
/// # Errors
/// As [`read_arkit`].
fn parse_polycam(
    folder: &Path,
    files: &[FrameFile],
    images: &CaptureImages,
    options: &ReadOptions,
) -> Result<Import, ReadError> {
    let mut shots = Vec::new();
    for file in files {
        let value = parse_json(file.path, file.bytes)?;
        let root = Node::root(file.path, &value);
        let number = |key: &str| root.member(key)?.number();
        let mut transform = [[0.0; 4]; 3];
        for (i, row) in transform.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = number(&format!("t_{i}{j}"))?;
            }
        }
        // Names are microseconds, as is "timestamp".
        let microseconds = match root.optional("timestamp")? {
            Some(time) => Some(time.number()?),
            None => file.stem.parse::<u64>().ok().map(|time| time as f64),
        };
        shots.push(Shot {
            stem: file.stem.to_owned(),
            world_from_camera: pose(&root, from_rows(&transform))?,
            intrinsics: intrinsics(&root, [number("fx")?, number("fy")?, number("cx")?, number("cy")?])?,
            size: size(&root, ["width", "height"])?,
            time: microseconds.map(|time| time / 1e6),
        });
    }
    scene("Polycam", folder, shots, images, options)
}

/// The frame files of 3D Scanner App.
///
/// # Errors
/// As [`read_arkit`].
fn parse_scanner(
    folder: &Path,
    files: &[FrameFile],
    images: &CaptureImages,
    options: &ReadOptions,
) -> Result<Import, ReadError> {
    let mut shots = Vec::new();
    for file in files {
        let value = parse_json(file.path, file.bytes)?;
        let root = Node::root(file.path, &value);
        let node = root.member("cameraPoseARFrame")?;
        let transform = Matrix4::from_row_slice(&node.numbers::<16>()?);
        let [fx, skew, cx, _, fy, cy, ..] = root.member("intrinsics")?.numbers::<9>()?;
        if skew != 0.0 {
            return Err(
                root.error(format!("intrinsics[1] is {skew}, expected 0: the intrinsics by rows, without skew"))
            );
        }
        shots.push(Shot {
            stem: file.stem.to_owned(),
            world_from_camera: pose(&node, transform)?,
            intrinsics: intrinsics(&root, [fx, fy, cx, cy])?,
            size: None,
            time: root.optional("time")?.map(|time| time.number()).transpose()?,
        });
    }
    scene("3D Scanner App", folder, shots, images, options)
}

/// Record3D's `metadata`.
///
/// # Errors
/// As [`read_arkit`].
fn parse_record3d(
    path: &Path,
    bytes: &[u8],
    images: &CaptureImages,
    options: &ReadOptions,
) -> Result<Import, ReadError> {
    let value = parse_json(path, bytes)?;
    let root = Node::root(path, &value);
    let size = size(&root, ["w", "h"])?;
    // By columns.
    let [fx, _, _, _, fy, _, cx, cy, _] = root.member("K")?.numbers::<9>()?;
    let list = |key: &str| root.optional(key)?.map(|node| node.items()).transpose();
    let (own, times) = (list("perFrameIntrinsicCoeffs")?, list("frameTimestamps")?);
    let rate = root.optional("fps")?.map(|fps| fps.number()).transpose()?.filter(|fps| *fps > 0.0);
    let mut shots = Vec::new();
    for (index, node) in root.member("poses")?.items()?.iter().enumerate() {
        let [x, y, z, w, translation @ ..] = node.numbers::<7>()?;
        let rotation = rotation_of([w, x, y, z]);
        let rotation = rotation.ok_or_else(|| node.error("the quaternion x, y, z, w is not a rotation"))?;
        let intrinsics = match own.as_ref().and_then(|own| own.get(index)) {
            Some(node) => intrinsics(node, node.numbers()?)?,
            None => intrinsics(&root, [fx, fy, cx, cy])?,
        };
        let time = times.as_ref().and_then(|times| times.get(index)).map(|time| time.number()).transpose()?;
        shots.push(Shot {
            stem: index.to_string(),
            world_from_camera: matrix4(&rotation, &Vector3::from(translation)),
            intrinsics,
            size,
            time: time.or(rate.map(|rate| index as f64 / rate)),
        });
    }
    scene("Record3D", path, shots, images, options)
}

/// Focal lengths and principal point of a node.
fn intrinsics(node: &Node, intrinsics: [f64; 4]) -> Result<[f64; 4], ReadError> {
    match Camera::new(CameraModel::Pinhole, &intrinsics) {
        Ok(_) => Ok(intrinsics),
        Err(error) => Err(node.error(error.to_string())),
    }
}

/// A frame as the apps have it.
struct Shot {
    stem: String,
    /// With OpenGL's axes of the camera.
    world_from_camera: Matrix4<f64>,
    intrinsics: [f64; 4],
    size: Option<[f64; 2]>,
    time: Option<f64>,
}

/// Width and height by their keys, if they are there.
fn size(node: &Node, keys: [&str; 2]) -> Result<Option<[f64; 2]>, ReadError> {
    let side = |key: &str| {
        let Some(value) = node.optional(key)? else { return Ok(None) };
        match value.number()? {
            length if length > 0.0 => Ok(Some(length)),
            length => Err(value.error(format!("found {length}, expected a positive number of pixels"))),
        }
    };
    Ok(side(keys[0])?.zip(side(keys[1])?).map(|(width, height)| [width, height]))
}

fn pose(node: &Node, transform: Matrix4<f64>) -> Result<Matrix4<f64>, ReadError> {
    check_rigid(&transform, "the transform").map_err(|problem| node.error(problem))?;
    let bottom: Vector4<f64> = transform.row(3).transpose();
    if bottom != Vector4::w() {
        return Err(node.error(format!(
            "the last row of the transform is {:?}, expected [0, 0, 0, 1]: the matrix by rows",
            bottom.as_slice()
        )));
    }
    Ok(transform)
}

/// The scene of the frames.
fn scene(
    app: &str,
    path: &Path,
    shots: Vec<Shot>,
    images: &CaptureImages,
    options: &ReadOptions,
) -> Result<Import, ReadError> {
    // Nobody holds a phone level to the last digit: these poses are relative to the first image (older files of Record3D).
    let is_relative = shots
        .first()
        .is_some_and(|shot| (shot.world_from_camera.fixed_view::<3, 3>(0, 0) - Matrix3::identity()).amax() < LEVEL);
    let (up, world) = match is_relative {
        true => (None, "the world is that of the first image, in meters; its direction against gravity is unknown"),
        false => (Some([0.0, 1.0, 0.0]), "the world is ARKit's, in meters, y against gravity"),
    };
    let mut notes = vec![
        format!("{app}: OpenGL axes and camera-to-world poses were converted"),
        world.to_owned(),
        options.pixel_centers.note(),
    ];
    let mut scene = SceneFile { length_unit: Some("m".to_owned()), up, ..SceneFile::default() };
    let names: Vec<Option<String>> = shots.iter().map(|shot| (images.named)(&shot.stem)).collect();
    let with_images = names.iter().flatten().count();
    let all = shots.len();
    let mut off_center = Vec::new();
    for (shot, name) in shots.into_iter().zip(names) {
        if with_images > 0 && name.is_none() {
            continue;
        }
        let image = name.unwrap_or_else(|| format!("{}.jpg", shot.stem));
        let size = shot.size.or_else(|| (images.size_of)(&image)).or(options.image_size);
        let [fx, fy, cx, cy] = shot.intrinsics;
        if size.is_some_and(|[width, height]| (cx / width - 0.5).abs().max((cy / height - 0.5).abs()) > 0.125) {
            off_center.push(image.clone());
        }
        let shift = options.pixel_centers.shift();
        let camera = CameraRecord {
            model: CameraModel::Pinhole.name().to_owned(),
            width: size.map(|size| size[0]),
            height: size.map(|size| size[1]),
            params: vec![fx, fy, cx + shift, cy + shift],
            ..CameraRecord::default()
        };
        let gl_from_cv = Matrix4::from_diagonal(&Vector4::new(1.0, -1.0, -1.0, 1.0));
        let cam_from_world = inverse(&(shot.world_from_camera * gl_from_cv))
            .ok_or_else(|| ReadError::new(path, format!("the pose of frame {} cannot be inverted", shot.stem)))?;
        let camera = camera_id(&mut scene, camera);
        scene.frames.push(FrameRecord {
            id: image.clone(),
            camera: Some(camera),
            cam_from_world: Some(rows(&cam_from_world)),
            image: Some(image),
            time: shot.time,
            ..FrameRecord::default()
        });
    }
    match with_images {
        0 => notes.push("no images were found: the names in the scene end in .jpg".to_owned()),
        some if some < all => notes.push(format!("{} without an image left out", count(all - some, "frame"))),
        _ => {}
    }
    if let Some(first) = off_center.first() {
        notes.push(format!(
            "{} with a principal point far from the middle, such as \"{first}\": were they turned or resized?",
            count(off_center.len(), "image")
        ));
    }
    if scene.cameras.iter().any(|camera| camera.width.is_none()) {
        notes.push("the image sizes are unknown: box edges at the border are not treated as cut off".to_owned());
    }
    Import { scene, notes, ..Import::default() }.checked(path)
}

#[cfg(test)]
#[path = "arkit/tests.rs"]
mod tests;
