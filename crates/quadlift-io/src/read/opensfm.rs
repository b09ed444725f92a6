//! `reconstruction.json` of OpenSfM, which OpenDroneMap writes too.
//!
//! Poses are world-to-camera with OpenCV's axes, a rotation vector and a translation. Focal lengths and principal points are
//! shares of the larger side of the image, principal points from its middle. Convention: "Geometric Models" of OpenSfM's
//! documentation (`doc/source/geometry.rst`); keys: `opensfm/io.py`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Rotation3, Vector3};
use quadlift::geometry::{Camera, CameraModel};
use serde_json::Value;

use super::colmap::{DEFAULT_POINTS, evenly_spread};
use super::format::{Format, PoseFormat};
use super::import::Import;
use super::json::{Node, parse_json};
use super::poses::{matrix4, rows};
use crate::error::ReadError;
use crate::input::read_bytes;
use crate::scene_file::{CameraRecord, FrameRecord, REFERENCE, SceneFile};
use crate::wording::count;

/// The name of the file, and its places in the folders of OpenSfM and OpenDroneMap.
const FILES: [&str; 2] = ["reconstruction.json", "opensfm/reconstruction.json"];

/// The file in a folder of OpenSfM or OpenDroneMap, if it is there.
fn file_in(folder: &Path) -> Option<PathBuf> {
    FILES.iter().map(|name| folder.join(name)).find(|path| path.is_file())
}

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "opensfm",
    title: "OpenSfM",
    about: "OpenSfM's or OpenDroneMap's reconstruction.json",
    looks: "OpenSfM (reconstruction.json)",
    options: &["points"],
    finds: |probe| match probe.folder() {
        Some(folder) => probe.when(file_in(folder).is_some()),
        None => probe.when(probe.keys()?.list_has("shots")),
    },
    read: |path, options| read_opensfm(path, options.points.unwrap_or(DEFAULT_POINTS)),
};

/// Reads `reconstruction.json`, given as file or folder. Frame ids are the names of the shots, sorted. Of several
/// reconstructions the one with most shots is read, of its points at most `most_points`, evenly spread.
///
/// # Errors
/// [`ReadError`] with the entry, what was found and what was expected.
fn read_opensfm(path: &Path, most_points: usize) -> Result<Import, ReadError> {
    let file = if path.is_dir() { file_in(path).unwrap_or_else(|| path.join(FILES[0])) } else { path.to_owned() };
    let folder = file.parent().unwrap_or(Path::new(""));
    let bytes = read_bytes(&file)?;
    let beside = folder.join("reference_lla.json");
    let reference = beside.is_file().then(|| read_bytes(&beside)).transpose()?;
    let reference = reference.as_deref().map(|bytes| (&*beside, bytes));
    let mut import = parse_opensfm(&file, &bytes, reference, most_points)?;
    // OpenDroneMap keeps the images beside the folder of OpenSfM.
    let image_folders = [folder.join("images"), folder.join("../images")];
    import.image_folder = image_folders.into_iter().find(|folder| folder.is_dir());
    Ok(import)
}

/// The cameras in the bytes of `reconstruction.json`, and of `reference_lla.json` if there is one; the paths are used in
/// messages.
///
/// # Errors
/// As [`read_opensfm`].
fn parse_opensfm(
    path: &Path,
    bytes: &[u8],
    reference: Option<(&Path, &[u8])>,
    most_points: usize,
) -> Result<Import, ReadError> {
    let value = parse_json(path, bytes)?;
    let reference_value = reference.map(|(path, bytes)| Ok((path, parse_json(path, bytes)?))).transpose()?;
    let mut notes =
        vec!["OpenSfM: poses need no conversion; focal lengths and principal points became pixels".to_owned()];
    let largest = largest(&Node::root(path, &value), &mut notes)?;
    let mut scene = SceneFile::default();
    let beside = reference_value.as_ref().map(|(path, value)| Node::root(path, value));
    match largest.optional(REFERENCE)?.or(beside) {
        Some(node) if is_reference(&node)? => {
            scene.length_unit = Some("m".to_owned());
            scene.up = Some([0.0, 0.0, 1.0]);
            let object: &serde_json::Map<String, Value> = node.object()?;
            scene.extra.insert(REFERENCE.to_owned(), Value::Object(object.clone()));
            notes.push("the world is in meters, x east, y north, z up from reference_lla, which is kept".to_owned());
        }
        _ => {
            notes.push("there is no reference_lla: the length unit and the direction of gravity are unknown".to_owned())
        }
    }
    let cameras = largest.member("cameras")?;
    let mut used = BTreeMap::new();
    let mut rotated = 0;
    for (name, shot) in largest.member("shots")?.members()? {
        let camera_node = shot.member("camera")?;
        let camera_name = camera_node.text()?;
        if !used.contains_key(camera_name) {
            let node = cameras.optional(camera_name)?;
            let node = node.ok_or_else(|| camera_node.error(format!("\"cameras\" has no \"{camera_name}\"")))?;
            used.insert(camera_name, camera(camera_name, &node)?);
        }
        let rotation = Rotation3::new(Vector3::from(shot.member("rotation")?.numbers()?));
        let translation = Vector3::from(shot.member("translation")?.numbers()?);
        let orientation = shot.optional("orientation")?.map(|node| node.number()).transpose()?;
        rotated += usize::from(orientation.is_some_and(|turn| turn > 1.0));
        let time = shot.optional("capture_time")?.map(|node| node.number()).transpose()?;
        scene.frames.push(FrameRecord {
            id: name.to_owned(),
            camera: Some(camera_name.to_owned()),
            cam_from_world: Some(rows(&matrix4(rotation.matrix(), &translation))),
            image: Some(name.to_owned()),
            // OpenSfM writes 0 where it does not know the time.
            time: time.filter(|time| *time > 0.0),
            ..FrameRecord::default()
        });
    }
    scene.cameras = used.into_values().collect();
    if rotated > 0 {
        let text = "with an EXIF orientation: boxes must be in the pixels as they are stored, not as viewers turn them";
        notes.push(format!("{} {text}", count(rotated, "shot")));
    }
    if let Some(node) = largest.optional("points")? {
        let points = points(&node)?;
        let all = points.len();
        scene.points = evenly_spread(points, most_points);
        match scene.points.len() {
            0 => {}
            kept if kept == all => notes.push(format!("{} of the reconstruction", count(all, "point"))),
            kept => notes.push(format!("{kept} of {}, evenly spread", count(all, "point"))),
        }
    }
    Import { scene, notes, ..Import::default() }.checked(path)
}

