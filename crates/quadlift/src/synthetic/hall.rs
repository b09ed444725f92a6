//! Halls with fixed cameras in which people walk (ours): boxes of each camera at the same time steps.

use std::f64::consts::TAU;

use nalgebra::{Matrix3x4, Point3, Rotation3, Unit, Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::calibrate_rig::{Rig, RigBox, RigCamera, RigCategory};
use crate::geometry::{
    BoundingBox, CamFromWorld, CameraError, Ellipsoid, Intrinsics, Projection, project_bounding_box,
};
use crate::random;
use crate::solve::SizePrior;

/// Size of the hall, meters.
const LENGTH: f64 = 8.0;
const WIDTH: f64 = 6.0;

/// Image size and focal length, pixels.
const IMAGE: [u32; 2] = [1280, 720];
const FOCAL: f64 = 800.0;

/// Speed of walking, meters for each second.
const SPEED: f64 = 1.2;

/// Streams of the seed.
const CAMERA_STREAM: u64 = 0;
const WALKER_STREAM: u64 = 1;
const BOX_STREAM: u64 = 2;

/// Where people walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WalkPath {
    /// From place to place in the hall.
    #[default]
    Anywhere,
    /// To and fro on one line.
    Line,
    /// Each stands in one place.
    Spot,
}

/// Options of a hall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HallOptions {
    /// Seed of the random numbers; cameras, paths and boxes have independent streams.
    pub seed: u64,
    /// Number of cameras: at the walls, 2.5 to 3 m high, evenly around from a random direction on (two: 60 to 150 degrees apart).
    pub cameras: usize,
    /// Number of people, 1.55 to 1.95 m high.
    pub pedestrians: usize,
    /// Number of time steps.
    pub time_steps: usize,
    /// Time between them, seconds.
    pub interval: f64,
    /// Where people walk.
    pub path: WalkPath,
    /// Standard deviation of the edges of boxes, in mean half sizes.
    pub edge_noise: f64,
    /// Probability that a person in the image is not detected.
    pub misses: f64,
    /// Mean number of false boxes for each box.
    pub false_boxes: f64,
    /// Whether boxes have the ids of people; false boxes have none.
    pub ids: bool,
}

impl Default for HallOptions {
    /// Four cameras and one person at 100 time steps, half a second apart, boxes without errors, with ids.
    fn default() -> Self {
        Self {
            seed: 0,
            cameras: 4,
            pedestrians: 1,
            time_steps: 100,
            interval: 0.5,
            path: WalkPath::Anywhere,
            edge_noise: 0.0,
            misses: 0.0,
            false_boxes: 0.0,
            ids: true,
        }
    }
}

/// A box in a hall.
#[derive(Debug, Clone, PartialEq)]
pub struct HallBox {
    /// Index of the camera.
    pub camera: usize,
    /// Number of the time step.
    pub time_step: usize,
    /// Number of the person; none of false boxes, or where ids are not wanted.
    pub object: Option<usize>,
    /// The box, cut off at the border of the image, pixels.
    pub bounding_box: BoundingBox,
}

/// A hall: the truth and what its cameras see. The world is in meters, z upwards, with the floor at zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Hall {
    /// The intrinsics of every camera.
    pub intrinsics: Intrinsics,
    /// Width and height of the images, pixels.
    pub image_size: [u32; 2],
    /// The true poses.
    pub cameras: Vec<CamFromWorld>,
    /// The boxes, by time steps and cameras.
    pub boxes: Vec<HallBox>,
}

impl Hall {
    /// What a calibration gets: the boxes as those of one category of upright bodies, with its size if that is known.
    pub fn rig(&self, size: Option<SizePrior>) -> Rig {
        let [width, height] = self.image_size.map(f64::from);
        let camera = || RigCamera {
            intrinsics: self.intrinsics,
            image_size: Some(Vector2::new(width, height)),
            cam_from_world: None,
        };
        let rig_box = |b: &HallBox| RigBox {
            camera: b.camera,
            time_step: b.time_step,
            object: b.object,
            category: Some(0),
            bounding_box: b.bounding_box,
            box_in_image: None,
        };
        Rig {
            cameras: self.cameras.iter().map(|_| camera()).collect(),
            categories: vec![RigCategory { upright: true, still: false, size }],
            boxes: self.boxes.iter().map(rig_box).collect(),
            up: None::<Unit<Vector3<f64>>>,
        }
    }
}

/// A camera at the wall in a direction from the middle of the hall.
fn camera(azimuth: f64, rng: &mut ChaCha8Rng) -> Result<CamFromWorld, CameraError> {
    let eye = Point3::new(0.6 * LENGTH * azimuth.cos(), 0.6 * WIDTH * azimuth.sin(), rng.random_range(2.5..3.0));
    let target = Point3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 1.0);
    let z = (target - eye).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    // Nobody mounts a camera exactly level.
    let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.05 * random::normal(rng));
    let level = nalgebra::Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
    let rotation = roll.matrix() * level;
    let mut matrix = Matrix3x4::zeros();
    matrix.fixed_columns_mut::<3>(0).copy_from(&rotation);
    matrix.set_column(3, &-(rotation * eye.coords));
    CamFromWorld::new(matrix)
}

/// A person on the way.
#[derive(Debug, Clone)]
struct Walker {
    /// Semi-axes of the body: half the width of shoulders and arms, half the depth, half the height.
    semi_axes: Vector3<f64>,
    place: Vector2<f64>,
    target: Vector2<f64>,
    heading: f64,
}

