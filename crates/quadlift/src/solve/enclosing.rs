//! The ellipsoid that encloses the real object, which fills only part of the body that fits its boxes (docs/method.md, section 13).
//!
//! A box edge is the plane at which the real object ends. The planes of a real object lie partly inside, partly outside
//! of the body that fits them best; the enclosing ellipsoid is one that most of them do not leave: the closest one of the body times a
//! factor or, with enough planes, one with its own proportions.
//!
//! That one minimizes the mean pinball loss of the logarithm of (distance of the plane) / (reach of the
//! ellipsoid), which makes it the quantile of the planes in each direction (quantile regression: Koenker and Bassett,
//! *Regression quantiles*, Econometrica 46, 1978). Few planes do not determine its proportions: they are pulled towards
//! those of the fitted body (docs/method.md, section 13).

use crate::tuning::ENCLOSING_PRIOR_SD;
use nalgebra::{Matrix3, Matrix3x4, Rotation3, SMatrix, SVector, Vector3};

/// Quantile of (distance of the measured plane) / (reach of the ellipsoid).
const QUANTILE: f64 = 0.85;

use super::conditioning::{ObjectFrame, axes_of};
use crate::geometry::linalg::solve_spd;
use crate::geometry::{Body, ConvexBody, Ellipsoid, TangentLines, edge_plane, support_plane};
use crate::optimize::median::quantile;
use crate::scene::View;

/// Minimum number of planes for separate proportions: twice the parameters. With fewer planes there is no gain: see the
/// 3 views above.
const MIN_PLANES: usize = 18;

/// The loss is round about zero, over this share of its mean.
const ROUND: f64 = 0.2;

/// The scale of the loss is at least this: planes of exact boxes have none.
const MIN_LOSS: f64 = 1e-4;

/// A plane is at least this far from the center, in units of the frame: one that cuts the body near its center is false.
const MIN_PLANE: f64 = 0.02;

/// The iteration ends after as many steps...
const MAX_STEPS: usize = 40;

/// ...or when center and axes move by less than this share of the size.
const SMALL_STEP: f64 = 1e-4;

/// A plane n.x <= d, in a frame about the body's center; n is a unit vector, d > 0 where the center lies inside.
#[derive(Debug, Clone, Copy)]
struct Plane {
    n: Vector3<f64>,
    d: f64,
}

/// The ellipsoid that encloses the object of these views; `None` without a plane, or if the planes contradict the body.
pub(super) fn enclosing(views: &[View], body: &Body) -> Option<Ellipsoid> {
    let closest = body.closest_ellipsoid();
    let unit = closest.semi_axes.product().cbrt();
    let frame = ObjectFrame { origin: body.center(), unit, axes: axes_of(views) };
    let planes = planes(views, &frame);
    let reach = |n: &Vector3<f64>| body.support(&(frame.axes * n)) / unit;
    let scale = quantile_of_ratios(&planes, reach, QUANTILE).filter(|scale| *scale > 0.0)?;
    let axes = frame.axes.tr_mul(closest.rotation.matrix());
    let turned = Ellipsoid { rotation: Rotation3::from_matrix_unchecked(axes), ..closest };
    let own = (planes.len() >= MIN_PLANES)
        .then(|| Fit::of(&turned, &planes, unit, QUANTILE))
        .flatten()
        .map(|fit| {
            let turned = Fit { axes: frame.axes * fit.axes * unit, ..fit };
            (frame.point_in_world(&fit.center), turned.shape())
        })
        .and_then(|(center, shape)| Ellipsoid::from_shape(center, &shape).ok());
    Some(own.unwrap_or(Ellipsoid { semi_axes: closest.semi_axes * scale, ..closest }))
}

/// The planes of all measured edges that are not cut off, in a frame.
fn planes(views: &[View], frame: &ObjectFrame) -> Vec<Plane> {
    let mut planes = Vec::with_capacity(4 * views.len());
    let mut push = |plane: nalgebra::Vector4<f64>| {
        // Planes are positive on the side of the object.
        let norm = plane.xyz().norm();
        let plane = Plane { n: -plane.xyz() / norm, d: plane.w / norm };
        if plane.n.iter().chain([&plane.d]).all(|x| x.is_finite()) {
            planes.push(plane);
        }
    };
    for view in views {
        let p: Matrix3x4<f64> = frame.local_projection(&view.projection);
        let ellipse = view.ellipse.filter(|_| view.bounding_box.is_none());
        if let Some(lines) = ellipse.as_ref().map(TangentLines::of_ellipse).or(view.tangent_lines) {
            lines.lines().filter(|line| !line.end.is_open()).for_each(|line| push(support_plane(&p, &line)));
        } else if let Some(bounding_box) = &view.bounding_box {
            (0..4).filter(|&edge| !view.cut_off[edge]).for_each(|edge| push(edge_plane(&p, bounding_box, edge)));
        }
    }
    planes
}

