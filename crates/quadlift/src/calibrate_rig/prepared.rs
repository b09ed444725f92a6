//! The boxes of a rig in the coordinates of their cameras, and which may show the same body.

use nalgebra::Vector3;

use super::pairs::{Candidate, DEPTH_SD, SizedPoint};
use super::predicted::Shape;
use super::problem::{MeasuredBox, ShapePrior};
use super::{Rig, RigBox, RigCategory};
use crate::scene::{BORDER_TOLERANCE_PX, edges_at_border};
use crate::sorting::StableSort;

/// Half height over radius of upright bodies: that of people, with the standard deviation of the logarithm: arms, bags, stride.
const LOG_RATIO: f64 = 0.8;
const LOG_RATIO_SD: f64 = 0.4;

/// Half height of a body of unknown size: bodies are one high.
const UNKNOWN_LOG_HEIGHT: f64 = -std::f64::consts::LN_2;

/// What a box shows, as far as it is known: boxes of the same thing may show the same body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Thing {
    /// An object.
    Object(usize),
    /// Any body of a category, without an id.
    Category(usize),
}

/// A box that is used.
#[derive(Debug, Clone)]
pub(super) struct PreparedBox {
    pub camera: usize,
    pub thing: Thing,
    pub category: usize,
    /// Instant; bodies that stand still have one alone.
    pub time_step: Option<usize>,
    /// The time step, of bodies that stand still, too.
    pub taken_at: usize,
    pub measured: MeasuredBox,
    /// Where the body is by the size of its box; not where the image cuts it off.
    pub point: Option<SizedPoint>,
}

/// A rig, prepared. Boxes without a category have one of their own, the last one.
#[derive(Debug, Clone)]
pub(super) struct Prepared<'a> {
    pub rig: &'a Rig,
    pub boxes: Vec<PreparedBox>,
    pub categories: Vec<RigCategory>,
    /// Of each category.
    pub shapes: Vec<ShapePrior>,
}

/// What is known of the shapes of a category.
fn shape_prior(category: usize, of: &RigCategory) -> ShapePrior {
    let log_height = of.size.map(|size| {
        let [length, width, height] = size.mean;
        if of.upright {
            [(0.5 * height).ln(), size.sd[2] / height]
        } else {
            // A ball whose box is as large on the average.
            let mean = (length * width * height).cbrt();
            [(0.5 * mean).ln(), (0..3).map(|k| size.sd[k] / size.mean[k]).fold(0.1, f64::max)]
        }
    });
    let ratio = of.size.map_or(LOG_RATIO, |size| (2.0 * size.mean[2] / (size.mean[0] + size.mean[1])).ln());
    ShapePrior { category, upright: of.upright, log_height, log_ratio: [ratio, LOG_RATIO_SD] }
}

impl ShapePrior {
    /// Whether bodies are wider than high, as vehicles are: their widths depend on the side from which they are seen.
    pub(super) fn is_wide(&self) -> bool {
        self.upright && self.log_ratio[0] < 0.0
    }

    /// The extent of a shape that tells how far it is.
    pub(super) fn extent(&self, shape: Shape) -> f64 {
        if self.is_wide() { shape.log_height.exp() } else { shape.extent() }
    }

    /// The usual shape.
    pub(super) fn usual(&self) -> Shape {
        let log_height = self.log_height.map_or(UNKNOWN_LOG_HEIGHT, |[mean, _]| mean);
        let log_radius = if self.upright { log_height - self.log_ratio[0] } else { log_height };
        Shape { log_radius, log_height, exponent: 2.0 }
    }
}

