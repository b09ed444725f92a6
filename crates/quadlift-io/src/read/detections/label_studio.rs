//! Label Studio: exports as JSON (tasks with annotations and predictions) and JSON-MIN (tasks with shapes).
//!
//! Coordinates are percent of the image's width and height, from its corner. Rotations are degrees, clockwise, of boxes
//! about their first corner and of ellipses about their center. Frames of videos count from 1; boxes between keyframes
//! lie on a line, as the program shows them. Format: "Label Studio JSON format of annotated tasks" and the pages of the
//! tags at labelstud.io.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::files::{ByImage, Detected, DetectionFiles, DetectionFormat, ImageKey, Numbering, Outline, edges_of_size};
use super::label_studio_brush::mask_of_brush;
use super::label_studio_links::{image_name, is_video};
use super::shapes::{PixelBudget, oriented_box};
use crate::error::ReadError;
use crate::input::read_bytes;
use crate::read::format::Format;
use crate::read::json::{Node, parse_json};

/// Most boxes between keyframes in a file: two keyframes of a few bytes may be any number of frames apart.
const MAX_BETWEEN_KEYFRAMES: u64 = 1 << 20;

/// Keys of the labels of a shape.
const LABELS: [&str; 6] =
    ["rectanglelabels", "polygonlabels", "ellipselabels", "brushlabels", "labels", "videorectanglelabels"];

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "label-studio",
    title: "Label Studio",
    about: "Label Studio's JSON or JSON-MIN: shapes of images, or tracks of a video",
    looks: "Label Studio (tasks with \"data\")",
    options: &[],
    finds: |probe| {
        let keys = probe.keys()?;
        let is_full = keys.has("data") && (keys.has("annotations") || keys.has("predictions"));
        probe.when(is_full || keys.has("annotation_id") && keys.has("annotator"))
    },
    read: |path, _| parse_label_studio(path, &read_bytes(path)?),
};

/// The shapes in the bytes of an export; the path serves for messages.
///
/// # Errors
/// [`ReadError`] with the entry, what was found and what was expected.
pub(super) fn parse_label_studio(path: &Path, bytes: &[u8]) -> Result<DetectionFiles, ReadError> {
    let value = parse_json(path, bytes)?;
    let mut reader = Reader { mask_pixels: PixelBudget::of_file(bytes.len()), ..Reader::default() };
    for task in Node::root(path, &value).items()? {
        reader.task(&task)?;
    }
    let (videos, images) = (reader.videos.len(), reader.found.images.len());
    if videos > 1 || videos == 1 && reader.found.images.iter().any(|image| image.key.number.is_none()) {
        let problem = format!(
            "the file has {videos} videos and {images} images or frames; expected images, or the frames of one video: \
             export its task"
        );
        return Err(ReadError::new(path, problem));
    }
    let notes = reader.notes();
    Ok(DetectionFiles {
        path: path.to_owned(),
        images: reader.found.images,
        normalized: true,
        numbering: if videos == 1 { Numbering::From(1) } else { Numbering::OfNames },
        notes,
    })
}

/// What has been read of a file.
#[derive(Default)]
struct Reader {
    found: ByImage,
    /// Names of the videos.
    videos: BTreeMap<String, ()>,
    /// Pixels that masks may still have.
    mask_pixels: PixelBudget,
    between_keyframes: u64,
    several: usize,
    predicted: usize,
    /// Results that were skipped, by the reason.
    skipped: BTreeMap<String, usize>,
}

/// Width and height of an image, if a result has them.
type Size = Option<[f64; 2]>;

/// Box and outline, in shares of the image.
type Shape = (Option<[f64; 4]>, Outline);

