//! Where the fixed cameras of a rig are, from what stands or walks by: boxes of the same bodies in several cameras at the same time steps
//! (ours; docs/method.md, section 23).
//!
//! Cameras have known intrinsics. The size of a box tells about how far its body is, so that what two cameras see are two clouds of
//! points, which a rigid motion takes to each other (`pairs`); from there all cameras, the vertical, the shapes of the bodies and
//! their places are adjusted together, to the edges of all boxes (`problem`, `adjust`). A camera that is not determined has
//! a status that says why, and no pose.

mod kabsch;
mod pairs;
mod predicted;
mod problem;
mod adjust;
mod prepared;
mod assemble;
mod solution;
mod alternatives;
mod outcome;
mod contradictions;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix6, Unit, Vector2, Vector3};

use self::alternatives::alternatives;
use self::assemble::{Pair, Tree, pairs, tree};
use self::contradictions::contradictions;
use self::prepared::Prepared;
use self::solution::{Solution, choose_exponents, refine, solution};
use crate::geometry::{BoundingBox, CamFromWorld, Intrinsics};
use crate::parallel::map_indices;
use crate::solve::SizePrior;

/// Better solutions that are taken up, one after another.
const MAX_BETTER: usize = 3;

/// Time steps by which a camera may be late or early.
const LATE: [i64; 10] = [1, -1, 2, -2, 3, -3, 4, -4, 5, -5];

/// Cameras that are tried at other time steps, at most.
const MAX_TRIED: usize = 3;

/// A fixed camera.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// The camera, without distortion.
    pub intrinsics: Intrinsics,
    /// Width and height in pixels: boxes at the border may be cut off there. Without it none is.
    pub image_size: Option<Vector2<f64>>,
    /// Its pose, if that is known: it is kept, and the other cameras are expressed in its world.
    pub cam_from_world: Option<CamFromWorld>,
}

/// A box of a camera at a time step.
#[derive(Debug, Clone, PartialEq)]
pub struct RigBox {
    /// Index of the camera.
    pub camera: usize,
    /// Number of the time step: the same for all cameras, in the order of time.
    pub time_step: usize,
    /// Number of the object, the same in all cameras and at all time steps. Boxes without one are matched by where they are.
    pub object: Option<usize>,
    /// Index of the category.
    pub category: Option<usize>,
    /// The box, pixels without distortion.
    pub bounding_box: BoundingBox,
    /// Where it is in the image itself, whose border may cut it: only where a lens bends the image.
    pub box_in_image: Option<BoundingBox>,
}

/// What is known of a category.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RigCategory {
    /// Whether its bodies are upright, as people are who walk: they tell the vertical.
    pub upright: bool,
    /// Whether its objects stay where they are at all time steps.
    pub still: bool,
    /// Their size, in the unit of the world that is sought: it tells the scale.
    pub size: Option<SizePrior>,
}

/// What the cameras of a rig saw.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rig {
    /// The cameras.
    pub cameras: Vec<RigCamera>,
    /// The categories.
    pub categories: Vec<RigCategory>,
    /// The boxes, in any order. Those of cameras that do not exist are left out.
    pub boxes: Vec<RigBox>,
    /// Upwards in the world of the given poses, if that is known.
    pub up: Option<Unit<Vector3<f64>>>,
}

/// A distance between the centers of two cameras that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownBaseline {
    /// Indices of the cameras.
    pub cameras: [usize; 2],
    /// The distance, in the unit of the world that is sought.
    pub length: f64,
}

/// Options of [`calibrate_rig()`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CalibrateOptions {
    /// Distances that are known: they tell the scale.
    pub baselines: Vec<KnownBaseline>,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// Whether a camera was calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CameraStatus {
    /// Its pose was given.
    Given,
    /// Its pose was found, or it is the camera in whose frame the others are found.
    Ok,
    /// It shares fewer than five boxes of whole bodies with the cameras that were calibrated.
    NotConnected,
    /// Its boxes and those of the others do not show the same bodies, whatever its pose is: wrong ids, time steps or intrinsics.
    Inconsistent,
    /// Two poses explain the boxes about as well.
    Ambiguous,
    /// Its boxes leave the pose open: too few, or of bodies that stay in one place or on one line.
    Undetermined,
}

