//! The common ground plane: estimated from the objects that stand on it, and in turn a constraint on them
//! (docs/method.md, section 11.1).
//!
//! The plane is `up.x = g0 + g1 (e1.x) + g2 (e2.x)` with two horizontal directions e1, e2, about a reference point.
//! Its three numbers are found by weighted least squares over the objects' lowest points, and over the cameras where
//! their height above the ground is known. An object stands on the plane that the others tell, with that plane's variance: one that
//! told its own plane would take its own error for knowledge.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use crate::geometry::linalg::solve_spd;
use crate::geometry::rotation::horizontal_basis;
use crate::tuning::{CAMERA_HEIGHT_SD, SLOPE_SD, UNEVENNESS, UNEVENNESS_FAR};

/// So many objects as expected are added when the unevenness of the ground is estimated.
const UNEVENNESS_PRIOR: f64 = 4.0;

/// Residuals beyond this many standard deviations are down-weighted (an object that does not stand on the ground).
const CAUCHY_SCALE: f64 = 3.0;

/// Share of a sum below which what is left after a subtraction is rounding.
const ROUNDING: f64 = 1e-9;

/// The common plane, as objects and cameras tell it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GroundPlane {
    reference: Point3<f64>,
    up: Unit<Vector3<f64>>,
    /// Normal equations of offset and slopes, all that is told together, and what each object told of them.
    told: Told,
    told_by: BTreeMap<usize, Told>,
    /// Ratio of the actual to the expected unevenness, at least one: drifting heights of poses look like unevenness.
    unevenness: f64,
}

/// What is told of the plane: its normal equations.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Told {
    normal: Matrix3<f64>,
    right: Vector3<f64>,
}

/// The plane below an object; heights above it are `normal.(x - through)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlaneBelow {
    pub through: Point3<f64>,
    pub normal: Vector3<f64>,
    /// Standard deviation of the height of an object's lowest point above the plane.
    pub sd: f64,
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

impl Told {
    /// That a point lies on the plane, which only counts `weight`.
    fn by(row: &Vector3<f64>, height: f64, weight: f64) -> Self {
        Self { normal: row * row.transpose() * weight, right: row * (height * weight) }
    }

    fn add(&mut self, other: &Self, sign: f64) {
        self.normal += other.normal * sign;
        self.right += other.right * sign;
    }
}

impl GroundPlane {
    /// Fits the plane to the lowest points of objects, by their indices; `None` without objects.
    pub(crate) fn fit(
        up: &Unit<Vector3<f64>>,
        lowest: &[(usize, LowestPoint)],
        cameras: &[Point3<f64>],
        camera_height: Option<f64>,
    ) -> Option<Self> {
        let reference = lowest.first()?.1.point;
        // Points on the plane, with the variance of their height.
        let mut points: Vec<(Point3<f64>, f64, f64)> =
            lowest.iter().map(|(_, l)| (l.point, l.variance, l.unevenness().powi(2))).collect();
        if let Some(height) = camera_height {
            // Cameras on a path are not independent: together they count as one.
            let variance = (CAMERA_HEIGHT_SD.get() * height).powi(2) * cameras.len() as f64;
            points.extend(cameras.iter().map(|camera| (camera - up.into_inner() * height, variance, 0.0)));
        }
        let slopes = Vector3::new(0.0, SLOPE_SD.get().powi(-2), SLOPE_SD.get().powi(-2));
        let nothing = Told { normal: Matrix3::from_diagonal(&slopes), right: Vector3::zeros() };
        let mut weights = vec![1.0; points.len()];
        let mut unevenness2 = 1.0f64;
        let (mut told, mut told_by) = (nothing, BTreeMap::new());
        for _ in 0..5 {
            (told, told_by) = (nothing, BTreeMap::new());
            for (k, ((point, variance, uneven), weight)) in points.iter().zip(&weights).enumerate() {
                let height = up.dot(&(point - reference));
                let by_point =
                    Told::by(&row(up, &reference, point), height, weight / (variance + unevenness2 * uneven));
                told.add(&by_point, 1.0);
                if let Some((object, _)) = lowest.get(k) {
                    told_by.insert(*object, by_point);
                }
            }
            let plane = solve_spd(&told.normal, &told.right)?;
            let mut ratio = (UNEVENNESS_PRIOR, UNEVENNESS_PRIOR);
            for ((point, variance, uneven), weight) in points.iter().zip(&mut weights) {
                let variance = variance + unevenness2 * uneven;
                let residual = up.dot(&(point - reference)) - plane.dot(&row(up, &reference, point));
                *weight = 1.0 / (1.0 + residual * residual / (variance * CAUCHY_SCALE * CAUCHY_SCALE));
                if *uneven > 0.0 {
                    ratio.0 += residual * residual / variance;
                    ratio.1 += 1.0;
                }
            }
            unevenness2 = (unevenness2 * ratio.0 / ratio.1).clamp(1.0, 1e4);
        }
        Some(Self { reference, up: *up, told, told_by, unevenness: unevenness2.sqrt() })
    }

