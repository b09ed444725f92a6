//! Images that are located in a map of a room (`quadlift relocalize`): one, or several of one camera.

use quadlift::LocalizeOptions;
use quadlift::diagnosis::{BoxFormat, CauseName, Correction, Mistake};
use quadlift::geometry::{BodyKind, CamFromWorld};
use quadlift::relocalize::{LandmarkMap, LocateStatus, LocatedImage, Query, QueryBox, Relocalization};
use quadlift::solve::PosteriorOptions;
use rayon::prelude::*;

use super::tally::{Verdict, Verdicts};
use crate::cameras::images::{Image, MapAndImages, Split, divide, is_within};
use crate::cameras::rooms::scene;
use crate::error::Error;

/// Categories of the objects of a room, in turn.
const CATEGORIES: [usize; 2] = [30, 15];

const FIRST_SEED: u64 = 300_000;

/// Objects of the map that an image shows at least.
const FEWEST: usize = 4;

/// Bound of a position that is right, as a share of the depth of the map.
const SHARE_OF_DEPTH: f64 = 0.1;

/// What is a wrong answer, in words.
pub(super) const WRONG: &str = "of the images with the status `ok`, more than half have a pose that is off by more than 5 degrees, or by \
                                10 % of the median depth of the map's objects. Noticed: a mistake is named, or fewer than half of the \
                                images are `ok`";

/// What is wrong with the images.
#[derive(Debug, Clone, Copy)]
enum Wrong {
    Nothing,
    OtherRoom,
    Made(Correction),
}

/// All of them, with their names.
fn mistakes() -> Vec<(&'static str, Wrong)> {
    let turned = |orientation| Wrong::Made(Correction::TurnedPictures { orientation, fractions: false });
    let mut all = vec![
        ("image of another room", Wrong::OtherRoom),
        ("quarter turn", turned(6)),
        ("half turn", turned(3)),
        ("mirrored", turned(2)),
        ("letterboxed", Wrong::Made(Correction::Letterbox(640.0))),
        ("normalized boxes", Wrong::Made(Correction::NormalizedBoxes)),
    ];
    all.extend([0.5, 1.5].map(|x| ("image size", Wrong::Made(Correction::ImageScale(x)))));
    all.extend([0.8, 1.25].map(|x| ("focal length", Wrong::Made(Correction::FocalFactor(x)))));
    let formats = [BoxFormat::CornersReadAsSize, BoxFormat::CenterReadAsCorner, BoxFormat::SwappedAxes];
    all.extend(formats.map(|format| ("box format", Wrong::Made(Correction::Boxes(format)))));
    all
}

impl Wrong {
    /// The right cause; `None` where there is no name for it.
    fn cause(self) -> Option<CauseName> {
        match self {
            Self::Made(correction) => Some(correction.cause()),
            Self::Nothing | Self::OtherRoom => None,
        }
    }

    /// The image as the mistake writes it; boxes that are none then are left out.
    fn of(self, query: &Query) -> Option<Query> {
        let Self::Made(correction) = self else { return Some(query.clone()) };
        let (mistake, size) = (Mistake(correction), query.image_size);
        let of_box = |b: &QueryBox| {
            let bounding_box = mistake.bounding_box(&b.bounding_box, &query.intrinsics, size)?;
            Some(QueryBox { bounding_box, box_in_image: None, category: b.category.clone() })
        };
        let intrinsics = mistake.intrinsics(&query.intrinsics, size)?;
        Some(Query { intrinsics, image_size: size, boxes: query.boxes.iter().filter_map(of_box).collect() })
    }
}

/// A room, divided into a map and images.
fn room(seed: u64) -> Result<MapAndImages, Error> {
    let scene = scene(CATEGORIES[(seed % CATEGORIES.len() as u64) as usize], seed)?;
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    divide(&scene, Split::Alternate, &LocalizeOptions { seed, ..options.into() })
}

/// The median depth of the objects of a map before a camera, world units.
fn depth(map: &LandmarkMap, pose: &CamFromWorld) -> f64 {
    let m = pose.matrix();
    let depth_of = |center: [f64; 3]| m[(2, 0)] * center[0] + m[(2, 1)] * center[1] + m[(2, 2)] * center[2] + m[(2, 3)];
    let depths = map.landmarks().iter().map(|landmark| depth_of(landmark.body.center.coords.into()));
    crate::scores::median(depths.filter(|depth| *depth > 0.0).collect()).unwrap_or(0.0)
}

