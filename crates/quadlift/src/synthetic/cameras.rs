//! The cameras: on a sphere around the objects, anywhere above them, or on a street.

use nalgebra::{Matrix3, Matrix3x4, Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::options::{SyntheticOptions, Trajectory};
use crate::geometry::{CamFromWorld, CameraError, Intrinsics};
use crate::random;

/// Image size in pixels: that of KITTI on a street.
pub(super) fn image_size(trajectory: Trajectory) -> [u32; 2] {
    if trajectory == Trajectory::Street { [1242, 375] } else { [1280, 960] }
}

/// The intrinsics of every camera, the principal point in the middle of the image: focal length 1500 pixels, less among
/// the objects.
pub(super) fn intrinsics(trajectory: Trajectory) -> Intrinsics {
    let [width, height] = image_size(trajectory).map(f64::from);
    let focal = match trajectory {
        Trajectory::Random => 900.0,
        Trajectory::Street => 720.0,
        _ => 1500.0,
    };
    Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * height }
}

/// A camera in the world before scaling and translation: the two parts of `cam_from_world`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

impl Pose {
    /// The camera in a world multiplied by `scale` and then moved by `offset`.
    pub(super) fn cam_from_world(&self, scale: f64, offset: &Vector3<f64>) -> Result<CamFromWorld, CameraError> {
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(&self.rotation);
        matrix.set_column(3, &(self.translation * scale - self.rotation * offset));
        CamFromWorld::new(matrix)
    }

    /// The camera rotated about its center by a small random rotation: normal angles about each axis, in radians.
    pub(super) fn with_noise(&self, sd: f64, rng: &mut ChaCha8Rng) -> Self {
        let turn = Rotation3::new(Vector3::from_fn(|_, _| sd * random::normal(rng)));
        Self { rotation: turn * self.rotation, translation: turn * self.translation }
    }

    fn at(center: Vector3<f64>, rotation: Matrix3<f64>) -> Self {
        Self { rotation, translation: -rotation * center }
    }
}

/// The cameras of all views, in order; only random trajectories use random numbers.
pub(super) fn poses(options: &SyntheticOptions, rng: &mut ChaCha8Rng) -> Vec<Pose> {
    let last = options.views.saturating_sub(1).max(1) as f64;
    let at_distance = Vector3::new(0.0, 0.0, options.distance);
    (0..options.views)
        .map(|view| {
            let s = view as f64 / last;
            let (azimuth, elevation) = match options.trajectory {
                Trajectory::Paper { azimuth, elevation } => (s * azimuth, s * elevation),
                Trajectory::Arc { span } => (s * span, 20.0 + s * 20.0 * span / 90.0),
                Trajectory::Orbit => {
                    let azimuth = 360.0 * view as f64 / options.views as f64;
                    (azimuth, 35.0 + 15.0 * (7.0 * azimuth.to_radians()).sin())
                }
                Trajectory::Random => return above_the_floor(options.cube_side, rng),
                Trajectory::Street => return on_the_street(view),
            };
            Pose { rotation: look(azimuth.to_radians(), elevation.to_radians()), translation: at_distance }
        })
        .collect()
}

/// A camera anywhere above the floor that looks at a point on it.
fn above_the_floor(side: f64, rng: &mut ChaCha8Rng) -> Pose {
    let mut within = |low: f64, high: f64| rng.random_range(low..high) * side;
    let center = Vector3::new(within(-0.8, 0.8), within(-0.8, 0.8), within(0.1, 0.5));
    let target = Vector3::new(within(-0.35, 0.35), within(-0.35, 0.35), 0.0);
    let back = center - target;
    Pose::at(center, look(back.y.atan2(back.x), back.z.atan2(back.xy().norm())))
}

/// A camera in a car that sways slightly while driving along x, 1.65 above the ground.
fn on_the_street(view: usize) -> Pose {
    let along = view as f64;
    let center = Vector3::new(along, 0.3 * (along / 30.0).sin(), 1.65);
    // It looks the way it drives: from behind itself at the origin of `look`.
    Pose::at(center, look(std::f64::consts::PI + 0.05 * (along / 50.0).sin(), 0.0))
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
        let poses = poses(&options, &mut random::stream(3, 0));
        let projection = |pose: &Pose| {
            let cam_from_world = pose.cam_from_world(1.0, &Vector3::zeros()).unwrap();
            Projection::from_camera(&intrinsics(trajectory), &cam_from_world)
        };
        poses.iter().map(projection).collect()
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

    #[test]
    fn free_cameras_see_the_floor_or_the_street_ahead() {
        for camera in projections(Trajectory::Random, 50) {
            let center = camera.center_in_world().unwrap();
            assert!(center.x.abs() <= 16.0 && center.y.abs() <= 16.0 && (2.0..=10.0).contains(&center.z));
            let ray = camera.ray_in_world(&Vector2::new(640.0, 480.0)).unwrap();
            let floor = center - ray * (center.z / ray.z);
            assert!(ray.z < 0.0 && floor.x.abs() <= 7.0 + 1e-9 && floor.y.abs() <= 7.0 + 1e-9);
        }
        for (view, camera) in projections(Trajectory::Street, 50).iter().enumerate() {
            let center = camera.center_in_world().unwrap();
            assert!((center.x - view as f64).abs() < 1e-9 && (center.z - 1.65).abs() < 1e-9);
            let ahead = camera.project_point(&Point3::new(center.x + 20.0, center.y, 1.65)).unwrap();
            assert!((ahead.x - 621.0).abs() < 40.0 && (ahead.y - 187.5).abs() < 1e-6);
            // Left of the street is left in the image.
            assert!(camera.project_point(&Point3::new(center.x + 20.0, 5.0, 1.65)).unwrap().x < ahead.x);
        }
    }

    #[test]
    fn noise_turns_cameras_about_their_centers() {
        let options = SyntheticOptions { trajectory: Trajectory::Random, views: 1, ..Default::default() };
        let mut rng = random::stream(4, 0);
        let exact = poses(&options, &mut rng)[0];
        let center = |pose: &Pose| -pose.rotation.transpose() * pose.translation;
        let mut squares = 0.0;
        for _ in 0..2000 {
            let noisy = exact.with_noise(0.01, &mut rng);
            assert!((center(&noisy) - center(&exact)).norm() < 1e-9);
            let turn = Rotation3::from_matrix_unchecked(noisy.rotation * exact.rotation.transpose());
            squares += turn.scaled_axis().norm_squared() / 2000.0;
        }
        // Three angles; the standard error of the mean square is 1.8 %.
        assert!((squares / (3.0 * 0.01 * 0.01) - 1.0).abs() < 0.08, "{squares}");
    }
}