    /// The plane below the lowest point of an object, as the cameras and the other objects tell it; `None` where they tell
    /// nothing. `object` is the index of one that was counted: what it told of the plane tells nothing of itself.
    pub(crate) fn below(&self, object: Option<usize>, lowest: &LowestPoint) -> Option<PlaneBelow> {
        let mut told = self.told;
        if let Some(own) = object.and_then(|object| self.told_by.get(&object)) {
            told.add(own, -1.0);
        }
        // What is left of the only one that told the height is rounding.
        if told.normal.m11 <= ROUNDING * self.told.normal.m11 {
            return None;
        }
        let plane = solve_spd(&told.normal, &told.right)?;
        let row = row(&self.up, &self.reference, &lowest.point);
        let variance = row.dot(&solve_spd(&told.normal, &row)?);
        let [e1, e2] = horizontal_basis(&self.up);
        let normal = (self.up.into_inner() - e1 * plane.y - e2 * plane.z).normalize();
        let through = self.reference + self.up.into_inner() * plane.x;
        Some(PlaneBelow { through, normal, sd: (variance + (self.unevenness * lowest.unevenness()).powi(2)).sqrt() })
    }
}

/// The row of a point in the normal equations of offset and slopes.
fn row(up: &Unit<Vector3<f64>>, reference: &Point3<f64>, point: &Point3<f64>) -> Vector3<f64> {
    let [e1, e2] = horizontal_basis(up);
    let d = point - reference;
    Vector3::new(1.0, e1.dot(&d), e2.dot(&d))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64, z: f64) -> LowestPoint {
        LowestPoint { point: Point3::new(x, y, z), variance: 1e-4, height: 1.0, distance: 1.0 }
    }

    fn indexed(lowest: &[LowestPoint]) -> Vec<(usize, LowestPoint)> {
        lowest.iter().copied().enumerate().collect()
    }

    fn height(plane: &GroundPlane, x: f64, y: f64, z: f64) -> f64 {
        let below = plane.below(None, &point(x, y, z)).unwrap();
        below.normal.dot(&(Point3::new(x, y, z) - below.through)) / below.normal.z
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
        let plane = GroundPlane::fit(&Vector3::z_axis(), &indexed(&lowest), &[], None).unwrap();
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
        let fit = |bump| GroundPlane::fit(&Vector3::z_axis(), &indexed(&points(bump)), &[], None).unwrap();
        assert_eq!(fit(0.01).unevenness, 1.0);
        assert!(fit(0.5).unevenness > 3.0, "{:?}", fit(0.5));
    }

    /// Against the covariance of all points at once: the height of one above what the others say.
    #[test]
    fn an_object_stands_on_the_plane_that_the_others_tell() {
        let lowest: Vec<LowestPoint> = [(0.0, 0.0, 0.0), (10.0, 0.0, 0.1), (0.0, 8.0, -0.1), (6.0, 7.0, 0.3)]
            .map(|(x, y, z)| LowestPoint { variance: 0.04, ..point(x, y, z) })
            .to_vec();
        let all = GroundPlane::fit(&Vector3::z_axis(), &indexed(&lowest), &[], None).unwrap();
        let others = GroundPlane::fit(&Vector3::z_axis(), &indexed(&lowest[..3]), &[], None).unwrap();
        let (counted, not_counted) = (all.below(Some(3), &lowest[3]).unwrap(), others.below(None, &lowest[3]).unwrap());
        assert!((counted.sd / not_counted.sd - 1.0).abs() < 0.01, "{counted:?} {not_counted:?}");
        assert!((counted.normal - not_counted.normal).norm() < 1e-3);
        // Generalized least squares: slopes of 0.06, heights of 0.2 and of the unevenness of 0.08.
        let own = 0.04 + 0.08f64.powi(2);
        assert!(counted.sd > (own / 3.0 + 0.08f64.powi(2)).sqrt() && counted.sd < 0.5, "{counted:?}");
    }

    #[test]
    fn an_object_alone_does_not_tell_where_it_stands() {
        let alone = LowestPoint { variance: 4.0, ..point(3.0, 2.0, 1.0) };
        let plane = GroundPlane::fit(&Vector3::z_axis(), &[(7, alone)], &[], None).unwrap();
        assert_eq!(plane.below(Some(7), &alone), None);
        // Another one beside it stands as uncertainly as the first.
        let beside = plane.below(None, &point(4.0, 2.0, 1.0)).unwrap();
        assert!((beside.sd / 2.0 - 1.0).abs() < 0.01, "{beside:?}");
    }

    #[test]
    fn cameras_of_known_height_fix_the_plane_of_a_single_uncertain_object() {
        let cameras: Vec<Point3<f64>> = (0..10).map(|k| Point3::new(f64::from(k), 0.0, 1.65)).collect();
        let vague = LowestPoint { variance: 4.0, ..point(15.0, 3.0, 1.0) };
        let plane = GroundPlane::fit(&Vector3::z_axis(), &[(0, vague)], &cameras, Some(1.65)).unwrap();
        assert!(height(&plane, 5.0, 0.0, 0.0).abs() < 0.06, "{plane:?}");
        assert!(GroundPlane::fit(&Vector3::z_axis(), &[], &cameras, Some(1.65)).is_none());
    }
}
