//! Checks `up` against the cameras: people and robots hold cameras upright, so that the horizon is level in the image.

use nalgebra::{Matrix3, Vector3};

use super::camera::CameraParts;
use super::correction::Correction;
use crate::scene::Scene;
use crate::sorting::StableSort;

/// Maximum number of frames.
const MAX_FRAMES: usize = 200;

/// Minimum number of frames.
const MIN_FRAMES: usize = 5;

/// Cameras whose x axis rises by less than this (a sine: 20 degrees) are upright.
const LEVEL: f64 = 0.34;

/// A camera that is upright has a y axis that rises or falls by more than this (a sine: 10 degrees), unless it looks down more
/// steeply than this (70 degrees).
const RISES: f64 = 0.17;
const STEEP: f64 = 0.94;

/// Fraction of upright cameras if there is an upright direction.
const NEARLY_ALL: f64 = 0.95;

/// The cameras must look into different directions, or many directions are level: second eigenvalue of the scatter of their
/// x axes (1/3 where they look anywhere; 0.03 is a standard deviation of 10 degrees)...
const SPREAD: f64 = 0.03;

/// ...and so many times the third one, which is the scatter of their rolls.
const DISTINCT: f64 = 6.0;

/// `up` contradicts the cameras when it differs by more than this from their upright direction (a cosine: 30 degrees).
const CONTRADICTS: f64 = 0.866;

/// An upright direction this near to an axis of the world is that axis (a cosine: 10 degrees).
const IS_AXIS: f64 = 0.985;

/// The correction of a scene's `up` if it contradicts the direction in which nearly all its cameras are upright, and
/// whether it is certain: all cameras may be mounted upside down.
pub fn corrected_up(scene: &Scene) -> Option<(Correction, bool)> {
    let up = scene.up?;
    let stride = scene.frames.len().div_ceil(MAX_FRAMES).max(1);
    let frames = scene.frames.iter().step_by(stride);
    let cameras: Vec<Matrix3<f64>> = frames
        .filter_map(|frame| CameraParts::from_projection(&frame.projection))
        .map(|camera| camera.rotation)
        .collect();
    let share = |held: fn(&Matrix3<f64>, &Vector3<f64>) -> bool| {
        cameras.iter().filter(|camera| held(camera, &up)).count() as f64 / cameras.len() as f64
    };
    if share(is_level) >= NEARLY_ALL && share(is_upside_down) < NEARLY_ALL {
        return None;
    }
    let upright = upright_direction(&cameras)?;
    let (cosine, correction) = (upright.dot(&up), Correction::Up(snapped(upright).into()));
    (cosine < CONTRADICTS).then_some((correction, cosine > -CONTRADICTS))
}

/// Whether a camera is level for this up direction; its image may be rotated by multiples of 90 degrees, as for
/// portraits.
fn is_level(camera: &Matrix3<f64>, up: &Vector3<f64>) -> bool {
    let [right, down, forward] = in_camera(camera, up);
    let looks_down = forward < -STEEP;
    (right.abs() < LEVEL && (down.abs() > RISES || looks_down))
        || (down.abs() < LEVEL && (right.abs() > LEVEL || looks_down))
}

/// Whether a camera is upside down where up is so.
fn is_upside_down(camera: &Matrix3<f64>, up: &Vector3<f64>) -> bool {
    let [right, down, forward] = in_camera(camera, up);
    right.abs() < LEVEL && (down > RISES || forward > STEEP)
}

/// A direction of the world in the axes of a camera: right, down, forward.
fn in_camera(camera: &Matrix3<f64>, direction: &Vector3<f64>) -> [f64; 3] {
    (camera * direction).into()
}