fn anywhere(rng: &mut ChaCha8Rng) -> Vector2<f64> {
    let (x, y) = (0.4 * LENGTH, 0.4 * WIDTH);
    Vector2::new(rng.random_range(-x..x), rng.random_range(-y..y))
}

impl Walker {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        let semi_axes =
            Vector3::new(rng.random_range(0.26..0.36), rng.random_range(0.2..0.28), rng.random_range(0.775..0.975));
        let (place, target) = (anywhere(rng), anywhere(rng));
        Self { semi_axes, place, target, heading: rng.random_range(0.0..TAU) }
    }

    fn walk(&mut self, path: WalkPath, by: f64, line: &[Vector2<f64>; 2], rng: &mut ChaCha8Rng) {
        let mut left = by;
        while left > 0.0 && path != WalkPath::Spot {
            let way = self.target - self.place;
            self.heading = way.y.atan2(way.x) + 0.5 * TAU / 2.0;
            if way.norm() > left {
                self.place += way.normalize() * left;
                break;
            }
            left -= way.norm().max(1e-3);
            self.place = self.target;
            self.target = match path {
                WalkPath::Anywhere => anywhere(rng),
                _ if (self.place - line[0]).norm() < 1e-6 => line[1],
                _ => line[0],
            };
        }
    }

    fn body(&self) -> Ellipsoid {
        Ellipsoid {
            center: Point3::new(self.place.x, self.place.y, self.semi_axes.z),
            semi_axes: self.semi_axes,
            rotation: Rotation3::from_axis_angle(&Vector3::z_axis(), self.heading),
        }
    }
}

/// Makes a hall: the same options always give the same hall.
///
/// # Errors
/// [`CameraError`]: never for numbers in their ranges.
pub fn generate_hall(options: &HallOptions) -> Result<Hall, CameraError> {
    let [width, height] = IMAGE.map(f64::from);
    let intrinsics = Intrinsics::new(FOCAL, FOCAL, 0.5 * width, 0.5 * height)?;
    let mut rng = random::stream(options.seed, CAMERA_STREAM);
    let first = rng.random_range(0.0..TAU);
    let apart = if options.cameras == 2 { rng.random_range(1.0..2.6) } else { TAU / options.cameras.max(1) as f64 };
    let azimuths = (0..options.cameras).map(|k| first + apart * k as f64);
    let cameras = azimuths.map(|azimuth| camera(azimuth, &mut rng)).collect::<Result<Vec<_>, _>>()?;
    let projections: Vec<Projection> = cameras.iter().map(|pose| Projection::from_camera(&intrinsics, pose)).collect();

    let mut rng = random::stream(options.seed, WALKER_STREAM);
    let line = [anywhere(&mut rng), anywhere(&mut rng)];
    let mut pedestrians: Vec<Walker> = (0..options.pedestrians).map(|_| Walker::new(&mut rng)).collect();
    if options.path == WalkPath::Line {
        for walker in &mut pedestrians {
            walker.place = line[0] + (line[1] - line[0]) * rng.random_range(0.0..1.0);
            walker.target = line[1];
        }
    }
    let mut of_boxes = random::stream(options.seed, BOX_STREAM);
    let mut boxes = Vec::new();
    for time_step in 0..options.time_steps {
        for (camera, projection) in projections.iter().enumerate() {
            for (object, walker) in pedestrians.iter().enumerate() {
                let exact = project_bounding_box(projection, &walker.body());
                let Some(found) = exact.ok().and_then(|exact| detected(&exact, options, &mut of_boxes)) else {
                    continue;
                };
                let object = options.ids.then_some(object);
                boxes.push(HallBox { camera, time_step, object, bounding_box: found });
                if of_boxes.random_range(0.0..1.0) < options.false_boxes {
                    let size = of_boxes.random_range(20.0..150.0);
                    let (x, y) = (of_boxes.random_range(0.0..width - size), of_boxes.random_range(0.0..height - size));
                    if let Ok(bounding_box) = BoundingBox::new([x, y, x + 0.5 * size, y + size]) {
                        boxes.push(HallBox { camera, time_step, object: None, bounding_box });
                    }
                }
            }
        }
        for walker in &mut pedestrians {
            walker.walk(options.path, SPEED * options.interval, &line, &mut rng);
        }
    }
    Ok(Hall { intrinsics, image_size: IMAGE, cameras, boxes })
}

/// The box of a person, with its errors, if most of it is in the image and it is not missed.
fn detected(exact: &BoundingBox, options: &HallOptions, rng: &mut ChaCha8Rng) -> Option<BoundingBox> {
    let [width, height] = IMAGE.map(f64::from);
    let center = exact.center();
    let missed = rng.random_range(0.0..1.0) < options.misses;
    let sd = options.edge_noise * exact.mean_half_size();
    let noise: [f64; 4] = std::array::from_fn(|_| sd * random::normal(rng));
    let inside = center.x > 0.0 && center.x < width && center.y > 0.0 && center.y < height;
    if !inside || missed {
        return None;
    }
    let edges = exact.edges();
    let most = [width, height];
    BoundingBox::new(std::array::from_fn(|k| (edges[k] + noise[k]).clamp(0.0, most[k % 2]))).ok()
}
