//! Real sequences and the errors of their segmentation, for the test and for the table of `examples/measure.rs`.
// The test looks at fewer figures than the table; clippy does not take helpers of tests for tests.
#![allow(dead_code, clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::Path;

use image::RgbImage;
use quadlift::geometry::{BoundingBox, Ellipse};
use quadlift::metrics::ellipse_iou;
use quadlift_segment::{Crop, CropOptions, Mask, Moments, PixelTerm, ViewSegmentation};
use serde_json::Value;

/// An object's crops in a scene and the true masks.
pub struct Sequence {
    pub name: String,
    pub crops: Vec<Crop>,
    pub truth: Vec<Mask>,
}

/// Errors of one view: overlaps, angle in degrees (NaN for round objects), centre error over the mean semi-axis, logarithm
/// of the ratio of areas; and its confidence.
pub struct Row {
    pub mask_iou: f64,
    pub ellipse_iou: f64,
    pub angle: f64,
    pub center: f64,
    pub log_area: f64,
    pub confidence: f64,
}

/// The mean of some numbers.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0, 0.0), |(n, sum), x| (n + 1, sum + x));
    sum / f64::from(n)
}

/// The errors of a view against its true mask.
pub fn errors(view: &ViewSegmentation, truth: &Mask) -> Row {
    let e: Ellipse = Moments::of_mask(truth, PixelTerm::Centers).unwrap().ellipse().unwrap();
    let (axes, found) = (e.semi_axes, view.ellipse.semi_axes);
    let turn = (view.ellipse.angle - e.angle).rem_euclid(std::f64::consts::PI);
    let angle = turn.min(std::f64::consts::PI - turn).to_degrees();
    Row {
        mask_iou: view.mask.iou(truth),
        ellipse_iou: ellipse_iou(&view.ellipse, &e),
        angle: if axes.x > 1.2 * axes.y { angle } else { f64::NAN },
        center: (view.ellipse.center - e.center).norm() / (axes.x * axes.y).sqrt(),
        log_area: ((found.x * found.y) / (axes.x * axes.y)).ln(),
        confidence: view.confidence,
    }
}

/// The objects of a scene with at least three views; one image is held at a time.
pub fn read(path: &Path) -> Vec<Sequence> {
    let scene: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let folder = path.parent().unwrap();
    let mut by_frame: BTreeMap<String, Vec<&Value>> = BTreeMap::new();
    for detection in scene["detections"].as_array().unwrap() {
        let visible = detection["visible_fraction"].as_f64().unwrap_or(1.0) >= 0.7;
        if detection["source"] == "visible-mask" && visible {
            by_frame.entry(detection["frame"].as_str().unwrap().to_owned()).or_default().push(detection);
        }
    }
    let mut sequences: BTreeMap<String, Sequence> = BTreeMap::new();
    for frame in scene["frames"].as_array().unwrap() {
        let Some(detections) = by_frame.get(frame["id"].as_str().unwrap()) else { continue };
        let image: RgbImage = image::open(folder.join(frame["image"].as_str().unwrap())).unwrap().into_rgb8();
        for detection in detections {
            let labels = image::open(folder.join(detection["mask"]["path"].as_str().unwrap())).unwrap().into_luma8();
            let value = detection["mask"]["value"].as_u64().unwrap();
            let inside = labels.as_raw().iter().map(|&label| u64::from(label) == value).collect();
            let truth = Mask::new([0, 0], labels.width(), labels.height(), inside).unwrap();
            if truth.count() < 50 {
                continue;
            }
            let edges: [f64; 4] = std::array::from_fn(|i| detection["box"][i].as_f64().unwrap());
            let bounding_box = BoundingBox::new(edges).unwrap();
            let crop = Crop::cut(&image, &bounding_box, &CropOptions::default()).unwrap();
            let object = detection["object"].as_str().unwrap();
            let name = format!("{}/{object}", path.file_stem().unwrap().to_string_lossy());
            let sequence =
                sequences.entry(object.to_owned()).or_insert_with(|| Sequence { name, crops: vec![], truth: vec![] });
            sequence.crops.push(crop);
            sequence.truth.push(truth.trimmed());
        }
    }
    sequences.into_values().filter(|s| s.crops.len() >= 3).collect()
}
