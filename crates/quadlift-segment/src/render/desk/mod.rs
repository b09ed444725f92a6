//! A desk that people recognise, photographed from all sides that a person at it would take: for the demo and the
//! tutorial. Things of every day under soft light, with exact cameras, true masks, and a simulated detector whose boxes
//! say what they show but not which one.

mod detector;
mod light;
mod paint;
mod things;

use image::RgbImage;
use nalgebra::Point3;
use quadlift::geometry::{Body, BoundingBox, Intrinsics, Projection};
use quadlift::scene::{DetectionInput, SceneBuilder};
use quadlift::synthetic::random::{normal, stream};
use quadlift::synthetic::{SyntheticError, SyntheticFrame, SyntheticScene};

use super::camera::look;
use super::envelope::enclosing_ellipsoid;
use crate::label_image::LabelImage;
use crate::parallel::map_indices;
use detector::{Found, detect};
use light::{Picture, Target};
use things::Part;

/// Streams of the seed.
const CAMERA_STREAM: u64 = 0;
const DETECTOR_STREAM: u64 = 1;

/// Focal length in widths of the image.
const FOCAL_LENGTH: f64 = 0.92;
/// How far the camera goes around the desk, radians to each side, and the least and the largest of its distance from
/// the middle and of its height (metres).
const REACH: f64 = 0.82;
const DISTANCE: [f64; 2] = [1.0, 1.15];
const HEIGHT: [f64; 2] = [0.42, 0.72];
/// Things of which a smaller share is visible are not detected, nor those with fewer pixels.
const LEAST_VISIBLE: f64 = 0.45;
const LEAST_PIXELS: usize = 150;

/// Options of the rendered desk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeskOptions {
    /// Seed of the way of the camera and of the detector's errors.
    pub seed: u64,
    /// Number of views.
    pub views: usize,
    /// Width of the images in pixels, from 16 to 4096.
    pub width: u32,
    /// Height of the images in pixels, from 16 to 4096.
    pub height: u32,
}

impl Default for DeskOptions {
    fn default() -> Self {
        Self { seed: 0, views: 20, width: 640, height: 480 }
    }
}

/// The rendered images of the desk, simulated detections, and ground truth.
#[derive(Debug, Clone)]
pub struct RenderedDesk {
    /// Cameras, detections (by frame; without objects, with category and score) and true bodies: cuboids, cylinders and
    /// ellipsoids where a thing is one, otherwise the minimum-volume enclosing ellipsoid. Metres; up is z; the top of
    /// the desk is z = 0. `outliers` are false positives and boxes that are far off; `true_objects` has the true object
    /// of each detection, if any.
    pub synthetic: SyntheticScene,
    /// Category of each thing, in the order of the truth.
    pub categories: Vec<&'static str>,
    /// The images, in the order of the frames.
    pub images: Vec<RgbImage>,
    /// The visible pixels of all things, in the order of the frames: thing k has the value `k + 1`.
    pub labels: Vec<LabelImage>,
}

/// Photographs the desk: the same options give the same bytes, on any number of threads.
///
/// # Errors
/// [`SyntheticError::OutOfRange`] if the size of the images is out of range.
pub fn render_desk(options: &DeskOptions) -> Result<RenderedDesk, SyntheticError> {
    for (what, size) in [("width of the images", options.width), ("height of the images", options.height)] {
        if !(16..=4096).contains(&size) {
            let expected = "a number from 16 to 4096";
            return Err(SyntheticError::OutOfRange { what, value: f64::from(size), expected });
        }
    }
    let (things, parts) = things::desk();
    let frames = frames(options)?;
    let targets = Target::all(&parts);
    let pictures: Vec<Picture> =
        map_indices(frames.len(), |index| light::render(&targets, &frames[index], things.len()));

    let mut builder = SceneBuilder::new("desk");
    builder.up([0.0, 0.0, 1.0])?;
    builder.length_unit("m");
    let size = [options.width, options.height].map(f64::from);
    let mut rng = stream(options.seed, DETECTOR_STREAM);
    let (mut outliers, mut true_objects) = (Vec::new(), Vec::new());
    for frame in &frames {
        let projection = Projection::from_camera(&frame.intrinsics, &frame.cam_from_world);
        builder.add_frame(&frame.id, projection, Some(size))?;
    }
    for (frame, picture) in frames.iter().zip(&pictures) {
        for found in detect(&visible(picture), size, things.len(), &mut rng) {
            let Found { thing, like, bounding_box, score, is_wrong } = found;
            builder.add_detection(&DetectionInput {
                frame: &frame.id,
                category: Some(things[like].category),
                score: Some(score),
                bounding_box: Some(bounding_box),
                ..Default::default()
            })?;
            outliers.push(is_wrong);
            true_objects.push(thing);
        }
    }
    let truth = things.iter().enumerate().map(|(k, thing)| {
        let parts: Vec<&Part> = parts.iter().filter(|part| part.thing == Some(k)).collect();
        (thing.name.to_owned(), body_of(&parts))
    });
    let truth = truth.collect();
    let (images, labels) = pictures.into_iter().map(|picture| (picture.image, picture.labels)).unzip();
    Ok(RenderedDesk {
        synthetic: SyntheticScene { scene: builder.build(), truth, frames, outliers, true_objects },
        categories: things.iter().map(|thing| thing.category).collect(),
        images,
        labels,
    })
}

