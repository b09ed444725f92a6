//! A transform that makes matched objects agree: Levenberg-Marquardt over a rotation, a translation and a logarithm of the scale.

use nalgebra::{Matrix3, Matrix6, Rotation3, SMatrix, SVector, Vector3};

use super::Matrix7;
use super::log_shape::{coordinates, rotation_of_coordinates};
use super::prepared::{PreparedMaps, PreparedObject};
use crate::geometry::linalg::cholesky;
use crate::geometry::{Similarity, skew};
use crate::optimize::levenberg_marquardt::{Equations, Minimum, Problem, minimize};
use crate::optimize::student_t::StudentT;

/// Degrees of freedom of the Student t distributions of centers and of shapes: covariances of estimates may be too small.
pub(super) const DOF: f64 = 5.0;

/// Squared step (radians, extents of the map, logarithm of the scale) below which the search has ended.
const SMALL_STEP: f64 = 1e-24;

/// Standard deviation of the logarithm of a scale before anything is known of it.
pub(super) const LOG_SCALE_SD: f64 = 4.0;

type Vector7 = SVector<f64, 7>;

/// The objects of map B in the frame of map A.
pub(super) struct Moved {
    /// Centers and their covariances.
    pub centers: Vec<(Vector3<f64>, Matrix3<f64>)>,
    rotation: Matrix3<f64>,
    of_coordinates: Matrix6<f64>,
    log_scale: f64,
}

impl Moved {
    pub(super) fn new(maps: &PreparedMaps, a_from_b: &Similarity) -> Self {
        let rotation = *a_from_b.rotation.matrix();
        let squared = a_from_b.scale * a_from_b.scale;
        let moved = |object: &PreparedObject| {
            let covariance = rotation * object.center_covariance * rotation.transpose() * squared;
            (a_from_b.point(&object.center.into()).coords, covariance)
        };
        let centers = maps.b.objects.iter().map(moved).collect();
        let of_coordinates = rotation_of_coordinates(&rotation);
        Self { centers, rotation, of_coordinates, log_scale: a_from_b.scale.ln() }
    }

    /// The logarithm of the shape of an object.
    fn log_shape(&self, object: &PreparedObject) -> Matrix3<f64> {
        self.rotation * object.log_shape * self.rotation.transpose() + Matrix3::identity() * (2.0 * self.log_scale)
    }

    /// The Cholesky factor of the covariance of the difference of two centers.
    pub(super) fn center_factor(&self, maps: &PreparedMaps, (i, j): (usize, usize)) -> Option<Matrix3<f64>> {
        cholesky(&(maps.a.objects[i].center_covariance + self.centers[j].1))
    }

    /// The same of the logarithms of two shapes.
    pub(super) fn shape_factor(&self, maps: &PreparedMaps, (i, j): (usize, usize)) -> Option<Matrix6<f64>> {
        let of_b = self.of_coordinates * maps.b.objects[j].log_shape_covariance * self.of_coordinates.transpose();
        cholesky(&(maps.a.objects[i].log_shape_covariance + of_b))
    }

    /// The difference of two shapes: the one of A minus the one of B.
    pub(super) fn shape_difference(&self, maps: &PreparedMaps, (i, j): (usize, usize)) -> SVector<f64, 6> {
        coordinates(&(maps.a.objects[i].log_shape - self.log_shape(&maps.b.objects[j])))
    }
}

/// A match with the factors by which its residuals are whitened; they are kept during a search.
struct Match {
    pair: (usize, usize),
    center: Matrix3<f64>,
    shape: Matrix6<f64>,
}

/// Solves with a lower triangular factor.
pub(super) fn whitened<const N: usize, const C: usize>(
    factor: &SMatrix<f64, N, N>,
    m: &SMatrix<f64, N, C>,
) -> SMatrix<f64, N, C> {
    let mut x = *m;
    for column in 0..C {
        for i in 0..N {
            for k in 0..i {
                x[(i, column)] -= factor[(i, k)] * x[(k, column)];
            }
            x[(i, column)] /= factor[(i, i)];
        }
    }
    x
}

/// The transform followed by a small motion about a pivot: rotation vector, translation, logarithm of the scale.
pub(super) fn moved(a_from_b: &Similarity, pivot: &Vector3<f64>, by: &Vector7) -> Similarity {
    let turn = Rotation3::new(by.fixed_rows::<3>(0).into_owned());
    let factor = by[6].exp();
    let from_pivot = a_from_b.translation - pivot;
    Similarity {
        scale: a_from_b.scale * factor,
        rotation: turn * a_from_b.rotation,
        translation: turn * from_pivot * factor + pivot + by.fixed_rows::<3>(3),
    }
}

