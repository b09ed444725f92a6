//! Figures of the methods on scenes with images and masks:
//! `cargo run --release -p quadlift-segment --example measure -- SCENE.json... [--sequences] [--seed=N]
//! [--method=NAME]`.
//!
//! The boxes are those of the source `visible-mask` that are at least 70 % visible; the truth is the mask that the
//! detection names. Means over sequences (an object in a scene), except the median and the angle (over views; objects
//! whose axes differ by less than a fifth have no angle).
// A tool for development: it stops at the first thing that is wrong, and its table is its output.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::PathBuf;
use std::sync::LazyLock;
use std::time::Instant;

use quadlift_segment::{SegmentMethod, SegmentOptions, SegmentStatus, segment_object};

#[path = "../tests/common/mod.rs"]
mod common;
use common::{Row, Sequence, errors, mean, read};

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

fn correlation(pairs: Vec<(f64, f64)>) -> f64 {
    let (x, y) = (mean(pairs.iter().map(|p| p.0)), mean(pairs.iter().map(|p| p.1)));
    let c = |f: &dyn Fn(&(f64, f64)) -> f64| mean(pairs.iter().map(f));
    c(&|p| (p.0 - x) * (p.1 - y)) / (c(&|p| (p.0 - x).powi(2)) * c(&|p| (p.1 - y).powi(2))).sqrt()
}