/// The reconstruction with most shots, the first one of equals.
fn largest<'a>(root: &Node<'a>, notes: &mut Vec<String>) -> Result<Node<'a>, ReadError> {
    let mut found: Vec<(usize, Node)> = Vec::new();
    for item in root.items()? {
        found.push((item.member("shots")?.object()?.len(), item));
    }
    let all = found.len();
    let Some((index, (shots, node))) =
        found.into_iter().enumerate().reduce(|best, next| if next.1.0 > best.1.0 { next } else { best })
    else {
        return Err(root.error("found an empty list, expected a reconstruction"));
    };
    if all > 1 {
        notes.push(format!(
            "the largest of {all} reconstructions was read, number {} with {}; each has a world frame of its own",
            index + 1,
            count(shots, "shot")
        ));
    }
    Ok(node)
}

/// Whether a reference has a place; OpenSfM writes zeros if no image has a position of GPS.
fn is_reference(node: &Node) -> Result<bool, ReadError> {
    let mut any = false;
    for (key, most) in [("latitude", 90.0), ("longitude", 180.0), ("altitude", f64::INFINITY)] {
        let value = node.member(key)?;
        let number = value.number()?;
        if number.abs() > most {
            return Err(value.error(format!("found {number}, expected degrees from -{most} to {most}")));
        }
        any |= number != 0.0;
    }
    Ok(any)
}

/// The points with their ids.
fn points(node: &Node) -> Result<Vec<(u64, [f64; 3])>, ReadError> {
    let members = node.members()?.into_iter().enumerate();
    let point = |(index, (id, point)): (usize, (&str, Node))| {
        Ok((id.parse().unwrap_or(index as u64), point.member("coordinates")?.numbers()?))
    };
    members.map(point).collect()
}

/// A camera in pixels.
fn camera(id: &str, node: &Node) -> Result<CameraRecord, ReadError> {
    let size = |key: &str| {
        let value = node.member(key)?;
        match value.number()? {
            length if length > 0.0 => Ok(length),
            length => Err(value.error(format!("found {length}, expected a positive number of pixels"))),
        }
    };
    let (width, height) = (size("width")?, size("height")?);
    let unit = width.max(height);
    let number = |key: &str| Ok::<f64, ReadError>(node.optional(key)?.map(|x| x.number()).transpose()?.unwrap_or(0.0));
    let [k1, k2, k3, k4] = [number("k1")?, number("k2")?, number("k3")?, number("k4")?];
    let [p1, p2] = [number("p1")?, number("p2")?];
    let kind = node.optional("projection_type")?.map(|kind| kind.text()).transpose()?.unwrap_or("perspective");
    let (model, coefficients) = match kind {
        "perspective" | "simple_radial" | "radial" | "brown" => {
            if k3 != 0.0 {
                (CameraModel::FullOpenCv, vec![k1, k2, p1, p2, k3, 0.0, 0.0, 0.0])
            } else if [k1, k2, p1, p2] != [0.0; 4] {
                (CameraModel::OpenCv, vec![k1, k2, p1, p2])
            } else {
                (CameraModel::Pinhole, Vec::new())
            }
        }
        "fisheye" | "fisheye_opencv" => (CameraModel::OpenCvFisheye, vec![k1, k2, k3, k4]),
        "spherical" | "equirectangular" if width == 2.0 * height => (CameraModel::Equirectangular, Vec::new()),
        "spherical" | "equirectangular" => {
            return Err(node.error(format!("a spherical image of {width}x{height}; expected twice as wide as high")));
        }
        other => {
            return Err(node.error(format!(
                "the projection_type \"{other}\" is not supported; expected perspective, simple_radial, radial, brown, \
                 fisheye, fisheye_opencv, spherical or equirectangular"
            )));
        }
    };
    let params = if model == CameraModel::Equirectangular {
        vec![width, height]
    } else {
        let focal = |key: &str| match node.optional(key)? {
            Some(own) => own.number(),
            None => node.member("focal")?.number(),
        };
        let center = |key: &str, side: f64| Ok::<f64, ReadError>(0.5 * side + unit * number(key)?);
        let mut params =
            vec![unit * focal("focal_x")?, unit * focal("focal_y")?, center("c_x", width)?, center("c_y", height)?];
        params.extend(coefficients);
        params
    };
    Camera::new(model, &params).map_err(|error| node.error(error.to_string()))?;
    Ok(CameraRecord {
        id: id.to_owned(),
        model: model.name().to_owned(),
        width: Some(width),
        height: Some(height),
        params,
        ..CameraRecord::default()
    })
}

#[cfg(test)]
#[path = "opensfm/tests.rs"]
mod tests;
