//! The options of an object map that a user can choose.

use quadlift::association::IdPolicy;
use quadlift::online::OnlineOptions;

use super::Command::{Node, Python, Stream};
use super::{Group, Kind, Range, Spec};

/// A row with what all have.
const ROW: Spec<OnlineOptions> = Spec { group: Group::Model, of: &[Stream, Python, Node], ..Spec::ROW };

/// The options of an object map that a user can choose; priors are read from files.
pub const MAP: &[Spec<OnlineOptions>] = &[
    Spec {
        name: "ids",
        kind: Kind::Choice(&IdPolicy::NAMES),
        placeholder: "trust|evidence|ignore",
        short: "Choose how far to trust existing ids",
        help: "How far to trust the ids of detections (of a tracker): trust, evidence or ignore",
        group: Group::Association,
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
        placeholder: "N",
        short: "Confirm objects with this many views",
        help: "Views that an object needs to be confirmed",
        group: Group::Model,
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
        help: "Skip detections with a lower score",
        group: Group::Input,
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
        placeholder: "PX",
        short: "Set the pixel error of box edges",
        help: "Error of box edges that does not depend on the size of the box, in pixels [default: 2, 4 or 8, selected as the evidence \
               grows]",
        group: Group::Model,
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
        placeholder: "N",
        short: "Keep at most this many views per object",
        help: "Views that an object keeps; the others are forgotten, those that add least first",
        group: Group::Model,
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
        placeholder: "N",
        short: "Keep at most this many objects",
        help: "Objects that the map keeps",
        group: Group::Model,
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
    use crate::options::{Spelling, Value, set_options};

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
        set_options(MAP, &given, &mut options, Spelling::Flag).unwrap();
        let found: Vec<(&str, Value)> = MAP.iter().map(|row| (row.name, (row.get)(&options))).collect();
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