impl Reader {
    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.several > 0 {
            notes.push(format!("{} tasks have several annotations: the first of each was read", self.several));
        }
        if self.predicted > 0 {
            notes.push(format!("{} tasks have no annotation: their predictions were read", self.predicted));
        }
        if !self.videos.is_empty() {
            notes.push("frames of the video count from 1".to_owned());
        }
        if self.between_keyframes > 0 {
            notes.push(format!("{} boxes between keyframes were interpolated linearly", self.between_keyframes));
        }
        notes.extend(self.skipped.iter().map(|(what, count)| format!("{count} {what} were skipped")));
        notes
    }

    /// A task: the full form has its results in annotations, JSON-MIN in lists beside the name of the image.
    fn task(&mut self, task: &Node) -> Result<(), ReadError> {
        let Some(data) = task.optional("data")? else {
            let name = image_name(task)?;
            let mut results = Vec::new();
            for (_, list) in task.members()?.into_iter().filter(|(_, value)| value.is_list()) {
                results.extend(list.items()?.into_iter().filter(Node::is_object));
            }
            return self.results(name, &results, None);
        };
        let name = image_name(&data)?;
        let mut annotations = Vec::new();
        for annotation in task.optional("annotations")?.map_or(Ok(Vec::new()), |list| list.items())? {
            let canceled = annotation.optional("was_cancelled")?.map_or(Ok(false), |flag| flag.boolean())?;
            annotations.extend((!canceled).then_some(annotation));
        }
        self.several += usize::from(annotations.len() > 1);
        if let Some(annotation) = annotations.first() {
            return self.results(name, &annotation.member("result")?.items()?, None);
        }
        let predictions = task.optional("predictions")?.map_or(Ok(Vec::new()), |list| list.items())?;
        // Predictions may be exported as their numbers.
        let Some(prediction) = predictions.iter().find(|prediction| prediction.is_object()) else { return Ok(()) };
        self.predicted += 1;
        let score = prediction.optional("score")?.map(|score| score.number()).transpose()?;
        self.results(name, &prediction.member("result")?.items()?, score)
    }

    /// The shapes of an image or a video; `score` is that of all of them.
    fn results(&mut self, name: String, results: &[Node], score: Option<f64>) -> Result<(), ReadError> {
        // Results with one id are the parts of one region: its shape, its labels.
        let mut label_of = HashMap::new();
        for result in results {
            if let (Some(id), Some(label)) = (result.optional("id")?, label(result)?) {
                label_of.entry(id.word()?).or_insert(label);
            }
        }
        let (mut shapes, mut seen): (Vec<Detected>, _) = (Vec::new(), HashMap::new());
        let mut image_size = None;
        for (index, result) in results.iter().enumerate() {
            let id = result.optional("id")?.map(|id| id.word()).transpose()?;
            // The full form has the shape in "value".
            let value = result.optional("value")?.unwrap_or_else(|| result.clone());
            if !value.is_object() || result.optional("type")?.map(|kind| kind.word()).transpose()?.is_some_and(no_shape)
            {
                continue;
            }
            let size = size(result)?;
            let category = match label(result)? {
                Some(label) => Some(label),
                None => id.as_ref().and_then(|id| label_of.get(id).cloned()),
            };
            let score = result.optional("score")?.map(|score| score.number()).transpose()?.or(score);
            if let Some(sequence) = value.optional("sequence")? {
                let track = id.unwrap_or_else(|| index.to_string());
                if seen.insert(track.clone(), 0).is_none() {
                    self.videos.insert(name.clone(), ());
                    let detected = Detected { track: Some(track), category, score, ..Detected::default() };
                    self.track(&sequence, &detected, size)?;
                }
                continue;
            }
            if result.optional("image_rotation")?.map_or(Ok(0.0), |angle| angle.number())? != 0.0 {
                self.skip("shapes of rotated images (image_rotation)");
                continue;
            }
            let Some((bounding_box, outline)) = self.shape(&value, size)? else { continue };
            let detected = Detected { category, score, bounding_box, outline, ..Detected::default() };
            image_size = image_size.or(size);
            // JSON-MIN has no ids: shapes in the same place are one region.
            let region = id.unwrap_or_else(|| format!("{:?} {:?}", detected.bounding_box, detected.outline));
            let index = *seen.entry(region).or_insert(shapes.len());
            match shapes.get_mut(index) {
                Some(shape) if shape.category.is_none() => shape.category = detected.category,
                Some(shape) if detected.category.is_none() || shape.category == detected.category => {}
                _ => shapes.push(detected),
            }
        }
        // A video without tracks has no frames to speak of.
        let has_frames = self.videos.contains_key(&name) || shapes.is_empty() && is_video(&name);
        if !has_frames {
            let image = self.found.image(ImageKey { name: Some(name), size: image_size, ..ImageKey::default() });
            image.detections.extend(shapes);
        }
        Ok(())
    }

    fn skip(&mut self, what: &str) {
        *self.skipped.entry(what.to_owned()).or_insert(0) += 1;
    }

    /// Box and outline in shares of the image; `None` for what is no region, or cannot be read, which is counted.
    fn shape(&mut self, value: &Node, size: Size) -> Result<Option<Shape>, ReadError> {
        let has = |key: &str| value.optional(key).map(|found| found.is_some());
        if has("points")? {
            let points = value.member("points")?.items()?;
            let corners = points.iter().map(Node::numbers).collect::<Result<Vec<[f64; 2]>, _>>()?;
            if corners.len() < 3 {
                let problem = format!("the polygon has {} points; expected 3 or more", corners.len());
                return Err(value.member("points")?.error(problem));
            }
            let polygon = corners.iter().flatten().map(|percent| percent / 100.0).collect();
            return Ok(Some((None, Outline::Polygons(vec![polygon]))));
        }
        if has("rle")? {
            let Some([width, height]) = size else {
                return Err(value.error("the mask has no \"original_width\" and \"original_height\""));
            };
            let bytes = value.member("rle")?;
            let mask = mask_of_brush(&packed(&bytes)?, [width, height], &mut self.mask_pixels);
            let Some((edges, rle)) = mask.map_err(|problem| bytes.error(problem))? else {
                self.skip("empty masks");
                return Ok(None);
            };
            let edges = [edges[0] / width, edges[1] / height, edges[2] / width, edges[3] / height];
            return Ok(Some((Some(edges), Outline::Rle(rle))));
        }
        if has("radiusX")? {
            let number = |key: &str| value.member(key)?.number();
            let ([x, y], [rx, ry]) = ([number("x")?, number("y")?], [number("radiusX")?, number("radiusY")?]);
            let edges = edges_of_size([x - rx, y - ry, 2.0 * rx, 2.0 * ry]).map_err(|problem| value.error(problem))?;
            return Ok(self.turned(edges, [x, y], rotation(value)?, size).map(|outline| (None, outline)));
        }
        if has("width")? && has("height")? {
            return self.rectangle(value, size);
        }
        if has("x")? {
            self.skip("points");
        }
        Ok(None)
    }

    /// A box, which may be rotated.
    fn rectangle(&mut self, value: &Node, size: Size) -> Result<Option<Shape>, ReadError> {
        let number = |key: &str| value.member(key)?.number();
        let percent = [number("x")?, number("y")?, number("width")?, number("height")?];
        let edges = edges_of_size(percent).map_err(|problem| value.error(problem))?;
        let degrees = rotation(value)?;
        if degrees == 0.0 {
            return Ok(Some((Some(edges.map(|percent| percent / 100.0)), Outline::Unknown)));
        }
        Ok(self.turned(edges, [edges[0], edges[1]], degrees, size).map(|outline| (None, outline)))
    }

    /// A box in percent, turned about a point. A rotation is one of pixels: without the size of the image it is skipped.
    fn turned(&mut self, edges: [f64; 4], pivot: [f64; 2], degrees: f64, size: Size) -> Option<Outline> {
        let size = match (size, degrees) {
            (Some(size), _) => size,
            (None, 0.0) => [1.0, 1.0],
            (None, _) => {
                self.skip("rotated shapes without \"original_width\" and \"original_height\"");
                return None;
            }
        };
        let pixels = [edges[0] * size[0], edges[1] * size[1], edges[2] * size[0], edges[3] * size[1]];
        let corners = oriented_box(pixels, [pivot[0] * size[0], pivot[1] * size[1]], degrees);
        Some(Outline::OrientedBox(corners.map(|[x, y]| [x / size[0] / 100.0, y / size[1] / 100.0])))
    }

    /// The boxes of a track, with those between keyframes.
    fn track(&mut self, sequence: &Node, detected: &Detected, size: Size) -> Result<(), ReadError> {
        let mut keyframes = sequence.items()?.iter().map(Keyframe::read).collect::<Result<Vec<_>, _>>()?;
        keyframes.sort_by_key(|keyframe| keyframe.frame);
        keyframes.dedup_by_key(|keyframe| keyframe.frame);
        for (index, keyframe) in keyframes.iter().enumerate() {
            let next = keyframes.get(index + 1).filter(|_| keyframe.enabled);
            let count = next.map_or(1, |next| next.frame - keyframe.frame);
            self.between_keyframes += count - 1;
            if self.between_keyframes > MAX_BETWEEN_KEYFRAMES {
                return Err(sequence.error(format!(
                    "the tracks have more than {MAX_BETWEEN_KEYFRAMES} boxes between keyframes; export parts of the video"
                )));
            }
            for step in 0..count {
                let shape = next.map_or_else(|| *keyframe, |next| keyframe.towards(next, step as f64 / count as f64));
                let [x, y, width, height] = shape.percent;
                let edges = edges_of_size([x, y, width, height]).map_err(|problem| sequence.error(problem))?;
                let (bounding_box, outline) = if shape.degrees == 0.0 {
                    (Some(edges.map(|percent| percent / 100.0)), Outline::Unknown)
                } else {
                    match self.turned(edges, [edges[0], edges[1]], shape.degrees, size) {
                        Some(outline) => (None, outline),
                        None => continue,
                    }
                };
                let number = Some((keyframe.frame + step) as i64);
                let image = self.found.image(ImageKey { number, size, ..ImageKey::default() });
                image.detections.push(Detected { bounding_box, outline, ..detected.clone() });
            }
        }
        Ok(())
    }
}

