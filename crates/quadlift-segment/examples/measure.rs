//! Figures of the methods on scenes with images and masks:
//! `cargo run --release -p quadlift-segment --example measure -- SCENE.json... [--sequences] [--seed=N]
//! [--method=NAME]`.
//!
//! The boxes are those of the source `visible-mask` that are at least 70 % visible; the truth is the mask that the
//! detection names. Means over sequences (an object in a scene), except the median and the angle (over views; objects
//! whose axes differ by less than a fifth have no angle).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

use image::RgbImage;
use quadlift::geometry::{BoundingBox, Ellipse};
use quadlift::metrics::ellipse_iou;
use quadlift_segment::{
    Crop, CropOptions, Mask, Moments, PixelTerm, SegmentMethod, SegmentOptions, SegmentStatus, ViewSegmentation,
    segment_object,
};
use serde_json::Value;

/// An object's crops in a scene and the true masks.
struct Sequence {
    name: String,
    crops: Vec<Crop>,
    truth: Vec<Mask>,
}

/// Errors of one view.
struct Row {
    mask_iou: f64,
    ellipse_iou: f64,
    angle: f64,
    center: f64,
    log_area: f64,
    confidence: f64,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let per_sequence = arguments.iter().any(|a| a == "--sequences");
    let seed = arguments.iter().find_map(|a| a.strip_prefix("--seed=")).map_or(0, |seed| seed.parse().unwrap());
    let paths: Vec<PathBuf> = arguments.iter().filter(|a| !a.starts_with("--")).map(PathBuf::from).collect();
    let sequences: Vec<Sequence> = paths.iter().flat_map(|path| read(path)).collect();
    println!("{} sequences\n{:20} mIoU  eIoU  median angle c_err |larea| eIoU<.5 fallen ms/frame", sequences.len(), "");
    let methods = [
        (SegmentMethod::Box, true),
        (SegmentMethod::PlainMixture, false),
        (SegmentMethod::Sca, false),
        (SegmentMethod::ScaCut, false),
        (SegmentMethod::ScaCut, true),
        (SegmentMethod::GraphCut, false),
        (SegmentMethod::GraphCut, true),
    ];
    let only = arguments.iter().find_map(|a| a.strip_prefix("--method="));
    for (method, fall_back) in methods {
        if only.is_some_and(|name| name != method.name()) {
            continue;
        }
        let options = SegmentOptions { method, fall_back, seed, ..Default::default() };
        let mut rows = Vec::new();
        let (mut frames, mut fallen) = (0, 0);
        let start = seconds_of_work();
        let results: Vec<_> = sequences.iter().map(|s| segment_object(&s.crops, &options).unwrap()).collect();
        let seconds = seconds_of_work() - start;
        for (sequence, views) in sequences.iter().zip(&results) {
            let of_sequence: Vec<Row> = views.iter().zip(&sequence.truth).map(|(v, t)| errors(v, t)).collect();
            frames += views.len();
            fallen += views.iter().filter(|v| matches!(v.status, SegmentStatus::FellBack(_))).count();
            if per_sequence {
                let iou = mean(of_sequence.iter().map(|r| r.ellipse_iou));
                println!("    {:34} n={:3} {iou:.3}", sequence.name, views.len());
            }
            rows.push(of_sequence);
        }
        let over_sequences = |f: &dyn Fn(&Row) -> f64| mean(rows.iter().map(|r| mean(r.iter().map(f))));
        let all = || rows.iter().flatten();
        let mut ious: Vec<f64> = all().map(|r| r.ellipse_iou).collect();
        ious.sort_by(f64::total_cmp);
        println!(
            "{:20} {:.3} {:.4} {:.3} {:5.2}  {:.3} {:.3}  {:.3}   {:.3}  {:.2}   r(confidence, eIoU) {:.2}",
            format!("{}{}", method.name(), if fall_back { ", fall-back" } else { "" }),
            over_sequences(&|r| r.mask_iou),
            over_sequences(&|r| r.ellipse_iou),
            ious[ious.len() / 2],
            mean(all().map(|r| r.angle).filter(|a| a.is_finite())),
            over_sequences(&|r| r.center),
            over_sequences(&|r| r.log_area.abs()),
            over_sequences(&|r| if r.ellipse_iou < 0.5 { 1.0 } else { 0.0 }),
            fallen as f64 / frames as f64,
            1e3 * seconds / frames as f64,
            correlation(all().map(|r| (r.confidence, r.ellipse_iou)).collect()),
        );
    }
}

/// Seconds that the processor worked for this thread; where the system does not say, seconds that went by.
fn seconds_of_work() -> f64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|first| first.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0, 0.0), |(n, sum), x| (n + 1, sum + x));
    sum / f64::from(n)
}

fn correlation(pairs: Vec<(f64, f64)>) -> f64 {
    let (x, y) = (mean(pairs.iter().map(|p| p.0)), mean(pairs.iter().map(|p| p.1)));
    let c = |f: &dyn Fn(&(f64, f64)) -> f64| mean(pairs.iter().map(f));
    c(&|p| (p.0 - x) * (p.1 - y)) / (c(&|p| (p.0 - x).powi(2)) * c(&|p| (p.1 - y).powi(2))).sqrt()
}

fn errors(view: &ViewSegmentation, truth: &Mask) -> Row {
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
fn read(path: &Path) -> Vec<Sequence> {
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
