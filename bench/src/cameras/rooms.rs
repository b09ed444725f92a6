//! Synthetic rooms: maps of 30 objects in few or many categories, boxes with noise, misses and false boxes.

use std::f64::consts::TAU;

use quadlift::LocalizeOptions;
use quadlift::geometry::BodyKind;
use quadlift::geometry::{
    BoundingBox, CamFromWorld, Ellipsoid, Intrinsics, Projection, Similarity, project_bounding_box,
};
use quadlift::nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};
use quadlift::scene::{NewDetection, Scene, SceneBuilder};
use quadlift::solve::PosteriorOptions;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use super::images::{Known, Split, TITLES, Tally, divide, located, located_by_centers};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::table::{Cell, Table};

/// Objects of a room, images of it, and rooms of each row.
const OBJECTS: usize = 30;
pub(super) const FRAMES: usize = 40;
const ROOMS: u64 = 10;

/// Categories of the objects.
pub(super) const CATEGORIES: [usize; 4] = [30, 6, 3, 1];

/// Standard deviation of the edges of the boxes, in mean half sizes.
const EDGE_NOISE: f64 = 0.03;

/// Share of objects without a box, and of boxes beside which there is a false one.
const MISSES: f64 = 0.2;
const FALSE_BOXES: f64 = 0.2;

/// Image size and focal length, pixels.
const WIDTH: f64 = 1280.0;
const HEIGHT: f64 = 720.0;
const FOCAL: f64 = 900.0;

/// Bound of the position, meters, and objects of the map that an image shows at least.
const BOUND: f64 = 0.1;
const FEWEST: usize = 4;

const FIRST_SEED: u64 = 271;

/// A room of 8 x 6 m with z upwards.
pub(super) fn room(categories: usize, rng: &mut ChaCha8Rng) -> Vec<(Ellipsoid, usize)> {
    let sizes: Vec<Vector3<f64>> = (0..categories)
        .map(|_| Vector3::from_fn(|_, _| rng.random_range(0.6..1.0)) * rng.random_range(0.1..0.4))
        .collect();
    let object = |k: usize| {
        let category = k % categories;
        let center = Point3::new(rng.random_range(-4.0..4.0), rng.random_range(-3.0..3.0), rng.random_range(0.2..1.6));
        let semi_axes = sizes[category].map(|x| x * rng.random_range(0.9..1.1));
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..TAU));
        (Ellipsoid { center, semi_axes, rotation }, category)
    };
    (0..OBJECTS).map(object).collect()
}

/// A camera at the walls, so far around the room, at the height of a person.
fn camera(angle: f64, rng: &mut ChaCha8Rng) -> Result<CamFromWorld, Error> {
    let eye = Point3::new(6.0 * angle.cos(), 5.0 * angle.sin(), rng.random_range(1.3..1.9));
    let target = Point3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.8);
    let z = (target - eye).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let mut matrix = Matrix3x4::zeros();
    for (row, axis) in [x, z.cross(&x), z].iter().enumerate() {
        matrix.fixed_view_mut::<1, 3>(row, 0).copy_from(&axis.transpose());
        matrix[(row, 3)] = -axis.dot(&eye.coords);
    }
    Ok(CamFromWorld::new(matrix)?)
}

/// Images of a room.
pub(crate) fn scene(categories: usize, seed: u64) -> Result<Scene, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let objects = room(categories, &mut rng);
    images(&objects, [0, FRAMES], categories, &Similarity::identity(), &mut rng)
}