/// A keyframe of a track.
#[derive(Debug, Clone, Copy)]
struct Keyframe {
    /// Number of the frame, from 1.
    frame: u64,
    /// Left, top, width and height in percent.
    percent: [f64; 4],
    /// Rotation in degrees.
    degrees: f64,
    /// Whether the object is visible until the next keyframe.
    enabled: bool,
}

impl Keyframe {
    fn read(node: &Node) -> Result<Self, ReadError> {
        let number = |key: &str| node.member(key)?.number();
        let frame = node.member("frame")?;
        let is_frame = |frame: &u64| (1..=u64::from(u32::MAX)).contains(frame);
        Ok(Self {
            frame: frame
                .whole()
                .ok()
                .filter(is_frame)
                .ok_or_else(|| frame.error("expected the number of a frame, from 1"))?,
            percent: [number("x")?, number("y")?, number("width")?, number("height")?],
            degrees: rotation(node)?,
            enabled: node.optional("enabled")?.map_or(Ok(true), |flag| flag.boolean())?,
        })
    }

    /// This keyframe at 0, the next one at 1.
    fn towards(&self, next: &Self, share: f64) -> Self {
        let between = |a: f64, b: f64| a + share * (b - a);
        let percent = std::array::from_fn(|index| between(self.percent[index], next.percent[index]));
        Self { percent, degrees: between(self.degrees, next.degrees), ..*self }
    }
}

