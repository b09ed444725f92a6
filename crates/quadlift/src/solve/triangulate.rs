//! Rough position and size of an object from the centers and sizes of its outlines: the frame in which the closed forms
//! are well conditioned, and the start of the iterations.

use nalgebra::{Point3, Vector2, Vector3};

use super::streaming_qr::StreamingQr;
use crate::geometry::{Ellipse, Projection};

/// Rounds of reweighting that convert the algebraic error to pixels.
const ROUNDS: usize = 3;

/// Below this share of their size, differences are rounding errors.
const ROUNDING: f64 = 1e-12;

/// The point whose images are nearest to the given pixels (linear triangulation, rows divided by the depth).
///
/// `None` if it is not determined: fewer than two views, all cameras at one point, parallel rays, or non-finite
/// numbers. If rays diverge, the point may lie behind the cameras.
pub fn triangulate(observations: &[(Projection, Vector2<f64>)]) -> Option<Point3<f64>> {
    // Relative to a camera center the numbers are of the size of the baselines, wherever the world's origin is.
    let origin = observations.first()?.0.center_in_world()?;
    let mut baseline = 0f64;
    for (projection, _) in observations {
        baseline = baseline.max((projection.center_in_world()? - origin).norm());
    }
    if baseline <= ROUNDING * origin.coords.norm() {
        return None;
    }
    let mut point = Vector3::zeros();
    for round in 0..ROUNDS {
        let mut all_rows = Vec::with_capacity(2 * observations.len());
        for (projection, pixel) in observations {
            let (m, moved) = (projection.m(), projection.matrix() * origin.to_homogeneous());
            let depth = if round == 0 { m.row(2).norm() } else { (m.row(2) * point)[0] + moved.z };
            let mut rows = [[0.0; 10]; 2];
            for (i, row) in rows.iter_mut().enumerate() {
                for j in 0..3 {
                    row[j] = (m[(i, j)] - pixel[i] * m[(2, j)]) / depth;
                }
                row[3] = (moved[i] - pixel[i] * moved.z) / depth;
            }
            all_rows.extend(rows);
        }
        let mut qr = StreamingQr::new();
        for rows in all_rows.chunks_mut(40) {
            qr.push_rows(rows);
        }
        let r = qr.r();
        // Parallel rays: the last pivot is the spread of their directions.
        if r[2][2].abs() <= ROUNDING * r[0][0].abs() {
            return None;
        }
        for i in (0..3).rev() {
            let known: f64 = (i + 1..3).map(|j| r[i][j] * point[j]).sum();
            point[i] = -(r[i][3] + known) / r[i][i];
        }
        if !point.iter().all(|x| x.is_finite()) {
            return None;
        }
    }
    Some(origin + point)
}

