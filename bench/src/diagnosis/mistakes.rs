//! The mistakes that are made, and what they cost.

use std::collections::HashMap;

use quadlift::diagnosis::{BoxFormat, CameraParts, CauseName, Correction, Mistake};
use quadlift::geometry::{Body, BodyKind, ConvexBody};
use quadlift::metrics::iou3d_bodies;
use quadlift::scene::{Detection, Frame, Scene};
use quadlift::solve::{Method, PosteriorOptions};
use quadlift::synthetic::Trajectory;
use quadlift::{LocalizeOptions, localize};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A mistake.
#[derive(Debug, Clone, Copy)]
pub(crate) enum NamedMistake {
    /// A correction undoes it.
    Undone(Correction),
    /// The later half of the trajectory has steps multiplied by this.
    ScaleJump(f64),
    /// This share of the frames, the last ones, has the pose of the frame before them.
    RepeatedPoses(f64),
    /// This share of the frames, spread evenly, has another convention.
    SomeFrames(Correction, f64),
    /// Ids are numbers in each frame, from left to right.
    MixedIds,
}

/// All mistakes, several sizes of those that have a size.
pub(crate) fn all() -> Vec<NamedMistake> {
    // The order is that of the tables and of the draws.
    let (poses, quaternion_orders) = Correction::OF_POSES.split_at(9);
    let mut all = poses.to_vec();
    all.extend([
        Correction::NormalizedIntrinsics,
        Correction::CenteredPrincipalPoint,
        Correction::NormalizedBoxes,
        Correction::Letterbox(640.0),
        Correction::Letterbox(1024.0),
        Correction::NormalizedLetterbox,
        Correction::ReversedFrames,
    ]);
    all.extend(quaternion_orders);
    all.extend([0.5, 0.8, 1.25, 2.0].map(Correction::FocalFactor));
    all.extend([0.5, 0.75, 1.5, 2.0].map(Correction::ImageScale));
    all.extend([-0.2, 0.1].map(Correction::RadialDistortion));
    all.extend([1, -1, 2, -2, 5].map(Correction::FrameOffset));
    let formats = [
        BoxFormat::CornersReadAsSize,
        BoxFormat::CenterReadAsCorner,
        BoxFormat::CornerReadAsCenter,
        BoxFormat::CornersReadAsCenter,
        BoxFormat::SwappedAxes,
    ];
    all.extend(formats.map(Correction::Boxes));
    for (orientation, fractions) in [(2, false), (3, false), (6, false), (8, false), (6, true), (8, true)] {
        all.push(Correction::TurnedPictures { orientation, fractions });
    }
    let mut all: Vec<NamedMistake> = all.into_iter().map(NamedMistake::Undone).collect();
    all.extend([0.5, 1.3].map(NamedMistake::ScaleJump));
    all.extend([0.3, 0.6].map(NamedMistake::RepeatedPoses));
    for correction in [Correction::OpenGlAxes, Correction::BodyAxes, Correction::InvertPoses] {
        all.extend([0.5, 0.3, 0.15].map(|share| NamedMistake::SomeFrames(correction, share)));
    }
    all.push(NamedMistake::MixedIds);
    all
}

/// Some mistakes, drawn for a scene.
pub(super) fn mistakes_of(seed: u64, count: usize) -> Vec<NamedMistake> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6D69_7374);
    let all = all();
    (0..count).map(|_| all[rng.random_range(0..all.len())]).collect()
}

impl NamedMistake {
    /// Its name in the tables.
    pub(crate) fn name(&self) -> String {
        let value = match self {
            Self::Undone(correction) => correction.value(),
            Self::ScaleJump(x) | Self::RepeatedPoses(x) | Self::SomeFrames(_, x) => Some(*x),
            Self::MixedIds => None,
        };
        let name = self.cause().name();
        if let Self::SomeFrames(_, share) = self {
            return format!("{name} in {:.0} % of the frames", 100.0 * share);
        }
        value.map_or_else(|| name.to_owned(), |value| format!("{name} {value}"))
    }

    /// The expected causes.
    pub(crate) fn cause(&self) -> CauseName {
        match self {
            Self::Undone(correction) | Self::SomeFrames(correction, _) => correction.cause(),
            Self::ScaleJump(_) => CauseName::ScaleJump,
            Self::RepeatedPoses(_) => CauseName::DuplicatePoses,
            Self::MixedIds => CauseName::ObjectIds,
        }
    }

    /// The wrong scene; `None` where most boxes would be none.
    pub(crate) fn make(&self, scene: &Scene) -> Option<Scene> {
        let wrong = match *self {
            Self::Undone(correction) => Mistake(correction).apply(scene),
            Self::ScaleJump(factor) => with_scale_jump(scene, factor)?,
            Self::RepeatedPoses(share) => {
                let mut wrong = scene.clone().into_parts();
                let last = ((1.0 - share) * scene.frames.len() as f64) as usize;
                let held = scene.frames.get(last.saturating_sub(1))?.projection;
                wrong.frames.iter_mut().skip(last).for_each(|frame| frame.projection = held);
                Scene::from_parts(wrong).ok()?
            }
            Self::SomeFrames(correction, share) => {
                let mut wrong = scene.clone().into_parts();
                let others = Mistake(correction).apply(scene);
                for (k, (frame, other)) in wrong.frames.iter_mut().zip(&others.frames).enumerate() {
                    let is_wrong = ((k + 1) as f64 * share).floor() > (k as f64 * share).floor();
                    frame.projection = if is_wrong { other.projection } else { frame.projection };
                }
                Scene::from_parts(wrong).ok()?
            }
            Self::MixedIds => with_mixed_ids(scene)?,
        };
        (2 * wrong.detections.len() >= scene.detections.len()).then_some(wrong)
    }

