//! CVAT: an XML file of a task, "CVAT for images 1.1" or "CVAT for video 1.1" (feature `xml`).
//!
//! Images have names and shapes; tracks have a shape for each frame, by its number from 0. Coordinates are pixels from
//! the corner of the image. Rotations are degrees, clockwise about the center of the box. Runs of masks go along the rows
//! of the window of the mask. Format: "XML annotation format", version 1.1, of docs.cvat.ai.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use super::files::{
    ByImage, Detected, DetectedImage, DetectionFiles, DetectionFormat, ImageKey, Numbering, Outline, checked_edges,
};
use super::shapes::{PixelBudget, add_part, mask_of_rows, oriented_box};
use crate::error::ReadError;
use crate::input::{paths_below, read_bytes};
use crate::read::format::Format;
use crate::read::xml::{DocumentType, Element, Xml};

/// Name of the file in an export.
const FILE: &str = "annotations.xml";

/// Shapes that are no region of an image.
const NOT_REGIONS: [&str; 5] = ["polyline", "points", "cuboid", "skeleton", "tag"];

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "cvat",
    title: "CVAT",
    about: "CVAT's XML: boxes, polygons, masks and ellipses of images, or tracks of a video",
    looks: "CVAT (<annotations>)",
    options: &[],
    finds: |probe| match probe.labels("xml")? {
        Some(first) => probe.when(first.is_xml("annotations")?),
        None => Ok(None),
    },
    read: |path, _| read_cvat(path),
};

/// Reads a file, or the `annotations.xml` (otherwise the only XML file) in a folder.
///
/// # Errors
/// [`ReadError`] with line and column, what was found and what was expected.
pub(super) fn read_cvat(path: &Path) -> Result<DetectionFiles, ReadError> {
    if !path.is_dir() {
        return parse_cvat(path, &read_bytes(path)?);
    }
    let file = path.join(FILE);
    if file.is_file() {
        return parse_cvat(&file, &read_bytes(&file)?);
    }
    match paths_below(path, "xml")?.as_slice() {
        [(_, file)] => parse_cvat(file, &read_bytes(file)?),
        [] => Err(ReadError::new(path, format!("there is no {FILE} in the folder"))),
        several => Err(ReadError::new(path, format!("the folder has {} XML files; name one of them", several.len()))),
    }
}

/// The annotations in the bytes of a file; the path serves for messages.
///
/// # Errors
/// As [`read_cvat`].
pub(super) fn parse_cvat(path: &Path, bytes: &[u8]) -> Result<DetectionFiles, ReadError> {
    let xml = Xml::parse(path, bytes, "annotations of CVAT", DocumentType::Refused)?;
    let root = &xml.root;
    if &*root.name != "annotations" {
        return Err(xml.error(root, format!("the file holds <{}>; expected <annotations>", root.name)));
    }
    let mut reader = Reader { xml: &xml, budget: PixelBudget::of_file(bytes.len()), skipped: BTreeMap::new() };
    let mut images = root.children("image").map(|image| reader.image(image)).collect::<Result<Vec<_>, _>>()?;
    let mut notes = Vec::new();
    let sampled = reader.sampling(root)?;
    let numbering = match (root.children("track").next(), root.children("image").next()) {
        (None, _) => sampled.unwrap_or(Numbering::OfNames),
        (Some(_), None) => {
            let (frames, single) = reader.tracks(root)?;
            images = frames;
            notes.push("frames of the video count from 0".to_owned());
            if single > 0 {
                notes.push(format!("{single} tracks have one shape: they have no object ids"));
            }
            sampled.unwrap_or(Numbering::From(0))
        }
        (Some(track), Some(_)) => {
            return Err(xml.error(track, "the file holds both <image> and <track>; expected one of them"));
        }
    };
    if let Some(Numbering::Sampled { first, step, last }) = sampled {
        notes.push(format!("every {step}th frame of the video was annotated, from {first} to {last} (frame_filter)"));
    }
    let skipped = reader.skipped.iter();
    notes.extend(skipped.map(|(kind, count)| format!("{count} shapes of the kind {kind} were skipped")));
    Ok(DetectionFiles { path: path.to_owned(), images, numbering, notes, ..DetectionFiles::default() })
}

/// A file that is being read.
struct Reader<'a> {
    xml: &'a Xml<'a>,
    /// Pixels that masks may still have.
    budget: PixelBudget,
    /// Shapes that are no region, by their kind.
    skipped: BTreeMap<String, usize>,
}

