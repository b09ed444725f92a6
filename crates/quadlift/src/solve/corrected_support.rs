//! How far an object reaches in a direction: the support of its body, corrected by its residuals (docs/method.md, section 13).
//!
//! An object is no ellipsoid and no cuboid, and says so in the same direction view after view: the plane of an edge lies beside the plane
//! that touches the body. These residuals are a Gaussian process over the directions of the planes. Near edges it follows them; where
//! nothing was seen it is zero, and the body stands.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x4, Vector3, Vector4};

use super::conditioning::ObjectFrame;
use crate::geometry::{Body, ConvexBody, TangentLines, edge_plane, support_plane};
use crate::optimize::median::median;
use crate::scene::View;

/// Reach of the process: its correlation falls to 61 % over a chord of this length between unit directions.
pub(super) const REACH: f64 = 0.3;

/// Chord beyond which correlations (less than .04 %) do not count, in reaches.
pub(super) const FARTHEST: f64 = 4.0;

/// The correction in a direction comes from so many of the nearest edges. Box IoU of LINEMOD's objects in 100 views, upright: .859, .863,
/// .871 with 12, 16 and 24; elsewhere the same.
const NEAREST: usize = 16;

/// Half sizes that are not noise, at the least.
const MIN_NOISE: f64 = 0.02;

/// Robust deviation over the median of the absolute residuals, somewhat less than that of a normal distribution, whose tails are long.
const PER_MEDIAN: f64 = 1.2;

/// Residuals beyond so many deviations are of wrong boxes.
const MOST_DEVIATIONS: f64 = 4.0;

/// Edges from which the deviation of the process is taken, at most, and evenly spread: pairs are compared.
const SAMPLE: usize = 128;

/// Deviation of the process over that of the residuals that nearby edges have in common: the fit has taken most of what they had.
const LEFT_BY_THE_FIT: f64 = 3.0;

/// Smallest and largest deviation of the process, in sizes of the body.
const DEVIATIONS: [f64; 2] = [0.01, 0.32];

/// Edges whose likelihood is taken, at most about: the time grows with their third power.
const LIKELIHOOD_SAMPLE: usize = 64;

/// Usual deviation of the process, in sizes of the body; its logarithm has a standard deviation of 1.
const USUAL_DEVIATION: f64 = 0.1;

/// One edge of a box, or tangent line: where the object ends in a direction.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Unit vector away from the object, world axes.
    direction: Vector3<f64>,
    /// How much farther than the body the object reaches, in sizes of the body.
    residual: f64,
}

/// The support of a body with its correction.
pub(crate) struct CorrectedSupport<'a> {
    body: &'a Body,
    /// World units: the geometric mean of the half extents.
    size: f64,
    edges: Vec<Edge>,
    /// Standard deviation of the process, in sizes.
    deviation: f64,
    /// Standard deviation of a single edge about it, in sizes.
    noise: f64,
    /// Root mean square of the residuals, in sizes.
    residual: f64,
}

/// How far an object reaches from the center of its body, world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reach {
    pub distance: f64,
    /// Standard deviation of the correction.
    pub sd: f64,
}