/// Residuals and their derivatives.
type Linearized<const N: usize> = (SVector<f64, N>, SMatrix<f64, N, 7>);

/// Residuals of a match and their derivatives by [`moved`]: of the center, and of the coordinates of `log A`.
fn residuals(
    maps: &PreparedMaps,
    now: &Moved,
    pivot: &Vector3<f64>,
    pair: (usize, usize),
) -> (Linearized<3>, Linearized<6>) {
    let center = now.centers[pair.1].0;
    let off = maps.a.objects[pair.0].center - center;
    let arm = center - pivot;
    let mut slope = SMatrix::<f64, 3, 7>::zeros();
    slope.fixed_columns_mut::<3>(0).copy_from(&skew(&arm));
    slope.fixed_columns_mut::<3>(3).copy_from(&(-Matrix3::identity()));
    slope.set_column(6, &-arm);
    let shape = now.log_shape(&maps.b.objects[pair.1]);
    let mut slope_of_shape = SMatrix::<f64, 6, 7>::zeros();
    for axis in 0..3 {
        let mut turn = Vector3::zeros();
        turn[axis] = 1.0;
        let by = skew(&turn) * shape - shape * skew(&turn);
        slope_of_shape.set_column(axis, &-coordinates(&by));
    }
    slope_of_shape.set_column(6, &coordinates(&(Matrix3::identity() * -2.0)));
    ((off, slope), (now.shape_difference(maps, pair), slope_of_shape))
}

/// Matched objects of two maps.
struct Matched<'a> {
    maps: &'a PreparedMaps,
    /// The middle of the matched objects of A.
    pivot: Vector3<f64>,
    matches: Vec<Match>,
    /// The squared extent of map A.
    squared_extent: f64,
}

impl Problem for Matched<'_> {
    type State = Similarity;
    type Equations = Equations<7>;

    fn linearize(&self, a_from_b: &Similarity) -> Option<Equations<7>> {
        let maps = self.maps;
        let mut all = Equations::zero();
        let student_t = StudentT::new(DOF);
        let now = Moved::new(maps, a_from_b);
        for matched in &self.matches {
            let ((off, slope), (off_shape, slope_of_shape)) = residuals(maps, &now, &self.pivot, matched.pair);
            let (off, slope) = (whitened(&matched.center, &off), whitened(&matched.center, &slope));
            let squares = off.norm_squared();
            let weight = student_t.weight_of(squares, 3);
            all.cost += student_t.cost_of(squares, 3);
            all.gradient += slope.tr_mul(&off) * weight;
            all.hessian += slope.tr_mul(&slope) * weight;
            let (off, slope) = (whitened(&matched.shape, &off_shape), whitened(&matched.shape, &slope_of_shape));
            let squares = off.norm_squared();
            let weight = student_t.weight_of(squares, 6);
            all.cost += student_t.cost_of(squares, 6);
            all.gradient += slope.tr_mul(&off) * weight;
            all.hessian += slope.tr_mul(&slope) * weight;
        }
        if let Some(known) = &maps.options.up {
            let up = a_from_b.rotation * known.up_in_b.into_inner();
            let wanted = known.up_in_a.into_inner();
            let residual = up.cross(&wanted) / known.sd;
            let slope = skew(&wanted) * skew(&up) / known.sd;
            all.cost += residual.norm_squared();
            let mut gradient = all.gradient.fixed_rows_mut::<3>(0);
            gradient += slope.tr_mul(&residual);
            let mut hessian = all.hessian.fixed_view_mut::<3, 3>(0, 0);
            hessian += slope.tr_mul(&slope);
        }
        if maps.options.scale.is_some() {
            all.hessian.fill_row(6, 0.0);
            all.hessian.fill_column(6, 0.0);
            all.hessian[(6, 6)] = 1.0;
            all.gradient[6] = 0.0;
        }
        all.cost.is_finite().then_some(all)
    }

    fn retract(&self, a_from_b: &Similarity, step: &Vector7) -> Option<Similarity> {
        Some(moved(a_from_b, &self.pivot, step)).filter(Similarity::is_valid)
    }

    fn is_last(&self, step: &Vector7, _: &Similarity, _: f64, _: f64) -> bool {
        let shift = step.fixed_rows::<3>(3).norm_squared() / self.squared_extent;
        step.fixed_rows::<3>(0).norm_squared() + shift + step[6] * step[6] < SMALL_STEP
    }
}

