//! Maps from opposite sides of synthetic rooms and of real scenes, without a common image, brought together by their objects.

use std::f64::consts::TAU;
use std::path::Path;

use quadlift::align::{AlignOptions, AlignStatus, CommonUp, MapObject, align};
use quadlift::geometry::{BodyKind, Projection, Similarity};
use quadlift::nalgebra::{Point3, Rotation3, Unit, Vector3};
use quadlift::scene::Scene;
use quadlift::solve::PosteriorOptions;
use quadlift::{LocalizeError, LocalizeOptions, localize};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use super::images::any_across;
use super::rooms::{CATEGORIES, FRAMES, images, normal, room};
use super::triples::align_by_centers;
use crate::data::TrueScene;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::table::{Cell, Table};

/// Draws of each row, and of those of rooms that have nothing in common.
const DRAWS: u64 = 200;
const OTHER_DRAWS: u64 = 50;

/// Objects of a room that are in both maps; half of the others is in each.
pub(crate) const COMMON: usize = 12;

const FIRST_SEED: u64 = 829;

/// Bounds of what is right: scale, rotation in degrees, middle of the room in meters.
const MAX_SCALE: f64 = 0.02;
const MAX_DEGREES: f64 = 2.0;
const MAX_METERS: f64 = 0.1;

/// Standard deviation of the verticals, degrees.
const UP_SD: f64 = 2.0;

/// Real scenes: file, name, source of the boxes, bound of the position in meters.
const SCENES: [(&str, &str, &str, f64); 4] = [
    ("lmo_A", "LM-O A, boxes of models", "model", 0.05),
    ("lmo_B", "LM-O B, boxes of models", "model", 0.05),
    ("lmo_A", "LM-O A, boxes of masks", "visible-mask", 0.05),
    ("lmo_B", "LM-O B, boxes of masks", "visible-mask", 0.05),
];

/// Directions across which the frames of a real scene are divided.
const DIVISIONS: u64 = 12;

/// Two maps, and where the second one truly lies.
pub(crate) struct TwoMaps {
    pub a: Vec<MapObject>,
    pub b: Vec<MapObject>,
    pub a_from_b: Similarity,
    pub up: [Unit<Vector3<f64>>; 2],
    /// A point in the middle, in the frame of A.
    pub middle: Point3<f64>,
}

/// What is known of the second map.
#[derive(Debug, Clone, Copy)]
struct Known {
    scale: bool,
    up: bool,
}

const KNOWN: [(&str, Known); 4] = [
    ("align, rigid", Known { scale: true, up: false }),
    ("align, rigid, up", Known { scale: true, up: true }),
    ("align, similarity", Known { scale: false, up: false }),
    ("align, similarity, up", Known { scale: false, up: true }),
];

/// How draws ended.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    draws: usize,
    right: usize,
    wrong: usize,
}

impl Tally {
    fn plus(self, other: Self) -> Self {
        Self { draws: self.draws + other.draws, right: self.right + other.right, wrong: self.wrong + other.wrong }
    }

    fn of(found: Option<&Similarity>, maps: &TwoMaps, bound: f64) -> Self {
        let is_right = found.is_some_and(|found| is_within(found, maps, bound));
        Self { draws: 1, right: usize::from(is_right), wrong: usize::from(found.is_some() && !is_right) }
    }

    fn share(&self, count: usize) -> f64 {
        count as f64 / self.draws.max(1) as f64
    }

    fn cells(&self) -> Vec<Cell> {
        let percent = |count: usize| Cell::number(100.0 * self.share(count), 1);
        let refused = self.draws - self.right - self.wrong;
        vec![Cell::number(self.draws as f64, 0), percent(self.right), percent(self.wrong), percent(refused)]
    }
}

const TITLES: [&str; 4] = ["draws", "right [%]", "wrong [%]", "refused [%]"];

fn is_within(found: &Similarity, maps: &TwoMaps, bound: f64) -> bool {
    let in_b = maps.a_from_b.inverse().point(&maps.middle);
    (found.scale / maps.a_from_b.scale).ln().abs() < MAX_SCALE
        && found.angle_to(&maps.a_from_b).to_degrees() < MAX_DEGREES
        && (found.point(&in_b) - maps.middle).norm() < bound
}

/// A similarity anywhere: any rotation, scales from 1/8 to 8.
fn any_similarity(rng: &mut ChaCha8Rng) -> Similarity {
    let axis = Unit::new_normalize(Vector3::from_fn(|_, _| normal(rng)));
    let rotation = Rotation3::from_axis_angle(&axis, rng.random_range(0.0..TAU));
    let scale = rng.random_range(-2.08f64..2.08).exp();
    Similarity { scale, rotation, translation: Vector3::from_fn(|_, _| rng.random_range(-20.0..20.0)) }
}

