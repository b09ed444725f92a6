//! An alignment as JSON.

use quadlift::align::{AlignStatus, Alignment, MapTransform};
use quadlift::geometry::quaternion_from_rotation;
use serde_json::{Value, json};

use super::map_objects::MapObjects;
use crate::numbers::significant;

/// The field of a merged file that says how its maps were aligned.
pub const ALIGNMENT: &str = "alignment";

/// Significant digits of evidence and standard deviations, and of covariances.
const FIGURE_DIGITS: i32 = 6;
const COVARIANCE_DIGITS: i32 = 9;

/// How two maps were aligned: `status`, `reason` where it is ambiguous, and of the most probable transform what [`transform_record`] gives; then the
/// `alternatives`. Without a transform that can be trusted the most probable one is the first alternative.
pub fn alignment_record(found: &Alignment, maps: [&MapObjects; 2]) -> Value {
    let mut record = json!({ "status": found.status.name() });
    if let AlignStatus::Ambiguous(reason) = found.status {
        record["reason"] = reason.name().into();
    }
    let mut others = &found.transforms[..];
    if let (AlignStatus::Ok, [best, rest @ ..]) = (found.status, others) {
        others = rest;
        if let (Value::Object(all), Value::Object(of_best)) = (&mut record, transform_record(best, maps)) {
            all.extend(of_best);
        }
    }
    if !others.is_empty() {
        record["alternatives"] = others.iter().map(|transform| transform_record(transform, maps)).collect();
    }
    record
}

/// A transform: `a_from_b` (`scale`, `rotation` as a unit quaternion, `translation`), `evidence`, `rotation_sd`, `position_sd`, `log_scale_sd`,
/// `covariance` about the `pivot`, and the `matches` by id.
pub fn transform_record(transform: &MapTransform, [a, b]: [&MapObjects; 2]) -> Value {
    let figure = |x: f64| significant(x, FIGURE_DIGITS);
    let [rotation_sd, position_sd, log_scale_sd] = transform.sds();
    let covariance: [[f64; 7]; 7] =
        std::array::from_fn(|i| std::array::from_fn(|j| significant(transform.covariance[(i, j)], COVARIANCE_DIGITS)));
    let to = &transform.a_from_b;
    let matched = |&(i, j): &(usize, usize)| {
        let distance = (a.objects[i].ellipsoid.center - to.point(&b.objects[j].ellipsoid.center)).norm();
        json!({ "a": a.ids[i], "b": b.ids[j], "distance": figure(distance) })
    };
    let translation: [f64; 3] = to.translation.into();
    let pivot: [f64; 3] = transform.pivot.coords.into();
    json!({
        "a_from_b": {
            "scale": to.scale,
            "rotation": quaternion_from_rotation(&to.rotation),
            "translation": translation,
        },
        "evidence": figure(transform.evidence),
        "rotation_sd": figure(rotation_sd),
        "position_sd": figure(position_sd),
        "log_scale_sd": figure(log_scale_sd),
        "pivot": pivot,
        "covariance": covariance,
        "matches": transform.matches.iter().map(matched).collect::<Vec<_>>(),
    })
}
