//! Every analytic derivative against central differences.

use nalgebra::{Matrix3, Matrix3x4, Point3, Rotation3, SVector, Vector2, Vector3};
use proptest::prelude::*;

use super::objective::Objective;
use super::prior::{LearnedSize, ObjectPrior};
use super::size_site::{Matrix6, ShapeInformation, SizeSite, Vector6};
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::geometry::{BodyKind, BoundingBox, CamFromWorld, Ellipse, Intrinsics, Projection};
use crate::optimize::normal_equations::NormalEquations;
use crate::scene::View;
use crate::solve::conditioning::ObjectFrame;
use crate::solve::noise_model::NoiseModel;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::residuals::measurements::{Measurements, Plane};
use crate::solve::posterior::residuals::view_rows::view_rows;
use crate::solve::posterior::shared::size_model::SizeDistribution;

const STEP: f64 = 1e-6;

pub(super) fn projection(azimuth: f64) -> Projection {
    let r = Rotation3::from_euler_angles(1.3, azimuth, 0.2);
    let mut pose = Matrix3x4::zeros();
    pose.fixed_columns_mut::<3>(0).copy_from(r.matrix());
    pose.set_column(3, &Vector3::new(0.3, -0.2, 9.0));
    let intrinsics = Intrinsics::new(700.0, 720.0, 320.0, 240.0).unwrap();
    Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap())
}

fn view(azimuth: f64, ellipse: Option<Ellipse>, bounding_box: Option<[f64; 4]>) -> View {
    View {
        frame_index: 0,
        projection: projection(azimuth),
        image_size: Some(Vector2::new(640.0, 480.0)),
        box_in_image: None,
        tangent_lines: None,
        partial: false,
        bounding_box: bounding_box.map(|b| BoundingBox::new(b).unwrap()),
        ellipse,
        occluded_edges: [false; 4],
        cut_off: [false; 4],
        cues: Default::default(),
        depth_scale: crate::scene::DepthScale::Source,
        depth_shift: 0.0,
    }
}

fn measurements(ellipses_as_planes: bool) -> Measurements {
    let frame = ObjectFrame { origin: Point3::new(0.1, 0.2, -0.1), unit: 0.8, axes: rotation(0.5, -0.2, 0.9) };
    let ellipse = Ellipse::new(Vector2::new(340.0, 220.0), Vector2::new(90.0, 50.0), 0.4).unwrap();
    let views = [
        view(0.2, None, Some([250.0, 160.0, 420.0, 300.0])),
        view(0.9, None, Some([1.0, 150.0, 400.0, 310.0])),
        view(-0.4, Some(ellipse), None),
    ];
    Measurements::new(frame, &views, ellipses_as_planes, false)
}

