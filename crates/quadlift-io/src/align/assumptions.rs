//! What is assumed of two files: their scale by their units, their verticals; and whether the objects contradict that.

use quadlift::align::{AlignOptions, AlignStatus, Alignment, CLEAR, CommonUp, MapObject, align};
use quadlift::nalgebra::{Unit, Vector3};

use super::map_objects::MapObjects;
use crate::scene_file::SceneFile;
use crate::write::meters_of;

/// Where the scale between two maps comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum MapScale {
    /// From the units of the files, where both are known; otherwise it is estimated.
    #[default]
    OfUnits,
    /// From the units of the files, where both are known; otherwise it is 1.
    Rigid,
    /// It is estimated.
    Estimated,
}

/// How long a unit of the second file is in units of the first one, if both have a known `length_unit`.
pub fn scale_of_units(a: &SceneFile, b: &SceneFile) -> Option<f64> {
    let meters = |file: &SceneFile| meters_of(file.length_unit.as_deref()?);
    Some(meters(b)? / meters(a)?)
}

/// The options for two files; `up_sd` is the standard deviation of the angle between their `up` (radians), if these are used where both have
/// one.
pub fn options_of(a: &SceneFile, b: &SceneFile, scale: MapScale, up_sd: Option<f64>) -> AlignOptions {
    let scale = match scale {
        MapScale::Estimated => None,
        MapScale::OfUnits => scale_of_units(a, b),
        MapScale::Rigid => Some(scale_of_units(a, b).unwrap_or(1.0)),
    };
    let up = |file: &SceneFile| file.up.and_then(|up| Unit::try_new(Vector3::from(up), 1e-9));
    let up = up_sd.and_then(|sd| Some(CommonUp { up_in_a: up(a)?, up_in_b: up(b)?, sd }));
    AlignOptions { scale, up }
}

/// An assumption that the objects contradict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Contradiction {
    /// By the objects the scale is another one than the known one; the standard deviation is that of its logarithm.
    Scale {
        /// The scale of the objects.
        found: f64,
        /// Its standard deviation, relative.
        sd: f64,
        /// The known scale.
        known: f64,
    },
    /// Only without the common vertical the maps can be aligned.
    Up,
    /// The mirror image of the second map explains them clearly better: one of them is left-handed.
    Mirrored,
}

/// Standard deviations and least difference of logarithms from which a scale contradicts the known one, and the difference from which the
/// maps are not aligned at all.
const SCALE_DEVIATIONS: f64 = 3.0;
const MIN_DIFFERENCE: f64 = 0.01;
const WRONG_SCALE: f64 = 0.03;

/// Aligns two maps, the first one with the mirror image of the second, and both again without what was assumed: maps whose objects
/// contradict the known scale, or whose mirror image fits clearly better, are not aligned, although the best transform may be the only one.
pub fn align_checked(a: &MapObjects, b: &MapObjects, options: &AlignOptions) -> (Alignment, Option<Contradiction>) {
    let with = |options: &AlignOptions| align(&a.objects, &b.objects, options);
    let mut found = with(options);
    let is_found = |found: &Alignment| found.status == AlignStatus::Ok;
    let evidence_of = |found: &Alignment| found.transforms.first().map_or(f64::NEG_INFINITY, |best| best.evidence);
    let up_in_mirror = options.up.map(|up| CommonUp { up_in_b: -up.up_in_b, ..up });
    let mirrored: Vec<MapObject> = b.objects.iter().map(MapObject::mirrored).collect();
    let mirror = align(&a.objects, &mirrored, &AlignOptions { up: up_in_mirror, ..*options });
    if is_found(&mirror) && evidence_of(&mirror) > evidence_of(&found) + CLEAR {
        found.status = AlignStatus::NoAlignment;
        return (found, Some(Contradiction::Mirrored));
    }
    if let Some(known) = options.scale {
        let free = with(&AlignOptions { scale: None, ..*options });
        if let (true, Some(best)) = (is_found(&free), free.transforms.first()) {
            let off = (best.a_from_b.scale / known).ln().abs();
            let sd = best.sds()[2];
            let evidence = evidence_of(&found);
            if off > MIN_DIFFERENCE.max(SCALE_DEVIATIONS * sd) {
                if off > WRONG_SCALE && best.evidence > evidence + CLEAR {
                    found.status = AlignStatus::NoAlignment;
                }
                return (found, Some(Contradiction::Scale { found: best.a_from_b.scale, sd, known }));
            }
        }
    }
    if is_found(&found) || options.up.is_none() {
        return (found, None);
    }
    let without = with(&AlignOptions { up: None, ..*options });
    let contradiction = is_found(&without).then_some(Contradiction::Up);
    (found, contradiction)
}