/// The objects that `quadlift localize` finds, with their categories.
fn map_of(scene: &Scene, options: &LocalizeOptions) -> Result<Vec<MapObject>, Error> {
    let found = localize(scene, options)?;
    let object = |estimate: &quadlift::solve::Estimate| {
        let category = estimate.category_index.map(|index| scene.categories[index].clone());
        MapObject::from_estimate(estimate, category)
    };
    Ok(found.estimates.iter().filter_map(object).collect())
}

/// Two maps of a room from its two halves; with `common` objects in both.
pub(crate) fn rooms(categories: usize, common: usize, seed: u64) -> Result<TwoMaps, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut all = room(categories, &mut rng);
    for k in (1..all.len()).rev() {
        all.swap(k, rng.random_range(0..=k));
    }
    let own = (all.len() - common) / 2;
    let of_a = &all[..common + own];
    let of_b: Vec<_> = all[..common].iter().chain(&all[common + own..]).copied().collect();
    let b_from_room = any_similarity(&mut rng);
    let scene_a = images(of_a, [0, FRAMES / 2], categories, &Similarity::identity(), &mut rng)?;
    let scene_b = images(&of_b, [FRAMES / 2, FRAMES], categories, &b_from_room, &mut rng)?;
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    let options = LocalizeOptions { seed, ..options.into() };
    Ok(TwoMaps {
        a: map_of(&scene_a, &options)?,
        b: map_of(&scene_b, &options)?,
        a_from_b: b_from_room.inverse(),
        up: [Vector3::z_axis(), b_from_room.direction(&Vector3::z_axis())],
        middle: Point3::new(0.0, 0.0, 0.9),
    })
}

/// Aligns the maps with what is known.
fn aligned(maps: &TwoMaps, known: Known) -> Option<Similarity> {
    let [up_in_a, up_in_b] = maps.up;
    let up = known.up.then_some(CommonUp { up_in_a, up_in_b, sd: UP_SD.to_radians() });
    let options = AlignOptions { scale: known.scale.then_some(maps.a_from_b.scale), up };
    let found = align(&maps.a, &maps.b, &options);
    found.transforms.first().filter(|_| found.status == AlignStatus::Ok).map(|best| best.a_from_b)
}

/// All methods on two maps: those of [`KNOWN`], then centers with the scale known and unknown.
fn tallies(maps: &TwoMaps, bound: f64, seed: u64) -> Vec<Tally> {
    let of_known = KNOWN.iter().map(|(_, known)| aligned(maps, *known));
    let scale = Some(maps.a_from_b.scale);
    let of_centers = [scale, None].map(|scale| align_by_centers(&maps.a, &maps.b, scale, seed));
    of_known.chain(of_centers).map(|found| Tally::of(found.as_ref(), maps, bound)).collect()
}

/// The names of the methods of [`tallies`].
fn methods() -> impl Iterator<Item = &'static str> {
    KNOWN.iter().map(|(name, _)| *name).chain(["centers, rigid", "centers, similarity"])
}

/// Sums of the tallies of each method.
fn summed(all: &[Vec<Tally>]) -> Vec<Tally> {
    (0..methods().count()).map(|k| all.iter().fold(Tally::default(), |sum, one| sum.plus(one[k]))).collect()
}

/// Adds the table of rooms.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", 2 * CATEGORIES.len(), run.progress);
    let (draws, other_draws) = (run.scenes(DRAWS), run.scenes(OTHER_DRAWS));
    report.text(format!(
        "Two maps of a room, made by `quadlift localize` from the {} images of one half of its walls and from those of the other half: no image is \
         common. Of the 30 objects {COMMON} (40 %) are in both maps, half of the others in each. The second map is moved by a rotation, a \
         translation and a scale from 1/8 to 8. Right: within {:.0} % of the scale, {MAX_DEGREES} degrees, and {MAX_METERS} m in the middle of the \
         room; wrong: beyond, with the status `ok`; refused: any other status. \"Rigid\": the scale is known; \"up\": the vertical is, to {UP_SD} \
         degrees. \"Centers\" is Umeyama's method on three centers of equal categories in RANSAC, written for this table: it claims what four \
         centers agree with. {draws} draws for each row. Of maps with nothing in common ({other_draws} draws) no answer is right.",
        FRAMES / 2,
        100.0 * MAX_SCALE,
    ));
    let titles = ["maps", "categories", "method"].into_iter().chain(TITLES);
    let mut table = Table::new("Maps of synthetic rooms from opposite sides", titles);
    let (mut least_right, mut most_wrong) = (1.0_f64, 0.0_f64);
    for (name, common, count) in [("40 % in common", COMMON, draws), ("nothing in common", 0, other_draws)] {
        for categories in CATEGORIES {
            let draw = |number: u64| {
                let seed = run.seed.wrapping_add(FIRST_SEED + number);
                Ok(tallies(&rooms(categories, common, seed)?, MAX_METERS, seed))
            };
            let draws = (0..count).into_par_iter().map(draw).collect::<Result<Vec<_>, Error>>()?;
            for (k, (method, tally)) in methods().zip(summed(&draws)).enumerate() {
                if k < KNOWN.len() {
                    most_wrong = most_wrong.max(tally.share(tally.wrong));
                    least_right = if common > 0 { least_right.min(tally.share(tally.right)) } else { least_right };
                }
                let labels = [name.to_owned(), categories.to_string(), method.to_owned()].map(Cell::from);
                table.push(labels.into_iter().chain(tally.cells()).collect());
            }
            steps.done();
        }
    }
    report.table(table);
    let headline = |id, what, value| Headline::ours(id, what, "align", value);
    report.headlines.push(headline("align_right", "share of pairs of maps that are aligned, the lowest", least_right));
    report.headlines.push(headline(
        "align_wrong",
        "share of pairs of maps that are wrongly aligned, the highest",
        most_wrong,
    ));
    Ok(())
}

