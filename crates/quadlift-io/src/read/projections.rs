//! Plain lists of 3x4 projections from world points to pixels, as CSV or JSON.
//!
//! CSV: a row for each frame, `id, p11, ..., p14, p21, ..., p34` by rows of the matrix, then `width, height`, then the
//! name of the image, as far as they are known; a first row with names is passed over. With 12 columns there is no id,
//! and the frames are numbered from 0. JSON: a list of `{"id", "projection", "width", "height", "image"}`, or
//! `{"frames": [...]}` around it, or an object `{id: projection}`.

use std::collections::HashSet;
use std::path::Path;

use quadlift::geometry::rotation_defect;
use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, Visitor};

use super::format::{Format, PoseFormat};
use super::import::{Import, PixelCenters};
use super::json::{Node, parse_json};
use super::poses::from_rows;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::scene_file::{FrameRecord, SceneFile};

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "projections",
    title: "projections",
    about: "A list of 3x4 projections, CSV or JSON",
    looks: "projections (12 to 16 columns, or JSON)",
    options: &["image_size", "pixel_centers"],
    finds: |probe| {
        let is_row = probe.line()?.is_some_and(|line| line.commas && line.words.len() >= 12);
        probe.when(is_row || probe.keys()?.are_json())
    },
    read: |path, options| read_projections(path, options.image_size, options.pixel_centers),
};

/// Reads a file of projections: JSON where it begins with a bracket, CSV otherwise. `image_size` is width and height
/// where the file does not say.
///
/// # Errors
/// [`ReadError`] with line or entry, what was found and what was expected.
fn read_projections(
    path: &Path,
    image_size: Option<[f64; 2]>,
    pixel_centers: PixelCenters,
) -> Result<Import, ReadError> {
    let mut import = parse_projections(path, &read_bytes(path)?, image_size, pixel_centers)?;
    import.image_folder = path.parent().map(Path::to_owned);
    Ok(import)
}

/// The frames in the bytes of a file of projections; the path serves for messages.
///
/// # Errors
/// As [`read_projections`].
fn parse_projections(
    path: &Path,
    bytes: &[u8],
    image_size: Option<[f64; 2]>,
    pixel_centers: PixelCenters,
) -> Result<Import, ReadError> {
    let text = as_utf8(path, bytes)?;
    let mut frames =
        if text.trim_start().starts_with(['{', '[']) { from_json(path, bytes) } else { from_csv(path, text) }?;
    if !frames.is_empty() && frames.iter().all(|frame| frame.projection.as_ref().is_some_and(is_pose)) {
        return Err(ReadError::new(
            path,
            "the matrices are poses [R | t] without intrinsics; expected projections K [R | t] to pixels: multiply each by its 3x3 \
             matrix K, or give poses and intrinsics in another format (docs/formats: nerfstudio, TUM)",
        ));
    }
    for frame in &mut frames {
        if let Some(size) = image_size
            && frame.width.is_none()
        {
            (frame.width, frame.height) = (Some(size[0]), Some(size[1]));
        }
        if let Some([x, y, z]) = &mut frame.projection {
            for column in 0..4 {
                x[column] += pixel_centers.shift() * z[column];
                y[column] += pixel_centers.shift() * z[column];
            }
        }
    }
    let mut notes = vec![pixel_centers.note().replace("principal points", "projections")];
    if frames.iter().any(|frame| frame.width.is_none()) {
        notes.push("image sizes are unknown: box edges at the border are not treated as cut off".to_owned());
    }
    Import { scene: SceneFile { frames, ..SceneFile::default() }, notes, ..Import::default() }.checked(path)
}

/// Whether a matrix is a rotation and a translation, up to a factor: no camera with pixels has such a projection.
fn is_pose(rows: &[[f64; 4]; 3]) -> bool {
    let part = from_rows(rows).fixed_view::<3, 3>(0, 0).into_owned();
    rotation_defect(&(part / part.determinant().cbrt())) < 1e-3
}

/// A matrix by rows from twelve numbers.
fn by_rows(numbers: &[f64]) -> Option<[[f64; 4]; 3]> {
    let row = |i: usize| numbers.get(4 * i..4 * i + 4)?.try_into().ok();
    Some([row(0)?, row(1)?, row(2)?])
}

