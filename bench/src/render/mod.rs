//! Rendered test scenes: textured, shaded objects on cluttered backgrounds from exactly known cameras, with true masks.
//!
//! Objects of simple solids stand on the ground of a procedural world, a light throws shadows, and a camera goes around
//! them on an arc, much as a person with a camera would. What is drawn follows the numpy prototype with which the
//! segmentation was developed: colors of the objects overlap with those of the clutter and of the ground.

mod texture;
mod sensor;
mod solid;
mod envelope;
mod objects;
mod options;
mod camera;
mod world;
mod frame;
pub mod scene_files;

pub use objects::ObjectKind;
pub use options::RenderOptions;

use quadlift::geometry::{Body, BoundingBox, Projection};
use quadlift::random::{normal, stream};
use quadlift::scene::{NewDetection, SceneBuilder};
use quadlift::synthetic::{SyntheticError, SyntheticScene};
use quadlift_segment::LabelImage;
use quadlift_segment::image::RgbImage;
use rayon::prelude::*;

use frame::Rendering;
use world::World;

/// Streams of the seed. Every frame's sensor has one of its own, from the last one on.
const WORLD_STREAM: u64 = 0;
const CAMERA_STREAM: u64 = 1;
const BOX_STREAM: u64 = 2;
const FIRST_FRAME_STREAM: u64 = 3;

/// Width and height in pixels that a box keeps when noise would make its edges cross.
const MIN_BOX: f64 = 1.0;

/// A rendered scene and its ground truth.
#[derive(Debug, Clone)]
pub struct RenderedScene {
    /// The scene as input of an estimator, the cameras and the true bodies. The detections have the boxes of the
    /// visible pixels; they are ordered by frame, then by object. The body of an object is the ellipsoid of least
    /// volume that encloses it, as in the paper's real data ("envelope"); an object that is an ellipsoid is its own
    /// envelope.
    pub synthetic: SyntheticScene,
    /// The images, in the order of the frames.
    pub images: Vec<RgbImage>,
    /// The visible pixels of all objects, in the order of the frames: object number k (from 0, in the order of the
    /// truth) has the value `k + 1`. A pixel is the object's when the ray through its center meets it first.
    pub labels: Vec<LabelImage>,
    /// What each object is, in the order of the truth.
    pub kinds: Vec<ObjectKind>,
    /// For each detection, the value of its object in the label image of its frame.
    pub values: Vec<u16>,
    /// For each detection, the visible share of the object's pixels inside the image, in (0, 1].
    pub visible_fractions: Vec<f64>,
}

/// Renders a scene: the same options always give the same bytes, on any number of threads.
///
/// # Errors
/// [`SyntheticError::OutOfRange`] when an option is out of its range.
pub fn render(options: &RenderOptions) -> Result<RenderedScene, SyntheticError> {
    options.check()?;
    let world = World::draw(options, &mut stream(options.seed, WORLD_STREAM));
    let frames = camera::frames(options, &world.path, &mut stream(options.seed, CAMERA_STREAM))?;
    let one = |(index, frame)| {
        frame::render(&world, frame, options, &mut stream(options.seed, FIRST_FRAME_STREAM + index as u64))
    };
    let rendered: Vec<Rendering> = frames.par_iter().enumerate().map(one).collect();

    let mut builder = SceneBuilder::new("rendered");
    builder.up([0.0, 0.0, 1.0])?;
    for frame in &frames {
        let projection = Projection::from_camera(&frame.intrinsics, &frame.cam_from_world);
        builder.add_frame(&frame.id, projection, Some([frame.width, frame.height].map(f64::from)))?;
    }
    let id = |object: usize| format!("object_{object:03}");
    let (mut values, mut visible_fractions) = (Vec::new(), Vec::new());
    let mut rng = stream(options.seed, BOX_STREAM);
    for (frame, rendering) in frames.iter().zip(&rendered) {
        for (value, mask) in rendering.labels.masks() {
            let object = usize::from(value) - 1;
            let visible_fraction = mask.count() as f64 / rendering.whole[object] as f64;
            let Some(exact) = mask.bounding_box().filter(|_| visible_fraction >= options.least_visible) else {
                continue;
            };
            let noisy = noisy_box(&exact, options, || normal(&mut rng))?;
            builder.add_detection(&NewDetection {
                frame: &frame.id,
                object: Some(&id(object)),
                category: Some(world.objects[object].kind.name()),
                bounding_box: Some(noisy),
                ..Default::default()
            })?;
            values.push(value);
            visible_fractions.push(visible_fraction);
        }
    }
    let body = |(k, object): (usize, &objects::Object)| (id(k), Body::from(object.envelope()));
    let truth = world.objects.iter().enumerate().map(body).collect();
    let (images, labels) = rendered.into_iter().map(|rendering| (rendering.image, rendering.labels)).unzip();
    let outliers = vec![false; values.len()];
    let true_objects = values.iter().map(|&value| Some(usize::from(value) - 1)).collect();
    Ok(RenderedScene {
        synthetic: SyntheticScene { scene: builder.build(), truth, frames, outliers, true_objects },
        images,
        labels,
        kinds: world.objects.iter().map(|object| object.kind).collect(),
        values,
        visible_fractions,
    })
}

/// The box with noise on each edge, cut at the border of the image; where edges would cross, the box keeps a pixel.
fn noisy_box(
    exact: &BoundingBox,
    options: &RenderOptions,
    mut normal: impl FnMut() -> f64,
) -> Result<BoundingBox, SyntheticError> {
    let sigma = options.box_noise * exact.mean_half_size();
    let [width, height] = [options.width, options.height].map(f64::from);
    let mut moved = exact.edges().map(|edge| edge + sigma * normal());
    for (axis, size) in [width, height].into_iter().enumerate() {
        moved[axis + 2] = moved[axis + 2].clamp(MIN_BOX, size);
        moved[axis] = moved[axis].clamp(0.0, size).min(moved[axis + 2] - MIN_BOX);
    }
    Ok(BoundingBox::new(moved)?)
}

#[cfg(test)]
mod tests;