fn quantile_of_ratios(planes: &[Plane], reach: impl Fn(&Vector3<f64>) -> f64, share: f64) -> Option<f64> {
    let ratios = planes.iter().map(|plane| plane.d / reach(&plane.n));
    quantile(&mut ratios.filter(|ratio| ratio.is_finite()).collect::<Vec<f64>>(), share)
}

/// An ellipsoid about a center: the image of the unit ball by `axes`.
#[derive(Debug, Clone, Copy)]
struct Fit {
    center: Vector3<f64>,
    axes: Matrix3<f64>,
}

/// What is minimized.
struct Loss<'a> {
    planes: &'a [Plane],
    /// Planes that the fitted body touches, in directions that are spread evenly over it.
    prior: Vec<Plane>,
    quantile: f64,
    /// Mean loss of the planes at the start.
    scale: f64,
}

impl Fit {
    /// The separate enclosing ellipsoid, in the frame of the planes, whose unit is `unit`.
    fn of(body: &Ellipsoid, planes: &[Plane], unit: f64, quantile: f64) -> Option<Self> {
        // The symmetric root: with equal axes it does not depend on which of them the ellipsoid has.
        let rotation = body.rotation.matrix();
        let axes = rotation * Matrix3::from_diagonal(&(body.semi_axes / unit)) * rotation.transpose();
        let body = Self { center: Vector3::zeros(), axes };
        let start = body.to_quantile(planes, quantile)?;
        // With a scale of zero the loss is not rounded.
        let mut loss = Loss { planes, prior: start.tangent_planes()?, quantile, scale: 0.0 };
        let mean = planes.iter().map(|plane| loss.pinball(start.log_ratio(plane))).sum::<f64>() / planes.len() as f64;
        loss.scale = mean.max(MIN_LOSS);
        let (mut fit, mut value) = (start, loss.value(&start));
        for _ in 0..MAX_STEPS {
            let Some(step) = loss.step(&fit) else { break };
            // A step that is too long makes the loss larger.
            let better = (0..8).map(|k| step * 0.5f64.powi(k)).find_map(|step| {
                let moved = fit.moved(&step);
                let found = loss.value(&moved);
                (found < value).then_some((moved, found, step.amax()))
            });
            let Some((moved, found, length)) = better else { break };
            (fit, value) = (moved, found);
            if length < SMALL_STEP {
                break;
            }
        }
        // Rounding the loss makes the ellipsoid a little too large.
        fit.to_quantile(planes, quantile)
    }

    /// The same ellipsoid, scaled so that the quantile of (distance) / (reach) is one.
    fn to_quantile(self, planes: &[Plane], quantile: f64) -> Option<Self> {
        let moved: Vec<Plane> =
            planes.iter().map(|plane| Plane { d: plane.d - plane.n.dot(&self.center), ..*plane }).collect();
        let scale = quantile_of_ratios(&moved, |n| self.reach(n), quantile)?;
        let fit = Self { axes: self.axes * scale, ..self };
        (scale > 0.0 && fit.axes.iter().all(|x| x.is_finite())).then_some(fit)
    }

    fn reach(&self, n: &Vector3<f64>) -> f64 {
        (self.axes.transpose() * n).norm()
    }

    fn distance(&self, plane: &Plane) -> f64 {
        plane.d - plane.n.dot(&self.center)
    }

    /// Logarithm of (distance of the plane) / (reach).
    fn log_ratio(&self, plane: &Plane) -> f64 {
        (self.distance(plane).max(MIN_PLANE) / self.reach(&plane.n)).ln()
    }

