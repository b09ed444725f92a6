//! The one call: a scene and options in, estimates out.

use crate::scene::Scene;
use crate::solve::{Estimate, MapOptions, RegOptions};

/// Which estimator solves for each object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Maximum a posteriori refinement: the default.
    #[default]
    Map,
    /// Tangent planes of box edges, closed form.
    Planes,
    /// Conditioned closed form (LfD).
    Lfd,
    /// The paper's closed form (PfD), in pixel coordinates.
    Pfd,
    /// The paper's regularised estimator (section 4.1).
    Reg,
}

impl Method {
    /// The fewest views with which the method can give an answer.
    pub fn fewest_views(self) -> usize {
        match self {
            Self::Map | Self::Reg => 2,
            Self::Planes | Self::Lfd | Self::Pfd => 3,
        }
    }
}

/// Everything that can be chosen.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Which estimator.
    pub method: Method,
    /// Take the detections of this source only; needed when the scene has several.
    pub source: Option<String>,
    /// Objects with fewer views get the status `too_few_views` (never below what the method needs).
    pub min_views: usize,
    /// Leave out detections with a higher occlusion level.
    pub max_occluded: Option<f64>,
    /// Leave out detections with a higher truncation level.
    pub max_truncated: Option<f64>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Options of [`Method::Map`].
    pub map: MapOptions,
    /// Options of [`Method::Reg`].
    pub reg: RegOptions,
}

/// Why a scene cannot be localised at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LocalizeError {
    /// Several sources and none chosen.
    #[error(
        "the detections come from several sources ({}); choose one, because some may be made from the truth",
        .0.join(", ")
    )]
    SeveralSources(Vec<String>),
    /// The chosen source does not exist.
    #[error("there are no detections of the source \"{chosen}\"; the scene has: {}", .known.join(", "))]
    UnknownSource {
        /// The source that was asked for.
        chosen: String,
        /// The sources of the scene.
        known: Vec<String>,
    },
    /// An option is outside of its range.
    #[error("{0}")]
    Option(String),
}

/// Detections that took no part, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// They name no object (association is not built in yet).
    pub without_object: usize,
    /// Their occlusion or truncation level is too high.
    pub occluded_or_truncated: usize,
}

/// The result for a scene.
#[derive(Debug, Clone, Default)]
pub struct Localization {
    /// One estimate for each object id that a detection of the chosen source names, in the order of the ids.
    pub estimates: Vec<Estimate>,
    /// Detections that took no part.
    pub left_out: LeftOut,
    /// Noise levels that the scene's residuals show, by name (relative to the detection's half size; radians for angles).
    pub noise: Vec<(&'static str, f64)>,
}

/// Called with the number of objects done and their total, from any thread.
pub type Progress<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// Localises every object that the detections name.
///
/// # Errors
/// [`LocalizeError`] when the options do not fit the scene; a single object that cannot be solved is a
/// [`crate::solve::Status`] instead.
pub fn localize(_scene: &Scene, _options: &Options, _progress: Progress) -> Result<Localization, LocalizeError> {
    Ok(Localization::default())
}