/// A refined transform.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub a_from_b: Similarity,
    /// The middle of the matched objects of A.
    pub pivot: Vector3<f64>,
    /// Inverse covariance of a motion of [`moved`]. That of a known scale is 1.
    pub information: Matrix7,
}

/// The transform near a start at which the matched objects agree best; `None` where there is none.
pub(super) fn refine(
    maps: &PreparedMaps,
    start: &Similarity,
    pairs: &[(usize, usize)],
    steps: usize,
) -> Option<Refined> {
    let at_start = Moved::new(maps, start);
    let matches: Vec<Match> = pairs
        .iter()
        .map(|&pair| {
            let (center, shape) = (at_start.center_factor(maps, pair)?, at_start.shape_factor(maps, pair)?);
            Some(Match { pair, center, shape })
        })
        .collect::<Option<_>>()?;
    let count = pairs.len().max(1) as f64;
    let pivot = pairs.iter().fold(Vector3::zeros(), |sum, pair| sum + maps.a.objects[pair.0].center / count);
    let squared_extent = maps.a.extents.norm_squared();
    let matched = Matched { maps, pivot, matches, squared_extent };
    let Minimum { state: mut a_from_b, equations, .. } = minimize(&matched, *start, steps)?;
    // A rotation that was multiplied often stays one.
    a_from_b.rotation.renormalize();
    let mut information = equations.hessian;
    // What is known before: it keeps motions finite that the objects leave open.
    for k in 0..3 {
        information[(k, k)] += 1.0 / (std::f64::consts::PI * std::f64::consts::PI);
        information[(3 + k, 3 + k)] += 1.0 / squared_extent;
    }
    if maps.options.scale.is_none() {
        information[(6, 6)] += 1.0 / (LOG_SCALE_SD * LOG_SCALE_SD);
    }
    Some(Refined { a_from_b, pivot, information })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::align::{AlignOptions, MapObject};
    use crate::geometry::Ellipsoid;
    use nalgebra::Point3;

    fn maps() -> PreparedMaps {
        let object = |center: [f64; 3], semi_axes: [f64; 3]| MapObject {
            ellipsoid: Ellipsoid {
                center: Point3::from(center),
                semi_axes: semi_axes.into(),
                rotation: Rotation3::from_euler_angles(center[0], 0.3, -0.6),
            },
            covariance: None,
            category: None,
        };
        let a = [object([0.3, 1.0, -0.5], [0.5, 0.3, 0.2]), object([2.0, -1.0, 0.4], [0.4, 0.4, 0.1])];
        let b = [object([0.1, 0.9, -0.2], [0.3, 0.2, 0.25]), object([1.0, 1.0, 0.0], [0.5, 0.2, 0.1])];
        PreparedMaps::new(&a, &b, &AlignOptions::default())
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let maps = maps();
        let start = Similarity {
            scale: 1.7,
            rotation: Rotation3::from_euler_angles(0.4, -0.2, 1.1),
            translation: Vector3::new(0.5, 0.1, -0.3),
        };
        let pivot = Vector3::new(0.2, 0.6, -0.1);
        let at = |by: &Vector7| {
            let moved = Moved::new(&maps, &moved(&start, &pivot, by));
            let ((center, slope), (shape, slope_of_shape)) = residuals(&maps, &moved, &pivot, (0, 1));
            (center, slope, shape, slope_of_shape)
        };
        let (_, slope, _, slope_of_shape) = at(&Vector7::zeros());
        for k in 0..7 {
            let mut by = Vector7::zeros();
            by[k] = 1e-6;
            let (more, less) = (at(&by), at(&-by));
            assert!(((more.0 - less.0) / 2e-6 - slope.column(k)).norm() < 1e-8, "{k}");
            assert!(((more.2 - less.2) / 2e-6 - slope_of_shape.column(k)).norm() < 1e-8, "{k}");
        }
    }

    #[test]
    fn whitening_divides_by_the_factor() {
        let m = Matrix3::new(4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0);
        let factor = cholesky(&m).unwrap();
        let v = Vector3::new(1.0, -2.0, 0.3);
        assert!((whitened(&factor, &v).norm_squared() - v.dot(&(m.try_inverse().unwrap() * v))).abs() < 1e-12);
    }
}