    /// Its derivatives by the center and by S in `axes <- axes exp(S)` (11, 22, 33, 12, 13, 23).
    fn gradient(&self, plane: &Plane) -> SVector<f64, 9> {
        let distance = self.distance(plane);
        let by_center = if distance > MIN_PLANE { -plane.n / distance } else { Vector3::zeros() };
        let m = (self.axes.transpose() * plane.n).normalize();
        let by_shape = [m.x * m.x, m.y * m.y, m.z * m.z, 2.0 * m.x * m.y, 2.0 * m.x * m.z, 2.0 * m.y * m.z].map(|x| -x);
        SVector::from_iterator(by_center.iter().copied().chain(by_shape))
    }

    fn moved(&self, step: &SVector<f64, 9>) -> Self {
        let s = Matrix3::new(step[3], step[6], step[7], step[6], step[4], step[8], step[7], step[8], step[5]);
        Self {
            center: self.center + Vector3::new(step[0], step[1], step[2]),
            // The exponential to second order: steps are small.
            axes: self.axes * (Matrix3::identity() + s + s * s * 0.5),
        }
    }

    fn shape(&self) -> Matrix3<f64> {
        self.axes * self.axes.transpose()
    }

    /// Planes that touch the ellipsoid where a cube about the unit ball has its 26 faces, edges and corners.
    fn tangent_planes(&self) -> Option<Vec<Plane>> {
        let normals = self.axes.try_inverse()?.transpose();
        let mut planes = Vec::with_capacity(26);
        for k in (0..27).filter(|k| *k != 13) {
            let direction = Vector3::new(f64::from(k / 9 - 1), f64::from(k / 3 % 3 - 1), f64::from(k % 3 - 1));
            let n = (normals * direction).normalize();
            planes.push(Plane { n, d: self.reach(&n) });
        }
        Some(planes)
    }
}

