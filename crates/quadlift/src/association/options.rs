//! What can be chosen about association, and why it refuses a scene.

use super::warning::AssociationWarning;
use crate::scene::SourceError;
use crate::solve::CategoryPriors;

/// What the object ids that come with the detections (of a tracker, of a labeller) are worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum IdUse {
    /// They are right and stay as they are; only detections without an id are associated.
    Trust,
    /// They may be wrong (tracks break, and swap their objects): they count as evidence.
    #[default]
    Evidence,
    /// They are not looked at.
    Ignore,
}

/// A part of association that can be switched off, to find out what it is worth (`quadlift reproduce association`).
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Objects whose union has more evidence are merged.
    Merge,
    /// The weaker of two bodies in one place goes.
    Nested,
    /// Weak objects are dissolved and sought anew; only in a thorough search.
    Dissolve,
    /// Everything is done twice, the second time with what has been learnt.
    SecondPass,
    /// A reason for which objects are doubtful.
    Warning(AssociationWarning),
}

/// Everything that can be chosen about association.
#[derive(Debug, Clone)]
pub struct AssociateOptions {
    /// Take the detections of this source only; needed when the scene has several.
    pub source: Option<String>,
    /// What the ids of the detections are worth.
    pub ids: IdUse,
    /// Probability that an id is wrong, in (0, 1), where ids are evidence.
    pub wrong_id_share: f64,
    /// Objects with fewer views are not reported; at least 2.
    pub min_views: usize,
    /// Leave out detections with a lower score; those without a score stay.
    pub min_score: Option<f64>,
    /// Leave out a detection that overlaps a better one (higher score, else larger) of its frame and category with a
    /// higher intersection over union than this, in [0, 1].
    pub max_overlap: Option<f64>,
    /// Part of the standard deviation of box edges that does not depend on the size of the box, in pixels: slack for
    /// bodies that are no ellipsoids and for poses. `None`: 2, 4 or 8, as much as costs little evidence. 1 suits
    /// exact synthetic boxes. (Learning it from the residuals was tried: it comes out too small, because they do not show
    /// wrong poses.)
    pub pixel_sd: Option<f64>,
    /// Sizes by category, where they are known; other priors are not used here, because they do not help.
    pub priors: CategoryPriors,
    /// Search from several starts and seek weak objects anew. It takes about eight times as long; it helps where there
    /// are few views or many misses (F1 .986 to .993 with 6 views, .990 to .998 with 60 % missed) and hardly elsewhere.
    pub thorough: bool,
    /// Leave a part out; not for use, only to measure what it is worth.
    #[doc(hidden)]
    pub without: Option<Part>,
}

impl Default for AssociateOptions {
    fn default() -> Self {
        Self {
            source: None,
            ids: IdUse::default(),
            wrong_id_share: 0.05,
            min_views: 3,
            min_score: None,
            max_overlap: None,
            pixel_sd: None,
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
    /// The observer cancelled the work.
    #[error("cancelled")]
    Cancelled,
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
            return refuse("least number of views", self.min_views as f64, "at least 2");
        }
        if let Some(score) = self.min_score
            && !score.is_finite()
        {
            return refuse("least score", score, "a finite number");
        }
        if let Some(overlap) = self.max_overlap
            && !(0.0..=1.0).contains(&overlap)
        {
            return refuse("largest overlap", overlap, "a number from 0 to 1");
        }
        if let Some(sd) = self.pixel_sd
            && !(sd.is_finite() && sd > 0.0)
        {
            return refuse("standard deviation in pixels", sd, "a positive number");
        }
        Ok(())
    }
}