impl CameraStatus {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Given => "given",
            Self::Ok => "ok",
            Self::NotConnected => "not_connected",
            Self::Inconsistent => "inconsistent",
            Self::Ambiguous => "ambiguous",
            Self::Undetermined => "undetermined",
        }
    }

    /// Whether there is a pose that can be trusted.
    pub fn has_pose(self) -> bool {
        matches!(self, Self::Given | Self::Ok)
    }
}

/// What speaks against a camera whose boxes those of the others contradict.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Contradiction {
    /// At its time steps the other cameras see other bodies, or no pose explains its boxes: another place, wrong ids or time steps.
    OtherBodies,
    /// Its edges are off by so many times as much as those of the others.
    Noise(f64),
    /// Its boxes agree better with a focal length that is longer by about this factor: a wrong focal length, or images of another size.
    FocalLength(f64),
    /// It would be below the floor, upside down: its images are mirrored.
    Mirrored,
    /// A given pose contradicts the boxes, so that its world is not known.
    GivenPoses,
    /// Its boxes agree with those that the others see so many time steps before; after, if it is negative.
    Late(i64),
}

impl Contradiction {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::OtherBodies => "other_bodies",
            Self::Noise(_) => "noise",
            Self::FocalLength(_) => "focal_length",
            Self::Mirrored => "mirrored",
            Self::GivenPoses => "given_poses",
            Self::Late(_) => "late",
        }
    }

    /// Its factor or number of time steps, if it has one.
    pub fn value(self) -> Option<f64> {
        match self {
            Self::Noise(value) | Self::FocalLength(value) => Some(value),
            Self::Late(steps) => Some(steps as f64),
            _ => None,
        }
    }
}

/// A camera of the rig, calibrated or not.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedCamera {
    /// Whether it was calibrated.
    pub status: CameraStatus,
    /// Its pose; with [`CameraStatus::Given`] and [`CameraStatus::Ok`] alone.
    pub cam_from_world: Option<CamFromWorld>,
    /// Covariance of its errors relative to the reference camera or the given ones, in the frame of the camera: rotation vector
    /// (radians) and position (world units), at the scale of the answer, which has a standard deviation of its own. None of the reference and of given cameras.
    pub covariance: Option<Matrix6<f64>>,
    /// Number of time steps at which it shares bodies with other calibrated cameras.
    pub time_steps: usize,
    /// Root mean square distance of measured and predicted edges, pixels.
    pub residual_px: Option<f64>,
    /// Standard deviation of its edges, relative to the mean half size of their boxes.
    pub edge_noise: Option<f64>,
    /// What speaks against it, with [`CameraStatus::Inconsistent`]; of a given camera, why its pose cannot be right.
    pub contradiction: Option<Contradiction>,
}

impl CalibratedCamera {
    /// Standard deviations of the rotation (radians) and the position (world units): root mean squares over the axes.
    pub fn sds(&self) -> Option<[f64; 2]> {
        let covariance = self.covariance?;
        Some([0, 3].map(|first| (covariance.fixed_view::<3, 3>(first, first).trace() / 3.0).max(0.0).sqrt()))
    }
}

/// What tells the unit of the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RigScale {
    /// The given poses.
    GivenPoses,
    /// Distances between cameras.
    Baselines,
    /// The usual sizes of categories.
    Sizes,
    /// Nothing: the object that is seen most is one unit high.
    Arbitrary,
}

impl RigScale {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::GivenPoses => "given_poses",
            Self::Baselines => "baselines",
            Self::Sizes => "sizes",
            Self::Arbitrary => "arbitrary",
        }
    }
}

/// The vertical, as upright bodies tell it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertical {
    /// Upwards in the world.
    pub up: Unit<Vector3<f64>>,
    /// Standard deviation of its angle, each way, relative to the reference camera, radians.
    pub sd: f64,
}

/// The cameras of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// In the order of the input.
    pub cameras: Vec<CalibratedCamera>,
    /// The camera in whose frame the others were found; none if a pose was given, or no two cameras see the same bodies.
    pub reference: Option<usize>,
    /// What tells the unit of the world.
    pub scale: RigScale,
    /// Relative standard deviation of the scale where sizes tell it.
    pub scale_sd: Option<f64>,
    /// The vertical, where it is known well enough to turn the world by it: then the world has z upwards and its origin on the floor below the
    /// reference camera. Otherwise the world is the frame of the reference camera. Given poses keep their world.
    pub vertical: Option<Vertical>,
    /// Standard deviation of the edges of boxes as it was estimated, relative to their mean half size.
    pub edge_noise: Option<f64>,
}

