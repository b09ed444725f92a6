//! COCO: data sets with annotations (`instances_*.json`) and lists of results, with boxes, polygons and masks in runs.
//!
//! Boxes are left, top, width, height in pixels from the corner of the image, which are those of scene files. Format:
//! "Data format" and "Results format" of cocodataset.org; runs as in pycocotools' `maskApi.c`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use quadlift_segment::{Polygons, Rle};

use super::files::{
    ByImage, Detected, DetectionFiles, DetectionFormat, File, ImageKey, Numbering, Outline, edges_of_size,
};
use super::shapes::are_by_rows;
use crate::error::ReadError;
use crate::input::{paths_below, read_bytes};
use crate::read::format::Format;
use crate::read::json::{Node, parse_json};
use crate::scene_file::{RleCounts, RleRecord};
use crate::wording::count;

/// Name of Roboflow's annotations, in the folder of each part of a data set: `train`, `valid`, `test`.
const ROBOFLOW: &str = "_annotations.coco.json";

/// The annotations in a folder of Roboflow and in those in it, if there are any.
fn files_of_roboflow(folder: &Path) -> Result<Option<Vec<PathBuf>>, ReadError> {
    let all = paths_below(folder, "json")?.into_iter().map(|(_, path)| path);
    let files: Vec<PathBuf> = all.filter(|path| path.ends_with(ROBOFLOW)).collect();
    Ok((!files.is_empty()).then_some(files))
}

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "coco",
    title: "COCO",
    about: "COCO: annotations or a list of results, with boxes, polygons and masks",
    looks: "COCO (annotations, or a list with \"image_id\")",
    options: &["annotations"],
    finds: |probe| match probe.folder() {
        Some(folder) => probe.when(files_of_roboflow(folder)?.is_some()),
        None => {
            // Other programs have annotations of one image, which they name beside them.
            let keys = probe.keys()?;
            let is_data_set =
                keys.object_has("annotations") && !["image", "image_path"].iter().any(|key| keys.has(key));
            probe.when(is_data_set || keys.has("image_id"))
        }
    },
    read: |path, options| read_coco(path, options.annotations.as_deref()),
};

/// Reads a data set or a list of results; of a folder the annotations of Roboflow in it. Results name images and categories by numbers only; `annotations` is the data
/// set that has their names.
///
/// # Errors
/// [`ReadError`] with the entry, what was found and what was expected.
pub(super) fn read_coco(path: &Path, annotations: Option<&Path>) -> Result<DetectionFiles, ReadError> {
    if path.is_dir() {
        return read_roboflow(path);
    }
    let bytes = read_bytes(path)?;
    match annotations {
        None => parse_coco((path, &bytes), None),
        Some(data_set) => parse_coco((path, &bytes), Some((data_set, &read_bytes(data_set)?))),
    }
}

/// The parts of a data set of Roboflow, one after another.
fn read_roboflow(folder: &Path) -> Result<DetectionFiles, ReadError> {
    let Some(files) = files_of_roboflow(folder)? else {
        return Err(ReadError::new(folder, format!("there is no {ROBOFLOW} in the folder; expected it, or a file")));
    };
    let mut all = DetectionFiles { path: folder.to_owned(), numbering: Numbering::OfNames, ..Default::default() };
    for path in &files {
        let part = parse_coco((path, &read_bytes(path)?), None)?;
        all.images.extend(part.images);
        all.notes.extend(part.notes);
    }
    all.notes.dedup();
    Ok(all)
}

/// The detections in the bytes of such files; the paths serve for messages.
///
/// # Errors
/// As [`read_coco`].
pub(super) fn parse_coco(file: File, annotations: Option<File>) -> Result<DetectionFiles, ReadError> {
    let value = parse_json(file.0, file.1)?;
    let root = Node::root(file.0, &value);
    let mut names = Names::default();
    if let Some((path, bytes)) = annotations {
        names = Names::read(&Node::root(path, &parse_json(path, bytes)?))?;
    }
    let list = if root.is_list() {
        root
    } else {
        let own = Names::read(&root)?;
        names.are_known = true;
        names.images.extend(own.images);
        names.categories.extend(own.categories);
        root.member("annotations")?
    };
    let mut found = ByImage::default();
    // Images without annotations are known to be empty.
    for key in names.images.values() {
        found.image(key.clone());
    }
    let (mut crowds, mut unnamed) = (0, BTreeMap::new());
    for node in list.items()? {
        if is_set(&node, "iscrowd")? {
            crowds += 1;
            continue;
        }
        let key = names.image(&node)?;
        let mut detected = detected(&node, key.size)?;
        // The number, until here.
        if let Some(id) = detected.category.as_mut().filter(|_| !names.categories.is_empty()) {
            match names.categories.get(id) {
                Some(name) => id.clone_from(name),
                None => *unnamed.entry(id.clone()).or_insert(0) += 1,
            }
        }
        found.image(key).detections.push(detected);
    }
    check_runs(file.0, &found)?;
    let mut notes = Vec::new();
    if crowds > 0 {
        notes.push(format!("{crowds} crowd annotations (\"iscrowd\") were skipped"));
    }
    for (id, number) in unnamed {
        let annotations = count(number, "annotation");
        notes.push(format!("{annotations} of the category {id}, which the file does not list: its number is the name"));
    }
    if names.categories.is_empty() {
        notes.push(
            "the file does not name the categories: category numbers are used (--annotations FILE names them)"
                .to_owned(),
        );
    }
    Ok(DetectionFiles {
        path: file.0.to_owned(),
        images: found.images,
        numbering: Numbering::OfNames,
        notes,
        ..DetectionFiles::default()
    })
}