/// Two maps from the frames of a scene on the two sides of a plane through its middle, across a horizontal direction.
fn sides(scene: &Scene, angle: f64, options: &LocalizeOptions, seed: u64) -> Result<TwoMaps, Error> {
    let up = scene.up.unwrap_or(Vector3::z_axis());
    let side = any_across(&up);
    let direction = side * angle.cos() + up.cross(&side) * angle.sin();
    let along = |k: usize| scene.frames[k].projection.center_in_world().unwrap_or_default().coords.dot(&direction);
    let mut order: Vec<usize> = (0..scene.frames.len()).collect();
    order.sort_by(|&p, &q| along(p).total_cmp(&along(q)));
    let mut is_of_a = vec![false; order.len()];
    order[..order.len() / 2].iter().for_each(|&k| is_of_a[k] = true);
    let half = |of_a: bool, to: &Similarity| -> Result<Vec<MapObject>, Error> {
        let mut half = scene.clone();
        half.edit(|parts| {
            parts.detections.retain(|d| is_of_a[d.frame_index as usize] == of_a && d.object_index.is_some());
            for frame in &mut parts.frames {
                let (pose, k) = (frame.projection.camera_pose(), frame.projection.intrinsics());
                if let (Some(Ok(pose)), Some(k)) = (pose.map(|pose| to.camera(&pose)), k) {
                    frame.projection = Projection::from_camera(&k, &pose);
                }
            }
            parts.up = parts.up.map(|up| to.direction(&up));
        })?;
        map_of(&half, options)
    };
    let b_from_a = any_similarity(&mut ChaCha8Rng::seed_from_u64(seed));
    let a = half(true, &Similarity::identity())?;
    let count = a.len().max(1) as f64;
    let middle = a.iter().fold(Vector3::zeros(), |sum, object| sum + object.ellipsoid.center.coords / count);
    Ok(TwoMaps {
        b: half(false, &b_from_a)?,
        a_from_b: b_from_a.inverse(),
        up: [up, b_from_a.direction(&up)],
        middle: middle.into(),
        a,
    })
}

/// Adds the table of real scenes.
pub(super) fn run_real(data: &Path, run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", SCENES.len(), run.progress);
    let divisions = run.scenes(DIVISIONS);
    report.text(format!(
        "The same with real scenes: two maps from the frames on the two sides of a plane through the middle of the cameras, in {divisions} \
         directions. Right: within {:.0} % of the scale, {MAX_DEGREES} degrees, and 5 cm in the middle of the objects.",
        100.0 * MAX_SCALE
    ));
    let mut table =
        Table::new("Maps of real scenes from two sides", ["scene", "objects", "method"].into_iter().chain(TITLES));
    for (file, name, source, bound) in SCENES {
        let mut scene = TrueScene::read(data, file, name)?.scene;
        let chosen = scene.source_index(Some(source)).map_err(LocalizeError::from)?;
        scene.edit(|parts| parts.detections.retain(|detection| detection.source_index == chosen))?;
        let options = LocalizeOptions { seed: run.seed, source: Some(source.to_owned()), ..Default::default() };
        let draw = |number: u64| {
            let angle = TAU / 2.0 * number as f64 / divisions as f64;
            let seed = run.seed.wrapping_add(FIRST_SEED + number);
            let maps = sides(&scene, angle, &options, seed)?;
            Ok((maps.a.len().min(maps.b.len()), tallies(&maps, bound, seed)))
        };
        let draws = (0..divisions).into_par_iter().map(draw).collect::<Result<Vec<_>, Error>>()?;
        let objects = draws.iter().map(|draw| draw.0).min().unwrap_or_default();
        let all: Vec<Vec<Tally>> = draws.into_iter().map(|draw| draw.1).collect();
        for (method, tally) in methods().zip(summed(&all)) {
            let labels = [name.to_owned(), objects.to_string(), method.to_owned()].map(Cell::from);
            table.push(labels.into_iter().chain(tally.cells()).collect());
        }
        steps.done();
    }
    report.table(table);
    Ok(())
}