impl<'a> CorrectedSupport<'a> {
    /// From the views that show the object. Edges that are cut off or hidden say nothing.
    pub(crate) fn new<'v>(body: &'a Body, views: impl IntoIterator<Item = &'v View>) -> Self {
        let size = body.half_extents.product().cbrt();
        let frame = ObjectFrame { origin: body.center, unit: size, axes: Matrix3::identity() };
        let mut edges = Vec::new();
        for view in views {
            let p = frame.local_projection(&view.projection);
            planes(view, &p, |plane| {
                // Planes are positive on the side of the object.
                let length = plane.xyz().norm();
                let direction = -plane.xyz() / length;
                let residual = plane.w / length - body.support(&direction) / size;
                if residual.is_finite() {
                    edges.push(Edge { direction, residual });
                }
            });
        }
        let mut sizes: Vec<f64> = edges.iter().map(|edge| edge.residual.abs()).collect();
        let limit = MOST_DEVIATIONS * (PER_MEDIAN * median(&mut sizes).unwrap_or(0.0)).max(MIN_NOISE);
        edges.retain(|edge| edge.residual.abs() <= limit);
        let common = common_variance(&edges);
        let mean = edges.iter().map(|edge| edge.residual * edge.residual).sum::<f64>() / edges.len().max(1) as f64;
        let noise = (mean - common).max(MIN_NOISE * MIN_NOISE).sqrt();
        let deviation = (LEFT_BY_THE_FIT * common.sqrt()).clamp(DEVIATIONS[0], DEVIATIONS[1]);
        Self { body, size, edges, deviation, noise, residual: mean.sqrt() }
    }

    /// How far the object reaches along a unit vector (world axes).
    pub(crate) fn along(&self, direction: &Vector3<f64>) -> Reach {
        let support = self.body.support(direction);
        let [correction, sd] = self.correction(direction).map(|x| x * self.size);
        Reach { distance: support + correction, sd }
    }

    /// Logarithms of the likelihood of the residuals with noise of these standard deviations, for each of the deviations of the process,
    /// whose logarithm is a priori normal about [`USUAL_DEVIATION`]. What the fit may have taken from them, anything that is quadratic in the
    /// direction, says nothing. A part of the edges, evenly spread, is enough.
    pub(super) fn log_likelihoods<const N: usize, const M: usize>(
        &self,
        noises: &[f64; N],
        deviations: &[f64; M],
    ) -> [[f64; M]; N] {
        let step = self.edges.len().div_ceil(LIKELIHOOD_SAMPLE) | 1;
        let sample: Vec<&Edge> = self.edges.iter().step_by(step).collect();
        let count = sample.len();
        let residuals = DVector::from_fn(count, |k, _| sample[k].residual);
        let product = DMatrix::from_fn(count, count, |i, j| sample[i].direction.dot(&sample[j].direction));
        let correlations = product.map(|product| correlation(2.0 - 2.0 * product));
        let of_fit = product.map(|product| (1.0 + product).powi(2));
        let log_likelihood = |noise: f64, deviation: f64| {
            let mut covariance = &correlations * (deviation * deviation) + &of_fit;
            (0..count).for_each(|k| covariance[(k, k)] += noise * noise);
            let Some(factor) = covariance.cholesky() else { return f64::NEG_INFINITY };
            let half_log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum();
            let prior = (deviation / USUAL_DEVIATION).ln();
            -half_log_determinant - 0.5 * (residuals.dot(&factor.solve(&residuals)) + prior * prior)
        };
        noises.map(|noise| deviations.map(|deviation| log_likelihood(noise, deviation)))
    }

    /// The same with other standard deviations of noise and process, in sizes.
    pub(super) fn with_levels(self, noise: f64, deviation: f64) -> Self {
        Self { noise, deviation, ..self }
    }

    /// The correction in a direction, world units, and the share of the variance of the process that edges explain there.
    pub(super) fn amount_and_explained(&self, direction: &Vector3<f64>) -> [f64; 2] {
        let [mean, sd] = self.correction(direction);
        [mean * self.size, 1.0 - (sd / self.deviation).powi(2)]
    }

    /// Standard deviation of the process, world units.
    pub(super) fn deviation(&self) -> f64 {
        self.deviation * self.size
    }

    /// Standard deviation of a single edge about the corrected support over that about the body.
    pub(super) fn noise_ratio(&self) -> f64 {
        self.noise / self.residual.max(self.noise)
    }

    /// Mean and standard deviation of the process in a direction, in sizes.
    fn correction(&self, direction: &Vector3<f64>) -> [f64; 2] {
        let mut near: Vec<(f64, usize)> = Vec::with_capacity(self.edges.len());
        let farthest = (FARTHEST * REACH).powi(2);
        let squared = self.edges.iter().map(|edge| (edge.direction - direction).norm_squared());
        near.extend(squared.enumerate().filter(|(_, squared)| *squared < farthest).map(|(k, squared)| (squared, k)));
        if near.len() > NEAREST {
            near.select_nth_unstable_by(NEAREST, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            near.truncate(NEAREST);
        }
        // In units of the variance of the process. Row by row of the Cholesky factor L of the covariance of the residuals, with
        // x = L^-1 (covariances with the direction) and y = L^-1 (residuals).
        let noise = (self.noise / self.deviation).powi(2);
        let mut factor = [[0.0; NEAREST]; NEAREST];
        let (mut x, mut y) = ([0.0; NEAREST], [0.0; NEAREST]);
        let (mut mean, mut variance) = (0.0, 1.0);
        for (i, &(squared, index)) in near.iter().enumerate() {
            let edge = &self.edges[index];
            let (done, rest) = factor.split_at_mut(i);
            let row = &mut rest[0];
            let mut diagonal = 1.0 + noise;
            let (mut of_x, mut of_y) = (correlation(squared), edge.residual);
            for (j, done) in done.iter().enumerate() {
                let other = &self.edges[near[j].1].direction;
                let mut sum = correlation((edge.direction - other).norm_squared());
                for k in 0..j {
                    sum -= row[k] * done[k];
                }
                row[j] = sum / done[j];
                diagonal -= row[j] * row[j];
                of_x -= row[j] * x[j];
                of_y -= row[j] * y[j];
            }
            // Rounding cannot take what the noise adds.
            row[i] = diagonal.max(noise).sqrt();
            (x[i], y[i]) = (of_x / row[i], of_y / row[i]);
            mean += x[i] * y[i];
            variance -= x[i] * x[i];
        }
        [mean, self.deviation * variance.max(0.0).sqrt()]
    }
}