/// Rejects masks without boxes whose runs go along rows: their boxes would be those of stripes.
fn check_runs(path: &Path, found: &ByImage) -> Result<(), ReadError> {
    let (mut masks, mut by_rows) = (0, 0);
    for detected in found.images.iter().flat_map(|image| &image.detections) {
        if let (None, Outline::Rle(rle)) = (detected.bounding_box, &detected.outline) {
            masks += 1;
            by_rows += usize::from(are_by_rows(rle));
        }
    }
    if 2 * by_rows <= masks {
        return Ok(());
    }
    let which = format!("the runs of {by_rows} of {masks} masks go along the rows of the image");
    Err(ReadError::new(
        path,
        format!("{which}; COCO's go along its columns (encode them with pycocotools, or add a \"bbox\" to each)"),
    ))
}

/// The images and categories of a data set.
#[derive(Debug, Default)]
struct Names {
    /// Whether there is a data set.
    are_known: bool,
    images: BTreeMap<String, ImageKey>,
    categories: BTreeMap<String, String>,
}

impl Names {
    fn read(root: &Node) -> Result<Self, ReadError> {
        let mut names = Self { are_known: true, ..Self::default() };
        for image in root.member("images")?.items()? {
            let number = |key: &str| image.optional(key)?.map(|node| node.number()).transpose();
            let size = number("width")?.zip(number("height")?).map(|(width, height)| [width, height]);
            let key =
                ImageKey { name: Some(image.member("file_name")?.text()?.to_owned()), size, ..ImageKey::default() };
            let id = image.member("id")?;
            if names.images.insert(id.word()?, key).is_some() {
                return Err(id.error("the id of the image is used twice"));
            }
        }
        if let Some(categories) = root.optional("categories")? {
            for category in categories.items()? {
                let (id, name) = (category.member("id")?, category.member("name")?.text()?);
                if let Some(earlier) = names.categories.insert(id.word()?, name.to_owned())
                    && earlier != name
                {
                    return Err(id.error(format!("two categories have this id: \"{earlier}\" and \"{name}\"")));
                }
            }
        }
        Ok(names)
    }

    /// The image of an annotation. Without image names only the image number is known; results of Ultralytics also have
    /// the name.
    fn image(&self, node: &Node) -> Result<ImageKey, ReadError> {
        let id = node.member("image_id")?;
        let word = id.word()?;
        if let Some(key) = self.images.get(&word) {
            return Ok(key.clone());
        }
        if self.are_known {
            return Err(id.error(format!("there is no image with the id {word} among the images of the data set")));
        }
        let name = node.optional("file_name")?.map(|name| name.text()).transpose()?;
        Ok(match (name, word.parse()) {
            (Some(name), _) => ImageKey { name: Some(name.to_owned()), ..ImageKey::default() },
            (None, Ok(number)) => ImageKey { number: Some(number), ..ImageKey::default() },
            (None, Err(_)) => ImageKey { name: Some(word), ..ImageKey::default() },
        })
    }
}

/// Whether a flag is there and not zero.
fn is_set(node: &Node, key: &str) -> Result<bool, ReadError> {
    let Some(flag) = node.optional(key)? else { return Ok(false) };
    flag.boolean().or_else(|_| flag.number().map(|number| number != 0.0))
}

/// A detection; its category is that of the file, a number as a rule.
fn detected(node: &Node, image_size: Option<[f64; 2]>) -> Result<Detected, ReadError> {
    let bounding_box = match node.optional("bbox")? {
        Some(numbers) => Some(edges_of_size(numbers.numbers()?).map_err(|problem| numbers.error(problem))?),
        None => None,
    };
    let category = node.optional("category_id")?.map(|id| id.word()).transpose()?;
    let outline = match node.optional("segmentation")? {
        Some(segmentation) => outline(&segmentation, image_size)?,
        None => Outline::Unknown,
    };
    if bounding_box.is_none() && outline == Outline::Unknown {
        return Err(node.error("there is neither a \"bbox\" nor a \"segmentation\""));
    }
    let attributes = node.optional("attributes")?.filter(Node::is_object);
    let track = match node.optional("track_id")? {
        Some(track) => Some(track),
        None => attributes.map(|attributes| attributes.optional("track_id")).transpose()?.flatten(),
    };
    Ok(Detected {
        track: track.map(|track| track.word()).transpose()?,
        category,
        score: node.optional("score")?.map(|score| score.number()).transpose()?,
        bounding_box,
        outline,
        ..Detected::default()
    })
}

/// Polygons, or runs as text or numbers. An empty list is none.
fn outline(node: &Node, image_size: Option<[f64; 2]>) -> Result<Outline, ReadError> {
    if node.is_list() {
        let polygons = node.items()?.iter().map(Node::list_of_numbers).collect::<Result<Vec<_>, _>>()?;
        Polygons::new(&polygons).map_err(|problem| node.error(problem.to_string()))?;
        return Ok(if polygons.is_empty() { Outline::Unknown } else { Outline::Polygons(polygons) });
    }
    let record: RleRecord = node.record()?;
    let [height, width] = record.size;
    let checked = match &record.counts {
        RleCounts::Runs(runs) => Rle::new(height, width, runs.clone()),
        RleCounts::Compressed(text) => Rle::from_compressed(height, width, text),
    };
    checked.map_err(|problem| node.error(problem.to_string()))?;
    match image_size {
        Some(size) if size != [f64::from(width), f64::from(height)] => {
            Err(node.error(format!("the mask has {width} x {height} pixels, its image has {} x {}", size[0], size[1])))
        }
        _ => Ok(Outline::Rle(record)),
    }
}
