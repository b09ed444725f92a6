//! Residuals of cues: zero at the truth, their derivatives against differences.

use nalgebra::{Matrix3, Point3, Rotation3, SVector, Vector3};
use proptest::prelude::*;

use super::jacobian_tests::projection;
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::geometry::{Body, BodyKind, BoundingBox, CamFromWorld, Intrinsics, Projection, project_bounding_box};
use crate::scene::{Box3dCue, Cues, DepthCue, View};
use crate::solve::conditioning::ObjectFrame;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::residuals::measurements::Measurements;

const STEP: f64 = 1e-6;

fn frame() -> ObjectFrame {
    ObjectFrame { origin: Point3::new(0.1, 0.2, -0.1), unit: 0.8, axes: rotation(0.5, -0.2, 0.9) }
}

/// A view with a depth and the 3D box of a body with this center (world), half extents and rotation, all of them scaled.
fn view(center: Point3<f64>, half: Vector3<f64>, rotation: Matrix3<f64>, scale: f64) -> View {
    let projection = projection(0.4);
    let pose = projection.camera_pose().unwrap();
    let cam_from_world = pose.matrix().fixed_columns::<3>(0).into_owned();
    let box3d = Box3dCue {
        center: Some(Point3::from(pose.matrix() * center.to_homogeneous() * scale)),
        half_extents: Some(half * scale),
        rotation: Some(Rotation3::from_matrix_unchecked(cam_from_world * rotation)),
        ..Default::default()
    };
    let pixel = projection.project_point(&center).unwrap();
    let bounding_box = BoundingBox::new([pixel.x - 40.0, pixel.y - 30.0, pixel.x + 40.0, pixel.y + 30.0]).unwrap();
    let depth = DepthCue { median: 8.0 * scale, sd: None, source: None };
    let cues = Cues { depth: Some(depth), box3d: Some(box3d) };
    View { cues, ..View::from_box(projection, bounding_box) }
}

fn rows<B: BodyModel>(m: &Measurements, body: &B) -> (Vec<f64>, Vec<[f64; 9]>, Vec<NoiseGroup>) {
    let (mut all, mut rows) = (Vec::new(), Vec::new());
    for cue in &m.cues {
        cue.rows(body, &NoiseLevels::new(67.0), &mut rows);
        all.extend_from_slice(&rows);
    }
    let values = all.iter().map(|row| row.residual).collect();
    (values, all.iter().map(|row| row.row).collect(), all.iter().map(|row| row.group).collect())
}

fn check<B: BodyModel>(m: &Measurements, body: &B, accuracy: f64) {
    let (_, slopes, groups) = rows(m, body);
    assert_eq!(slopes.len(), 10);
    for k in 0..9 {
        let mut step = SVector::<f64, 9>::zeros();
        step[k] = STEP;
        let (plus, ..) = rows(m, &body.retract(&step).unwrap());
        let (minus, ..) = rows(m, &body.retract(&-step).unwrap());
        for (i, slope) in slopes.iter().enumerate() {
            let numeric = (plus[i] - minus[i]) / (2.0 * STEP);
            let scale = 1.0 + slope.iter().map(|x| x.abs()).fold(0.0, f64::max);
            let group = groups[i];
            assert!((numeric - slope[k]).abs() < accuracy * scale, "{group:?} {i} {k}: {numeric} {}", slope[k]);
        }
    }
}

fn rotation(a: f64, b: f64, c: f64) -> Matrix3<f64> {
    *Rotation3::from_euler_angles(a, b, c).matrix()
}

fn measured(turn: f64) -> View {
    view(Point3::new(0.2, 0.1, 0.3), Vector3::new(1.4, 0.7, 0.5), rotation(0.4, -0.3 + turn, 0.9), 1.1)
}

fn measurements(turn: f64) -> Measurements {
    Measurements::new(frame(), &[measured(turn)], true, false)
}

