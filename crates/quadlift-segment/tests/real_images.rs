//! Figures on real images, where they are at hand: they cannot be part of the project.

use std::path::PathBuf;

use quadlift_segment::{SegmentMethod, SegmentOptions, segment_object};

mod common;
use common::{errors, mean, read};

#[test]
fn real_objects_are_found() {
    let data = std::env::var_os("QUADLIFT_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")), PathBuf::from);
    let scene = data.join("scenes/lmo_B.json");
    if !scene.exists() {
        println!("skipped: there is no {}; set QUADLIFT_DATA", scene.display());
        return;
    }
    let sequences = read(&scene);
    assert_eq!(sequences.len(), 7);
    // The ellipse in the box has an IoU of 0.739 and an error of 16.7 degrees.
    for (method, least_mask, least_ellipse, most_angle) in BOUNDS {
        let options = SegmentOptions { method, ..Default::default() };
        let rows: Vec<Vec<_>> = sequences
            .iter()
            .map(|s| {
                segment_object(&s.crops, &options).unwrap().iter().zip(&s.truth).map(|(v, t)| errors(v, t)).collect()
            })
            .collect();
        let mask = mean(rows.iter().map(|rows| mean(rows.iter().map(|r| r.mask_iou))));
        let ellipse = mean(rows.iter().map(|rows| mean(rows.iter().map(|r| r.ellipse_iou))));
        let angle = mean(rows.iter().flatten().map(|r| r.angle).filter(|a| a.is_finite()));
        println!("{}: mask IoU {mask:.3}, ellipse IoU {ellipse:.3}, angle {angle:.1}", method.name());
        assert!(mask > least_mask && ellipse > least_ellipse && angle < most_angle);
    }
}

/// A little below what is measured. Method, smallest mean IoU of masks and of ellipses, largest mean error of
/// the angle in degrees.
const BOUNDS: [(SegmentMethod, f64, f64, f64); 3] = [
    (SegmentMethod::Sca, 0.755, 0.81, 8.5),
    (SegmentMethod::ScaCut, 0.765, 0.82, 8.2),
    (SegmentMethod::GraphCut, 0.77, 0.825, 8.3),
];
