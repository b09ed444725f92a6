//! The cameras: on a sphere around the objects, looking at its centre.

use nalgebra::{Matrix3, Matrix3x4, Vector3};

use super::options::{SyntheticOptions, Trajectory};
use crate::geometry::{CamFromWorld, CameraError, Intrinsics};

/// Image size in pixels.
pub(super) const IMAGE_SIZE: [u32; 2] = [1280, 960];

/// The intrinsics of every camera: focal length 1500 pixels, the principal point in the middle of the image.
pub(super) const INTRINSICS: Intrinsics =
    Intrinsics { fx: 1500.0, fy: 1500.0, cx: 0.5 * IMAGE_SIZE[0] as f64, cy: 0.5 * IMAGE_SIZE[1] as f64 };

/// The rotation `cam_from_world` of each view, in order.
pub(super) fn rotations(options: &SyntheticOptions) -> Vec<Matrix3<f64>> {
    let last = options.views.saturating_sub(1).max(1) as f64;
    (0..options.views)
        .map(|view| {
            let s = view as f64 / last;
            let (azimuth, elevation) = match options.trajectory {
                Trajectory::Paper { azimuth, elevation } => (s * azimuth, s * elevation),
                Trajectory::Arc { span } => (s * span, 20.0 + s * 20.0 * span / 90.0),
            };
            look(azimuth.to_radians(), elevation.to_radians())
        })
        .collect()
}

/// The pose of a camera with the given rotation that sees the origin straight ahead at `distance`, after the world
/// has been moved by `offset`.
pub(super) fn pose(rotation: &Matrix3<f64>, distance: f64, offset: &Vector3<f64>) -> Result<CamFromWorld, CameraError> {
    let translation = Vector3::new(0.0, 0.0, distance) - rotation * offset;
    let mut matrix = Matrix3x4::zeros();
    matrix.fixed_columns_mut::<3>(0).copy_from(rotation);
    matrix.set_column(3, &translation);
    CamFromWorld::new(matrix)
}

/// The rotation of a camera that looks at the origin from the given azimuth and elevation (radians): z up in the
/// world, y down in the image.
fn look(azimuth: f64, elevation: f64) -> Matrix3<f64> {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.sin_cos(), elevation.sin_cos());
    let forward = -Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
    // Horizontal, hence defined even straight above the origin.
    let right = Vector3::new(-sin_a, cos_a, 0.0);
    Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Projection;
    use nalgebra::{Point3, Vector2};

    fn projections(trajectory: Trajectory, views: usize) -> Vec<Projection> {
        let options = SyntheticOptions { trajectory, views, ..Default::default() };
        let pose = |r| pose(r, options.distance, &Vector3::zeros()).unwrap();
        rotations(&options).iter().map(|r| Projection::from_camera(&INTRINSICS, &pose(r))).collect()
    }

    fn on_sphere(azimuth: f64, elevation: f64) -> Point3<f64> {
        let (a, e) = (f64::to_radians(azimuth), f64::to_radians(elevation));
        Point3::new(200.0 * e.cos() * a.cos(), 200.0 * e.cos() * a.sin(), 200.0 * e.sin())
    }

    #[test]
    fn cameras_stand_on_the_trajectory_and_look_at_the_origin_upright() {
        let arc = Trajectory::Arc { span: 90.0 };
        for (trajectory, view, expected) in [
            (Trajectory::default(), 0, on_sphere(0.0, 0.0)),
            (Trajectory::default(), 5, on_sphere(30.0, 35.0)),
            (Trajectory::default(), 10, on_sphere(60.0, 70.0)),
            (arc, 0, on_sphere(0.0, 20.0)),
            (arc, 10, on_sphere(90.0, 40.0)),
        ] {
            let camera = projections(trajectory, 11)[view];
            assert!((camera.center_in_world().unwrap() - expected).norm() < 1e-9);
            assert!((camera.project_point(&Point3::origin()).unwrap() - Vector2::new(640.0, 480.0)).norm() < 1e-9);
            let above = camera.project_point(&Point3::new(0.0, 0.0, 1.0)).unwrap();
            assert!((above.x - 640.0).abs() < 1e-9 && above.y < 479.0);
        }
    }

    #[test]
    fn one_view_and_the_zenith_are_no_special_cases() {
        assert_eq!(projections(Trajectory::default(), 1).len(), 1);
        let above = projections(Trajectory::Paper { azimuth: 0.0, elevation: 90.0 }, 2)[1];
        assert!((above.center_in_world().unwrap() - Point3::new(0.0, 0.0, 200.0)).norm() < 1e-9);
    }
}