/// Direction of the ray along which a view measures its depth, in the frame.
fn ray_of(view: &View) -> Vector3<f64> {
    frame().direction_from_world(&view.projection.ray_in_world(&view.measured_box().unwrap().center()).unwrap())
}

proptest! {
    #[test]
    fn rows_of_an_ellipsoid(a in -3.0..3.0f64, b in -1.5..1.5f64, x in -0.5..0.5f64, l in 0.5..1.6f64) {
        let axes = Vector3::new(1.7 * l, 1.1, 0.6);
        let body = EllipsoidModel::from_axes(Vector3::new(x, -0.2, 0.1), rotation(a, b, 0.7), axes);
        check(&measurements(0.0), &body, 2e-6);
    }

    #[test]
    fn rows_of_oriented_bodies(a in -0.4..0.4f64, b in -0.4..0.4f64, x in -0.5..0.5f64, q in 1.1..2.0f64) {
        let axes = frame().axes.tr_mul(&rotation(0.4, -0.3, 0.9)) * rotation(a, b, 0.1);
        for form in [BodyKind::Cuboid, BodyKind::Cylinder, BodyKind::Superellipsoid(q)] {
            let body = OrientedModel::new(Vector3::new(x, -0.2, 0.1), axes, Vector3::new(1.2, 0.8, 0.6), form);
            // The near side has a kink where a component of the ray through the middle of the box vanishes.
            let ray = ray_of(&measured(0.0));
            prop_assume!(body.axes().tr_mul(&ray).abs().min() > 0.03);
            check(&measurements(0.0), &body, 2e-5);
        }
    }
}

/// Residuals at the body that was measured, with its scale in the logarithms.
#[test]
fn at_the_truth_only_the_scale_is_left() {
    let (center, half) = (Point3::new(0.2, 0.1, 0.3), Vector3::new(1.4, 0.7, 0.5));
    let axes = rotation(0.4, -0.3, 0.9);
    let turned_axes = frame().axes.tr_mul(&axes);
    let local = frame().point_from_world(&center);
    for scale in [1.0, 1.1] {
        let m = Measurements::new(frame(), &[view(center, half, axes, scale)], true, false);
        let noise = NoiseLevels::new(67.0);
        let expected = |group: NoiseGroup| match group {
            NoiseGroup::BoxDistance | NoiseGroup::BoxSize => scale.ln() / noise.of(group),
            _ => 0.0,
        };
        let check = |(values, _, groups): (Vec<f64>, Vec<[f64; 9]>, Vec<NoiseGroup>)| {
            for (value, group) in values.into_iter().zip(groups).filter(|(_, group)| *group != NoiseGroup::Depth) {
                assert!((value - expected(group)).abs() < 1e-9, "{group:?}: {value} {}", expected(group));
            }
        };
        check(rows(&m, &EllipsoidModel::from_axes(local, turned_axes, half / frame().unit)));
        check(rows(&m, &OrientedModel::new(local, turned_axes, half / frame().unit, BodyKind::Cuboid)));
        // The same body with its axes named in another order, one of them reversed.
        let [a, b, c] = [0, 1, 2].map(|k| turned_axes.column(k).into_owned());
        let other = Matrix3::from_columns(&[b, -a, c]);
        let turned = Vector3::new(half.y, half.x, half.z) / frame().unit;
        check(rows(&m, &OrientedModel::new(local, other, turned, BodyKind::Cuboid)));
    }
}

