//! Test scenes for the closed forms, and the dense solution that they are compared with.
// The benchmarks use a part of it, and are not test code to clippy.
#![allow(dead_code, clippy::unwrap_used)]

use nalgebra::{DMatrix, Matrix3, Matrix3x4, Matrix4, Point3, Rotation3, SVector, Vector2, Vector3, Vector6};
use quadlift::geometry::{CamFromWorld, Ellipse, Ellipsoid, Intrinsics, Projection, project_ellipsoid, vech3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(crate) type Vech = SVector<f64, 10>;
pub(crate) type Views = Vec<(Projection, Ellipse)>;

/// A camera at `center` that looks at `target` (z up): f = 1500 px, principal point (640, 480).
pub(crate) fn camera(center: &Vector3<f64>, target: &Vector3<f64>) -> Projection {
    let z = (target - center).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let rotation = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
    let mut pose = Matrix3x4::zeros();
    pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    pose.set_column(3, &(-rotation * center));
    let intrinsics = Intrinsics::new(1500.0, 1500.0, 640.0, 480.0).unwrap();
    Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap())
}

/// Camera centers at distance 200 from the origin, on the arc of the paper's synthetic set-up, `span` times as long.
pub(crate) fn arc(count: usize, span: f64) -> Vec<Vector3<f64>> {
    let point = |f: usize| {
        let s = span * f as f64 / (count - 1) as f64;
        let (azimuth, elevation) = (60f64.to_radians() * s, 70f64.to_radians() * s);
        Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()) * 200.0
    };
    (0..count).map(point).collect()
}

/// An ellipsoid of the paper's synthetic set-up: in a cube of side 20, longest axis 3 to 12.
pub(crate) fn random_ellipsoid(rng: &mut ChaCha8Rng) -> Ellipsoid {
    let longest = 0.5 * rng.random_range(3.0..12.0);
    let mut angle = || rng.random_range(-3.0..3.0);
    let rotation = Rotation3::from_euler_angles(angle(), angle(), angle());
    Ellipsoid {
        center: Point3::from(Vector3::from_fn(|_, _| rng.random_range(-10.0..10.0))),
        semi_axes: Vector3::new(1.0, rng.random_range(0.3..1.0), rng.random_range(0.3..1.0)) * longest,
        rotation,
    }
}

/// The outline of an ellipsoid with its center moved by up to `noise` of the mean semi-axis, its size by the factor
/// `1 +- noise`.
pub(crate) fn observe(
    projection: Projection,
    body: &Ellipsoid,
    noise: f64,
    rng: &mut ChaCha8Rng,
) -> (Projection, Ellipse) {
    let ellipse = project_ellipsoid(&projection, body).unwrap();
    let mut draw = || if noise > 0.0 { rng.random_range(-noise..noise) } else { 0.0 };
    let center = ellipse.center() + ellipse.semi_axes().mean() * Vector2::new(draw(), draw());
    let semi_axes = ellipse.semi_axes() * (1.0 + draw());
    (projection, Ellipse::new(center, semi_axes, ellipse.angle()).unwrap())
}

/// A random ellipsoid seen from the paper's arc.
pub(crate) fn scene(count: usize, noise: f64, seed: u64) -> (Views, Ellipsoid) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let body = random_ellipsoid(&mut rng);
    let see = |center: &Vector3<f64>| observe(camera(center, &Vector3::zeros()), &body, noise, &mut rng);
    (arc(count, 1.0).iter().map(see).collect(), body)
}

/// The same observations in well-scaled coordinates: each ellipse becomes the unit circle, the object has the center
/// `t` (nearly) and the radius 1, its depth is 1.
pub(crate) fn normalized(views: &Views, t: &Vector3<f64>, radius: f64) -> Views {
    let circle = Ellipse::new(Vector2::zeros(), Vector2::repeat(1.0), 0.0).unwrap();
    let normalize = |(projection, ellipse): &(Projection, Ellipse)| {
        let inverse = ellipse.shape().cholesky().unwrap().l().try_inverse().unwrap();
        let mut h = Matrix3::identity();
        h.fixed_view_mut::<2, 2>(0, 0).copy_from(&inverse);
        h.fixed_view_mut::<2, 1>(0, 2).copy_from(&(-inverse * ellipse.center()));
        let mut p = h * projection.matrix();
        let moved = p.fixed_columns::<3>(0) * t + p.column(3);
        p.set_column(3, &moved);
        for j in 0..3 {
            let column = p.column(j) * radius;
            p.set_column(j, &column);
        }
        (Projection::from_matrix(p / p[(2, 3)]).unwrap(), circle)
    };
    views.iter().map(normalize).collect()
}

/// The lower triangle of a symmetric matrix, by columns.
pub(crate) fn vech4(m: &Matrix4<f64>) -> Vech {
    let column = |j: usize| (j..4).map(move |i| m[(i, j)]);
    Vech::from_iterator((0..4).flat_map(column))
}

/// `vech(P Q P^T)` of the quadric with this `vech`.
pub(crate) fn projected(projection: &Projection, v: &Vech) -> Vector6<f64> {
    let p = projection.matrix();
    let mut q = Matrix4::zeros();
    let lower = (0..4).flat_map(|j| (j..4).map(move |i| (i, j)));
    for ((i, j), x) in lower.zip(v.iter()) {
        (q[(i, j)], q[(j, i)]) = (*x, *x);
    }
    vech3(&(p * q * p.transpose()))
}

/// The dual conic of an ellipse, scaled so that its last entry is -1.
pub(crate) fn dual_conic(ellipse: &Ellipse) -> Matrix3<f64> {
    let c = ellipse.center();
    let mut dual = Matrix3::identity() * -1.0;
    dual.fixed_view_mut::<2, 2>(0, 0).copy_from(&(ellipse.shape() - c * c.transpose()));
    dual.fixed_view_mut::<2, 1>(0, 2).copy_from(&-c);
    dual.fixed_view_mut::<1, 2>(2, 0).copy_from(&-c.transpose());
    dual
}

/// The paper's dense M (6F x (10 + F)).
pub(crate) fn dense_system(views: &[(Projection, Ellipse)]) -> DMatrix<f64> {
    let count = views.len();
    let mut m = DMatrix::<f64>::zeros(6 * count, 10 + count);
    for (f, (projection, ellipse)) in views.iter().enumerate() {
        let c = vech3(&dual_conic(ellipse));
        for j in 0..10 {
            m.view_mut((6 * f, j), (6, 1)).copy_from(&projected(projection, &Vech::ith(j, 1.0)));
        }
        m.view_mut((6 * f, 10 + f), (6, 1)).copy_from(&-c);
    }
    m
}

/// The paper's own computation: the last right singular vector of the dense M and its singular value.
pub(crate) fn dense_pfd(views: &[(Projection, Ellipse)]) -> (Vec<f64>, f64) {
    let svd = dense_system(views).svd(false, true);
    let last = svd.singular_values.len() - 1;
    (svd.v_t.unwrap().row(last).iter().copied().collect(), svd.singular_values[last])
}
