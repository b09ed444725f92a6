//! Two maps of rooms that are aligned (`quadlift align`).

use std::f64::consts::FRAC_PI_2;

use quadlift::align::{AlignOptions, AlignStatus, CommonUp, MapObject};
use quadlift::nalgebra::{Rotation3, Unit};
use quadlift_io::align::{Contradiction, MapObjects, align_checked};
use rayon::prelude::*;

use super::tally::{Verdict, Verdicts};
use crate::cameras::alignment::{COMMON, TwoMaps, rooms};
use crate::cameras::images::any_across;
use crate::error::Error;

/// Categories of the objects of a room, in turn.
const CATEGORIES: [usize; 4] = [30, 6, 3, 1];

const FIRST_SEED: u64 = 400_000;

/// Standard deviation of the verticals, radians.
const UP_SD: f64 = 0.035;

/// Errors of a right transform: rotation, degrees; scale; position in the middle of the room, meters (a tenth of its depth).
const MAX_DEGREES: f64 = 5.0;
const MAX_SCALE: f64 = 0.1;
const MAX_METERS: f64 = 0.6;

/// What is a wrong answer, in words.
pub(super) const WRONG: &str = "the status is `ok`, and the transform is off by more than 5 degrees, 10 % of the scale, or 0.6 m \
                                (10 % of the room's depth) in the middle; of another room and of a mirrored map every transform is. Noticed: another \
                                status, or a contradiction";

/// What is wrong with map B.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mistake {
    Nothing,
    /// It is of another room.
    OtherRoom,
    /// It is mirrored.
    Mirrored,
    /// Its scale is this factor of the known one.
    Scale(f64),
    /// Its vertical is horizontal.
    Up,
}

/// Mistakes with what is known: the scale, the vertical.
const MISTAKES: [(&str, Mistake, [bool; 2]); 13] = [
    ("another room, rigid", Mistake::OtherRoom, [true, false]),
    ("another room, rigid, up", Mistake::OtherRoom, [true, true]),
    ("another room, similarity", Mistake::OtherRoom, [false, false]),
    ("another room, similarity, up", Mistake::OtherRoom, [false, true]),
    ("mirrored map, rigid", Mistake::Mirrored, [true, false]),
    ("mirrored map, rigid, up", Mistake::Mirrored, [true, true]),
    ("mirrored map, similarity", Mistake::Mirrored, [false, false]),
    ("mirrored map, similarity, up", Mistake::Mirrored, [false, true]),
    ("map at another scale, rigid", Mistake::Scale(0.5), [true, false]),
    ("map at another scale, rigid", Mistake::Scale(0.8), [true, false]),
    ("map at another scale, rigid", Mistake::Scale(1.25), [true, true]),
    ("wrong vertical, rigid", Mistake::Up, [true, true]),
    ("wrong vertical, similarity", Mistake::Up, [false, true]),
];

/// What is said about two maps.
fn verdict(maps: &TwoMaps, mistake: Mistake, [knows_scale, knows_up]: [bool; 2]) -> Verdict {
    let [up_in_a, mut up_in_b] = maps.up;
    let mut b = maps.b.clone();
    let mut scale = maps.a_from_b.scale;
    match mistake {
        Mistake::Nothing | Mistake::OtherRoom => {}
        Mistake::Mirrored => {
            b = b.iter().map(MapObject::mirrored).collect();
            up_in_b = -up_in_b;
        }
        Mistake::Scale(factor) => scale *= factor,
        Mistake::Up => {
            let across = any_across(&up_in_b);
            up_in_b = Rotation3::from_axis_angle(&Unit::new_normalize(across), FRAC_PI_2) * up_in_b;
        }
    }
    let up = knows_up.then_some(CommonUp { up_in_a, up_in_b, sd: UP_SD });
    let objects = |objects: Vec<MapObject>| MapObjects { objects, ..Default::default() };
    let options = AlignOptions { scale: knows_scale.then_some(scale), up };
    let (found, contradiction) = align_checked(&objects(maps.a.clone()), &objects(b), &options);
    let is_ok = found.status == AlignStatus::Ok;
    let named = match mistake {
        Mistake::Nothing => contradiction.is_some(),
        Mistake::OtherRoom => matches!(found.status, AlignStatus::NoAlignment | AlignStatus::TooFewObjects),
        Mistake::Mirrored => matches!(contradiction, Some(Contradiction::Mirrored)),
        Mistake::Scale(_) => matches!(contradiction, Some(Contradiction::Scale { .. })),
        Mistake::Up => matches!(contradiction, Some(Contradiction::Up)),
    };
    let has_truth = !matches!(mistake, Mistake::OtherRoom | Mistake::Mirrored);
    let is_right = found.transforms.first().filter(|_| has_truth).is_some_and(|best| {
        let (found, truth) = (&best.a_from_b, &maps.a_from_b);
        (found.scale / truth.scale).ln().abs() < MAX_SCALE
            && found.angle_to(truth).to_degrees() < MAX_DEGREES
            && (found.point(&truth.inverse().point(&maps.middle)) - maps.middle).norm() < MAX_METERS
    });
    Verdict { noticed: !is_ok || contradiction.is_some(), named, wrong: is_ok && !is_right, hidden: false }
}

/// The verdicts.
///
/// # Errors
/// [`Error::Localize`].
pub(super) fn aligned([seed, seeds, right]: [u64; 3]) -> Result<Verdicts, Error> {
    let first = FIRST_SEED + seed * 1_000_000;
    let categories = |seed: u64| CATEGORIES[(seed % CATEGORIES.len() as u64) as usize];
    let of_right = |k: u64| -> Result<(u64, Verdict), Error> {
        let seed = first + 500_000 + k;
        let known = [[true, false], [true, true], [false, false], [false, true]][(seed / 4 % 4) as usize];
        Ok((seed, verdict(&rooms(categories(seed), COMMON, seed)?, Mistake::Nothing, known)))
    };
    let of_draw = |k: u64| -> Result<Vec<Verdict>, Error> {
        let seed = first + k;
        let [same, other] = [COMMON, 0].map(|common| rooms(categories(seed), common, seed));
        let (same, other) = (same?, other?);
        let maps = |mistake| if mistake == Mistake::OtherRoom { &other } else { &same };
        Ok(MISTAKES.iter().map(|&(_, mistake, known)| verdict(maps(mistake), mistake, known)).collect())
    };
    let right = (0..right).into_par_iter().map(of_right).collect::<Result<_, _>>()?;
    let draws = (0..seeds).into_par_iter().map(of_draw).collect::<Result<Vec<_>, _>>()?;
    let mut verdicts = Verdicts { right, ..Default::default() };
    for (k, (name, mistake, _)) in MISTAKES.iter().enumerate() {
        for (seed, draw) in (first..).zip(&draws) {
            verdicts.push(name, true, (seed, format!("{name} ({mistake:?})"), draw[k]));
        }
    }
    Ok(verdicts)
}
