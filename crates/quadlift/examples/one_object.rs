//! Localizes a single object without a scene, with the default estimator and with a closed form.
//!
//!     cargo run --example one_object -p quadlift

#![allow(clippy::print_stdout, reason = "an example")]

use quadlift::geometry::{BodyKind, BoundingBox, CamFromWorld, Intrinsics, Projection};
use quadlift::nalgebra::Matrix3x4;
use quadlift::scene::View;
use quadlift::solve::{Estimator, Method, PosteriorOptions};

/// The rows of `[R | t]`, world to camera (x right, y down, z forward), and the box `x0, y0, x1, y1` in pixels.
const VIEWS: [([f64; 12], [f64; 4]); 4] = [
    ([0.0, 1.0, 0.0, 0.0, 0.60, 0.00, -0.8, 0.0, -0.80, 0.00, -0.6, 1.0], [271.0, 190.0, 332.0, 256.0]),
    ([-0.6, 0.8, 0.0, 0.0, 0.48, 0.36, -0.8, 0.0, -0.64, -0.48, -0.6, 1.0], [269.0, 182.0, 326.0, 248.0]),
    ([-0.8, 0.6, 0.0, 0.0, 0.48, 0.64, -0.6, 0.0, -0.36, -0.48, -0.8, 1.0], [269.0, 182.0, 329.0, 250.0]),
    ([-1.0, 0.0, 0.0, 0.0, 0.00, 0.60, -0.8, 0.0, 0.00, -0.80, -0.6, 1.0], [273.0, 175.0, 342.0, 235.0]),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let intrinsics = Intrinsics::new(600.0, 600.0, 320.0, 240.0)?;
    let mut views = Vec::new();
    for (pose, edges) in VIEWS {
        let cam_from_world = CamFromWorld::new(Matrix3x4::from_row_slice(&pose))?;
        let projection = Projection::from_camera(&intrinsics, &cam_from_world);
        views.push(View::from_box(projection, BoundingBox::new(edges)?).with_image_size(640.0, 480.0));
    }

    let map = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    for method in [Method::from(map), Method::Planes] {
        let name = method.name();
        let estimate = Estimator::new(method)?.fit(&views);
        let center = estimate.center.ok_or_else(|| format!("{name}: {}", estimate.status.name()))?;
        let residual = estimate.rms_residual_px().unwrap_or(f64::NAN);
        println!(
            "{name}: {}, center {:.3?}, residual {residual:.2} px",
            estimate.status.name(),
            center.coords.as_slice()
        );
    }
    Ok(())
}
