//! The scenes of the experiment, with the options under which each is localized.

use std::path::Path;

use quadlift::LocalizeOptions;
use quadlift::geometry::BodyKind;
use quadlift::scene::Scene;
use quadlift::solve::{PoseMotion, PosteriorOptions};
use quadlift_io::builtin_priors;
use quadlift_io::scene_file::ObjectBodies;

use crate::compare::sets::{self, Overlap, Set};
use crate::error::Error;
use crate::progress::Run;

/// Height of KITTI's cameras above the road, meters.
const CAMERA_HEIGHT: f64 = 1.65;

/// The rows of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Group {
    Real,
    Synthetic,
    Cues,
    Priors,
    RefinedPoses,
    LearnedSizes,
}

impl Group {
    /// All of them, in the order of the rows.
    pub(super) const ALL: [Self; 6] =
        [Self::Real, Self::Synthetic, Self::Cues, Self::Priors, Self::RefinedPoses, Self::LearnedSizes];

    /// The name of the row.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Real => "real scenes",
            Self::Synthetic => "synthetic scenes",
            Self::Cues => "depths, 3D boxes, outlines",
            Self::Priors => "cuboids with size priors",
            Self::RefinedPoses => "refined poses",
            Self::LearnedSizes => "learned sizes",
        }
    }

    fn options(self, seed: u64) -> LocalizeOptions {
        let map = match self {
            Self::Real | Self::Synthetic | Self::Cues => PosteriorOptions::default(),
            Self::Priors => PosteriorOptions {
                body: Some(BodyKind::Cuboid),
                priors: builtin_priors(),
                camera_height: Some(CAMERA_HEIGHT),
                ..Default::default()
            },
            Self::RefinedPoses => PosteriorOptions { refine_poses: Some(PoseMotion::Auto), ..Default::default() },
            Self::LearnedSizes => PosteriorOptions { learn_sizes: true, ..Default::default() },
        };
        LocalizeOptions { seed, enclosing: true, ..map.into() }
    }

    /// The groups of a set. Scenes without ids are left out: which boxes show one object is another question.
    fn of(set: &Set) -> Vec<Self> {
        let name = set.name.as_str();
        match (set.has_ids, set.is_real, set.options.is_empty()) {
            (false, ..) => Vec::new(),
            (true, _, false) if name.contains("GPS") => vec![Self::Priors, Self::RefinedPoses],
            (true, _, false) => vec![Self::Priors],
            (true, true, true) if name.starts_with("KITTI") => vec![Self::Real, Self::LearnedSizes],
            (true, true, true) => vec![Self::Real],
            (true, false, _) if name.starts_with("street") => vec![Self::Synthetic, Self::RefinedPoses],
            (true, false, _) if name.starts_with("standing") => vec![Self::Synthetic, Self::LearnedSizes],
            (true, false, _) if ["depths", "outlines"].iter().any(|cue| name.starts_with(cue)) => vec![Self::Cues],
            (true, false, _) => vec![Self::Synthetic],
        }
    }
}

/// A scene with options and truth.
pub(super) struct Case {
    pub group: Group,
    pub scene: Scene,
    pub options: LocalizeOptions,
    pub overlap: Overlap,
    /// The true objects that count.
    pub truth: Vec<ObjectBodies>,
}

/// All cases; without data the synthetic ones alone.
///
/// # Errors
/// [`Error`] of a scene that cannot be read or made.
pub(super) fn cases(data: Option<&Path>, scenes: u64, run: &Run) -> Result<Vec<Case>, Error> {
    let mut sets = data.map(sets::real).transpose()?.unwrap_or_default();
    sets.extend(sets::synthetic(scenes)?);
    let mut cases = Vec::new();
    for set in &sets {
        let groups = Group::of(set);
        for case in set.scenes.iter().take(if run.short { 1 } else { usize::MAX }) {
            let path = Path::new(&case.name);
            for &group in &groups {
                let mut truth = case.truth.to_objects().map_err(|error| error.in_file(path))?;
                truth.retain(|object| case.counted.contains(&object.id));
                cases.push(Case {
                    group,
                    scene: case.input.to_scene().map_err(|error| error.in_file(path))?,
                    options: group.options(run.seed),
                    overlap: set.overlap,
                    truth,
                });
            }
        }
    }
    Ok(cases)
}
