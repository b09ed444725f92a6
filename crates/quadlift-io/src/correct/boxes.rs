//! Boxes, oriented boxes, ellipses and polygons of detections, corrected.

use std::collections::HashMap;

use nalgebra::Vector2;
use quadlift::diagnosis::{Correction, PixelMap};
use quadlift::geometry::{Ellipse, OrientedBox};

use crate::error::EntryError;
use crate::scene_file::{DetectionRecord, SceneFile};

/// Corrects the boxes, oriented boxes, ellipses, outlines and polygons of all detections; returns their number. Label images and RLE are not
/// changed: they have their own size.
pub(super) fn correct(file: &mut SceneFile, correction: &Correction) -> Result<usize, EntryError> {
    let needs_size = correction.pixel_map(None).is_none();
    change(file, |record, size| {
        if needs_size && size.is_none() {
            return Err(UNKNOWN_SIZE);
        }
        map(record, correction, size)
    })
}

/// Scales boxes that were measured in images of one size to the images of the cameras; cameras without a size get this
/// one. Returns a description.
pub(super) fn from_image_size(file: &mut SceneFile, measured: [f64; 2]) -> Result<String, EntryError> {
    let mut scaled = 0;
    let sizes = file.cameras.iter_mut().map(|camera| (&mut camera.width, &mut camera.height));
    let of_projections = file.frames.iter_mut().filter(|frame| frame.projection.is_some());
    for (width, height) in sizes.chain(of_projections.map(|frame| (&mut frame.width, &mut frame.height))) {
        if width.is_none() && height.is_none() {
            (*width, *height) = (Some(measured[0]), Some(measured[1]));
        }
    }
    let detections = change(file, |record, size| {
        let Some(size) = size else {
            return Err("the image size of the camera is unknown: give the camera a \"width\" and a \"height\"");
        };
        let factor = size.component_div(&Vector2::from(measured));
        if factor != Vector2::repeat(1.0) {
            scaled += 1;
            map_pixels(record, &PixelMap::scaling(factor, Vector2::zeros()));
        }
        Ok(())
    })?;
    let [width, height] = measured;
    Ok(format!("{scaled} of {detections} detections were scaled from images of {width} x {height} pixels"))
}

/// Maps boxes from letterboxed images of this width and height to the images of the cameras; returns the number of the
/// detections.
pub(super) fn from_letterbox(file: &mut SceneFile, letterbox: [f64; 2]) -> Result<usize, EntryError> {
    let letterbox = Vector2::from(letterbox);
    change(file, |record, size| {
        let size = size.ok_or(UNKNOWN_SIZE)?;
        // The image was scaled by this, and moved by the margins.
        let gain = letterbox.component_div(&size).min();
        let shift = -0.5 * (letterbox / gain - size);
        map_pixels(record, &PixelMap::scaling(Vector2::repeat(1.0 / gain), shift));
        Ok(())
    })
}

/// The problem of a correction that needs the size of the image.
const UNKNOWN_SIZE: &str = "the image size is needed but unknown: give the camera a \"width\" and a \"height\"";

/// Changes every detection, with the size of its frame's image; returns their number.
fn change(
    file: &mut SceneFile,
    mut map: impl FnMut(&mut DetectionRecord, Option<Vector2<f64>>) -> Result<(), &'static str>,
) -> Result<usize, EntryError> {
    let sizes = file.image_sizes();
    let size_of: HashMap<&str, Option<Vector2<f64>>> =
        file.frames.iter().zip(&sizes).map(|(frame, size)| (frame.id.as_str(), size.map(Vector2::from))).collect();
    for (index, record) in file.detections.iter_mut().enumerate() {
        let size = size_of.get(&*record.frame).copied().flatten();
        map(record, size).map_err(|problem| EntryError::new(format!("detections[{index}]"), problem))?;
    }
    Ok(file.detections.len())
}

fn map(
    record: &mut DetectionRecord,
    correction: &Correction,
    image_size: Option<Vector2<f64>>,
) -> Result<(), &'static str> {
    match correction.pixel_map(image_size) {
        Some(map) if map != PixelMap::IDENTITY => map_pixels(record, &map),
        _ => {
            if let Some(edges) = &mut record.bounding_box {
                *edges = correction.edges(*edges, image_size).ok_or("the box cannot be corrected")?;
            }
        }
    }
    Ok(())
}

/// Maps the box, the ellipse, the oriented box and the points of masks and outlines.
fn map_pixels(record: &mut DetectionRecord, map: &PixelMap) {
    if let Some(edges) = &mut record.bounding_box {
        *edges = map.edges(*edges);
    }
    if let Some(ellipse) = &mut record.ellipse {
        // `to_scene` reports invalid ellipses.
        let given = Ellipse::new(ellipse.center.into(), ellipse.semi_axes.into(), ellipse.angle).ok();
        if let Some(corrected) = given.and_then(|given| map.ellipse(&given).ok()) {
            let extra = std::mem::take(&mut ellipse.extra);
            **ellipse = corrected.into();
            ellipse.extra = extra;
        }
    }
    if let Some(turned) = &mut record.oriented_box
        // `to_scene` reports invalid ones.
        && let Ok(given) = turned.oriented_box()
    {
        // The corners that follow each other along the width and across it; a factor that differs makes a parallelogram of them.
        let [a, b, c, d] = given.corners().map(|corner| map.point(corner));
        if let Some(corrected) = OrientedBox::of_corners([c, d, a, b]) {
            let extra = std::mem::take(&mut turned.extra);
            **turned = corrected.into();
            turned.extra = extra;
        }
    }
    for point in record.outline.as_deref_mut().into_iter().flatten() {
        *point = map.point((*point).into()).into();
    }
    let polygons = record.mask.as_mut().and_then(|mask| mask.polygons.as_mut());
    for coordinates in polygons.into_iter().flatten() {
        for pair in coordinates.chunks_exact_mut(2) {
            pair.copy_from_slice(map.point(Vector2::new(pair[0], pair[1])).as_slice());
        }
    }
}
