//! The cameras: on an arc around the objects, held by hand.

use nalgebra::{Matrix3, Matrix3x4, Point3, Vector3};
use quadlift::geometry::{CamFromWorld, CameraError, Intrinsics};
use quadlift::random::normal;
use quadlift::synthetic::SyntheticFrame;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::options::RenderOptions;

/// Focal length in widths of the image.
const FOCAL_LENGTH: f64 = 1.25;

/// Standard deviations of the azimuth (radians), of the point that is looked at (world units) and of the roll (radians).
const AZIMUTH_NOISE: f64 = 0.006;
const TARGET_NOISE: f64 = 0.08;
const ROLL_NOISE: f64 = 0.03;

/// Clutter keeps away from the cameras by this share of their distance from the objects.
const CLEARANCE: f64 = 0.3;

/// The way of the camera around the objects.
#[derive(Debug, Clone)]
pub(super) struct Path {
    middle: Point3<f64>,
    distance: f64,
    /// Azimuth at the start, and how far it goes (radians).
    azimuth: f64,
    arc: f64,
    /// Elevation at the start and at the end (radians).
    elevation: [f64; 2],
}

impl Path {
    /// Draws a way around objects within `radius` of their middle.
    pub(super) fn draw(rng: &mut ChaCha8Rng, middle: &Point3<f64>, radius: f64, arc: f64) -> Self {
        let azimuth = rng.random_range(0.0..std::f64::consts::TAU);
        let elevation = [0, 1].map(|_| rng.random_range(18.0..45.0f64).to_radians());
        // A single object fills a third of the image; several must have room.
        let distance = rng.random_range(5.0..7.0) * f64::max(1.0, 0.42 * radius);
        Self { middle: *middle, distance, azimuth, arc, elevation }
    }

    /// The place of the camera at `s` in [0, 1] of the way.
    fn position(&self, s: f64, azimuth_error: f64) -> Point3<f64> {
        let azimuth = self.azimuth + self.arc * s + azimuth_error;
        let sway = 0.05 * (std::f64::consts::TAU * s).sin();
        let elevation = self.elevation[0] + (self.elevation[1] - self.elevation[0]) * s + sway;
        let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.sin_cos(), elevation.sin_cos());
        self.middle + Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e) * self.distance
    }

    /// Whether a camera would come too near to something of this size.
    pub(super) fn comes_near(&self, center: &Point3<f64>, size: f64) -> bool {
        // As closely spaced as the clearance is wide.
        let steps = (2.0 * self.arc.abs() / CLEARANCE).clamp(1.0, 100.0).ceil() as usize;
        (0..=steps).any(|k| {
            let camera = self.position(k as f64 / steps as f64, 0.0);
            (camera.xy() - center.xy()).norm() < CLEARANCE * self.distance + size
        })
    }
}

/// The cameras of all views along a path.
pub(super) fn frames(
    options: &RenderOptions,
    path: &Path,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<SyntheticFrame>, CameraError> {
    let [width, height] = [options.width, options.height].map(f64::from);
    let intrinsics = Intrinsics::new(FOCAL_LENGTH * width, FOCAL_LENGTH * width, 0.5 * width, 0.5 * height)?;
    let last = options.views.saturating_sub(1).max(1) as f64;
    (0..options.views)
        .map(|view| {
            let position = path.position(view as f64 / last, AZIMUTH_NOISE * normal(rng));
            let target = path.middle + Vector3::from_fn(|_, _| TARGET_NOISE * normal(rng));
            let cam_from_world = look(&position, &target, ROLL_NOISE * normal(rng))?;
            let id = format!("{view:06}");
            Ok(SyntheticFrame { id, intrinsics, cam_from_world, width: options.width, height: options.height })
        })
        .collect()
}

/// The pose of a camera at `position` that looks at `target`, turned about its axis by `roll` radians from upright.
/// The two may not stand above each other.
pub(super) fn look(position: &Point3<f64>, target: &Point3<f64>, roll: f64) -> Result<CamFromWorld, CameraError> {
    let forward = (target - position).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let (sin, cos) = roll.sin_cos();
    let (x, y) = (right * cos + down * sin, down * cos - right * sin);
    let rotation = Matrix3::from_rows(&[x.transpose(), y.transpose(), forward.transpose()]);
    let mut matrix = Matrix3x4::zeros();
    matrix.fixed_columns_mut::<3>(0).copy_from(&rotation);
    matrix.set_column(3, &(-(rotation * position.coords)));
    CamFromWorld::new(matrix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::Projection;
    use quadlift::random::stream;

    #[test]
    fn cameras_look_at_the_target_upright() {
        let intrinsics = Intrinsics::new(600.0, 600.0, 240.0, 180.0).unwrap();
        let (position, target) = (Point3::new(3.0, -4.0, 2.0), Point3::new(0.1, 0.2, 0.5));
        let projection = Projection::from_camera(&intrinsics, &look(&position, &target, 0.0).unwrap());
        assert!((projection.center_in_world().unwrap() - position).norm() < 1e-12);
        let at = projection.project_point(&target).unwrap();
        assert!((at - nalgebra::Vector2::new(240.0, 180.0)).norm() < 1e-9);
        let above = projection.project_point(&(target + Vector3::z() * 0.3)).unwrap();
        assert!((above.x - 240.0).abs() < 1e-9 && above.y < 179.0);
    }

    #[test]
    fn the_arc_is_gone_around_in_small_steps() {
        let options = RenderOptions { views: 20, ..Default::default() };
        let path = Path::draw(&mut stream(3, 0), &Point3::new(0.0, 0.0, 0.5), 1.0, options.arc.to_radians());
        let frames = frames(&options, &path, &mut stream(3, 1)).unwrap();
        let azimuth = |frame: &SyntheticFrame| {
            let projection = Projection::from_camera(&frame.intrinsics, &frame.cam_from_world);
            let offset = projection.center_in_world().unwrap() - path.middle;
            assert!((offset.norm() - path.distance).abs() < 1e-9);
            offset.y.atan2(offset.x)
        };
        let turned = |a: f64, b: f64| (b - a).rem_euclid(std::f64::consts::TAU).to_degrees();
        assert!((turned(azimuth(&frames[0]), azimuth(&frames[19])) - 100.0).abs() < 3.0);
        for pair in frames.windows(2) {
            let step = turned(azimuth(&pair[0]), azimuth(&pair[1]));
            assert!(step > 1.5 && step < 9.0, "{step}");
        }
    }
}