/// The radius of the sphere at `center` whose outlines have the size of the ellipses: the geometric mean over the
/// views of `sqrt(l1 l2) depth / focal length`, in world units. `None` when it is not positive and finite.
pub(crate) fn object_radius(observations: &[(Projection, Ellipse)], center: &Point3<f64>) -> Option<f64> {
    let log = |(projection, ellipse): &(Projection, Ellipse)| {
        let size = ellipse.semi_axes.product().sqrt();
        (size * projection.depth(center).abs() / projection.focal_length()).ln()
    };
    let mean = observations.iter().map(log).sum::<f64>() / observations.len() as f64;
    Some(mean.exp()).filter(|radius| radius.is_finite() && *radius > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{CamFromWorld, Ellipsoid, Intrinsics, project_ellipsoid};
    use nalgebra::{Matrix3x4, Rotation3};

    /// A camera at `center` whose axes are turned by `yaw` about y.
    fn camera(center: Vector3<f64>, yaw: f64) -> Projection {
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), -yaw);
        let mut pose = Matrix3x4::zeros();
        pose.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
        pose.set_column(3, &(rotation * -center));
        let intrinsics = Intrinsics::new(700.0, 720.0, 320.0, 240.0).unwrap();
        Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap())
    }

    fn see(cameras: &[Projection], point: &Point3<f64>) -> Vec<(Projection, Vector2<f64>)> {
        cameras.iter().map(|p| (*p, p.project_point(point).unwrap())).collect()
    }

    #[test]
    fn two_exact_views_give_the_point_wherever_the_origin_is() {
        for shift in [0.0, 1e3, 1e6] {
            let shift = Vector3::new(shift, -shift, 0.5 * shift);
            let point = Point3::new(0.3, -0.2, 9.0) + shift;
            let cameras = [camera(shift, 0.0), camera(shift + Vector3::new(1.0, 0.2, 0.0), -0.1)];
            let found = triangulate(&see(&cameras, &point)).unwrap();
            // An error of rounding in the camera's position, times distance over baseline, squared at the worst.
            assert!((found - point).norm() < 1e-12 + 1e-14 * shift.norm(), "{}", (found - point).norm());
        }
    }

    #[test]
    fn errors_are_weighed_in_pixels() {
        // The far camera must not outvote the near ones: compare with the minimum of the reprojection error, which
        // has a gradient of zero.
        let point = Point3::new(0.1, 0.2, 5.0);
        let cameras = [
            camera(Vector3::zeros(), 0.0),
            camera(Vector3::new(2.0, 0.0, 0.0), -0.3),
            camera(Vector3::new(-40.0, 0.0, -90.0), 0.3),
        ];
        let mut views = see(&cameras, &point);
        views[2].1 += Vector2::new(0.5, -0.4);
        views[0].1 += Vector2::new(0.2, 0.1);
        let found = triangulate(&views).unwrap();
        let cost = |x: &Point3<f64>| -> f64 {
            views.iter().map(|(p, pixel)| (p.project_point(x).unwrap() - pixel).norm_squared()).sum()
        };
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-3);
            assert!(cost(&found) < cost(&(found + step)) && cost(&found) < cost(&(found - step)));
        }
    }

    #[test]
    fn undetermined_points_are_refused() {
        let point = Point3::new(0.3, -0.2, 9.0);
        let center = Vector3::new(5.0, 1.0, -3.0);
        // Pure rotation, parallel rays, one view, no view, NaN.
        let turned: Vec<_> = [0.0, 0.1, -0.1].iter().map(|&yaw| camera(center, yaw)).collect();
        assert_eq!(triangulate(&see(&turned, &point)), None);
        let parallel: Vec<_> =
            (0..3).map(|i| (camera(Vector3::new(i as f64, 0.0, 0.0), 0.0), Vector2::new(320.0, 240.0))).collect();
        assert_eq!(triangulate(&parallel), None);
        assert_eq!(triangulate(&parallel[..1]), None);
        assert_eq!(triangulate(&[]), None);
        let mut broken = see(&[camera(center, 0.0), camera(Vector3::zeros(), 0.0)], &point);
        broken[0].1.x = f64::NAN;
        assert_eq!(triangulate(&broken), None);
    }

    #[test]
    fn the_radius_of_a_sphere_is_its_own() {
        let sphere = Ellipsoid {
            center: Point3::new(0.0, 0.0, 50.0),
            semi_axes: Vector3::repeat(0.5),
            rotation: Rotation3::identity(),
        };
        let cameras = [camera(Vector3::zeros(), 0.0), camera(Vector3::new(3.0, 0.0, 0.0), -0.05)];
        let views: Vec<_> = cameras.iter().map(|p| (*p, project_ellipsoid(p, &sphere).unwrap())).collect();
        let radius = object_radius(&views, &sphere.center).unwrap();
        assert!((radius - 0.5).abs() < 1e-3, "{radius}");
        assert_eq!(object_radius(&[], &sphere.center), None);
        assert_eq!(object_radius(&views, &Point3::new(f64::NAN, 0.0, 0.0)), None);
    }
}
