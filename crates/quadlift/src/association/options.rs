//! Options and errors of association.

use super::warning::AssociationWarning;
use crate::scene::SourceError;
use crate::solve::CategoryPriors;

/// How far to trust object ids that detections already have (from a tracker or a labeller).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum IdPolicy {
    /// Ids are correct and kept; only detections without an id are associated.
    Trust,
    /// Ids may be wrong (tracks break and swap objects) and count as evidence.
    #[default]
    Evidence,
    /// Ids are ignored.
    Ignore,
}

/// A part of association that can be switched off for ablations (`quadlift-bench association`).
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The weaker of two overlapping bodies is removed.
    Nested,
    /// The search runs twice, the second time with the learned statistics.
    SecondPass,
    /// A reason for uncertain objects.
    Warning(AssociationWarning),
}

/// Options of association.
#[derive(Debug, Clone)]
pub struct AssociateOptions {
    /// Take the detections of this source only; needed when the scene has several.
    pub source: Option<String>,
    /// How far to trust the ids of the detections.
    pub ids: IdPolicy,
    /// Probability that an id is wrong, in (0, 1), for [`IdPolicy::Evidence`].
    pub wrong_id_share: f64,
    /// Objects with fewer views are not reported; at least 2.
    pub min_views: usize,
    /// Skip detections with a lower score; those without a score are kept.
    pub min_score: Option<f64>,
    /// Skip a detection whose intersection over union with a better one (higher score, else larger) of its frame and category
    /// is above this, in [0, 1].
    pub max_overlap: Option<f64>,
    /// The part of the standard deviation of box edges that does not depend on the box size, in pixels: slack for bodies that
    /// are not ellipsoids and for pose errors. `None` selects 2, 4 or 8 (docs/method.md, section 15.7). Use 1 for exact
    /// synthetic boxes. An estimate from the residuals was tried: it is too small, because they do not show pose errors.
    pub edge_noise_px: Option<f64>,
    /// Sizes by category, if known. Other priors are not used: they did not help.
    pub priors: CategoryPriors,
    /// Search from several starts. About four times as slow. It helps with few views (F1 .985 to .996 with 6 views) and hardly
    /// elsewhere.
    pub thorough: bool,
    /// Switch a part off; for ablations only.
    #[doc(hidden)]
    pub without: Option<Part>,
}

impl Default for AssociateOptions {
    fn default() -> Self {
        Self {
            source: None,
            ids: IdPolicy::default(),
            wrong_id_share: 0.05,
            min_views: 3,
            min_score: None,
            max_overlap: None,
            edge_noise_px: None,
            priors: CategoryPriors::default(),
            thorough: false,
            without: None,
        }
    }
}

/// Why a scene cannot be associated at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AssociateError {
    /// The source to take is not clear.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// An option is outside of its range.
    #[error("the {what} is {value}; expected {expected}")]
    OutOfRange {
        /// The option.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The observer canceled the work.
    #[error("canceled")]
    Canceled,
}

impl AssociateOptions {
    /// Whether a part of association is used.
    pub(crate) fn uses(&self, part: Part) -> bool {
        self.without != Some(part)
    }

    /// Whether the options make sense by themselves, whatever the scene is.
    ///
    /// # Errors
    /// [`AssociateError::OutOfRange`] names the first option that is outside of its range.
    pub fn validate(&self) -> Result<(), AssociateError> {
        let refuse = |what, value, expected| Err(AssociateError::OutOfRange { what, value, expected });
        if !(self.wrong_id_share > 0.0 && self.wrong_id_share < 1.0) {
            return refuse("share of wrong ids", self.wrong_id_share, "a number between 0 and 1");
        }
        if self.min_views < 2 {
            return refuse("minimum number of views", self.min_views as f64, "at least 2");
        }
        if let Some(score) = self.min_score
            && !score.is_finite()
        {
            return refuse("minimum score", score, "a finite number");
        }
        if let Some(overlap) = self.max_overlap
            && !(0.0..=1.0).contains(&overlap)
        {
            return refuse("maximum overlap", overlap, "a number from 0 to 1");
        }
        if let Some(sd) = self.edge_noise_px
            && !(sd.is_finite() && sd > 0.0)
        {
            return refuse("standard deviation in pixels", sd, "a positive number");
        }
        Ok(())
    }
}