/// The images with these numbers, the second one excluded, of the [`FRAMES`] around a room, in a world that is that of the room, moved; objects have
/// ids, false boxes none.
pub(super) fn images(
    objects: &[(Ellipsoid, usize)],
    [first, end]: [usize; 2],
    categories: usize,
    world_from_room: &Similarity,
    rng: &mut ChaCha8Rng,
) -> Result<Scene, Error> {
    let intrinsics = Intrinsics::new(FOCAL, FOCAL, WIDTH / 2.0, HEIGHT / 2.0)?;
    let mut builder = SceneBuilder::new("room");
    builder.up((world_from_room.rotation * Vector3::z()).into())?;
    for frame in first..end {
        let pose = camera(TAU * frame as f64 / FRAMES as f64, rng)?;
        let projection = Projection::from_camera(&intrinsics, &pose);
        let frame = frame.to_string();
        let moved = Projection::from_camera(&intrinsics, &world_from_room.camera(&pose)?);
        builder.add_frame(&frame, moved, Some([WIDTH, HEIGHT]))?;
        for (index, (body, category)) in objects.iter().enumerate() {
            let Ok(exact) = project_bounding_box(&projection, body) else { continue };
            let center = exact.center();
            let inside = center.x > 0.0 && center.x < WIDTH && center.y > 0.0 && center.y < HEIGHT;
            if !inside || rng.random_range(0.0..1.0) < MISSES {
                continue;
            }
            let sd = EDGE_NOISE * exact.mean_half_size();
            let mut edge = |at: f64, most: f64| (at + sd * normal(rng)).clamp(0.0, most);
            let edges =
                [edge(exact.x0(), WIDTH), edge(exact.y0(), HEIGHT), edge(exact.x1(), WIDTH), edge(exact.y1(), HEIGHT)];
            let (id, category) = (index.to_string(), category.to_string());
            let mut add = |object: Option<&str>, category: &str, edges: [f64; 4]| -> Result<(), Error> {
                let Ok(bounding_box) = BoundingBox::new(edges) else { return Ok(()) };
                let input = NewDetection {
                    frame: &frame,
                    object,
                    category: Some(category),
                    bounding_box: Some(bounding_box),
                    ..Default::default()
                };
                builder.add_detection(&input)?;
                Ok(())
            };
            add(Some(&id), &category, edges)?;
            if rng.random_range(0.0..1.0) < FALSE_BOXES {
                let (x, y) = (rng.random_range(0.0..WIDTH - 100.0), rng.random_range(0.0..HEIGHT - 100.0));
                let size = rng.random_range(20.0..100.0);
                add(None, &rng.random_range(0..categories).to_string(), [x, y, x + size, y + size])?;
            }
        }
    }
    Ok(builder.build())
}

/// A number with the standard normal distribution (Box and Muller).
pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random_range(0.0..TAU));
    (-2.0 * a.ln()).sqrt() * b.cos()
}

/// Adds the table.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", CATEGORIES.len() * Split::ALL.len(), run.progress);
    let count = run.scenes(ROOMS);
    report.text(format!(
        "Maps of {OBJECTS} objects in rooms of 8 x 6 m, made by `quadlift localize` from half of {FRAMES} images around the room (every \
         second one, or those of one side); the other images are located without ids. Boxes have {EDGE_NOISE} of their half size of noise, \
         {MISSES} of the objects have none, and beside {FALSE_BOXES} of them there is a false one. Objects of one category have sizes \
         within 10 %. Right: within {BOUND} m and 5 degrees, of the images with {FEWEST} objects of the map and more; wrong: beyond, with the \
         status `ok`; refused: any other status. {count} rooms for each row. \"Centers\" is P3P with RANSAC over the centers of boxes and \
         objects, written for this table; gravity is known to one degree."
    ));
    let titles = ["map from", "categories", "method"].into_iter().chain(TITLES);
    let mut table = Table::new("Images located in synthetic rooms", titles);
    let (mut least_right, mut most_wrong) = (1.0_f64, 0.0_f64);
    for split in Split::ALL {
        for categories in CATEGORIES {
            let of_room = |number: u64| -> Result<[Tally; 3], Error> {
                let seed = run.seed.wrapping_add(FIRST_SEED + number);
                let scene = scene(categories, seed)?;
                let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
                let all = divide(&scene, split, &LocalizeOptions { seed, ..options.into() })?;
                Ok([
                    located(&all, Known::Nothing, FEWEST, BOUND),
                    located(&all, Known::Gravity, FEWEST, BOUND),
                    located_by_centers(&all, FEWEST, BOUND, seed),
                ])
            };
            let rooms = (0..count).into_par_iter().map(of_room).collect::<Result<Vec<_>, _>>()?;
            let all = |k: usize| rooms.iter().fold(Tally::default(), |sum, of_room| sum.plus(of_room[k]));
            (least_right, most_wrong) = (0..2).map(all).fold((least_right, most_wrong), |(right, wrong), tally| {
                let share = |n: usize| n as f64 / tally.images.max(1) as f64;
                (share(tally.right).min(right), share(tally.wrong).max(wrong))
            });
            for (k, method) in ["relocalize", "relocalize, gravity", "centers"].into_iter().enumerate() {
                let tally = all(k);
                let labels = [split.name().to_owned(), categories.to_string(), method.to_owned()].map(Cell::from);
                table.push(labels.into_iter().chain(tally.cells()).collect());
            }
            steps.done();
        }
    }
    report.table(table);
    let headline = |id, what, value| Headline::ours(id, what, "relocalize", value);
    report.headlines.push(headline(
        "cameras_right",
        "share of images of rooms that are located, the lowest",
        least_right,
    ));
    report.headlines.push(headline(
        "cameras_wrong",
        "share of images of rooms that are wrongly located, the highest",
        most_wrong,
    ));
    Ok(())
}
