//! The common ground plane: estimated from the objects that stand on it, and in turn a constraint on them
//! (docs/method.md, section 11.1).
//!
//! The plane is `up.x = g0 + g1 (e1.x) + g2 (e2.x)` with two horizontal directions e1, e2, about a reference point.
//! Its three numbers are found by weighted least squares over the objects' lowest points, and over the cameras where
//! their height above the ground is known.

use crate::tuning::CAMERA_HEIGHT_SD;
use crate::tuning::SLOPE_SD;
use crate::tuning::UNEVENNESS;
use crate::tuning::UNEVENNESS_FAR;
use nalgebra::{Matrix3, Point3, Unit, Vector3};

use crate::geometry::linalg::solve_spd;
use crate::geometry::rotation::horizontal_basis;

/// So many objects as expected are added when the unevenness of the ground is estimated.
const UNEVENNESS_PRIOR: f64 = 4.0;

/// Residuals beyond this many standard deviations are down-weighted (an object that does not stand on the ground).
const CAUCHY_SCALE: f64 = 3.0;

/// A plane; heights above it are `normal.(x - reference) + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GroundPlane {
    pub reference: Point3<f64>,
    pub normal: Vector3<f64>,
    pub offset: f64,
    /// Ratio of the actual to the expected unevenness, at least one: drifting heights of poses look like unevenness.
    pub unevenness: f64,
}

/// The lowest point of an object and its variance along `up`, without the constraint of the plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LowestPoint {
    pub point: Point3<f64>,
    pub variance: f64,
    /// Height of the object.
    pub height: f64,
    /// Distance from the nearest camera.
    pub distance: f64,
}

impl LowestPoint {
    /// Standard deviation of the point's height above the plane.
    pub(crate) fn unevenness(&self) -> f64 {
        UNEVENNESS.get() * self.height + UNEVENNESS_FAR.get() * self.distance
    }
}

impl GroundPlane {
    /// Fits the plane; `None` without objects.
    pub(crate) fn fit(
        up: &Unit<Vector3<f64>>,
        lowest: &[LowestPoint],
        cameras: &[Point3<f64>],
        camera_height: Option<f64>,
    ) -> Option<Self> {
        let reference = lowest.first()?.point;
        let [e1, e2] = horizontal_basis(up);
        // Points on the plane, with the variance of their height.
        let mut points: Vec<(Point3<f64>, f64, f64)> =
            lowest.iter().map(|l| (l.point, l.variance, l.unevenness().powi(2))).collect();
        if let Some(height) = camera_height {
            // Cameras on a path are not independent: together they count as one.
            let variance = (CAMERA_HEIGHT_SD.get() * height).powi(2) * cameras.len() as f64;
            points.extend(cameras.iter().map(|camera| (camera - up.into_inner() * height, variance, 0.0)));
        }
        let mut plane = Vector3::zeros();
        let mut weights = vec![1.0; points.len()];
        let mut unevenness2 = 1.0f64;
        for _ in 0..5 {
            let mut normal =
                Matrix3::from_diagonal(&Vector3::new(0.0, SLOPE_SD.get().powi(-2), SLOPE_SD.get().powi(-2)));
            let mut right = Vector3::zeros();
            for ((point, variance, uneven), weight) in points.iter().zip(&weights) {
                let variance = variance + unevenness2 * uneven;
                let d = point - reference;
                let row = Vector3::new(1.0, e1.dot(&d), e2.dot(&d));
                normal += row * row.transpose() * (weight / variance);
                right += row * (up.dot(&d) * weight / variance);
            }
            plane = solve_spd(&normal, &right)?;
            let mut ratio = (UNEVENNESS_PRIOR, UNEVENNESS_PRIOR);
            for ((point, variance, uneven), weight) in points.iter().zip(&mut weights) {
                let variance = variance + unevenness2 * uneven;
                let d = point - reference;
                let residual = up.dot(&d) - plane.dot(&Vector3::new(1.0, e1.dot(&d), e2.dot(&d)));
                *weight = 1.0 / (1.0 + residual * residual / (variance * CAUCHY_SCALE * CAUCHY_SCALE));
                if *uneven > 0.0 {
                    ratio.0 += residual * residual / variance;
                    ratio.1 += 1.0;
                }
            }
            unevenness2 = (unevenness2 * ratio.0 / ratio.1).clamp(1.0, 1e4);
        }
        let direction = up.into_inner() - e1 * plane.y - e2 * plane.z;
        let length = direction.norm();
        Some(Self { reference, normal: direction / length, offset: -plane.x / length, unevenness: unevenness2.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64, z: f64) -> LowestPoint {
        LowestPoint { point: Point3::new(x, y, z), variance: 1e-4, height: 1.0, distance: 1.0 }
    }

    fn height(plane: &GroundPlane, x: f64, y: f64, z: f64) -> f64 {
        plane.normal.dot(&(Point3::new(x, y, z) - plane.reference)) + plane.offset
    }

    #[test]
    fn a_gently_sloped_plane_is_found_in_spite_of_a_floating_object() {
        let mut lowest: Vec<LowestPoint> = (0..30)
            .map(|k| {
                let (x, y) = (f64::from(k % 6) * 10.0, f64::from(k / 6) * 10.0);
                point(x, y, 0.5 + 0.02 * x)
            })
            .collect();
        lowest.push(point(20.0, 20.0, 4.0));
        let plane = GroundPlane::fit(&Vector3::z_axis(), &lowest, &[], None).unwrap();
        for (x, y) in [(0.0, 0.0), (50.0, 40.0)] {
            assert!(height(&plane, x, y, 0.5 + 0.02 * x).abs() < 0.05, "{plane:?}");
        }
        assert!((height(&plane, 20.0, 20.0, 4.0) - 3.1).abs() < 0.1);
    }

    #[test]
    fn points_that_contradict_a_plane_make_it_uneven() {
        let points = |bump: f64| -> Vec<LowestPoint> {
            (0..16).map(|k| point(f64::from(k), f64::from(k * k % 7), bump * f64::from(k * k % 3 - 1))).collect()
        };
        let fit = |bump| GroundPlane::fit(&Vector3::z_axis(), &points(bump), &[], None).unwrap();
        assert_eq!(fit(0.01).unevenness, 1.0);
        assert!(fit(0.5).unevenness > 3.0, "{:?}", fit(0.5));
    }

    #[test]
    fn cameras_of_known_height_fix_the_plane_of_a_single_uncertain_object() {
        let cameras: Vec<Point3<f64>> = (0..10).map(|k| Point3::new(f64::from(k), 0.0, 1.65)).collect();
        let vague = LowestPoint { variance: 4.0, ..point(15.0, 3.0, 1.0) };
        let plane = GroundPlane::fit(&Vector3::z_axis(), &[vague], &cameras, Some(1.65)).unwrap();
        assert!(height(&plane, 5.0, 0.0, 0.0).abs() < 0.06, "{plane:?}");
        assert!(GroundPlane::fit(&Vector3::z_axis(), &[], &cameras, Some(1.65)).is_none());
    }
}
