//! Simulated depths and 3D boxes of detections, with noise, biases and outliers (ours).

use nalgebra::{Point3, Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::geometry::rotation::horizontal_basis;
use crate::geometry::visible_surface::visible_depth;
use crate::geometry::{Body, ConvexBody};
use crate::random;
use crate::scene::{Box3dCue, Cues, DepthCue, Detection, Scene, SceneError, View};

/// Rays along each side of a box.
const RAYS: usize = 15;

/// The stream of the seed for depths, and for 3D boxes.
const DEPTH_STREAM: u64 = 40;
const BOX_STREAM: u64 = 41;
const FRAME_SCALE_STREAM: u64 = 42;

/// Simulated cues; the default simulates none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CueOptions {
    /// Depths, if any.
    pub depth: Option<DepthNoise>,
    /// 3D boxes, if any.
    pub box3d: Option<Box3dNoise>,
}

/// Errors of simulated depths, relative to the depth where nothing else is said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthNoise {
    /// Standard deviation of the error of each depth.
    pub noise: f64,
    /// Measured over true depth of all: 1 without a bias.
    pub scale: f64,
    /// Added to all measured depths, in world units times `scale`: 0 without a bias. Depths that are not positive with it are
    /// left out.
    pub shift: f64,
    /// Probability, in [0, 1], of the depth of something else: the background, at 1.5 to 3 times the depth.
    pub outliers: f64,
    /// Standard deviation of the logarithm of a scale that the depths of each frame share.
    pub frame_scale: f64,
}

/// Errors of simulated 3D boxes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Box3dNoise {
    /// Standard deviation of the distance, relative.
    pub distance: f64,
    /// Standard deviation of the position across the ray, each way, relative to the distance.
    pub across: f64,
    /// Standard deviation of the logarithm of each extent.
    pub size: f64,
    /// Measured over true extents of all.
    pub size_bias: f64,
    /// Standard deviation of the rotation about the body's third axis, radians.
    pub yaw: f64,
    /// Probability, in [0, 1], that front and back are confused.
    pub flips: f64,
    /// Probability, in [0, 1], of a box that is wrong in everything.
    pub outliers: f64,
}

impl Default for DepthNoise {
    /// A network for metric depth: 5 % noise, 10 % too far.
    fn default() -> Self {
        Self { noise: 0.05, scale: 1.1, shift: 0.0, outliers: 0.0, frame_scale: 0.0 }
    }
}

impl Default for Box3dNoise {
    /// A monocular 3D detector for cars: center 4 % of the distance along the ray and 1 % across, extents 8 % too large with 10 %
    /// noise, yaw 8 degrees with 10 % flips, 5 % outliers.
    fn default() -> Self {
        Self {
            distance: 0.04,
            across: 0.01,
            size: 0.1,
            size_bias: 1.08,
            yaw: 8f64.to_radians(),
            flips: 0.1,
            outliers: 0.05,
        }
    }
}

/// The scene with simulated cues for each detection that has a true body, from the sources `depth` and `box3d`. Depths are the
/// medians over rays that meet the body; with a scale of each frame the scene says so. The boxes of the detections stay as they are.
///
/// # Errors
/// [`SceneError`] if the options give numbers that are out of range.
pub fn simulate_cues(
    scene: &Scene,
    body_of: impl Fn(usize, &Detection) -> Option<Body>,
    options: &CueOptions,
    seed: u64,
) -> Result<Scene, SceneError> {
    let mut parts = scene.clone().into_parts();
    parts.cue_sources = vec!["depth".to_owned(), "box3d".to_owned()];
    let mut depths = random::stream(seed, DEPTH_STREAM);
    let mut boxes = random::stream(seed, BOX_STREAM);
    let mut scales = random::stream(seed, FRAME_SCALE_STREAM);
    let spread = options.depth.map_or(0.0, |noise| noise.frame_scale);
    let of_frame: Vec<f64> = scene.frames.iter().map(|_| (spread * random::normal(&mut scales)).exp()).collect();
    if spread > 0.0 {
        parts.scaled_by_frame.insert(0);
    }
    for (index, detection) in parts.detections.iter_mut().enumerate() {
        let view = scene.view(&scene.detections[index]);
        let Some(body) = body_of(index, detection) else { continue };
        let scale = |noise: DepthNoise| {
            let of_frame = of_frame[view.frame_index];
            DepthNoise { scale: noise.scale * of_frame, shift: noise.shift * of_frame, ..noise }
        };
        let depth = options.depth.and_then(|noise| simulated_depth(&view, &body, &scale(noise), &mut depths));
        let box3d = options.box3d.and_then(|noise| simulated_box(&view, &body, &noise, &mut boxes));
        detection.cues = (depth.is_some() || box3d.is_some()).then(|| Box::new(Cues { depth, box3d }));
    }
    Scene::from_parts(parts)
}

