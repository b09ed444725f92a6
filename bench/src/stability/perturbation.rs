//! Changes of a scene that leave its objects as they are.

use quadlift::LocalizeOptions;
use quadlift::geometry::{BoundingBox, Projection};
use quadlift::nalgebra::{Matrix3x4, Point3, Rotation3, Unit, Vector3};
use quadlift::scene::{Scene, SceneParts};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::error::Error;

/// Seed of orders and of moved boxes.
const SEED: u64 = 20;

/// Added to the seed of the options.
const OTHER_SEED: u64 = 1000;

/// A change that should not change the answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Perturbation {
    /// The world is turned and moved.
    World,
    /// Lengths are 3.7 times as large, also those of cues and priors.
    Scale,
    /// Frames, detections and objects have another order.
    Order,
    /// Poses are multiplied by 1 + 1e-15.
    Rounding,
    /// Random starts have another seed.
    Seed,
    /// The edges of boxes are moved by up to so many pixels.
    Boxes(f64),
}

/// How the world changed: x becomes scale * rotation * x + shift.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorldChange {
    pub rotation: Rotation3<f64>,
    pub shift: Vector3<f64>,
    pub scale: f64,
}

impl Default for WorldChange {
    fn default() -> Self {
        Self { rotation: Rotation3::identity(), shift: Vector3::zeros(), scale: 1.0 }
    }
}

impl WorldChange {
    /// Turned about no special axis by no special angle, and moved.
    pub(super) fn moved() -> Self {
        let axis = Unit::new_normalize(Vector3::new(1.0, -2.0, 1.5));
        let rotation = Rotation3::from_axis_angle(&axis, 1.1);
        Self { rotation, shift: Vector3::new(3.1, -2.3, 1.7), scale: 1.0 }
    }

    fn projection(&self, projection: &Projection) -> Result<Projection, Error> {
        let m = projection.m() * self.rotation.inverse().matrix() / self.scale;
        let last = projection.matrix().column(3) - m * self.shift;
        let columns = [m.column(0).into_owned(), m.column(1).into_owned(), m.column(2).into_owned(), last];
        Ok(Projection::from_matrix(Matrix3x4::from_columns(&columns) * self.scale)?)
    }
}

impl Perturbation {
    /// All of them, in the order of the columns.
    pub(super) const ALL: [Self; 7] =
        [Self::World, Self::Scale, Self::Order, Self::Rounding, Self::Seed, Self::Boxes(1e-3), Self::Boxes(1e-6)];

    /// The title of the column.
    pub(super) fn name(self) -> String {
        match self {
            Self::World => "world".to_owned(),
            Self::Scale => "scale".to_owned(),
            Self::Order => "order".to_owned(),
            Self::Rounding => "rounding".to_owned(),
            Self::Seed => "seed".to_owned(),
            Self::Boxes(pixels) => format!("{pixels:.0e} px"),
        }
    }

    /// Short name of the headline.
    pub(super) fn id(self) -> &'static str {
        match self {
            Self::World => "stability_world",
            Self::Scale => "stability_scale",
            Self::Order => "stability_order",
            Self::Rounding => "stability_rounding",
            Self::Seed => "stability_seed",
            Self::Boxes(pixels) if pixels > 1e-5 => "stability_boxes",
            Self::Boxes(_) => "stability_boxes_slightly",
        }
    }

    /// The changed scene and options, and how the world changed.
    ///
    /// # Errors
    /// [`Error`] of a changed scene that is not valid.
    pub(super) fn of(
        self,
        scene: &Scene,
        options: &LocalizeOptions,
    ) -> Result<(Scene, LocalizeOptions, WorldChange), Error> {
        let (mut parts, mut options) = (scene.clone().into_parts(), options.clone());
        let mut world = WorldChange::default();
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        match self {
            Self::World => world = WorldChange::moved(),
            Self::Scale => world.scale = 3.7,
            Self::Order => reorder(&mut parts, &mut rng),
            Self::Rounding => {
                for frame in &mut parts.frames {
                    frame.projection = Projection::from_matrix(frame.projection.matrix() * (1.0 + 1e-15))?;
                }
            }
            Self::Seed => options.seed = options.seed.wrapping_add(OTHER_SEED),
            Self::Boxes(pixels) => {
                for bounding_box in parts.detections.iter_mut().filter_map(|d| d.bounding_box.as_mut()) {
                    let edges = bounding_box.edges().map(|edge| edge + pixels * rng.random_range(-1.0..1.0));
                    *bounding_box = BoundingBox::new(edges).unwrap_or(*bounding_box);
                }
            }
        }
        if matches!(self, Self::World | Self::Scale) {
            change_world(&mut parts, &mut options, &world)?;
        }
        Ok((Scene::from_parts(parts)?, options, world))
    }
}

fn change_world(parts: &mut SceneParts, options: &mut LocalizeOptions, world: &WorldChange) -> Result<(), Error> {
    for frame in &mut parts.frames {
        frame.projection = world.projection(&frame.projection)?;
    }
    for point in &mut parts.points {
        point.position = Point3::from(world.rotation * point.position.coords * world.scale + world.shift);
    }
    parts.up = parts.up.map(|up| world.rotation * up);
    for cues in parts.detections.iter_mut().filter_map(|d| d.cues.as_mut()) {
        **cues = cues.scaled(world.scale);
    }
    if let Some(map) = options.method.posterior_options_mut() {
        map.camera_height = map.camera_height.map(|height| height * world.scale);
        for size in map.priors.by_category.values_mut().filter_map(|prior| prior.size.as_mut()) {
            size.mean = size.mean.map(|x| x * world.scale);
            size.sd = size.sd.map(|x| x * world.scale);
        }
    }
    Ok(())
}

/// Another order of frames, detections and objects.
fn reorder(parts: &mut SceneParts, rng: &mut ChaCha8Rng) {
    let frames = order(parts.frames.len(), rng);
    parts.frames = frames.old.iter().map(|&k| parts.frames[k].clone()).collect();
    let objects = order(parts.object_ids.len(), rng);
    parts.object_ids = objects.old.iter().map(|&k| parts.object_ids[k].clone()).collect();
    parts.detections.shuffle(rng);
    for detection in &mut parts.detections {
        detection.frame_index = frames.new[detection.frame_index as usize] as u32;
        detection.object_index = detection.object_index.map(|index| objects.new[index as usize] as u32);
    }
    for point in &mut parts.points {
        point.observations.iter_mut().for_each(|one| one.frame_index = frames.new[one.frame_index as usize] as u32);
    }
}

/// An order: the old index of each new one, and the new index of each old one.
struct Order {
    old: Vec<usize>,
    new: Vec<usize>,
}

fn order(count: usize, rng: &mut ChaCha8Rng) -> Order {
    let mut old: Vec<usize> = (0..count).collect();
    old.shuffle(rng);
    let mut new = vec![0; count];
    old.iter().enumerate().for_each(|(k, &was)| new[was] = k);
    Order { old, new }
}
