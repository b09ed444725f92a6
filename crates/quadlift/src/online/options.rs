//! Options of the object map.

use crate::association::{AssociateError, AssociateOptions, IdPolicy};
use crate::options::Command::{Node, Python, Stream};
use crate::options::{Kind, Range, Spec, Value};
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

/// A row with what all have.
const ROW: Spec<OnlineOptions> = Spec {
    name: "",
    kind: Kind::Flag,
    help: "",
    group: "",
    of: &[Stream, Python, Node],
    only: None,
    needs: None,
    whole_scene: true,
    get: |_| Value::Unset,
    set: |_, _| Ok(()),
};

/// The options of an object map that a user can choose; priors are read from files.
pub const ONLINE: &[Spec<OnlineOptions>] = &[
    Spec {
        name: "ids",
        kind: Kind::Choice(&IdPolicy::NAMES),
        help: "How far to trust the ids of detections (of a tracker): trust, evidence or ignore",
        get: |o| o.ids.name().into(),
        set: |o, value| {
            o.ids = value.named()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "min_views",
        kind: Kind::Whole(2),
        help: "Views that an object needs to be confirmed",
        get: |o| o.min_views.into(),
        set: |o, value| {
            o.min_views = value.count()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "min_score",
        kind: Kind::Number(Range::Finite),
        help: "Skip detections with a lower score",
        get: |o| o.min_score.into(),
        set: |o, value| {
            o.min_score = value.number();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "edge_noise_px",
        kind: Kind::Number(Range::Positive),
        help: "Error of box edges that does not depend on the size of the box, in pixels [default: 2, 4 or 8, selected as the evidence \
               grows]",
        get: |o| o.edge_noise_px.into(),
        set: |o, value| {
            o.edge_noise_px = value.number();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "max_views",
        kind: Kind::Whole(4),
        help: "Views that an object keeps; the others are forgotten, those that add least first",
        get: |o| o.max_views.into(),
        set: |o, value| {
            o.max_views = value.count()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "max_objects",
        kind: Kind::Whole(1),
        help: "Objects that the map keeps",
        get: |o| o.max_objects.into(),
        set: |o, value| {
            o.max_objects = value.count()?;
            Ok(())
        },
        ..ROW
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Spelling, set_options};

    #[test]
    fn every_row_is_set_and_read_back() {
        let given: [(&str, Value); 6] = [
            ("ids", "trust".into()),
            ("min_views", 5_usize.into()),
            ("min_score", 0.5.into()),
            ("edge_noise_px", 3.0.into()),
            ("max_views", 8_usize.into()),
            ("max_objects", 9_usize.into()),
        ];
        let mut options = OnlineOptions::default();
        set_options(ONLINE, &given, &mut options, Spelling::Flag).unwrap();
        let found: Vec<(&str, Value)> = ONLINE.iter().map(|row| (row.name, (row.get)(&options))).collect();
        assert_eq!(found, given);
        // All fields: one for experiments, and the priors.
        let OnlineOptions {
            ids: _,
            wrong_id_share: _,
            min_views: _,
            min_score: _,
            edge_noise_px: _,
            priors: _,
            max_views: _,
            max_objects: _,
        } = options;
    }
}