impl<'a> Prepared<'a> {
    pub(super) fn new(rig: &'a Rig) -> Self {
        let mut categories = rig.categories.clone();
        categories.push(RigCategory::default());
        let shapes: Vec<ShapePrior> = categories.iter().enumerate().map(|(k, of)| shape_prior(k, of)).collect();
        let prepare = |given: &RigBox| {
            let camera = rig.cameras.get(given.camera)?;
            let category = given.category.filter(|&k| k < rig.categories.len()).unwrap_or(rig.categories.len());
            let (k, b) = (&camera.intrinsics, &given.bounding_box);
            let pixels = b.edges();
            let in_image = given.box_in_image.as_ref().unwrap_or(b);
            let pixel = [1.0 / k.fx, 1.0 / k.fy];
            let middle = [k.cx, k.cy];
            let measured = MeasuredBox {
                edges: std::array::from_fn(|e| (pixels[e] - middle[e % 2]) * pixel[e % 2]),
                cut_off: edges_at_border(in_image, camera.image_size, BORDER_TOLERANCE_PX),
                size: pixel.map(|pixel| b.mean_half_size() * pixel),
                pixel,
            };
            let thing = given.object.map_or(Thing::Category(category), Thing::Object);
            // Still bodies without ids cannot be told from those of the next time step: they are taken as new ones.
            let still = categories[category].still && given.object.is_some();
            let point = measured.is_whole().then(|| sized_point(&measured, &shapes[category])).flatten();
            let time_step = (!still).then_some(given.time_step);
            let taken_at = given.time_step;
            Some(PreparedBox { camera: given.camera, thing, category, time_step, taken_at, measured, point })
        };
        let mut boxes: Vec<PreparedBox> = rig.boxes.iter().filter_map(prepare).collect();
        // The order of the input does not matter.
        boxes.stable_sort_by(|a, b| {
            let edges = || a.measured.edges.iter().zip(&b.measured.edges).map(|(a, b)| a.total_cmp(b));
            let key = |b: &PreparedBox| (b.time_step, b.thing, b.camera);
            key(a).cmp(&key(b)).then_with(|| edges().find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal))
        });
        Self { rig, boxes, categories, shapes }
    }

    /// Pairs of boxes of two cameras that may show the same body, ordered by time steps; bodies that stand still have time steps of their
    /// own. With a `shift` the boxes of the second camera are those of that many time steps later, so that they agree by chance alone.
    pub(super) fn candidates(&self, first: usize, second: usize, shift: usize) -> Vec<Candidate> {
        let time_steps: Vec<&[PreparedBox]> = self.by_time_step().collect();
        let firsts: Vec<usize> =
            time_steps.iter().scan(0, |sum, group| Some(std::mem::replace(sum, *sum + group.len()))).collect();
        let of_camera = |number: usize, camera: usize| {
            let group = time_steps[number].iter().enumerate().filter(move |(_, b)| b.camera == camera);
            let first = firsts[number];
            group.filter_map(move |(k, b)| Some((first + k, b, b.point?)))
        };
        let mut all = Vec::new();
        for number in 0..time_steps.len() {
            let is_still = time_steps[number].first().is_some_and(|b| b.time_step.is_none());
            for (a, of_a, point_a) in of_camera(number, first) {
                for (b, of_b, point_b) in of_camera((number + shift) % time_steps.len(), second) {
                    if of_a.thing == of_b.thing {
                        all.push(Candidate { time_step: number, boxes: [a, b], points: [point_a, point_b] });
                        if is_still {
                            break;
                        }
                    }
                }
                // Of a body that stands still one box of each camera says where it is.
                if is_still {
                    break;
                }
            }
        }
        all
    }

    /// Number of time steps; each body that stands still counts as one.
    pub(super) fn time_steps(&self) -> usize {
        self.by_time_step().count()
    }

    fn by_time_step(&self) -> impl Iterator<Item = &[PreparedBox]> {
        let key = |b: &PreparedBox| (b.time_step, b.time_step.is_none().then_some(b.thing));
        self.boxes.chunk_by(move |a, b| key(a) == key(b))
    }
}

/// Of a body at depth Z the squared half sizes of its box add up to the square of its extent over that of Z, near the axis of the camera.
/// Of wide bodies only the height says how far they are.
fn sized_point(measured: &MeasuredBox, prior: &ShapePrior) -> Option<SizedPoint> {
    let [width, height] = measured.half_size();
    let extent = prior.extent(prior.usual());
    let depth = extent / if prior.is_wide() { height } else { width.hypot(height) };
    let [x, y] = measured.center();
    let place = Vector3::new(x, y, 1.0) * depth;
    place.iter().all(|x| x.is_finite()).then_some(SizedPoint { place, extent, depth_sd: DEPTH_SD })
}