/// The things that can be detected in a picture, with their boxes.
fn visible(picture: &Picture) -> Vec<(usize, BoundingBox)> {
    let seen = |(value, mask): (u16, crate::Mask)| {
        let thing = usize::from(value) - 1;
        let share = mask.count() as f64 / f64::from(picture.whole[thing].max(1));
        let is_seen = mask.count() >= LEAST_PIXELS && share >= LEAST_VISIBLE;
        mask.bounding_box().filter(|_| is_seen).map(|bounding_box| (thing, bounding_box))
    };
    picture.labels.masks().into_iter().filter_map(seen).collect()
}

/// The cameras: to and fro in front of the desk, held by hand.
fn frames(options: &DeskOptions) -> Result<Vec<SyntheticFrame>, SyntheticError> {
    let mut rng = stream(options.seed, CAMERA_STREAM);
    let [width, height] = [options.width, options.height].map(f64::from);
    let intrinsics = Intrinsics::new(FOCAL_LENGTH * width, FOCAL_LENGTH * width, 0.5 * width, 0.5 * height)?;
    let last = options.views.saturating_sub(1).max(1) as f64;
    let between = |[low, high]: [f64; 2], share: f64| low + (high - low) * share;
    (0..options.views)
        .map(|view| {
            let s = view as f64 / last;
            let angle = REACH * (2.0 * s - 1.0) + 0.012 * normal(&mut rng);
            let distance =
                between(DISTANCE, 0.5 + 0.5 * (2.4 * std::f64::consts::TAU * s).sin()) + 0.01 * normal(&mut rng);
            let height = between(HEIGHT, 0.5 - 0.5 * (1.5 * std::f64::consts::TAU * s).cos()) + 0.01 * normal(&mut rng);
            let position = Point3::new(distance * angle.sin(), -distance * angle.cos(), height);
            let target =
                Point3::new(0.02 * normal(&mut rng), 0.02 + 0.02 * normal(&mut rng), 0.06 + 0.015 * normal(&mut rng));
            let cam_from_world = look(&position, &target, 0.012 * normal(&mut rng))?;
            let id = format!("{view:06}");
            Ok(SyntheticFrame { id, intrinsics, cam_from_world, width: options.width, height: options.height })
        })
        .collect()
}

/// The body of a thing: that of its one part, or the ellipsoid of least volume that encloses all its parts.
fn body_of(parts: &[&Part]) -> Body {
    let points = || parts.iter().flat_map(|part| part.points()).collect::<Vec<Point3<f64>>>();
    match parts {
        [part] => part.body(),
        _ => None,
    }
    .unwrap_or_else(|| Body::Ellipsoid(enclosing_ellipsoid(&points())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::project_bounding_box;

    #[test]
    fn detections_are_of_the_things_they_name_and_the_pictures_are_lit() {
        let desk = render_desk(&DeskOptions { views: 5, width: 160, height: 120, ..Default::default() }).unwrap();
        let scene = &desk.synthetic.scene;
        assert!(scene.detections.len() > 20, "{}", scene.detections.len());
        for (k, detection) in scene.detections.iter().enumerate() {
            assert!(detection.object_index.is_none() && detection.category_index.is_some());
            let (Some(thing), false) = (desk.synthetic.true_objects[k], desk.synthetic.outliers[k]) else { continue };
            let truth = &desk.synthetic.truth[thing].1;
            let projection = &scene.frames[detection.frame_index as usize].projection;
            // The true body's box holds what is seen of the thing.
            let whole = project_bounding_box(projection, truth).unwrap().edges();
            let seen = detection.bounding_box.unwrap().edges();
            let slack = 0.3 * (whole[2] - whole[0]).max(whole[3] - whole[1]);
            assert!(seen[0] > whole[0] - slack && seen[3] < whole[3] + slack, "{thing} {seen:?} {whole:?}");
        }
        for image in &desk.images {
            let mean = image.as_raw().iter().map(|x| f64::from(*x)).sum::<f64>() / image.as_raw().len() as f64;
            assert!((70.0..190.0).contains(&mean), "{mean}");
        }
    }

    #[test]
    fn the_same_options_give_the_same_bytes() {
        let options = DeskOptions { views: 2, width: 64, height: 48, ..Default::default() };
        let [a, b] = [0, 1].map(|_| render_desk(&options).unwrap());
        assert!(a.images == b.images);
        let detections = |desk: &RenderedDesk| format!("{:?}", desk.synthetic.scene.detections);
        assert_eq!(detections(&a), detections(&b));
        assert!(render_desk(&DeskOptions { width: 0, ..options }).is_err());
    }
}
