//! Scenes that are observed frame by frame (`quadlift stream`), without ids.

use quadlift::geometry::Ellipsoid;
use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::scene::Scene;

use super::objects::{Answer, names, verdicts};
use super::tally::Verdicts;
use crate::diagnosis::mistakes::NamedMistake;
use crate::diagnosis::scenes::without_ids;
use crate::online::replay::replay;

/// Fewest frames: the check begins with 30.
const MIN_FRAMES: usize = 40;

/// What a map says after the last frame.
fn answer(scene: &Scene) -> Option<Answer> {
    let scene = without_ids(scene)?;
    let mut map = ObjectMap::new(OnlineOptions::default()).ok()?;
    replay(&mut map, &scene, |_, _, _| {});
    let bodies: Vec<Ellipsoid> = map.objects().map(|object| object.ellipsoid).collect();
    let noticed = map.consistent() == Some(false) || bodies.is_empty();
    Some(Answer { noticed, causes: names(map.diagnosis()), bodies })
}

/// The verdicts.
pub(super) fn streamed(numbers: [u64; 3]) -> Verdicts {
    let is_made = |mistake: &NamedMistake| !matches!(mistake, NamedMistake::MixedIds);
    verdicts(numbers, MIN_FRAMES, is_made, |scene, _| answer(scene))
}