/// The world direction in which nearly all cameras are upright; `None` if there is none or if it is ambiguous.
fn upright_direction(cameras: &[Matrix3<f64>]) -> Option<Vector3<f64>> {
    if cameras.len() < MIN_FRAMES {
        return None;
    }
    let count = cameras.len() as f64;
    let axis = |camera: &Matrix3<f64>, row: usize| camera.row(row).transpose();
    let scatter: Matrix3<f64> =
        cameras.iter().map(|c| axis(c, 0) * axis(c, 0).transpose()).sum::<Matrix3<f64>>() / count;
    let eigen = scatter.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.stable_sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let [least, second] = [order[0], order[1]].map(|k| eigen.eigenvalues[k].max(0.0));
    if second < SPREAD || second < DISTINCT * least {
        return None;
    }
    let level = eigen.eigenvectors.column(order[0]).into_owned();
    // Up in the image, or behind a camera that looks down.
    let rises: f64 = cameras.iter().map(|c| -axis(c, 1).dot(&level) - axis(c, 2).dot(&level)).sum();
    let up = level * rises.signum();
    let is_upright = |camera: &Matrix3<f64>| {
        let (down, forward) = (axis(camera, 1).dot(&up), axis(camera, 2).dot(&up));
        axis(camera, 0).dot(&up).abs() < LEVEL && (down < 0.0 || forward < -LEVEL)
    };
    let upright = cameras.iter().filter(|camera| is_upright(camera)).count() as f64;
    (upright >= NEARLY_ALL * count).then_some(up)
}

/// The world axis closest to a direction, or the direction with three decimals.
fn snapped(direction: Vector3<f64>) -> Vector3<f64> {
    let largest = direction.iamax();
    if direction[largest].abs() > IS_AXIS {
        let mut axis = Vector3::zeros();
        axis[largest] = direction[largest].signum();
        return axis;
    }
    direction.map(|x| (x * 1e3).round() / 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{SyntheticOptions, Trajectory, generate};

    fn scene(trajectory: Trajectory) -> Scene {
        generate(&SyntheticOptions { objects: 3, views: 40, trajectory, ..Default::default() }).unwrap().scene
    }

    #[test]
    fn upright_cameras_contradict_another_up() {
        for trajectory in [Trajectory::Orbit, Trajectory::Random] {
            let mut scene = scene(trajectory);
            for (up, wrong) in [
                (Vector3::z(), false),
                (Vector3::new(0.1, 0.2, 1.0), false),
                (Vector3::y(), true),
                (-Vector3::y(), true),
                (Vector3::x(), true),
                (-Vector3::z(), true),
            ] {
                scene.0.up = Some(nalgebra::Unit::new_normalize(up));
                let found = corrected_up(&scene);
                let expected = (Correction::Up([0.0, 0.0, 1.0]), up != -Vector3::z());
                assert_eq!(found, wrong.then_some(expected), "{trajectory:?} {up:?}");
            }
            scene.0.up = None;
            assert_eq!(corrected_up(&scene), None);
        }
    }

    #[test]
    fn portraits_do_not_contradict_up() {
        let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        for trajectory in [Trajectory::default(), Trajectory::Orbit, Trajectory::Random, Trajectory::Street] {
            for pattern in 0..8 {
                let mut scene = scene(trajectory);
                for (index, frame) in scene.0.frames.iter_mut().enumerate() {
                    let turns =
                        if pattern < 3 { usize::from(index % (pattern + 1) == 0) } else { index * pattern / 3 % 4 };
                    let mut camera = CameraParts::from_projection(&frame.projection).unwrap();
                    for _ in 0..turns {
                        camera.rotation = quarter * camera.rotation;
                        camera.translation = quarter * camera.translation;
                    }
                    frame.projection = camera.projection().unwrap();
                }
                scene.0.up = Some(Vector3::z_axis());
                assert_eq!(corrected_up(&scene), None, "{trajectory:?} {pattern}");
            }
        }
    }

    #[test]
    fn a_turned_world_has_its_own_upright_direction() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.5, 0.3, 0.2);
        let cameras: Vec<Matrix3<f64>> = (scene(Trajectory::Orbit).frames.iter())
            .filter_map(|frame| CameraParts::from_projection(&frame.projection))
            .map(|camera| camera.rotation * turn.matrix().transpose())
            .collect();
        let expected = turn * Vector3::z();
        assert!(upright_direction(&cameras).unwrap().dot(&expected) > 0.9999);
    }

    #[test]
    fn cameras_that_roll_or_look_one_way_say_nothing() {
        let straight = vec![Matrix3::identity(); 20];
        assert_eq!(upright_direction(&straight), None);
        let rolled: Vec<Matrix3<f64>> = (0..20)
            .map(|k| {
                let yaw = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), 0.3 * f64::from(k));
                let roll = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), 1.1 * f64::from(k));
                (roll * yaw).into_inner()
            })
            .collect();
        assert_eq!(upright_direction(&rolled), None);
    }
}