impl Calibration {
    /// Whether no camera contradicts the others.
    pub fn is_consistent(&self) -> bool {
        self.cameras.iter().all(|camera| camera.contradiction.is_none())
    }
}

/// Finds the poses of the cameras of a rig. The same input gives the same answer.
///
/// Cameras that the others contradict are tried at other time steps: one that agrees with them there is late.
pub fn calibrate_rig(rig: &Rig, options: &CalibrateOptions) -> Calibration {
    let mut answer = calibrated(rig, options);
    let posed = answer.cameras.iter().filter(|camera| camera.status.has_pose()).count();
    // Fewer do not say which one is late.
    let contradicted = |camera: &usize| {
        posed >= 2 && answer.cameras[*camera].contradiction.is_some() && rig.cameras[*camera].cam_from_world.is_none()
    };
    let sought: Vec<usize> = (0..rig.cameras.len()).filter(contradicted).take(MAX_TRIED).collect();
    for camera in sought {
        let tried = map_indices(LATE.len(), |k| calibrated(&earlier(rig, camera, LATE[k]), options));
        let agrees = |k: &usize| {
            let found = &tried[*k].cameras[camera];
            let noise = found.edge_noise.filter(|_| found.status == CameraStatus::Ok)?;
            Some((noise, LATE[*k]))
        };
        let best = (0..LATE.len()).filter_map(|k| agrees(&k)).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, steps)) = best {
            answer.cameras[camera].contradiction = Some(Contradiction::Late(steps));
        }
    }
    answer
}

/// A rig with the boxes of a camera at earlier time steps.
fn earlier(rig: &Rig, camera: usize, steps: i64) -> Rig {
    let mut moved = rig.clone();
    for of_rig in &mut moved.boxes {
        let by = if of_rig.camera == camera { steps } else { 0 };
        of_rig.time_step = (of_rig.time_step as i64 + LATE.len() as i64 - by) as usize;
    }
    moved
}

fn calibrated(rig: &Rig, options: &CalibrateOptions) -> Calibration {
    let prepared = Prepared::new(rig);
    let mut pairs = pairs(&prepared, options.seed);
    let mut known: Vec<Option<Contradiction>> = vec![None; rig.cameras.len()];
    loop {
        let tree = tree(&prepared, &pairs);
        let Some((solution, ambiguous)) = solved(&prepared, &pairs, &tree, options) else {
            return outcome::nothing(rig, &pairs, &known);
        };
        let answer = outcome::calibration(&prepared, &pairs, &tree, &solution, &ambiguous, &known);
        let found = contradictions(&solution, &answer.cameras);
        if found.is_empty() {
            return outcome::without_two_alone(rig, &solution, answer);
        }
        found.iter().for_each(|&(camera, contradiction)| known[camera] = Some(contradiction));
        if found.iter().any(|&(camera, _)| rig.cameras[camera].cam_from_world.is_some()) {
            let sought = (0..rig.cameras.len()).filter(|&camera| solution.problem.free[camera]);
            sought.for_each(|camera| known[camera] = known[camera].or(Some(Contradiction::GivenPoses)));
            return outcome::nothing(rig, &pairs, &known);
        }
        // The others may be right without it.
        for pair in pairs.iter_mut().filter(|pair| pair.cameras.iter().any(|&camera| known[camera].is_some())) {
            pair.poses.clear();
            pair.status = CameraStatus::Inconsistent;
        }
    }
}

/// The best solution of cameras that hang together, and which of them have another one that is about as good.
fn solved(
    prepared: &Prepared,
    pairs: &[Pair],
    tree: &Tree,
    options: &CalibrateOptions,
) -> Option<(Solution, Vec<bool>)> {
    let mut solution = solution(prepared, tree, &tree.poses, options)?;
    refine(prepared, &mut solution);
    if choose_exponents(&mut solution) {
        refine(prepared, &mut solution);
    }
    let mut found = alternatives(prepared, pairs, tree, &solution);
    for _ in 0..MAX_BETTER {
        let Some((poses, up)) = found.better.take() else { break };
        let mut next = solution.clone();
        next.restart(prepared, poses, up);
        refine(prepared, &mut next);
        solution = next;
        found = alternatives(prepared, pairs, tree, &solution);
    }
    Some((solution, found.ambiguous))
}