fn from_csv(path: &Path, text: &str) -> Result<Vec<FrameRecord>, ReadError> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut frames = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let record = record.map_err(|error| {
            let line = error.position().map_or(0, |position| position.line());
            ReadError::new(path, format!("this is not valid CSV: {error}")).at(line as usize, 0)
        })?;
        let line = record.position().map_or(0, |position| position.line()) as usize;
        let error = |problem: String| ReadError::new(path, problem).at(line, 0);
        let columns = record.len();
        let first = usize::from(columns != 12);
        if index == 0 && record.get(first).is_some_and(|field| field.parse::<f64>().is_err()) {
            continue;
        }
        if !matches!(columns, 12 | 13 | 15 | 16) {
            return Err(error(format!(
                "found {columns} columns; expected 12 (a 3x4 matrix by rows), 13 with an id before, 15 with width and \
                 height after, or 16 with the name of the image"
            )));
        }
        let number = |column: usize| {
            let field = record.get(column).unwrap_or_default();
            let shown: String = field.chars().take(40).collect();
            (field.parse::<f64>().ok().filter(|x| x.is_finite()))
                .ok_or_else(|| error(format!("column {} is \"{shown}\"; expected a number", column + 1)))
        };
        let numbers = (first..first + 12).map(number).collect::<Result<Vec<f64>, _>>()?;
        frames.push(FrameRecord {
            id: if first == 1 { record.get(0).unwrap_or_default().to_owned() } else { frames.len().to_string() },
            projection: by_rows(&numbers),
            width: (columns > 13).then(|| number(13)).transpose()?,
            height: (columns > 13).then(|| number(14)).transpose()?,
            image: record.get(15).filter(|name| !name.is_empty()).map(str::to_owned),
            ..FrameRecord::default()
        });
    }
    Ok(frames)
}

fn from_json(path: &Path, bytes: &[u8]) -> Result<Vec<FrameRecord>, ReadError> {
    let value = parse_json(path, bytes)?;
    let root = Node::root(path, &value);
    let projection = |node: &Node| match node.numbers::<12>() {
        Ok(numbers) => Ok(by_rows(&numbers)),
        Err(_) => node.three_rows().map(Some),
    };
    let list = match root.is_object() {
        true => match root.optional("frames")? {
            Some(list) => list,
            None => {
                check_keys(path, bytes)?;
                let frame = |(id, node): (&str, Node)| {
                    Ok(FrameRecord { id: id.to_owned(), projection: projection(&node)?, ..FrameRecord::default() })
                };
                return root.members()?.into_iter().map(frame).collect();
            }
        },
        false => root,
    };
    let mut frames = Vec::new();
    for node in list.items()? {
        let number = |key: &str| node.optional(key)?.map(|node| node.number()).transpose();
        let text = |key: &str| node.optional(key)?.map(|node| node.text()).transpose();
        frames.push(FrameRecord {
            id: text("id")?.map_or_else(|| frames.len().to_string(), str::to_owned),
            projection: projection(&node.member("projection")?)?,
            width: number("width")?,
            height: number("height")?,
            image: text("image")?.map(str::to_owned),
            ..FrameRecord::default()
        });
    }
    Ok(frames)
}

/// Rejects duplicate keys in a JSON object: JSON readers keep the last of them.
fn check_keys(path: &Path, bytes: &[u8]) -> Result<(), ReadError> {
    let keys: Keys = serde_json::from_str(as_utf8(path, bytes)?)
        .map_err(|error| ReadError::new(path, error.to_string()).at(error.line(), error.column()))?;
    let mut seen = HashSet::new();
    match keys.0.iter().find(|key| !seen.insert(key.as_str())) {
        Some(key) => Err(ReadError::new(path, "two frames have this id").in_entry(key.clone())),
        None => Ok(()),
    }
}

/// The keys of a JSON object.
struct Keys(Vec<String>);

impl<'de> Deserialize<'de> for Keys {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct KeysVisitor;
        impl<'de> Visitor<'de> for KeysVisitor {
            type Value = Keys;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("an object {...}")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Keys, A::Error> {
                let mut keys = Vec::new();
                while let Some((key, IgnoredAny)) = map.next_entry::<String, IgnoredAny>()? {
                    keys.push(key);
                }
                Ok(Keys(keys))
            }
        }
        deserializer.deserialize_map(KeysVisitor)
    }
}

#[cfg(test)]
#[path = "projections/tests.rs"]
mod tests;