pub(super) fn correlation(squared_chord: f64) -> f64 {
    (-0.5 * squared_chord / (REACH * REACH)).exp()
}

/// The variance that residuals have in common where their directions are near: the products of pairs fall with the distance of their
/// directions as the correlation does. The least squares of that, 0 at least.
fn common_variance(edges: &[Edge]) -> f64 {
    // An odd step: four edges of a view follow one another.
    let step = (edges.len() / SAMPLE) | 1;
    let sample: Vec<&Edge> = edges.iter().step_by(step).take(SAMPLE).collect();
    let (mut products, mut squares) = (0.0, 0.0);
    for (k, one) in sample.iter().enumerate() {
        for other in &sample[..k] {
            let squared = (one.direction - other.direction).norm_squared();
            if squared < (FARTHEST * REACH).powi(2) {
                let correlation = correlation(squared);
                products += correlation * one.residual * other.residual;
                squares += correlation * correlation;
            }
        }
    }
    if squares > 0.0 { (products / squares).max(0.0) } else { 0.0 }
}

/// The planes of the edges of a view that end the object, positive on its side, for a projection `p` of any frame.
fn planes(view: &View, p: &Matrix3x4<f64>, mut push: impl FnMut(Vector4<f64>)) {
    let ellipse = view.ellipse.filter(|_| view.bounding_box.is_none() && !view.partial);
    if let Some(lines) = ellipse.as_ref().map(TangentLines::of_ellipse).or(view.tangent_lines) {
        lines.lines().filter(|line| !line.end.is_open()).for_each(|line| push(support_plane(p, &line)));
    } else if let Some(bounding_box) = &view.bounding_box {
        let is_seen = |edge: &usize| !view.cut_off[*edge] && !view.occluded_edges[*edge];
        (0..4).filter(is_seen).for_each(|edge| push(edge_plane(p, bounding_box, edge)));
    }
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{Point3, Rotation3};
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::{BodyKind, CamFromWorld, Intrinsics, Projection, project_bounding_box, project_ellipsoid};
    use crate::test_cases::cases;

    /// Boxes of a body near the origin in cameras on a circle of radius 20 about it, at several heights, turned about the origin.
    pub(in crate::solve) fn views(body: &Body, count: usize, turn: &Rotation3<f64>) -> Vec<View> {
        let intrinsics = Intrinsics::new(600.0, 600.0, 320.0, 240.0).unwrap();
        let view = |k: usize| {
            let angle = std::f64::consts::TAU * k as f64 / count as f64;
            let position = Vector3::new(20.0 * angle.cos(), 20.0 * angle.sin(), 4.0 * (k % 5) as f64 - 4.0);
            let z = -position.normalize();
            let x = z.cross(&Vector3::z()).normalize();
            let axes = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
            let mut pose = Matrix3x4::zeros();
            pose.fixed_columns_mut::<3>(0).copy_from(&(axes * turn.matrix().transpose()));
            pose.set_column(3, &-(axes * position));
            let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap());
            View { frame_index: k, ..View::from_box(projection, project_bounding_box(&projection, body).unwrap()) }
        };
        (0..count).map(view).collect()
    }

    pub(in crate::solve) fn body(kind: BodyKind) -> Body {
        Body {
            center: Point3::new(0.1, -0.2, 0.3),
            rotation: Rotation3::from_euler_angles(0.3, -0.2, 0.9),
            half_extents: Vector3::new(1.3, 1.0, 0.7),
            kind,
        }
    }

    const NOT_TURNED: fn() -> Rotation3<f64> = Rotation3::identity;

    /// How much farther the support of the body reaches than a corrected one, at most, over directions all around.
    fn largest_correction(support: &CorrectedSupport) -> f64 {
        let directions = (0..200).map(|k| Vector3::new((k as f64).cos(), (k as f64).sin(), 0.01 * k as f64 - 1.0));
        directions.map(|n| support.correction(&n.normalize())[0].abs()).fold(0.0, f64::max)
    }

    #[test]
    fn exact_boxes_and_none_leave_the_body_as_it_is() {
        for kind in BodyKind::ALL {
            let body = body(kind);
            let views = views(&body, 20, &NOT_TURNED());
            let seen = CorrectedSupport::new(&body, &views);
            assert_eq!(seen.edges.len(), 80);
            assert!(largest_correction(&seen) < 1e-9, "{kind:?}");
            let unseen = CorrectedSupport::new(&body, []);
            let along = unseen.along(&Vector3::x());
            assert_eq!((along.distance, largest_correction(&unseen)), (body.support(&Vector3::x()), 0.0));
            assert!((along.sd - DEVIATIONS[0] * body.half_extents.product().cbrt()).abs() < 1e-15);
        }
    }

    /// Boxes of a cuboid that an ellipsoid was fitted to: its faces are found, and are surer where they were seen.
    #[test]
    fn the_correction_finds_the_faces_of_another_body() {
        let truth = Body { rotation: Rotation3::from_euler_angles(0.0, 0.0, 0.4), ..body(BodyKind::Cuboid) };
        let fitted = Body { half_extents: truth.half_extents * 1.2, kind: BodyKind::Ellipsoid, ..truth };
        let views = views(&truth, 30, &NOT_TURNED());
        let support = CorrectedSupport::new(&fitted, &views);
        for k in 0..2 {
            let face: Vector3<f64> = truth.rotation.matrix().column(k).into();
            let (before, after) = (fitted.support(&face), support.along(&face));
            let expected = truth.half_extents[k];
            assert!((after.distance - expected).abs() < 0.5 * (before - expected).abs(), "{k}: {before} {after:?}");
            let between = Vector3::new(1.0, 0.0, 1.0).normalize();
            assert!(after.sd < 0.8 * support.along(&between).sd, "normals are level or vertical: cameras look level");
        }
    }

    #[test]
    fn hidden_and_cut_off_edges_and_wrong_boxes_say_nothing() {
        let fitted = body(BodyKind::Ellipsoid);
        let larger = fitted.scaled(1.1);
        let seen = views(&larger, 20, &NOT_TURNED());
        assert!(largest_correction(&CorrectedSupport::new(&fitted, &seen)) > 0.08);
        let open = |hidden: bool| {
            let open = |view: &View| View { occluded_edges: [hidden; 4], cut_off: [!hidden; 4], ..*view };
            seen.iter().map(open).collect::<Vec<View>>()
        };
        for views in [open(true), open(false)] {
            assert_eq!(largest_correction(&CorrectedSupport::new(&fitted, &views)), 0.0);
        }
        // Of a box twice as large no edge is left.
        let mut views = views(&fitted, 20, &NOT_TURNED());
        let wrong = project_bounding_box(&views[3].projection, &fitted.scaled(2.0)).unwrap();
        views[3].bounding_box = Some(wrong);
        let support = CorrectedSupport::new(&fitted, &views);
        assert_eq!((support.edges.len(), largest_correction(&support) < 1e-9), (76, true));
    }

    /// Tangent lines of ellipses count as edges of boxes do, but not those of parts.
    #[test]
    fn ellipses_have_tangent_lines() {
        let (fitted, larger) = (body(BodyKind::Ellipsoid), body(BodyKind::Ellipsoid).scaled(1.1));
        let outline = |view: View| View {
            ellipse: Some(project_ellipsoid(&view.projection, &larger.inscribed()).unwrap()),
            bounding_box: None,
            ..view
        };
        let seen: Vec<View> = views(&larger, 20, &NOT_TURNED()).into_iter().map(outline).collect();
        let support = CorrectedSupport::new(&fitted, &seen);
        assert_eq!(support.edges.len(), 160);
        assert!(support.edges.iter().all(|edge| edge.residual > 0.05 && edge.residual < 0.15));
        let parts: Vec<View> = seen.iter().map(|view| View { partial: true, ..*view }).collect();
        assert!(CorrectedSupport::new(&fitted, &parts).edges.is_empty());
    }

    /// The variance of residuals that are alike where directions are near, and of those that are not.
    #[test]
    fn what_near_edges_have_in_common_is_the_deviation() {
        let edge = |k: usize, residual: f64| {
            let angle = 0.05 * k as f64;
            Edge { direction: Vector3::new(angle.cos(), angle.sin(), 0.0), residual }
        };
        let common: Vec<Edge> = (0..120).map(|k| edge(k, 0.1 * (0.1 * k as f64).sin())).collect();
        let found = common_variance(&common).sqrt();
        assert!((0.05..0.1).contains(&found), "{found}");
        let alternating: Vec<Edge> = (0..120).map(|k| edge(k, if k % 2 == 0 { 0.1 } else { -0.1 })).collect();
        assert!(common_variance(&alternating).sqrt() < 0.02);
        assert_eq!(common_variance(&[]), 0.0);
    }

    proptest! {
        #![proptest_config(cases(32))]
        /// A turned world has the same correction, of the turned direction.
        #[test]
        fn the_correction_turns_with_the_world(a in -3.0..3.0f64, b in -1.5..1.5f64, c in -3.0..3.0f64) {
            let turn = Rotation3::from_euler_angles(a, b, c);
            let turned = |body: &Body| Body {
                center: turn * body.center,
                rotation: turn * body.rotation,
                ..*body
            };
            let (truth, fitted) = (body(BodyKind::Cuboid), body(BodyKind::Ellipsoid).scaled(1.2));
            let direction = Vector3::new(0.48, -0.6, 0.64);
            let (views_before, views_after) = (views(&truth, 9, &NOT_TURNED()), views(&turned(&truth), 9, &turn));
            let before = CorrectedSupport::new(&fitted, &views_before).along(&direction);
            let fitted = turned(&fitted);
            let after = CorrectedSupport::new(&fitted, &views_after).along(&(turn * direction));
            prop_assert!((before.distance - after.distance).abs() < 1e-9, "{before:?} {after:?}");
            prop_assert!((before.sd - after.sd).abs() < 1e-9);
        }
    }
}
