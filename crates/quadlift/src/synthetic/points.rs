//! Points of the surfaces about the objects, tracked through images.

use nalgebra::{Point3, Vector2, Vector3};
use rand::RngExt;

use super::objects::Object;
use super::options::SyntheticOptions;
use crate::geometry::Projection;
use crate::random;

const POINT_STREAM: u64 = 50;

/// Standard deviation of the place of a point about an object, relative to the mean semi-axis of the object.
const AROUND: f64 = 2.0;

/// Fewest and most frames, of those that follow each other with the point in their images, through which a point is tracked.
const SHORTEST: usize = 3;
const LONGEST: usize = 20;

/// A point in the world before it is scaled and moved, and where frames saw it.
pub(super) struct SimulatedPoint {
    pub position: Point3<f64>,
    pub observed: Vec<(usize, [f64; 2])>,
}

/// Draws the points that the exact cameras see; points that too few of them see are left out.
pub(super) fn track_points(
    options: &SyntheticOptions,
    objects: &[Object],
    projections: &[Projection],
    image_size: [u32; 2],
) -> Vec<SimulatedPoint> {
    let mut rng = random::stream(options.seed, POINT_STREAM);
    let size = Vector2::from(image_size.map(f64::from));
    let mut points = Vec::new();
    for _ in 0..if objects.is_empty() { 0 } else { options.points } {
        let object = &objects[rng.random_range(0..objects.len())];
        let offset = Vector3::from_fn(|_, _| AROUND * random::normal(&mut rng)) * object.semi_axes.mean();
        let position = object.center + offset;
        let pixel = |projection: &Projection| {
            let pixel = projection.project_point(&position)?;
            let is_inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < size.x && pixel.y < size.y;
            (is_inside && projection.depth(&position) <= options.trajectory.range()).then_some(pixel)
        };
        let seen: Vec<(usize, Vector2<f64>)> =
            projections.iter().enumerate().filter_map(|(k, projection)| Some((k, pixel(projection)?))).collect();
        if seen.len() < SHORTEST {
            continue;
        }
        let length = rng.random_range(SHORTEST..=LONGEST).min(seen.len());
        let first = rng.random_range(0..=seen.len() - length);
        let observed = seen[first..first + length].iter().map(|(frame, exact)| {
            let is_mismatch = rng.random_bool(options.point_mismatches);
            let wrong = Vector2::new(rng.random_range(0.0..size.x), rng.random_range(0.0..size.y));
            let noise = Vector2::new(random::normal(&mut rng), random::normal(&mut rng)) * options.point_noise;
            (*frame, if is_mismatch { wrong } else { exact + noise }.into())
        });
        points.push(SimulatedPoint { position, observed: observed.collect() });
    }
    points
}
