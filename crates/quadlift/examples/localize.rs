//! Localizes a cup from its boxes in four images.
//!
//!     cargo run --example localize -p quadlift

#![allow(clippy::print_stdout, reason = "an example")]

use quadlift::geometry::{BoundingBox, CamFromWorld, Intrinsics, Projection};
use quadlift::nalgebra::Matrix3x4;
use quadlift::scene::{NewDetection, SceneBuilder};
use quadlift::{LocalizeOptions, localize};

/// The rows of `[R | t]`, world to camera (x right, y down, z forward), and the box `x0, y0, x1, y1` in pixels.
const VIEWS: [([f64; 12], [f64; 4]); 4] = [
    ([0.0, 1.0, 0.0, 0.0, 0.60, 0.00, -0.8, 0.0, -0.80, 0.00, -0.6, 1.0], [271.0, 190.0, 332.0, 256.0]),
    ([-0.6, 0.8, 0.0, 0.0, 0.48, 0.36, -0.8, 0.0, -0.64, -0.48, -0.6, 1.0], [269.0, 182.0, 326.0, 248.0]),
    ([-0.8, 0.6, 0.0, 0.0, 0.48, 0.64, -0.6, 0.0, -0.36, -0.48, -0.8, 1.0], [269.0, 182.0, 329.0, 250.0]),
    ([-1.0, 0.0, 0.0, 0.0, 0.00, 0.60, -0.8, 0.0, 0.00, -0.80, -0.6, 1.0], [273.0, 175.0, 342.0, 235.0]),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let intrinsics = Intrinsics::new(600.0, 600.0, 320.0, 240.0)?;
    let mut builder = SceneBuilder::new("cups");
    for (index, (pose, edges)) in VIEWS.into_iter().enumerate() {
        let frame = index.to_string();
        let cam_from_world = CamFromWorld::new(Matrix3x4::from_row_slice(&pose))?;
        builder.add_frame(&frame, Projection::from_camera(&intrinsics, &cam_from_world), Some([640.0, 480.0]))?;
        builder.add_detection(&NewDetection {
            frame: &frame,
            object: Some("cup_1"),
            bounding_box: Some(BoundingBox::new(edges)?),
            ..Default::default()
        })?;
    }
    let scene = builder.build();

    for estimate in &localize(&scene, &LocalizeOptions::default())?.estimates {
        let id = &scene.object_ids[estimate.object_index];
        let body = estimate.body.ok_or_else(|| format!("{id}: {}", estimate.status.name()))?;
        let (center, half_extents) = (body.center.coords, body.half_extents);
        println!(
            "{id}: {}, center {:.3?}, half extents {:.3?} m",
            body.kind,
            center.as_slice(),
            half_extents.as_slice()
        );
        if let Some(sd) = estimate.center_sd() {
            println!("standard deviation of the center: {sd:.3} m");
        }
        for warning in &estimate.warnings {
            println!("warning: {warning}");
        }
    }
    Ok(())
}