impl Reader<'_> {
    /// An image of a task with images.
    fn image(&mut self, image: &Element) -> Result<DetectedImage, ReadError> {
        let xml = self.xml;
        let size = [xml.attribute_whole(image, "width")?, xml.attribute_whole(image, "height")?];
        let name = xml.attribute(image, "name")?;
        let mut detections: Vec<Detected> = Vec::new();
        let mut groups = HashMap::new();
        for shape in image.all_children() {
            let Some(detected) = self.shape(shape, Some(size))? else { continue };
            let detected = Detected { category: Some(xml.attribute(shape, "label")?.to_owned()), ..detected };
            // Polygons of one group and label are the parts of one object; the group 0 is none.
            let group = shape.attribute("group_id").filter(|id| *id != "0" && &*shape.name == "polygon");
            if let Some(group) = group {
                let index = *groups.entry((detected.category.clone(), group)).or_insert(detections.len());
                if let Some(object) = detections.get_mut(index) {
                    add_part(object, detected);
                    continue;
                }
            }
            detections.push(detected);
        }
        let key = ImageKey { name: Some(name.to_owned()), size: Some(size.map(f64::from)), ..ImageKey::default() };
        Ok(DetectedImage { key, detections })
    }

    /// The frames of a task with tracks, and the number of tracks with only one shape.
    fn tracks(&mut self, root: &Element) -> Result<(Vec<DetectedImage>, usize), ReadError> {
        let xml = self.xml;
        let (size, mut single) = (self.original_size(root)?, 0);
        let (mut frames, mut tasks) = (ByImage::default(), BTreeSet::new());
        for track in root.children("track") {
            tasks.insert(track.attribute("task_id"));
            if tasks.len() > 1 {
                let problem = "the tracks are of several tasks, whose frames have the same numbers; export one task";
                return Err(xml.error(track, problem));
            }
            let (id, label) = (xml.attribute(track, "id")?, xml.attribute(track, "label")?);
            let mut found = Vec::new();
            for shape in track.all_children() {
                // The object has left the image.
                if shape.attribute("outside") == Some("1") {
                    continue;
                }
                let Some(detected) = self.shape(shape, size)? else { continue };
                found.push((xml.attribute_whole(shape, "frame")?, detected));
            }
            // Shapes that are not tracked are exported as tracks of one frame.
            let is_track = found.len() > 1;
            single += usize::from(found.len() == 1);
            for (frame, detected) in found {
                let size = size.map(|size| size.map(f64::from));
                let image = frames.image(ImageKey { number: Some(frame.into()), size, ..ImageKey::default() });
                image.detections.push(Detected {
                    track: is_track.then(|| id.to_owned()),
                    category: Some(label.to_owned()),
                    ..detected
                });
            }
        }
        let mut images = frames.images;
        images.sort_by_key(|image| image.key.number);
        Ok((images, single))
    }

    /// The first element of a name in the description of the task or job.
    fn about<'e>(root: &'e Element, name: &'e str) -> Option<&'e Element> {
        let parts = root.children("meta").flat_map(Element::all_children);
        parts.flat_map(|part| part.children(name)).next()
    }

    /// The frames of a video of which only some were annotated.
    fn sampling(&self, root: &Element) -> Result<Option<Numbering>, ReadError> {
        let Some(filter) = Self::about(root, "frame_filter").filter(|filter| !filter.text().trim().is_empty()) else {
            return Ok(None);
        };
        let whole = |element: &Element, text: &str| {
            let problem =
                || self.xml.error(element, format!("<{}> is \"{text}\"; expected a whole number", element.name));
            text.trim().parse::<u32>().map(i64::from).map_err(|_| problem())
        };
        let step = filter.text().trim().strip_prefix("step=").unwrap_or(filter.text());
        let step = whole(filter, step)?.max(1);
        let number = |name: &str| Self::about(root, name).map(|element| whole(element, element.text())).transpose();
        let first = number("start_frame")?.unwrap_or(0);
        let last = match (number("stop_frame")?, number("size")?) {
            (Some(last), _) => last - (last - first) % step,
            (None, Some(count)) => first + (count - 1).max(0) * step,
            (None, None) => return Ok(None),
        };
        Ok((step > 1).then_some(Numbering::Sampled { first, step, last }))
    }

    /// Width and height of the frames of a video.
    fn original_size(&self, root: &Element) -> Result<Option<[u32; 2]>, ReadError> {
        let Some(size) = Self::about(root, "original_size") else { return Ok(None) };
        let side = |name: &str| {
            let (text, element) = self.xml.text(size, name)?;
            let problem = || self.xml.error(element, format!("<{name}> is \"{text}\"; expected a whole number"));
            text.parse().map_err(|_| problem())
        };
        Ok(Some([side("width")?, side("height")?]))
    }

    /// Box and outline of a shape; `None` for what is no region, which is counted.
    fn shape(&mut self, shape: &Element, image_size: Option<[u32; 2]>) -> Result<Option<Detected>, ReadError> {
        let xml = self.xml;
        let number = |name| xml.attribute_number(shape, name);
        let degrees = shape.attribute("rotation").map_or(Ok(0.0), |_| number("rotation"))?;
        let turned = |edges: [f64; 4]| {
            let center = [0.5 * (edges[0] + edges[2]), 0.5 * (edges[1] + edges[3])];
            (None, Outline::OrientedBox(oriented_box(edges, center, degrees)))
        };
        let (bounding_box, outline) = match &*shape.name {
            "box" => {
                let edges = [number("xtl")?, number("ytl")?, number("xbr")?, number("ybr")?];
                let edges = checked_edges(edges).map_err(|problem| xml.error(shape, problem))?;
                if degrees == 0.0 { (Some(edges), Outline::Unknown) } else { turned(edges) }
            }
            "ellipse" => {
                let ([x, y], [rx, ry]) = ([number("cx")?, number("cy")?], [number("rx")?, number("ry")?]);
                let edges = checked_edges([x - rx, y - ry, x + rx, y + ry]);
                turned(edges.map_err(|problem| xml.error(shape, problem))?)
            }
            "polygon" => (None, Outline::Polygons(vec![self.points(shape)?])),
            "mask" => self.mask(shape, image_size)?,
            name => {
                if NOT_REGIONS.contains(&name) {
                    *self.skipped.entry(name.to_owned()).or_insert(0) += 1;
                }
                return Ok(None);
            }
        };
        let occluded = shape.attribute("occluded").map(|_| number("occluded")).transpose()?;
        Ok(Some(Detected { bounding_box, outline, occluded, ..Detected::default() }))
    }

    /// The points of a polygon: "x,y;x,y;...".
    fn points(&self, shape: &Element) -> Result<Vec<f64>, ReadError> {
        let text = self.xml.attribute(shape, "points")?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        let mut points = Vec::new();
        for (index, pair) in text.split(';').enumerate() {
            let point = pair.split_once(',').and_then(|(x, y)| Some([number(x)?, number(y)?]));
            let Some(point) = point else {
                let shown: String = pair.chars().take(40).collect();
                return Err(self.xml.error(shape, format!("point {} is \"{shown}\"; expected x,y", index + 1)));
            };
            points.extend(point);
        }
        match points.len() / 2 {
            3.. => Ok(points),
            found => Err(self.xml.error(shape, format!("the polygon has {found} points; expected 3 or more"))),
        }
    }

    /// A mask in its window.
    fn mask(
        &mut self,
        shape: &Element,
        image_size: Option<[u32; 2]>,
    ) -> Result<(Option<[f64; 4]>, Outline), ReadError> {
        let xml = self.xml;
        let whole = |name| xml.attribute_whole(shape, name);
        let window = [whole("left")?, whole("top")?, whole("width")?, whole("height")?];
        let text = xml.attribute(shape, "rle")?;
        let mut runs = Vec::new();
        for (index, run) in text.split(',').map(str::trim).enumerate() {
            let shown = || run.chars().take(40).collect::<String>();
            let problem = || format!("run {} of the mask is \"{}\"; expected a whole number", index + 1, shown());
            runs.push(run.parse().map_err(|_| xml.error(shape, problem()))?);
        }
        let image_size = image_size.ok_or_else(|| xml.error(shape, "there is no <original_size>, which masks need"))?;
        let rle = mask_of_rows(&runs, window, image_size, &mut self.budget);
        Ok((None, Outline::Rle(rle.map_err(|problem| xml.error(shape, problem))?)))
    }
}

#[cfg(test)]
#[path = "cvat_tests.rs"]
mod tests;
