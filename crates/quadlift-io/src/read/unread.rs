//! Files of known programs that are not read: a message names the program, and what to give instead.

use super::json::{Node, parse_json};
use super::probe::Probe;
use crate::error::ReadError;

/// What a file is recognized by.
#[derive(Debug, Clone, Copy)]
enum Sign {
    /// All of these columns in the first line or the comment before it, in small letters.
    Columns(&'static [&'static str]),
    /// All of these keys in a JSON object.
    Object(&'static [&'static str]),
    /// All of these keys in the first entry of a JSON list.
    List(&'static [&'static str]),
    /// The outermost element of XML.
    Xml(&'static str),
    /// A file in the folder.
    Holds(&'static str),
}

const COLMAP: &str = "export its cameras as a COLMAP model";
const TRAJECTORY: &str = "write its poses as a TUM trajectory and its intrinsics into a file (--intrinsics)";
const DRONE: &str = "positions and angles of a drone are no calibrated cameras: reconstruct the images, such as with COLMAP or \
                     OpenDroneMap, and give that model";
const OPENSFM: &str = "give the project's opensfm/reconstruction.json";
const RESULTS: &str = "convert it to COCO or YOLO, with the names of the images";

/// The advice for matrices that nothing names.
pub(super) const UNNAMED: &str = "these are matrices without a name: if they are poses [R | t], the intrinsics are missing: give both \
                                  in another format, such as nerfstudio's transforms.json (fl_x, fl_y, cx, cy, w, h) or a TUM \
                                  trajectory with --intrinsics; if they are projections K [R | t] to pixels, name them: columns \
                                  p11 to p34, or the key \"projection\"";

/// How the message about such a file begins.
pub const UNREAD: &str = "this is a file of";

/// Programs by their files, and what to give instead.
const KNOWN: [(Sign, &str, &str); 18] = [
    (Sign::Columns(&["x", "y", "alt", "heading", "pitch", "roll"]), "RealityCapture", COLMAP),
    (Sign::Columns(&["omega", "phi", "kappa"]), "Metashape or Pix4D (omega, phi, kappa)", COLMAP),
    (Sign::Columns(&["frame", "qx", "qy", "qz", "qw"]), "Stray Scanner", TRAJECTORY),
    (Sign::Columns(&["latitude", "longitude"]), "a drone (latitude, longitude)", DRONE),
    (Sign::Columns(&["lat", "lon"]), "a drone (lat, lon)", DRONE),
    (Sign::Columns(&["yaw", "pitch", "roll"]), "a drone (yaw, pitch, roll)", DRONE),
    (Sign::Holds("odometry.csv"), "Stray Scanner", TRAJECTORY),
    (Sign::Object(&["sfm_data_version"]), "OpenMVG", "openMVG_main_openMVG2Colmap converts it to a COLMAP model"),
    (Sign::Object(&["views", "intrinsics"]), "Meshroom", COLMAP),
    (Sign::Object(&["views", "poses"]), "Meshroom", COLMAP),
    (Sign::Object(&["type", "features"]), "OpenDroneMap (shots.geojson) or another map in GeoJSON", OPENSFM),
    (Sign::Xml("document"), "Metashape", COLMAP),
    (Sign::List(&["segmentation", "predicted_iou"]), "SAM", RESULTS),
    (Sign::Object(&["image", "annotations"]), "SAM", RESULTS),
    (Sign::List(&["value", "label"]), "Grounded-SAM", RESULTS),
    (Sign::Object(&["image_path", "annotations"]), "Grounded-SAM", RESULTS),
    (Sign::List(&["image", "annotations"]), "CreateML", RESULTS),
    (Sign::List(&["name", "labels"]), "BDD", RESULTS),
];

/// What a file that no reader takes is, if it is known.
///
/// # Errors
/// [`ReadError`] if it cannot be read.
pub(super) fn known_but_unread(probe: &Probe) -> Result<Option<String>, ReadError> {
    // Of a folder with a file for each image, the first one.
    let first = match probe.folder() {
        Some(_) => probe.labels("json")?,
        None => Some(probe),
    };
    let header = first.map_or(Ok(Vec::new()), Probe::header)?;
    let has_all = |sign: Sign| -> Result<bool, ReadError> {
        if let Sign::Holds(name) = sign {
            return Ok(probe.has(name));
        }
        let Some(first) = first else { return Ok(false) };
        let keys = first.keys()?;
        Ok(match sign {
            Sign::Columns(names) => names.iter().all(|name| header.iter().any(|word| word == name)),
            Sign::Object(names) => names.iter().all(|name| keys.object_has(name)),
            Sign::List(names) => names.iter().all(|name| keys.list_has(name)),
            Sign::Xml(name) => first.is_xml(name)?,
            Sign::Holds(_) => false,
        })
    };
    for (sign, program, instead) in KNOWN {
        if has_all(sign)? {
            return Ok(Some(format!("{UNREAD} {program}, which is not read; {instead}")));
        }
    }
    Ok(None)
}

/// Whether a file holds matrices of 3 or 4 rows of four numbers, and nothing that tells what they are.
///
/// # Errors
/// As [`known_but_unread`].
pub(super) fn holds_matrices(probe: &Probe) -> Result<bool, ReadError> {
    if probe.folder().is_some() {
        return Ok(false);
    }
    if !probe.keys()?.are_json() {
        return Ok(probe.line()?.is_some_and(|line| {
            let numbers = line.numbers().iter().filter(|number| number.is_some()).count();
            line.words.len() >= 12 && numbers + 2 >= line.words.len()
        }));
    }
    let value = parse_json(probe.path(), probe.text()?.as_bytes())?;
    let root = Node::root(probe.path(), &value);
    let first = match root.is_object() {
        true => root.members()?.into_iter().next().map(|(_, node)| node),
        false => root.items()?.into_iter().next(),
    };
    Ok(first.is_some_and(|node| node.matrix().is_ok()))
}