fn simulated_depth(view: &View, body: &Body, noise: &DepthNoise, rng: &mut ChaCha8Rng) -> Option<DepthCue> {
    let error = 1.0 + noise.noise * random::normal(rng);
    let (chance, beyond) = (rng.random_range(0.0..1.0f64), rng.random_range(1.5..3.0f64));
    let factor = if chance < noise.outliers { beyond } else { error.max(0.1) };
    let depth = visible_depth(&view.projection, &view.measured_box()?, body, RAYS)?;
    let median = depth * noise.scale * factor + noise.shift;
    (median > 0.0).then_some(DepthCue { median, sd: None, source: Some(0) })
}

fn simulated_box(view: &View, body: &Body, noise: &Box3dNoise, rng: &mut ChaCha8Rng) -> Option<Box3dCue> {
    let [along, first, second, yaw] = std::array::from_fn(|_| random::normal(rng));
    let sizes = Vector3::from_fn(|_, _| random::normal(rng));
    let (flip, wrong) = (rng.random_range(0.0..1.0f64), rng.random_range(0.0..1.0f64));
    let (wrong_distance, wrong_yaw) = (rng.random_range(0.5..2.0f64), rng.random_range(0.0..std::f64::consts::TAU));
    let is_wrong = wrong < noise.outliers;
    let pose = view.projection.camera_pose()?;
    let center = pose.matrix() * body.center().to_homogeneous();
    let distance = center.norm();
    let [e1, e2] = horizontal_basis(&center.normalize());
    let factor = if is_wrong { wrong_distance } else { 1.0 + noise.distance * along };
    let center = center * factor.max(0.1) + (e1 * first + e2 * second) * (noise.across * distance);
    let turn = match (is_wrong, flip < noise.flips) {
        (true, _) => wrong_yaw,
        (false, true) => std::f64::consts::PI + noise.yaw * yaw,
        (false, false) => noise.yaw * yaw,
    };
    let cam_from_world = Rotation3::from_matrix_unchecked(pose.matrix().fixed_columns::<3>(0).into_owned());
    Some(Box3dCue {
        center: (center.z > 0.0).then(|| Point3::from(center)),
        half_extents: Some(
            body.half_extents.zip_map(&sizes, |half, e| half * noise.size_bias * (noise.size * e).exp()),
        ),
        rotation: Some(cam_from_world * body.rotation * Rotation3::from_axis_angle(&Vector3::z_axis(), turn)),
        source: Some(1),
        ..Default::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{SyntheticOptions, generate};

    #[test]
    fn exact_cues_are_those_of_the_body_and_outliers_are_as_many_as_asked_for() {
        let made = generate(&SyntheticOptions { objects: 20, views: 10, ..Default::default() }).unwrap();
        let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
        let exact =
            Box3dNoise { distance: 0.0, across: 0.0, size: 0.0, size_bias: 1.0, yaw: 0.0, flips: 0.0, outliers: 0.0 };
        let depth = DepthNoise { noise: 0.0, scale: 1.0, outliers: 0.25, ..Default::default() };
        let scene =
            simulate_cues(&made.scene, body_of, &CueOptions { depth: Some(depth), box3d: Some(exact) }, 1).unwrap();
        let mut wrong = 0;
        for (index, detection) in scene.detections.iter().enumerate() {
            let body = body_of(index, detection).unwrap();
            let projection = &scene.frames[detection.frame_index as usize].projection;
            let cues = detection.cues.as_ref().unwrap();
            let box3d = cues.box3d.unwrap();
            let pose = projection.camera_pose().unwrap();
            let center = pose.matrix() * body.center().to_homogeneous();
            assert!((box3d.center.unwrap().coords - center).norm() < 1e-9);
            assert!((box3d.half_extents.unwrap() - body.half_extents).norm() < 1e-12);
            let depth = cues.depth.unwrap().median / projection.depth(&body.center());
            wrong += usize::from(depth > 1.2);
            assert!(!(1.0..=1.2).contains(&depth), "{depth}");
        }
        assert!((30..70).contains(&wrong), "{wrong} of 200");
    }
}