/// Seen from near, a cuboid's depth is that at which rays of the camera meet it, not that of parallel rays: here 22 % less.
#[test]
fn a_near_cuboid_is_seen_in_perspective() {
    let turned = Rotation3::from_euler_angles(0.0, 10f64.to_radians(), 0.0)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), 0.5 * std::f64::consts::PI);
    let half_extents = Vector3::new(2.0, 0.75, 0.85);
    let car = Body { kind: BodyKind::Cuboid, center: Point3::new(0.0, 0.9, 6.0), half_extents, rotation: turned };
    let intrinsics = Intrinsics::new(720.0, 720.0, 620.0, 190.0).unwrap();
    let at_origin = CamFromWorld::new(nalgebra::Matrix3x4::identity()).unwrap();
    let projection = Projection::from_camera(&intrinsics, &at_origin);
    let bounding_box = project_bounding_box(&projection, &car).unwrap();
    // Computed on its own, with a grid of 121 x 121 rays and slabs (numpy).
    let depth = DepthCue { median: 4.03, sd: None, source: None };
    let cues = Cues { depth: Some(depth), box3d: None };
    let view = View { cues, ..View::from_box(projection, bounding_box) };
    let mut m = Measurements::new(frame(), std::slice::from_ref(&view), true, false);
    let local = frame().point_from_world(&car.center);
    let body =
        OrientedModel::new(local, frame().axes.tr_mul(turned.matrix()), half_extents / frame().unit, BodyKind::Cuboid);
    let off = |m: &Measurements| rows(m, &body).0[0] * NoiseLevels::new(67.0).of(NoiseGroup::Depth);
    assert!((off(&m) + 0.226).abs() < 0.005, "{}", off(&m));
    m.look_at(&body, &car, &[view]);
    assert!(off(&m).abs() < 0.01, "{}", off(&m));
    // The slopes are those of the closed form.
    let one = |step: f64| {
        let mut by = SVector::<f64, 9>::zeros();
        by[2] = step;
        rows(&m, &body.retract(&by).unwrap()).0[0]
    };
    let slope = rows(&m, &body).1[0][2];
    assert!(((one(STEP) - one(-STEP)) / (2.0 * STEP) - slope).abs() < 1e-4 * slope.abs());
}

/// The near side against the median, or the mean, of the depths at which rays meet the body.
#[test]
fn the_near_side_is_where_rays_meet_the_body() {
    let axes = rotation(0.3, 0.5, -0.2);
    let sizes = Vector3::new(1.3, 0.8, 0.5);
    let ray = Vector3::new(0.5, -0.3, 1.0).normalize();
    let [e1, e2] = crate::geometry::rotation::horizontal_basis(&ray);
    let local = axes.transpose();
    // Depths below the center at which parallel rays meet the body: inside(x) in units of the semi-axes.
    let depths = |inside: &dyn Fn(Vector3<f64>) -> bool| -> Vec<f64> {
        let mut depths = Vec::new();
        for i in -60..=60 {
            for j in -60..=60 {
                let across = e1 * (f64::from(i) / 40.0) + e2 * (f64::from(j) / 40.0);
                let at = |t: f64| (local * (across + ray * t)).component_div(&sizes);
                let first = (0..400).map(|k| -2.0 + f64::from(k) * 0.01).find(|t| inside(at(*t)));
                depths.extend(first.map(|t| -t));
            }
        }
        depths.sort_by(f64::total_cmp);
        depths
    };
    let mean = |depths: &[f64]| depths.iter().sum::<f64>() / depths.len() as f64;
    let near = |form| OrientedModel::new(Vector3::zeros(), axes, sizes, form).near_side(&ray).0;
    let round = depths(&|x| x.norm() < 1.0);
    let ellipsoid = EllipsoidModel::from_axes(Vector3::zeros(), axes, sizes).near_side(&ray).0;
    assert!((ellipsoid - round[round.len() / 2]).abs() < 0.02, "{ellipsoid} {}", round[round.len() / 2]);
    assert!((near(BodyKind::Superellipsoid(2.0)) - ellipsoid).abs() < 1e-12);
    let cuboid = mean(&depths(&|x| x.amax() < 1.0));
    assert!((near(BodyKind::Cuboid) - cuboid).abs() < 0.02, "{} {cuboid}", near(BodyKind::Cuboid));
    let cylinder = mean(&depths(&|x| x.xy().norm() < 1.0 && x.z.abs() < 1.0));
    assert!((near(BodyKind::Cylinder) - cylinder).abs() < 0.02, "{} {cylinder}", near(BodyKind::Cylinder));
}