/// Whitened residuals of all views; one-sided edges that agree are left out on both sides of a difference.
fn residuals<B: BodyModel>(m: &Measurements, body: &B, smooth: bool) -> (Vec<f64>, Vec<[f64; 9]>) {
    let (mut values, mut slopes, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for index in 0..m.views.len() {
        view_rows(m, index, body, &NoiseLevels::new(67.0), smooth, &mut rows);
        values.extend(rows.iter().map(|r| r.residual));
        slopes.extend(rows.iter().map(|r| r.row));
    }
    (values, slopes)
}

fn check_rows<B: BodyModel>(m: &Measurements, body: &B) {
    check_rows_in_form(m, body, false);
    check_rows_in_form(m, body, true);
}

fn check_rows_in_form<B: BodyModel>(m: &Measurements, body: &B, smooth: bool) {
    let (_, slopes) = residuals(m, body, smooth);
    for k in 0..9 {
        let mut step = SVector::<f64, 9>::zeros();
        step[k] = STEP;
        let (plus, _) = residuals(m, &body.retract(&step).unwrap(), smooth);
        let (minus, _) = residuals(m, &body.retract(&-step).unwrap(), smooth);
        assert_eq!(plus.len(), slopes.len());
        for (i, slope) in slopes.iter().enumerate() {
            let numeric = (plus[i] - minus[i]) / (2.0 * STEP);
            let scale = 1.0 + slope.iter().map(|x| x.abs()).fold(0.0, f64::max);
            assert!((numeric - slope[k]).abs() < 2e-6 * scale, "row {i} parameter {k}: {numeric} {}", slope[k]);
        }
    }
}

/// The gradient of an objective against differences of its cost, to this accuracy.
fn check_gradient<B: BodyModel>(objective: &Objective, body: &B, accuracy: f64) {
    let gradient = objective.linearize(body).unwrap().gradient() * 2.0;
    for k in 0..9 {
        let mut step = SVector::<f64, 9>::zeros();
        step[k] = STEP;
        let cost = |step| objective.linearize(&body.retract(&step).unwrap()).unwrap().cost;
        let numeric = (cost(step) - cost(-step)) / (2.0 * STEP);
        assert!((numeric - gradient[k]).abs() < accuracy, "parameter {k}: {numeric} {}", gradient[k]);
    }
}

/// The gradient of the cost of all views, 2 J^T W r, against differences of the cost: with heavy tails, with views that
/// may be outliers, and with edges that count less than ellipses.
fn check_loss(m: &Measurements, body: &EllipsoidModel, noise: &NoiseLevels, outlier_scale: Option<f64>) {
    let prior = ObjectPrior::default();
    let heavy_tails = true;
    let objective =
        Objective { measurements: m, prior: &prior, ground: None, noise, heavy_tails, outlier_scale, smooth: true };
    let here = objective.linearize(body).unwrap();
    check_gradient(&objective, body, 1e-4 * (here.gradient().amax() + 1e-3 * here.cost));
}

/// The gradient of the priors' cost, 2 J^T r, against differences of the cost.
fn check_priors<B: BodyModel>(prior: &ObjectPrior, body: &B) {
    let m = Measurements::new(
        ObjectFrame { origin: Point3::origin(), unit: 1.0, axes: Matrix3::identity() },
        &[],
        false,
        false,
    );
    let noise = NoiseLevels::new(67.0);
    let objective = Objective {
        measurements: &m,
        prior,
        ground: Some((Plane { n: Vector3::y(), d: 0.7 }, 5.0)),
        noise: &noise,
        heavy_tails: false,
        outlier_scale: None,
        smooth: false,
    };
    let here = objective.linearize(body).unwrap();
    check_gradient(&objective, body, 1e-5 * (1.0 + here.cost));
}

fn prior(up: Vector3<f64>) -> ObjectPrior {
    ObjectPrior {
        shape_weight: 2.0,
        log_size: Some([(0.3, 9.0), (-0.2, 7.0), (0.1, 11.0)]),
        up: Some(up.normalize()),
        upright_weight: 20.0,
        on_ground: true,
        axes_are_named: true,
        ..Default::default()
    }
}

/// A learned size in the place of that of the category: of an oriented body, and of an ellipsoid.
fn learned(up: Vector3<f64>, ellipsoid: bool) -> ObjectPrior {
    let prior = ObjectPrior { log_size: None, shape_weight: 0.0, ..prior(up) };
    let covariance = Matrix3::new(0.02, 0.01, 0.0, 0.01, 0.03, -0.01, 0.0, -0.01, 0.04);
    let size = SizeDistribution { mean: Vector3::new(0.4, 0.0, -0.3), covariance, dof: 8.0, named: false };
    if !ellipsoid {
        return ObjectPrior { learned_size: LearnedSize::new(&size, None, 0.6), ..prior };
    }
    let (information, axes) = (Matrix6::identity() * 20.0, rotation(0.3, 0.2, -0.4));
    let told = ShapeInformation { axes, information, vector: Vector6::new(0.5, 0.1, -0.2, 0.1, 0.0, 0.2) * 20.0 };
    ObjectPrior { size_site: SizeSite::new(&told, &size, None, 2.5, 0.7, 1), ..prior }
}

fn rotation(a: f64, b: f64, c: f64) -> Matrix3<f64> {
    *Rotation3::from_euler_angles(a, b, c).matrix()
}

proptest! {
    #[test]
    fn rows_of_an_ellipsoid(a in -3.0..3.0f64, b in -1.5..1.5f64, x in -0.5..0.5f64, l in 0.5..1.6f64) {
        let axes = Vector3::new(1.7 * l, 1.1, 0.6);
        let body = EllipsoidModel::from_axes(Vector3::new(x, -0.2, 0.1), rotation(a, b, 0.7), axes);
        check_rows(&measurements(false), &body);
        check_rows(&measurements(true), &body);
    }

    #[test]
    fn rows_of_a_cylinder(a in -3.0..3.0f64, b in -1.5..1.5f64, x in -0.5..0.5f64, c in 0.3..2.0f64) {
        let body =
            OrientedModel::new(Vector3::new(x, 0.1, 0.2), rotation(a, b, 0.3), Vector3::new(1.2, 0.8, c), BodyKind::Cylinder);
        // At a rim, and at the axis, the support function has a kink.
        let smooth = |edge: &crate::solve::posterior::residuals::measurements::Edge| {
            let u = body.axes().tr_mul(&edge.plane.n).normalize();
            u.z.abs() > 0.01 && u.xy().norm() > 0.02
        };
        prop_assume!(measurements(true).edges.iter().all(smooth));
        check_rows(&measurements(true), &body);
    }

    #[test]
    fn rows_of_a_superellipsoid(a in -3.0..3.0f64, b in -1.5..1.5f64, x in -0.5..0.5f64, q in 1.2..2.0f64) {
        let body = OrientedModel::new(Vector3::new(x, 0.1, 0.2), rotation(a, b, 0.3), Vector3::new(1.2, 0.8, 0.6), BodyKind::Superellipsoid(q));
        // Where a component of R^T n vanishes the curvature of the support function has no bound, and differences tell
        // nothing.
        let smooth = |edge: &crate::solve::posterior::residuals::measurements::Edge| {
            (body.axes().tr_mul(&edge.plane.n)).normalize().abs().min() > 0.02
        };
        prop_assume!(measurements(true).edges.iter().all(smooth));
        check_rows(&measurements(true), &body);
    }

    #[test]
    fn robust_losses(
        a in -3.0..3.0f64, x in -0.5..0.5f64, edges in 0.0..0.9f64, ellipses in 0.0..0.9f64, scale in 1.0..30.0f64,
    ) {
        let body = EllipsoidModel::from_axes(Vector3::new(x, -0.2, 0.1), rotation(a, 0.4, 0.7), Vector3::new(1.7, 1.1, 0.6));
        let correlations = [("edge_correlation", edges), ("ellipse_correlation", ellipses), ("edge_noise", 0.1)];
        let noise = NoiseLevels::given(&NoiseModel::new(correlations).unwrap(), 67.0);
        let ellipse = Ellipse::new(Vector2::new(330.0, 225.0), Vector2::new(80.0, 60.0), -0.3).unwrap();
        let frame = ObjectFrame { origin: Point3::new(0.1, 0.2, -0.1), unit: 0.8, axes: rotation(0.5, -0.2, 0.9) };
        let views = [
            view(0.2, None, Some([250.0, 160.0, 420.0, 300.0])),
            view(0.7, Some(ellipse), Some([245.0, 165.0, 415.0, 290.0])),
            view(-0.4, Some(ellipse), None),
            view(1.1, Some(ellipse), Some([150.0, 165.0, 400.0, 390.0])),
        ];
        let m = Measurements::new(frame, &views, false, false);
        check_loss(&m, &body, &noise, None);
        check_loss(&m, &body, &noise, Some(scale));
    }

    #[test]
    fn priors_of_an_ellipsoid(a in -3.0..3.0f64, b in -1.5..1.5f64, up in -1.0..1.0f64) {
        let body = EllipsoidModel::from_axes(Vector3::new(0.1, 0.2, 0.3), rotation(a, b, 0.7), Vector3::new(1.7, 1.1, 0.6));
        let mut prior = prior(Vector3::new(up, 0.3, 0.8));
        prior.log_size = None;
        check_priors(&prior, &body);
    }

    #[test]
    fn priors_of_a_superellipsoid(a in -3.0..3.0f64, b in -1.5..1.5f64, up in -1.0..1.0f64) {
        let body = OrientedModel::new(Vector3::new(0.1, 0.2, 0.3), rotation(a, b, 0.7), Vector3::new(1.7, 1.1, 0.6), BodyKind::Superellipsoid(1.4));
        check_priors(&prior(Vector3::new(up, 0.3, 0.8)), &body);
    }
}

proptest! {
    #[test]
    fn learned_sizes(a in -3.0..3.0f64, b in -1.5..1.5f64, up in -1.0..1.0f64) {
        let (center, axes, up) = (Vector3::new(0.1, 0.2, 0.3), rotation(a, b, 0.7), Vector3::new(up, 0.3, 0.8));
        let sizes = Vector3::new(1.7, 1.1, 0.6);
        let prior = learned(up, false);
        prop_assert!(prior.learned_size.is_some());
        check_priors(&prior, &OrientedModel::new(center, axes, sizes, BodyKind::Cuboid));
        let prior = learned(up, true);
        prop_assert!(prior.size_site.is_some());
        check_priors(&prior, &EllipsoidModel::from_axes(center, axes, sizes));
    }
}

#[test]
fn rows_of_a_sphere_and_of_a_cuboid_away_from_its_kinks() {
    let sphere = EllipsoidModel::from_axes(Vector3::new(0.1, 0.0, 0.2), Matrix3::identity(), Vector3::repeat(0.9));
    check_rows(&measurements(false), &sphere);
    let cuboid = OrientedModel::new(
        Vector3::new(0.1, 0.1, 0.2),
        rotation(0.5, 0.3, 0.9),
        Vector3::new(1.2, 0.8, 0.6),
        BodyKind::Superellipsoid(1.0),
    );
    check_rows(&measurements(true), &cuboid);
}

/// The deviation of 1/2 log A from its mean, in a basis that does not move.
fn shape_deviation(body: &EllipsoidModel, basis: &Matrix3<f64>) -> Matrix3<f64> {
    let log = body.semi_axes().map(f64::ln);
    let deviation = Matrix3::from_diagonal(&log.add_scalar(-log.mean()));
    let turn = basis.transpose() * body.axes();
    turn * deviation * turn.transpose()
}

#[test]
fn the_shape_prior_of_an_ellipsoid_has_the_curvature_of_its_matrix_logarithm() {
    let weight = 2.0;
    for axes in [Vector3::new(1.7, 1.1, 0.6), Vector3::new(1.0, 1.0, 0.9), Vector3::repeat(0.8)] {
        let body = EllipsoidModel::from_axes(Vector3::zeros(), rotation(0.5, -0.3, 0.9), axes);
        let slopes: Vec<Matrix3<f64>> = (0..9)
            .map(|k| {
                let mut step = SVector::<f64, 9>::zeros();
                step[k] = STEP;
                let moved = |step| shape_deviation(&body.retract(&step).unwrap(), body.axes());
                (moved(step) - moved(-step)) / (2.0 * STEP)
            })
            .collect();
        let mut equations = NormalEquations::zero();
        body.add_shape_prior(weight, &mut equations);
        let squares = shape_deviation(&body, body.axes()).norm_squared();
        assert!((equations.cost - weight * weight * squares).abs() < 1e-9);
        for i in 0..9 {
            for j in 0..9 {
                let (found, expected) = (equations.hessian()[(i, j)], weight * weight * slopes[i].dot(&slopes[j]));
                assert!((found - expected).abs() < 1e-6, "{axes:?} {i} {j}: {found} {expected}");
            }
        }
    }
}

#[test]
fn the_size_prior_of_an_ellipsoid_names_its_axes_by_up_and_length() {
    // Height along z, length along y: the prior's own values give no cost.
    let up = Vector3::z();
    let prior = ObjectPrior {
        log_size: Some([(2.0f64.ln(), 10.0), (1.0f64.ln(), 10.0), (0.5f64.ln(), 10.0)]),
        up: Some(up),
        ..Default::default()
    };
    let m = Measurements::new(
        ObjectFrame { origin: Point3::origin(), unit: 1.0, axes: Matrix3::identity() },
        &[],
        false,
        false,
    );
    let noise = NoiseLevels::new(67.0);
    let objective = Objective {
        measurements: &m,
        prior: &prior,
        ground: None,
        noise: &noise,
        heavy_tails: false,
        outlier_scale: None,
        smooth: false,
    };
    let body = EllipsoidModel::from_axes(Vector3::zeros(), Matrix3::identity(), Vector3::new(1.0, 2.0, 0.5));
    assert!(objective.linearize(&body).unwrap().cost < 1e-20);
    let wrong = EllipsoidModel::from_axes(Vector3::zeros(), Matrix3::identity(), Vector3::new(0.5, 2.0, 1.0));
    assert!(objective.linearize(&wrong).unwrap().cost > 10.0);
    check_priors(
        &prior,
        &EllipsoidModel::from_axes(Vector3::zeros(), rotation(0.1, 0.1, 0.3), Vector3::new(1.1, 2.1, 0.6)),
    );
}