impl Loss<'_> {
    /// The pinball loss of a logarithm, rounded about zero: `q` times the quantile above, less one below.
    fn pinball(&self, x: f64) -> f64 {
        let round = ROUND * self.scale;
        0.5 * (x.hypot(round) - round) + (self.quantile - 0.5) * x
    }

    /// Weight of a plane of the prior.
    fn prior_weight(&self) -> f64 {
        // Nine parameters, whatever the number of planes.
        9.0 / self.prior.len() as f64 / (ENCLOSING_PRIOR_SD.get() * ENCLOSING_PRIOR_SD.get())
    }

    fn value(&self, fit: &Fit) -> f64 {
        let of_planes: f64 = self.planes.iter().map(|plane| self.pinball(fit.log_ratio(plane))).sum();
        let of_prior: f64 = self.prior.iter().map(|plane| fit.log_ratio(plane).powi(2)).sum();
        of_planes / self.scale + 0.5 * self.prior_weight() * of_prior
    }

    /// The step to the minimum of the quadratic that lies above the loss and touches it at `fit` (iteratively reweighted
    /// least squares), in a linear approximation of the logarithms.
    fn step(&self, fit: &Fit) -> Option<SVector<f64, 9>> {
        let round = ROUND * self.scale;
        let (mut hessian, mut gradient) = (SMatrix::<f64, 9, 9>::zeros(), SVector::<f64, 9>::zeros());
        let mut add = |row: SVector<f64, 9>, slope: f64, curvature: f64| {
            gradient += row * slope;
            hessian.ger(curvature, &row, &row, 1.0);
        };
        for plane in self.planes {
            let x = fit.log_ratio(plane);
            let curvature = 0.5 / x.hypot(round);
            let slope = curvature * x + self.quantile - 0.5;
            add(fit.gradient(plane), slope / self.scale, curvature / self.scale);
        }
        for plane in &self.prior {
            let weight = self.prior_weight();
            add(fit.gradient(plane), weight * fit.log_ratio(plane), weight);
        }
        let step = -solve_spd(&hessian, &gradient)?;
        let longest = step.amax();
        // Beyond that neither the logarithms nor the exponential are what they are taken for.
        longest.is_finite().then(|| if longest > 0.3 { step * (0.3 / longest) } else { step })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3};

    use super::*;

    /// Unit normals that are spread evenly (a spiral).
    fn normals(count: usize) -> Vec<Vector3<f64>> {
        (0..count)
            .map(|k| {
                let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
                let (sin, cos) = (k as f64 * 2.399_963).sin_cos();
                Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
            })
            .collect()
    }

    fn ellipsoid() -> Ellipsoid {
        let rotation = Rotation3::from_euler_angles(0.3, -0.7, 1.1);
        Ellipsoid { center: Point3::new(0.1, -0.05, 0.0), semi_axes: Vector3::new(1.4, 1.0, 0.7), rotation }
    }

    fn tangent(body: &Ellipsoid, n: Vector3<f64>) -> Plane {
        Plane { n, d: n.dot(&body.center.coords) + body.support(&n) }
    }

    #[test]
    fn exact_planes_give_their_ellipsoid() {
        let truth = Ellipsoid { center: Point3::origin(), ..ellipsoid() };
        let planes: Vec<Plane> = normals(60).into_iter().map(|n| tangent(&truth, n)).collect();
        let fit = Fit::of(&truth, &planes, 1.0, 0.85).unwrap();
        assert!(fit.center.norm() < 1e-3, "{:?}", fit.center);
        assert!((fit.shape() - truth.shape()).amax() < 2e-3 * truth.shape().amax());
    }

    #[test]
    fn steps_go_down_and_gradients_are_those_of_differences() {
        let (body, fit) = (
            ellipsoid(),
            Fit {
                center: Vector3::new(0.1, 0.2, -0.1),
                axes: Matrix3::new(1.1, 0.2, 0.0, -0.1, 0.9, 0.1, 0.0, 0.3, 0.8),
            },
        );
        for n in normals(12) {
            let plane = tangent(&body, n);
            let gradient = fit.gradient(&plane);
            for k in 0..9 {
                let step = |sign: f64| SVector::<f64, 9>::from_fn(|i, _| if i == k { sign * 1e-6 } else { 0.0 });
                let difference =
                    (fit.moved(&step(1.0)).log_ratio(&plane) - fit.moved(&step(-1.0)).log_ratio(&plane)) / 2e-6;
                assert!((difference - gradient[k]).abs() < 1e-6, "{k}: {difference} {}", gradient[k]);
            }
        }
    }

    /// An object that fills its envelope in some directions only: a wrong start is left for the envelope, and where there
    /// are few planes the start stays.
    #[test]
    fn many_planes_find_the_envelope_and_few_keep_the_proportions() {
        let truth = Ellipsoid { center: Point3::origin(), ..ellipsoid() };
        // Every fifth plane lies inside, by up to a quarter.
        let inside = |k: usize| if k.is_multiple_of(5) { 1.0 - 0.05 * (k / 5 % 6) as f64 } else { 1.0 };
        let shrunk = |n: Vector3<f64>, k: usize| Plane { n, d: truth.support(&n) * inside(k) };
        let planes: Vec<Plane> = normals(400).into_iter().enumerate().map(|(k, n)| shrunk(n, k)).collect();
        // A sphere of the same volume.
        let radius = truth.semi_axes.product().cbrt();
        let sphere = Ellipsoid { semi_axes: Vector3::repeat(radius), ..truth };
        // Planes are in the unit of the frame.
        let planes: Vec<Plane> = planes.into_iter().map(|plane| Plane { d: plane.d / radius, ..plane }).collect();
        let fit = Fit::of(&sphere, &planes, radius, 0.85).unwrap();
        let error = (fit.shape() * (radius * radius) - truth.shape()).amax() / truth.shape().amax();
        assert!(error < 0.03, "{error}");
        let few_planes: Vec<Plane> = planes.iter().step_by(40).copied().collect();
        let few = Fit::of(&sphere, &few_planes, radius, 0.85).unwrap();
        let axes = crate::geometry::linalg::symmetric_eigen3(&few.shape()).unwrap().0;
        assert!(axes[0] / axes[2] < 1.7, "drawn to the sphere: {axes}");
    }

    #[test]
    fn the_quantile_of_the_planes_is_one() {
        let truth = Ellipsoid { center: Point3::origin(), ..ellipsoid() };
        let noise = |k: usize| 1.0 + 0.1 * ((k as f64 * 12.9898).sin() * 43_758.545).fract();
        let planes: Vec<Plane> =
            normals(200).into_iter().enumerate().map(|(k, n)| Plane { n, d: truth.support(&n) * noise(k) }).collect();
        let fit = Fit::of(&truth, &planes, 1.0, 0.85).unwrap();
        let outside = planes.iter().filter(|plane| fit.log_ratio(plane) > 1e-12).count();
        assert!((28..=31).contains(&outside), "{outside} of 200");
    }
}
