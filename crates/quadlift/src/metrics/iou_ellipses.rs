//! Area IoU of ellipses in the image.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Rotation2, Vector2};

use super::circle_ellipse::circle_ellipse_area;
use super::ratio_of_union;
use crate::geometry::Ellipse;
use crate::geometry::linalg::axes_of_image_of_ball;

/// Area of the intersection over area of the union, in [0, 1], exact to rounding.
///
/// Zero if an ellipse has no area or contains a non-finite number.
pub fn ellipse_iou(a: &Ellipse, b: &Ellipse) -> f64 {
    let area = |e: &Ellipse| PI * e.semi_axes.x * e.semi_axes.y;
    ratio_of_union(intersection_area(a, b).unwrap_or(0.0), area(a), area(b))
}

/// Maps the larger ellipse to the unit circle and turns the other one along the axes.
fn intersection_area(a: &Ellipse, b: &Ellipse) -> Option<f64> {
    let (circle, ellipse) = if a.semi_axes.product() >= b.semi_axes.product() { (a, b) } else { (b, a) };
    let to_circle = |v: Vector2<f64>| (Rotation2::new(-circle.angle) * v).component_div(&circle.semi_axes);
    let offset = to_circle(ellipse.center - circle.center);
    let turn = Rotation2::new(ellipse.angle);
    // The plane's map within a 3x3 matrix, whose third axis stays apart.
    let mut image = Matrix3::identity();
    for axis in 0..2 {
        let column = to_circle(turn * Vector2::ith(axis, ellipse.semi_axes[axis]));
        image.fixed_view_mut::<2, 1>(0, axis).copy_from(&column);
    }
    if !offset.iter().all(|x| x.is_finite()) {
        return None;
    }
    let (lengths, axes) = axes_of_image_of_ball(&image)?;
    let along = |axis: usize| axes[(0, axis)] * offset.x + axes[(1, axis)] * offset.y;
    let area = circle_ellipse_area(1.0, [along(0), along(1)], [lengths[0], lengths[1]]);
    Some(area * circle.semi_axes.product())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ellipse(x: f64, y: f64, a: f64, b: f64, angle: f64) -> Ellipse {
        Ellipse::new(Vector2::new(x, y), Vector2::new(a, b), angle).unwrap()
    }

    #[test]
    fn known_cases() {
        let e = ellipse(3.0, -2.0, 40.0, 15.0, 0.7);
        assert!((ellipse_iou(&e, &e) - 1.0).abs() < 1e-12);
        let smaller = ellipse(3.0, -2.0, 20.0, 7.5, 0.7);
        assert!((ellipse_iou(&e, &smaller) - 0.25).abs() < 1e-12);
        assert_eq!(ellipse_iou(&e, &ellipse(200.0, 0.0, 40.0, 15.0, 0.7)), 0.0);
        // Two unit circles at distance 1: the lens is 2 pi / 3 - sqrt(3) / 2.
        let lens = 2.0 * PI / 3.0 - 0.75f64.sqrt();
        let (p, q) = (ellipse(0.0, 0.0, 1.0, 1.0, 0.3), ellipse(0.6, 0.8, 1.0, 1.0, -1.0));
        assert!((ellipse_iou(&p, &q) - lens / (2.0 * PI - lens)).abs() < 1e-12);
        // A cross of two equal ellipses at a right angle: 4 a b atan(b / a).
        let (p, q) = (ellipse(0.0, 0.0, 3.0, 1.0, 0.2), ellipse(0.0, 0.0, 1.0, 3.0, 0.2));
        let common = 12.0 * (1.0f64 / 3.0).atan();
        assert!((ellipse_iou(&p, &q) - common / (6.0 * PI - common)).abs() < 1e-12);
        let broken = Ellipse { center: Vector2::new(f64::NAN, 0.0), ..p };
        assert_eq!(ellipse_iou(&p, &broken), 0.0);
    }

    proptest! {
        #[test]
        fn symmetric_and_in_range(
            x in -3.0..3.0f64, y in -3.0..3.0f64, a in 0.01..5.0f64, b in 0.01..5.0f64, angle in -3.0..3.0f64,
        ) {
            let (p, q) = (ellipse(500.0, 400.0, 2.0, 1.0, 0.4), ellipse(500.0 + x, 400.0 + y, a, b, angle));
            let iou = ellipse_iou(&p, &q);
            prop_assert!((0.0..=1.0).contains(&iou));
            prop_assert!((iou - ellipse_iou(&q, &p)).abs() < 1e-9);
        }
    }
}
