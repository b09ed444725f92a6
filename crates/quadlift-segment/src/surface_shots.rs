//! Simulated images of known bodies before walls, on the ground and behind other things; the depths are those of rays.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use quadlift::geometry::BoundingBox;
use quadlift::random::{normal, stream};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::depth_image::DepthImage;
use crate::mask::Mask;
use crate::surface::{Patch, median};

/// Pixels along each side of the simulated images, and half the angle (tangent) that they cover.
pub(crate) const SIDE: u32 = 120;
const HALF_ANGLE: f64 = 0.75;

/// World units of one count.
pub(crate) const SCALE: f64 = 5e-4;

/// A cuboid or an ellipsoid.
struct Solid {
    center: Point3<f64>,
    axes: Matrix3<f64>,
    half: Vector3<f64>,
    is_round: bool,
}

impl Solid {
    /// How far along a ray it begins and ends.
    fn hit(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<[f64; 2]> {
        let o = (self.axes.transpose() * (from - self.center)).component_div(&self.half);
        let d = (self.axes.transpose() * direction).component_div(&self.half);
        if self.is_round {
            let (a, b, c) = (d.norm_squared(), d.dot(&o), o.norm_squared() - 1.0);
            let root = (b * b - a * c).max(0.0).sqrt();
            return (root > 0.0).then(|| [-b - root, -b + root].map(|x| x / a));
        }
        let slabs = (0..3).map(|k| {
            let ends = [(-1.0 - o[k]) / d[k], (1.0 - o[k]) / d[k]];
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        });
        let [near, far] = slabs.fold([0.0f64, f64::INFINITY], |r, s| [r[0].max(s[0]), r[1].min(s[1])]);
        (near < far).then_some([near, far])
    }
}

/// A depth image of a body, its mask and box, and the true median depth of its visible surface.
pub(crate) struct Shot {
    pub image: DepthImage,
    pub mask: Mask,
    pub bounding_box: BoundingBox,
    pub half_size: f64,
    pub truth: f64,
    /// The depths of all surfaces along the ray of a pixel, also hidden ones, row by row.
    pub all: Vec<Vec<f64>>,
}

/// A body at the origin's place on the ground or above it, a wall behind, and in three of ten images something before a part of it.
pub(crate) fn shot(rng: &mut ChaCha8Rng) -> Option<Shot> {
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let half = Vector3::from_fn(|_, _| uniform(-0.7, 0.7).exp());
    let solid = Solid {
        center: Point3::new(0.0, 0.0, half.z),
        axes: *Rotation3::from_axis_angle(&Vector3::z_axis(), uniform(0.0, 6.3)).matrix(),
        half,
        is_round: uniform(0.0, 1.0) < 0.5,
    };
    let ground = if uniform(0.0, 1.0) < 0.3 { -uniform(0.5, 6.0) } else { 0.0 };
    let (distance, elevation) = (uniform(4.0, 16.0), uniform(0.05, 0.8));
    let camera = solid.center + Vector3::new(elevation.cos(), 0.0, elevation.sin()) * distance;
    let axis = (solid.center - camera).normalize();
    let right = axis.cross(&Vector3::z()).normalize();
    let down = axis.cross(&right);
    let wall = distance + if uniform(0.0, 1.0) < 0.5 { uniform(1.5, 4.0) } else { uniform(3.0, 25.0) };
    let occluder = (uniform(0.0, 1.0) < 0.3).then(|| (distance * uniform(0.4, 0.9), uniform(-0.8, 0.1)));
    // The tangent of the angle of half the image: the body fills a part of it.
    let reach = (half.norm() / distance).min(HALF_ANGLE) * 1.3;
    let focal = 0.5 * f64::from(SIDE) / reach;
    let direction = |x: u32, y: u32| {
        let tangent = |k: u32| (f64::from(k) + 0.5 - 0.5 * f64::from(SIDE)) / focal;
        axis + right * tangent(x) + down * tangent(y)
    };
    let solid_at = |x: u32, y: u32| solid.hit(&camera, &direction(x, y));
    let body = |x: u32, y: u32| solid_at(x, y).map(|[near, _]| near);
    let mut whole: Vec<f64> = (0..SIDE * SIDE).filter_map(|k| body(k % SIDE, k / SIDE)).collect();
    let truth = median(&mut whole)?;
    let outline = Mask::from_fn(SIDE, SIDE, |x, y| body(x, y).is_some());
    let exact = outline.bounding_box()?;
    let half_side = 0.25 * exact.size().sum();
    let [x0, y0, x1, y1] = [exact.x0(), exact.y0(), exact.x1(), exact.y1()].map(|e| e + 0.03 * half_side * normal(rng));
    let bounding_box = BoundingBox::new([x0, y0, x1, y1]).ok()?;
    let hides = |x: u32| {
        let across = 2.0 * (f64::from(x) - exact.center().x) / exact.size().x;
        occluder.filter(|(_, edge)| across < *edge).map(|(depth, _)| depth)
    };
    let (mut counts, mut all) = (Vec::new(), Vec::new());
    for k in 0..SIDE * SIDE {
        let (x, y) = (k % SIDE, k / SIDE);
        let d = direction(x, y);
        let floor = (ground - camera.z) / d.z;
        let behind = if floor > 0.0 { floor.min(wall) } else { wall };
        let depth = hides(x).unwrap_or(body(x, y).unwrap_or(behind).min(behind)) * (1.0 + 0.01 * normal(rng));
        all.push(hides(x).into_iter().chain(solid_at(x, y).into_iter().flatten()).chain([behind]).collect());
        let is_known = rng.random_range(0.0..1.0) > 0.1;
        counts.push(if is_known { (depth / SCALE).round() as u16 } else { 0 });
    }
    let mask = Mask::from_fn(SIDE, SIDE, |x, y| hides(x).is_none() && body(x, y).is_some());
    (mask.count() > 125).then_some(())?;
    let image = DepthImage::new(SIDE, SIDE, counts, SCALE).ok()?;
    Some(Shot { image, mask, bounding_box, half_size: 0.25 * bounding_box.size().sum() / focal, truth, all })
}

pub(crate) fn patch<'a>(shot: &'a Shot, mask: Option<&'a Mask>) -> Patch<'a> {
    Patch { bounding_box: shot.bounding_box, mask, image_size: [f64::from(SIDE); 2], half_size: shot.half_size }
}

/// Median, 68 %, 90 % and 95 % of errors in half sizes of the object.
pub(crate) fn quantiles(shots: &[Shot], depth: impl Fn(&Shot) -> f64) -> [f64; 4] {
    let error = |shot: &Shot| (depth(shot) / shot.truth - 1.0).abs() / shot.half_size;
    let mut errors: Vec<f64> = shots.iter().map(error).collect();
    errors.sort_by(f64::total_cmp);
    [0.5, 0.683, 0.9, 0.95].map(|share| errors[(share * errors.len() as f64) as usize])
}

pub(crate) fn shots() -> Vec<Shot> {
    (0..300).filter_map(|seed| shot(&mut stream(seed, 70))).collect()
}
