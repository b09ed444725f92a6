//! Plain lists of 3x4 projections from world points to pixels, as CSV or JSON.
//!
//! CSV: a row for each frame; the names in the first line, which may be a comment, decide what the columns are: `p11` to `p34`, and
//! `id`, `width`, `height`, `image` as far as they are known. JSON: a list of `{"id", "projection", "width", "height", "image"}`, or
//! `{"frames": [...]}` around it. Matrices without these names may be anything.

use std::path::Path;

use quadlift::geometry::rotation_defect;

use super::format::{Format, PoseFormat};
use super::import::{Import, PixelCenters};
use super::json::{Node, parse_json};
use super::poses::from_rows;
use super::probe::first_lines;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::scene_file::{FrameRecord, SceneFile};

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "projections",
    title: "projections",
    about: "A list of 3x4 projections, CSV or JSON",
    looks: "projections (columns p11 to p34, or JSON with \"projection\")",
    options: &["image_size", "pixel_centers"],
    finds: |probe| {
        let is_json = || Ok::<bool, ReadError>(probe.keys()?.are_json() && probe.text()?.contains("\"projection\""));
        probe.when(probe.header()?.iter().any(|name| name == "p11") || is_json()?)
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
            "the matrices are poses [R | t], the intrinsics are missing; expected projections K [R | t] to pixels: multiply each by \
             its 3x3 matrix K, or give poses and intrinsics in another format (docs/formats: nerfstudio, TUM)",
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

/// The names of the columns of a table, and those that one without names has: 12 without an id, or the first 13, 15 or 16.
const NAMES: [&str; 16] = [
    "id", "p11", "p12", "p13", "p14", "p21", "p22", "p23", "p24", "p31", "p32", "p33", "p34", "width", "height",
    "image",
];

/// The columns of a table.
struct Columns {
    id: Option<usize>,
    matrix: [[usize; 4]; 3],
    size: Option<[usize; 2]>,
    image: Option<usize>,
}

impl Columns {
    /// Those of names in the first line.
    fn named(names: &[&str]) -> Result<Self, String> {
        let column = |name: &str| names.iter().position(|known| known.eq_ignore_ascii_case(name));
        let mut matrix = [[0; 4]; 3];
        for (i, row) in matrix.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                let name = format!("p{}{}", i + 1, j + 1);
                let missing = || {
                    let shown = names.iter().take(20).map(|name| name.chars().take(40).collect::<String>());
                    let shown: Vec<String> = shown.collect();
                    format!(
                        "there is no column \"{name}\"; expected p11 to p34, the 3x4 matrix by rows, and id, width, height, image as \
                         far as known; the columns are {}",
                        shown.join(", ")
                    )
                };
                *entry = column(&name).ok_or_else(missing)?;
            }
        }
        let size = column("width").zip(column("height")).map(|(width, height)| [width, height]);
        Ok(Self { id: column("id"), matrix, size, image: column("image") })
    }
}

fn from_csv(path: &Path, text: &str) -> Result<Vec<FrameRecord>, ReadError> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut frames = Vec::new();
    let comment: Vec<&str> = first_lines(text)[0].split(',').map(str::trim).collect();
    let mut columns: Option<Columns> = None;
    for (index, record) in reader.records().enumerate() {
        let record = record.map_err(|error| {
            let line = error.position().map_or(0, |position| position.line());
            ReadError::new(path, format!("this is not valid CSV: {error}")).at(line as usize, 0)
        })?;
        let line = record.position().map_or(0, |position| position.line()) as usize;
        let error = |problem: String| ReadError::new(path, problem).at(line, 0);
        if index == 0 {
            // Names may stand in a comment, in as many columns as the table has.
            let names: Vec<&str> = match record.len() {
                count if count == comment.len() => comment.clone(),
                _ if record.get(1).is_some_and(|field| field.parse::<f64>().is_err()) => record.iter().collect(),
                12 => NAMES[1..13].to_vec(),
                count @ (13 | 15 | 16) => NAMES[..count].to_vec(),
                count => {
                    return Err(error(format!(
                        "found {count} columns without names; expected names in the first line, such as {}",
                        NAMES.join(", ")
                    )));
                }
            };
            columns = Some(Columns::named(&names).map_err(error)?);
            if record.iter().eq(names) {
                continue;
            }
        }
        let Some(columns) = &columns else { continue };
        let number = |column: usize| {
            let field = record.get(column).unwrap_or_default();
            let shown: String = field.chars().take(40).collect();
            (field.parse::<f64>().ok().filter(|x| x.is_finite()))
                .ok_or_else(|| error(format!("column {} is \"{shown}\"; expected a number", column + 1)))
        };
        let mut projection = [[0.0; 4]; 3];
        for (row, places) in projection.iter_mut().zip(columns.matrix) {
            for (entry, place) in row.iter_mut().zip(places) {
                *entry = number(place)?;
            }
        }
        let text = |column: usize| record.get(column).filter(|text| !text.is_empty()).map(str::to_owned);
        frames.push(FrameRecord {
            id: columns.id.and_then(text).unwrap_or_else(|| frames.len().to_string()),
            projection: Some(projection),
            width: columns.size.map(|[width, _]| number(width)).transpose()?,
            height: columns.size.map(|[_, height]| number(height)).transpose()?,
            image: columns.image.and_then(text),
            ..FrameRecord::default()
        });
    }
    Ok(frames)
}

fn from_json(path: &Path, bytes: &[u8]) -> Result<Vec<FrameRecord>, ReadError> {
    let value = parse_json(path, bytes)?;
    let root = Node::root(path, &value);
    let list = if root.is_object() { root.member("frames")? } else { root };
    let mut frames = Vec::new();
    for node in list.items()? {
        let number = |key: &str| node.optional(key)?.map(|node| node.number()).transpose();
        let text = |key: &str| node.optional(key)?.map(|node| node.text()).transpose();
        frames.push(FrameRecord {
            id: text("id")?.map_or_else(|| frames.len().to_string(), str::to_owned),
            projection: Some(node.member("projection")?.matrix()?),
            width: number("width")?,
            height: number("height")?,
            image: text("image")?.map(str::to_owned),
            ..FrameRecord::default()
        });
    }
    Ok(frames)
}

#[cfg(test)]
#[path = "projections/tests.rs"]
mod tests;