    /// Whether the wrong scene is as consistent as the right one, or nearly so, because of where the cameras stand.
    pub(crate) fn is_hidden_by(&self, trajectory: Trajectory) -> bool {
        match (self.cause(), trajectory) {
            // Cameras at 200 units from objects within 10: perspective is weak, and a focal length scales the world.
            (CauseName::FocalLength, Trajectory::Random) => false,
            (CauseName::FocalLength, _) => true,
            // Cameras at equal steps on an arc: the offset turns the world, nearly.
            (CauseName::FrameOffset, Trajectory::Arc { .. }) => true,
            // Cameras at equal steps on a straight line.
            (
                CauseName::FrameOffset
                | CauseName::LeftHandedAxes
                | CauseName::CameraToWorld
                | CauseName::OpenGlAxes
                | CauseName::LeftHandedCameraToWorld,
                Trajectory::Street,
            ) => true,
            // A car sees other objects before a jump than after it.
            (CauseName::ScaleJump, Trajectory::Street) => true,
            _ => false,
        }
    }
}

fn with_scale_jump(scene: &Scene, factor: f64) -> Option<Scene> {
    let camera = |frame: &Frame| CameraParts::from_projection(&frame.projection);
    let middle = scene.frames.len() / 2;
    let anchor = camera(scene.frames.get(middle.checked_sub(1)?)?)?.center();
    let mut wrong = scene.clone().into_parts();
    for frame in &mut wrong.frames[middle..] {
        let camera = camera(frame)?;
        let center = anchor + (camera.center() - anchor) * factor;
        frame.projection = camera.with_center(&center).projection()?;
    }
    Scene::from_parts(wrong).ok()
}

fn with_mixed_ids(scene: &Scene) -> Option<Scene> {
    let mut wrong = scene.clone().into_parts();
    let left = |d: &Detection| d.bounding_box.map_or(0.0, |b| b.x0());
    wrong.detections.sort_by(|a, b| a.frame_index.cmp(&b.frame_index).then(left(a).total_cmp(&left(b))));
    let (mut frame, mut next) = (u32::MAX, 0);
    for detection in &mut wrong.detections {
        next = if detection.frame_index == frame { next + 1 } else { 0 };
        (frame, detection.object_index) = (detection.frame_index, Some(next));
    }
    let largest = wrong.detections.iter().filter_map(|d| d.object_index).max();
    wrong.object_ids = (0..=largest.unwrap_or_default()).map(|number| format!("number {number}")).collect();
    Scene::from_parts(wrong).ok()
}

/// The cost of a mistake.
#[derive(Debug, Clone, Copy)]
pub(super) struct Harm {
    /// By how much the mean O3D falls.
    pub o3d: f64,
    /// Median distance of the centers from those of the right scene, in mean semi-axes.
    pub shift: f64,
}

impl Harm {
    /// Whether it counts.
    pub(super) fn matters(self) -> bool {
        self.o3d > 0.1 || self.shift > 0.5
    }
}

/// What a mistake costs; `truth` names the true bodies, `right` has the estimates of the right scene.
pub(super) fn harm(truth: &[(String, Body)], right: &HashMap<String, Body>, wrong: &Scene) -> Harm {
    let wrong = bodies(wrong);
    let (mut lost, mut shifts) = (0.0, Vec::new());
    for (id, body) in truth {
        let o3d = |bodies: &HashMap<String, Body>| bodies.get(id).map_or(0.0, |found| iou3d_bodies(found, body));
        lost += o3d(right) - o3d(&wrong);
        shifts.push(match (right.get(id), wrong.get(id)) {
            (Some(a), Some(b)) => (a.center() - b.center()).norm() / body.closest_ellipsoid().semi_axes.mean(),
            (None, _) => 0.0,
            (Some(_), None) => f64::INFINITY,
        });
    }
    shifts.sort_by(f64::total_cmp);
    Harm { o3d: lost / truth.len().max(1) as f64, shift: shifts.get(shifts.len() / 2).copied().unwrap_or(0.0) }
}

/// The estimated bodies by the names of their objects.
pub(super) fn bodies(scene: &Scene) -> HashMap<String, Body> {
    let mut options = LocalizeOptions { allow_inconsistent: true, ..Default::default() };
    options.method = Method::Posterior(PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() });
    let Ok(localization) = localize(scene, &options) else { return HashMap::new() };
    let named = |e: quadlift::solve::Estimate| Some((scene.object_ids[e.object_index].clone(), e.body?));
    localization.solution.estimates.into_iter().filter_map(named).collect()
}
