//! The options of an association that a user can choose; priors are read from files.

use quadlift::association::{AssociateOptions, IdPolicy};

use super::Command::{Associate, Python};
use super::{Group, Kind, Range, Spec};

/// A row with what all have.
const ROW: Spec<AssociateOptions> = Spec { group: Group::Input, of: &[Associate, Python], ..Spec::ROW };

/// The options of an association.
pub const ASSOCIATION: &[Spec<AssociateOptions>] = &[
    Spec {
        name: "source",
        kind: Kind::Text,
        placeholder: "SOURCE",
        short: "Use only the detections of this source",
        help: "Use only the detections of this source; required if the scene has several",
        get: |o| o.source.as_deref().into(),
        set: |o, value| {
            o.source = value.text().map(str::to_owned);
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "ids",
        kind: Kind::Choice(&IdPolicy::NAMES),
        placeholder: "trust|evidence|ignore",
        short: "Choose how far to trust existing ids",
        help: "How far to trust existing ids: trust (keep them), evidence (they may be wrong) or ignore",
        group: Group::Association,
        get: |o| o.ids.name().into(),
        set: |o, value| {
            o.ids = value.named()?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "thorough",
        short: "Search from several starts",
        help: "Search from several starts: takes about four times as long, better with few views",
        group: Group::Association,
        get: |o| o.thorough.into(),
        set: |o, value| {
            o.thorough = value.flag().unwrap_or_default();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "min_views",
        kind: Kind::Whole(2),
        placeholder: "N",
        short: "Skip objects with fewer views",
        help: "Skip objects with fewer views",
        group: Group::Association,
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
        placeholder: "SCORE",
        short: "Skip detections with a lower score",
        help: "Skip detections with a lower score, such as 0.5",
        get: |o| o.min_score.into(),
        set: |o, value| {
            o.min_score = value.number();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "max_overlap",
        kind: Kind::Number(Range::Share),
        placeholder: "IOU",
        short: "Skip boxes that overlap a better one",
        help: "Skip detections that overlap a better one of the same frame and category by more than this (intersection over \
               union)",
        get: |o| o.max_overlap.into(),
        set: |o, value| {
            o.max_overlap = value.number();
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "edge_noise_px",
        kind: Kind::Number(Range::Positive),
        placeholder: "PX",
        short: "Set the pixel error of box edges",
        help: "Error of box edges that does not depend on the size of the box, in pixels [default: 2, 4 or 8, the largest that \
               the evidence supports]",
        group: Group::Model,
        get: |o| o.edge_noise_px.into(),
        set: |o, value| {
            o.edge_noise_px = value.number();
            Ok(())
        },
        ..ROW
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Spelling, Value, set_options};

    #[test]
    fn every_row_is_set_and_read_back() {
        let given: [(&str, Value); 7] = [
            ("source", "yolo".into()),
            ("ids", "trust".into()),
            ("thorough", true.into()),
            ("min_views", 5_usize.into()),
            ("min_score", 0.5.into()),
            ("max_overlap", 0.7.into()),
            ("edge_noise_px", 3.0.into()),
        ];
        let mut options = AssociateOptions::default();
        set_options(ASSOCIATION, &given, &mut options, Spelling::Flag).unwrap();
        let found: Vec<(&str, Value)> = ASSOCIATION.iter().map(|row| (row.name, (row.get)(&options))).collect();
        assert_eq!(found, given);
        // All fields: the priors, and those for experiments.
        let AssociateOptions {
            source: _,
            ids: _,
            thorough: _,
            min_views: _,
            min_score: _,
            max_overlap: _,
            edge_noise_px: _,
            priors: _,
            wrong_id_share: _,
            without: _,
        } = options;
    }
}