/// Some images, evenly spread, that show enough of the map.
fn chosen(all: &MapAndImages, images: usize) -> Vec<&Image> {
    let seen: Vec<&Image> = all.images.iter().filter(|image| image.seen >= FEWEST).collect();
    seen.iter().step_by((seen.len() / images).max(1)).take(images).copied().collect()
}

/// What is said about images of a room; the images are those of `shown`.
fn verdict(room: &MapAndImages, shown: &MapAndImages, images: usize, wrong: Wrong) -> Option<Verdict> {
    let chosen = chosen(shown, images);
    let queries: Vec<Query> = chosen.iter().map(|image| wrong.of(&image.query)).collect::<Option<_>>()?;
    let found: Vec<Relocalization> = queries.iter().map(|query| room.map.relocalize(query, &room.options)).collect();
    let located = |(query, located)| LocatedImage { query, options: room.options.clone(), located };
    // As the program: images without enough boxes say nothing.
    let sought = queries.iter().zip(&found).filter(|(_, found)| found.status != LocateStatus::TooFewObjects);
    let mistake = room.map.common_mistake(&sought.map(located).collect::<Vec<_>>());
    let (mut ok, mut off) = (0, 0);
    for (image, located) in chosen.iter().zip(&found) {
        if let (LocateStatus::Ok, Some(best)) = (located.status, located.poses.first()) {
            let bound = SHARE_OF_DEPTH * depth(&room.map, &image.truth);
            let is_right = !matches!(wrong, Wrong::OtherRoom) && is_within(&best.cam_from_world, &image.truth, bound);
            (ok, off) = (ok + 1, off + usize::from(!is_right));
        }
    }
    let cause = mistake.map(|mistake| mistake.correction.cause());
    Some(Verdict {
        noticed: cause.is_some() || 2 * ok < chosen.len(),
        named: if let Wrong::Nothing = wrong { cause.is_some() } else { cause.is_some() && cause == wrong.cause() },
        wrong: 2 * off > ok,
        // The camera may have been turned: nothing but gravity tells.
        hidden: matches!(wrong, Wrong::Made(Correction::TurnedPictures { orientation: 3, .. })),
    })
}

/// The verdicts about commands with so many images.
///
/// # Errors
/// [`Error::Localize`], [`Error::Scene`].
pub(super) fn relocalized([seed, seeds, right]: [u64; 3], images: usize) -> Result<Verdicts, Error> {
    let first = FIRST_SEED + seed * 1_000_000;
    let of_room = |k: u64| -> Result<Vec<(&'static str, Wrong, u64, Verdict)>, Error> {
        let (own, other) = (room(first + k)?, room(first + k + 2 * seeds)?);
        let verdict = |(name, wrong): (&'static str, Wrong)| {
            let shown = if let Wrong::OtherRoom = wrong { &other } else { &own };
            Some((name, wrong, first + k, verdict(&own, shown, images, wrong)?))
        };
        Ok(mistakes().into_iter().filter_map(verdict).collect())
    };
    let rooms = (0..seeds).into_par_iter().map(of_room).collect::<Result<Vec<_>, _>>()?;
    let of_right = |k: u64| -> Result<_, Error> {
        let seed = first + 500_000 + k;
        let room = room(seed)?;
        Ok(verdict(&room, &room, images, Wrong::Nothing).map(|verdict| (seed, verdict)))
    };
    let right = (0..right).into_par_iter().map(of_right).collect::<Result<Vec<_>, _>>()?;
    let mut verdicts = Verdicts { right: right.into_iter().flatten().collect(), ..Default::default() };
    for (name, wrong) in mistakes() {
        let of_mistake = rooms.iter().flatten().filter(|case| case.0 == name && same(case.1, wrong));
        for (_, wrong, seed, verdict) in of_mistake {
            let mistake = if let Wrong::Made(correction) = wrong { format!("{correction:?}") } else { name.to_owned() };
            verdicts.push(name, wrong.cause().is_some(), (*seed, mistake, *verdict));
        }
    }
    Ok(verdicts)
}

/// Whether two mistakes are one.
fn same(a: Wrong, b: Wrong) -> bool {
    match (a, b) {
        (Wrong::Made(a), Wrong::Made(b)) => a == b,
        (Wrong::OtherRoom, Wrong::OtherRoom) | (Wrong::Nothing, Wrong::Nothing) => true,
        _ => false,
    }
}
