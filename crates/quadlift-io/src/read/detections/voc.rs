//! Pascal VOC: an XML file for each image, with boxes (feature `xml`).
//!
//! The files of the challenge itself count pixels from 1, and their boxes include the last pixel; annotation tools write
//! pixels from the corner of the image in the same form. The challenge's files name it in `source`.
//!
//! Format: `VOCreadxml.m` and `Annotations` of the devkit of the PASCAL Visual Object Classes Challenge 2012.

use std::path::Path;

use super::files::{
    Detected, DetectedImage, DetectionFiles, DetectionFormat, ImageKey, LabelFile, Numbering, checked_edges,
    label_files,
};
use crate::error::ReadError;
use crate::read::format::Format;
use crate::read::xml::{DocumentType, Element, Xml};

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "voc",
    title: "Pascal VOC",
    about: "Pascal VOC: XML files with boxes, as written by labelImg, CVAT and Roboflow",
    looks: "Pascal VOC (<annotation>)",
    options: &[],
    finds: |probe| match probe.labels("xml")? {
        Some(first) => probe.when(first.is_xml("annotation")?),
        None => Ok(None),
    },
    read: |path, _| parse_voc(path, &label_files(path, "xml")?),
};

/// The objects in such files; the path is that of their folder and serves for messages.
///
/// # Errors
/// [`ReadError`] with line and column, what was found and what was expected.
pub(super) fn parse_voc(path: &Path, files: &[LabelFile]) -> Result<DetectionFiles, ReadError> {
    let (mut from_one, mut without_box) = (0, 0);
    let images = files.iter().map(|file| image(file, &mut from_one, &mut without_box)).collect::<Result<_, _>>()?;
    let mut notes = Vec::new();
    if from_one > 0 {
        notes.push(format!(
            "{from_one} files of the VOC challenge count pixels from 1: 1 was subtracted from the left and top edges"
        ));
    }
    if without_box > 0 {
        notes.push(format!("{without_box} objects without <bndbox> were skipped"));
    }
    Ok(DetectionFiles { path: path.to_owned(), images, numbering: Numbering::OfNames, notes, ..Default::default() })
}

/// The objects of an image. Files that count pixels from 1, and objects without a box, are counted.
fn image(file: &LabelFile, from_one: &mut usize, without_box: &mut usize) -> Result<DetectedImage, ReadError> {
    let xml = Xml::parse(&file.path, &file.bytes, "an annotation of Pascal VOC", DocumentType::Allowed)?;
    let root = &xml.root;
    if &*root.name != "annotation" {
        return Err(xml.error(root, format!("the file holds <{}>; expected <annotation>", root.name)));
    }
    let first_pixel = if is_of_the_challenge(&xml) { 1.0 } else { 0.0 };
    *from_one += usize::from(first_pixel > 0.0);
    let name = root.children("filename").next().map(Element::text).filter(|name| !name.is_empty());
    // Tools that do not know the size write 0.
    let size = match root.children("size").next() {
        Some(size) => Some([xml.number(size, "width")?, xml.number(size, "height")?]),
        None => None,
    };
    let mut detections = Vec::new();
    for object in root.children("object") {
        let flag = |name| object.children(name).next().map(|_| xml.number(object, name)).transpose();
        let Some(bounds) = object.children("bndbox").next() else {
            *without_box += 1;
            continue;
        };
        let edge = |name| xml.number(bounds, name);
        let edges = [edge("xmin")? - first_pixel, edge("ymin")? - first_pixel, edge("xmax")?, edge("ymax")?];
        detections.push(Detected {
            category: Some(xml.text(object, "name")?.0.to_owned()),
            bounding_box: Some(checked_edges(edges).map_err(|problem| xml.error(bounds, problem))?),
            occluded: flag("occluded")?,
            truncated: flag("truncated")?,
            ..Detected::default()
        });
    }
    let key = ImageKey {
        name: Some(name.unwrap_or(&file.name).to_owned()),
        size: size.filter(|size| size.iter().all(|side| *side > 0.0)),
        ..ImageKey::default()
    };
    Ok(DetectedImage { key, detections })
}

/// Whether a file is one of the challenge's own.
fn is_of_the_challenge(xml: &Xml) -> bool {
    let source = xml.root.children("source").flat_map(|source| source.children("annotation"));
    source.map(Element::text).any(|annotation| annotation.starts_with("PASCAL VOC"))
}
