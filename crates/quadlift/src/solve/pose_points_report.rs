//! How well the points of a scene agree with its poses, where poses are corrected from them.

/// The points from which poses were corrected ([`super::PosteriorOptions::refine_poses`], [`super::PosteriorOptions::pose_noise`]).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PosePointsReport {
    /// Number of the scene's points.
    pub scene_points: usize,
    /// Number of the tracks that were chosen: with parallax, enough for every frame.
    pub points: usize,
    /// Number of their observations.
    pub observations: usize,
    /// Median distance of an observation from where its point appears, pixels, with the poses as given. `None` where most points would lie
    /// behind a camera.
    pub given_error: Option<f64>,
    /// The same with the corrected poses.
    pub error: Option<f64>,
    /// Noise level of the observations, each component, pixels; `None` where points were left out.
    pub noise: Option<f64>,
    /// Why points were left out.
    pub problem: Option<PosePointsProblem>,
}

/// Why the points of a scene were not used for its poses.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum PosePointsProblem {
    /// No point was seen from directions that differ enough.
    NoParallax,
    /// Corrections of the poses do not explain the pixels: they belong to another model or image size, or observations are mixed up.
    Contradict,
    /// The pixels agree with the poses, but the points do not lie where they say: another scale or world.
    Elsewhere {
        /// Median distance of an observation from where the point would be at its position, pixels; `None` behind a camera.
        error: Option<f64>,
    },
}

impl PosePointsProblem {
    /// Name in results.
    pub fn name(&self) -> &'static str {
        match self {
            Self::NoParallax => "no_parallax",
            Self::Contradict => "contradict_poses",
            Self::Elsewhere { .. } => "elsewhere",
        }
    }
}

/// The warning, for people; nothing where points were used.
impl std::fmt::Display for PosePointsReport {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let pixels = |error: Option<f64>| {
            error.map_or_else(|| "behind the cameras".to_owned(), |error| format!("{error:.1} px"))
        };
        match self.problem {
            None => Ok(()),
            Some(PosePointsProblem::NoParallax) => write!(
                f,
                "points were not used for the poses: none of the {} was observed from directions that differ by 1.5 degrees",
                self.scene_points
            ),
            Some(PosePointsProblem::Contradict) => write!(
                f,
                "points were not used for the poses: they contradict them (median error {} as given, {} with the best corrections); expected \
                 points and pixels of the model that the poses come from, in the images' full size",
                pixels(self.given_error),
                pixels(self.error)
            ),
            Some(PosePointsProblem::Elsewhere { error }) => write!(
                f,
                "points were not used for the poses: they do not lie where poses and pixels say (median error {}, {} where the rays meet); \
                 expected points of the world of the poses, with its scale, and pixels of the images' full size",
                pixels(error),
                pixels(self.error)
            ),
        }
    }
}
