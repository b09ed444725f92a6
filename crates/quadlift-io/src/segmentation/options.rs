//! The options of a segmentation that a user can choose.

use super::{Method, Settings};
use crate::options::Command::{Python, Segment};
use crate::options::{Group, Kind, Spec, Value};

/// A row with what all have.
const ROW: Spec<Settings> = Spec { kind: Kind::Text, group: Group::Input, of: &[Segment, Python], ..Spec::ROW };

/// The options of a segmentation.
pub const SEGMENTATION: &[Spec<Settings>] = &[
    Spec {
        name: "method",
        kind: Kind::Choice(&Method::NAMES),
        placeholder: "graphcut|sca|masks",
        short: "Choose the segmentation method",
        help: "Segmentation method: graphcut, sca or masks (those of the scene)",
        group: Group::Model,
        get: |o| o.method.name().into(),
        set: |o, value| {
            let found = Method::ALL.into_iter().find(|method| Some(method.name()) == value.text());
            o.method = found.ok_or_else(|| format!("expected one of {}", Method::NAMES.join(", ")))?;
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "source",
        placeholder: "SOURCE",
        short: "Use only the detections of this source",
        help: "Segment only the detections of this source; required if the scene has several",
        get: |o| o.source.as_deref().into(),
        set: |o, value| {
            o.source = value.text().map(str::to_owned);
            Ok(())
        },
        ..ROW
    },
    Spec {
        name: "seed",
        kind: Kind::Whole(0),
        placeholder: "N",
        short: "Set the seed of random numbers",
        help: "Seed of the random numbers",
        group: Group::Run,
        get: |o| Value::Whole(o.seed),
        set: |o, value| {
            o.seed = value.whole().unwrap_or_default();
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
        let given = [("method", "sca".into()), ("source", "yolo".into()), ("seed", Value::Whole(3))];
        let mut options = Settings::default();
        set_options(SEGMENTATION, &given, &mut options, Spelling::Flag).unwrap();
        let found: Vec<(&str, Value)> = SEGMENTATION.iter().map(|row| (row.name, (row.get)(&options))).collect();
        assert_eq!(found, given);
        assert_eq!(Method::ALL.map(Method::name), Method::NAMES);
        // All fields: crops are not a choice of a user.
        let Settings { method: _, source: _, seed: _, with_crops: _ } = options;
    }
}
