//! Options of the object map.

use crate::association::{AssociateError, AssociateOptions, IdPolicy};
use crate::solve::CategoryPriors;

/// Options of an [`super::ObjectMap`].
#[derive(Debug, Clone, PartialEq)]
pub struct OnlineOptions {
    /// How far to trust the ids of detections (of a tracker). [`IdPolicy::Trust`] makes them strong evidence, not certainty.
    pub ids: IdPolicy,
    /// Probability that an id is wrong, in (0, 1), for [`IdPolicy::Evidence`].
    pub wrong_id_share: f64,
    /// Views that an object needs to be confirmed; at least 2.
    pub min_views: usize,
    /// Skip detections with a lower score; those without a score are kept.
    pub min_score: Option<f64>,
    /// The part of the standard deviation of box edges that does not depend on the box size, pixels
    /// ([`AssociateOptions::edge_noise_px`]). `None` selects 2, 4 or 8 by the evidence of the objects.
    pub edge_noise_px: Option<f64>,
    /// Sizes by category, if known.
    pub priors: CategoryPriors,
    /// Maximum number of views that an object keeps; at least 4. The least informative views are forgotten.
    pub max_views: usize,
    /// Maximum number of objects. If there are more, tentative objects are removed first, then gone ones, then those that were
    /// seen least recently.
    pub max_objects: usize,
}

impl Default for OnlineOptions {
    fn default() -> Self {
        let batch = AssociateOptions::default();
        Self {
            ids: batch.ids,
            wrong_id_share: batch.wrong_id_share,
            min_views: batch.min_views,
            min_score: None,
            edge_noise_px: None,
            priors: CategoryPriors::default(),
            max_views: 32,
            max_objects: 100_000,
        }
    }
}

impl OnlineOptions {
    /// Checks the range of every option.
    ///
    /// # Errors
    /// [`AssociateError::OutOfRange`] names the first option that is outside of its range.
    pub fn validate(&self) -> Result<(), AssociateError> {
        let batch = AssociateOptions {
            wrong_id_share: self.wrong_id_share,
            min_views: self.min_views,
            min_score: self.min_score,
            edge_noise_px: self.edge_noise_px,
            ..AssociateOptions::default()
        };
        batch.validate()?;
        let refuse = |what, value, expected| Err(AssociateError::OutOfRange { what, value, expected });
        if self.max_views < 4 {
            return refuse("maximum number of views", self.max_views as f64, "at least 4");
        }
        if self.max_objects == 0 {
            return refuse("maximum number of objects", 0.0, "at least 1");
        }
        Ok(())
    }
}
