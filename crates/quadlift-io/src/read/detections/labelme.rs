//! LabelMe: a JSON file for each image, with its shapes.
//!
//! Points are pixels from the corner of the image. Shapes of one label and one `group_id` are the parts of one object.
//! Format: `label_file.py` and `shape.py` of the program labelme.

use std::collections::BTreeMap;
use std::path::Path;

use super::files::{
    Detected, DetectedImage, DetectionFiles, DetectionFormat, ImageKey, LabelFile, Numbering, Outline, label_files,
};
use super::shapes::add_part;
use crate::error::ReadError;
use crate::read::format::Format;
use crate::read::json::{Node, parse_json};

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "labelme",
    title: "LabelMe",
    about: "LabelMe's annotations",
    looks: "LabelMe (\"shapes\")",
    options: &[],
    finds: |probe| match probe.labels("json")? {
        Some(first) => probe.when(first.keys()?.has("shapes")),
        None => Ok(None),
    },
    read: |path, _| parse_labelme(path, &label_files(path, "json")?),
};

/// The shapes in such files; the path is that of their folder and serves for messages.
///
/// # Errors
/// [`ReadError`] with the entry, what was found and what was expected.
pub(super) fn parse_labelme(path: &Path, files: &[LabelFile]) -> Result<DetectionFiles, ReadError> {
    let mut left_out = BTreeMap::new();
    let images = files.iter().map(|file| image(file, &mut left_out)).collect::<Result<_, _>>()?;
    let notes =
        left_out.iter().map(|(kind, count)| format!("{count} shapes of the kind {kind} were skipped")).collect();
    Ok(DetectionFiles {
        path: path.to_owned(),
        images,
        numbering: Numbering::OfNames,
        notes,
        ..DetectionFiles::default()
    })
}

/// The shapes of an image. Shapes that are not regions are counted.
fn image(file: &LabelFile, left_out: &mut BTreeMap<String, usize>) -> Result<DetectedImage, ReadError> {
    let value = parse_json(&file.path, &file.bytes)?;
    let root = Node::root(&file.path, &value);
    let number = |key: &str| root.optional(key)?.map(|node| node.number()).transpose();
    let size = number("imageWidth")?.zip(number("imageHeight")?).map(|(width, height)| [width, height]);
    // The path of the image is relative to the file; without one the image has the name of the file.
    let name = root.optional("imagePath")?.map(|path| path.text()).transpose()?.filter(|path| !path.is_empty());
    let name = name.map_or_else(|| file.name.clone(), str::to_owned);
    let mut detections: Vec<Detected> = Vec::new();
    let mut groups = BTreeMap::new();
    for shape in root.member("shapes")?.items()? {
        let label = shape.member("label")?.text()?;
        let kind = shape.optional("shape_type")?.map_or(Ok("polygon"), |kind| kind.text())?;
        let points = shape.member("points")?;
        let corners = points.items()?.iter().map(Node::numbers).collect::<Result<Vec<[f64; 2]>, _>>()?;
        let (bounding_box, outline) = match (kind, corners.as_slice()) {
            // Two corners of a box, in any order; of a mask those of its pixels.
            ("rectangle" | "mask", [a, b]) => {
                (Some([a[0].min(b[0]), a[1].min(b[1]), a[0].max(b[0]), a[1].max(b[1])]), Outline::Unknown)
            }
            ("polygon" | "rectangle", [_, _, _, ..]) => (None, Outline::Polygons(vec![corners.concat()])),
            // The center and a point of the circle.
            ("circle", [center, point]) => {
                let radius = (point[0] - center[0]).hypot(point[1] - center[1]);
                (None, Outline::Circle([center[0], center[1], radius]))
            }
            ("rectangle" | "mask" | "polygon" | "circle", found) => {
                return Err(points.error(format!("found {} points; expected {}", found.len(), points_of(kind))));
            }
            _ => {
                *left_out.entry(kind.to_owned()).or_insert(0) += 1;
                continue;
            }
        };
        let score = shape.optional("score")?.map(|score| score.number()).transpose()?;
        let detected =
            Detected { category: Some(label.to_owned()), score, bounding_box, outline, ..Detected::default() };
        let Some(group) = shape.optional("group_id")? else {
            detections.push(detected);
            continue;
        };
        let index = *groups.entry((label.to_owned(), group.word()?)).or_insert(detections.len());
        match detections.get_mut(index) {
            Some(object) => add_part(object, detected),
            None => detections.push(detected),
        }
    }
    Ok(DetectedImage { key: ImageKey { name: Some(name), size, ..ImageKey::default() }, detections })
}

/// How many points a shape has.
fn points_of(kind: &str) -> &'static str {
    match kind {
        "polygon" => "3 or more of a polygon",
        "circle" => "2 of a circle, the center and one on it",
        _ => "2 of a box, opposite corners",
    }
}