/// The bytes of a packed mask.
fn packed(list: &Node) -> Result<Vec<u8>, ReadError> {
    let byte = |node: &Node| {
        let number = node.whole()?;
        u8::try_from(number).map_err(|_| node.error(format!("found {number}, expected a number from 0 to 255")))
    };
    list.items()?.iter().map(byte).collect()
}

/// Whether results of this type have no shape of their own, though they may repeat that of their region.
fn no_shape(kind: String) -> bool {
    ["choices", "textarea", "rating", "number", "taxonomy", "datetime", "relation", "timelinelabels"]
        .contains(&kind.as_str())
}

/// The rotation of a shape in degrees.
fn rotation(value: &Node) -> Result<f64, ReadError> {
    value.optional("rotation")?.map_or(Ok(0.0), |degrees| degrees.number())
}

/// Width and height of the image of a result.
fn size(result: &Node) -> Result<Size, ReadError> {
    let side = |key: &str| result.optional(key)?.map(|node| node.number()).transpose();
    let size = side("original_width")?.zip(side("original_height")?);
    Ok(size.map(|(width, height)| [width, height]).filter(|size| size.iter().all(|side| *side > 0.0)))
}

/// The first label of a result, in its value or (JSON-MIN) beside it.
fn label(result: &Node) -> Result<Option<String>, ReadError> {
    let value = result.optional("value")?.filter(Node::is_object).unwrap_or_else(|| result.clone());
    for key in LABELS {
        if let Some(labels) = value.optional(key)?.filter(Node::is_list)
            && let Some(first) = labels.items()?.first()
        {
            return Ok(Some(first.text()?.to_owned()));
        }
    }
    Ok(None)
}

#[cfg(test)]
#[path = "label_studio_tests.rs"]
mod tests;
