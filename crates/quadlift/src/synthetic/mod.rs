//! Seeded synthetic scenes with known truth: the set-up of PfD's synthetic experiments and variations of it.
//!
//! In that set-up objects lie in a cube of side 20 about the origin, cameras stand around it at a distance and look at
//! its center, and every object is seen by every camera. Other trajectories, and a [`Detector`] with misses and false
//! positives, make realistic scenes. The world's z axis points up.

mod cues;
mod hall;
mod options;
mod cameras;
mod detector;
mod noise;
mod objects;
mod points;
mod scene;
mod categories;
mod shapes;
mod tracks;
mod detections;

#[cfg(test)]
mod tests;

pub use categories::{CategoryOptions, CategorySizes, generate_categories};
pub use cues::{Box3dNoise, CueOptions, DepthNoise, simulate_cues};
pub use hall::{Hall, HallBox, HallOptions, WalkPath, generate_hall};
pub use options::{Detector, Noise, Observations, SyntheticError, SyntheticIds, SyntheticOptions, Trajectory};
pub use scene::{SyntheticFrame, SyntheticScene};
pub use shapes::{OrientedBoxNoise, ShapeOptions, SimulatedShape, simulate_shapes};

use nalgebra::Vector3;

use crate::geometry::{Body, Projection};
use crate::random;
use crate::scene::{NewDetection, SceneBuilder};
use detections::{detect, names};
use objects::Object;

/// Streams of the seed; those of detections are in `detections`.
const OBJECT_STREAM: u64 = 0;
const CAMERA_STREAM: u64 = 8;
const POSE_NOISE_STREAM: u64 = 9;

/// Makes a scene: the same options always give the same scene.
///
/// Every object is detected in every view that sees it, unless the detector misses it. An outlier replaces the box, and
/// the ellipse by the one inscribed in the wrong box.
///
/// # Errors
/// [`SyntheticError`] when an option is out of its range, or if an object does not lie in front of a camera (on
/// trajectories that require it).
pub fn generate(options: &SyntheticOptions) -> Result<SyntheticScene, SyntheticError> {
    generate_objects(options, |_| (), |_| None)
}

/// [`generate()`] with objects that are changed before they are placed, and with the category of each.
fn generate_objects(
    options: &SyntheticOptions,
    change: impl FnOnce(&mut Vec<Object>),
    category_of: impl Fn(usize) -> Option<String>,
) -> Result<SyntheticScene, SyntheticError> {
    options.check()?;
    let mut builder = SceneBuilder::new("synthetic");
    builder.up([0.0, 0.0, 1.0])?;

    // Measurements are made in the world before it is scaled and moved: its pixels are then the same to the last bit.
    let [width, height] = cameras::image_size(options.trajectory);
    let intrinsics = cameras::intrinsics(options.trajectory);
    let mut pose_noise = random::stream(options.seed, POSE_NOISE_STREAM);
    let (mut frames, mut projections) = (Vec::new(), Vec::new());
    let poses = cameras::poses(options, &mut random::stream(options.seed, CAMERA_STREAM));
    for (index, exact) in poses.iter().enumerate() {
        let plain = exact.cam_from_world(1.0, &Vector3::zeros())?;
        projections.push(Projection::from_camera(&intrinsics, &plain));
        let known = match options.pose_noise {
            0.0 => *exact,
            degrees => exact.with_noise(degrees.to_radians(), &mut pose_noise),
        };
        let frame = SyntheticFrame {
            id: format!("{index:06}"),
            intrinsics,
            cam_from_world: known.cam_from_world(options.scale, &options.offset)?,
            width,
            height,
        };
        let projection = Projection::from_camera(&frame.intrinsics, &frame.cam_from_world);
        builder.add_frame(&frame.id, projection, Some([f64::from(width), f64::from(height)]))?;
        frames.push(frame);
    }

    let mut rng = random::stream(options.seed, OBJECT_STREAM);
    let draw = |index| Object::draw(index, options.trajectory, options.cube_side, &mut rng);
    let mut objects: Vec<Object> = (0..options.objects).map(draw).collect();
    change(&mut objects);
    if options.standing {
        objects = objects.into_iter().map(Object::standing).collect();
    }
    let truth: Vec<(String, Body)> = objects
        .iter()
        .enumerate()
        .map(|(k, object)| (format!("object_{k:03}"), object.body(options.kind_of(k), options.scale, &options.offset)))
        .collect();
    let found = detect(options, &objects, &truth, &frames, &projections)?;
    let names = names(options, &found, &truth);
    for (detection, name) in found.iter().zip(&names) {
        let category = detection.object.and_then(&category_of);
        builder.add_detection(&NewDetection {
            frame: &frames[detection.frame].id,
            object: name.as_deref(),
            category: category.as_deref(),
            bounding_box: detection.bounding_box,
            ellipse: detection.ellipse,
            ..Default::default()
        })?;
    }
    for point in points::track_points(options, &objects, &projections, [width, height]) {
        let position = point.position.coords * options.scale + options.offset;
        builder.add_point(position.into(), &point.observed)?;
    }
    Ok(SyntheticScene {
        scene: builder.build(),
        truth,
        frames,
        outliers: found.iter().map(|f| f.is_outlier).collect(),
        true_objects: found.iter().map(|f| f.object).collect(),
    })
}
