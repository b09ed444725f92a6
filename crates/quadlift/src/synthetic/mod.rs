//! Seeded synthetic scenes with known truth: the set-up of PfD's synthetic experiments and variations of it.
//!
//! In that set-up objects lie in a cube of side 20 about the origin, cameras stand around it at a distance and look at
//! its centre, and every object is seen by every camera. Other trajectories, and a [`Detector`] with misses and false
//! positives, make realistic scenes. The world's z axis points up.

mod cameras;
mod detector;
mod noise;
mod objects;
mod options;
pub mod random;
mod tracks;

pub use options::{Detector, Noise, Observations, SyntheticError, SyntheticIds, SyntheticOptions, Trajectory};

use nalgebra::{Vector2, Vector3};

use crate::geometry::{
    Body, BoundingBox, CamFromWorld, ConvexBody, Ellipse, Intrinsics, Projection, project_bounding_box,
    project_ellipsoid,
};
use crate::scene::{DetectionInput, Scene, SceneBuilder};
use detector::DetectorSource;
use noise::NoiseSource;
use objects::Object;
use tracks::{Tracked, tracks};

/// Streams of the seed.
const OBJECT_STREAM: u64 = 0;
const FIRST_NOISE_STREAM: u64 = 1;
const CAMERA_STREAM: u64 = 8;
const POSE_NOISE_STREAM: u64 = 9;
const FIRST_DETECTOR_STREAM: u64 = 10;
const TRACK_STREAM: u64 = 13;
const EDGE_BIAS_STREAM: u64 = 14;

/// A scene and its ground truth.
#[derive(Debug, Clone)]
pub struct SyntheticScene {
    /// The scene as an estimator gets it: no categories, no sources, no length unit. The detections of true objects are
    /// ordered by object, then by frame; false boxes and duplicates come after them, by frame.
    pub scene: Scene,
    /// Id ("object_000", ...) and true body of each object, in the world of the scene.
    pub truth: Vec<(String, Body)>,
    /// The cameras, in the order of the scene's frames, with intrinsics and pose apart.
    pub frames: Vec<SyntheticFrame>,
    /// For each detection of the scene, whether it was replaced by an outlier.
    pub outliers: Vec<bool>,
    /// For each detection of the scene, the index of its object in `truth`; absent for false boxes and duplicates.
    pub true_objects: Vec<Option<usize>>,
}

/// A camera of a synthetic scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticFrame {
    /// Id of the frame ("000000", ...).
    pub id: String,
    /// Intrinsics, pixels.
    pub intrinsics: Intrinsics,
    /// Pose, with its noise.
    pub cam_from_world: CamFromWorld,
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
}

/// A detection before it has a name.
struct Found {
    frame: usize,
    object: Option<usize>,
    bounding_box: Option<BoundingBox>,
    ellipse: Option<Ellipse>,
    is_outlier: bool,
}

/// Makes a scene: the same options always give the same scene.
///
/// Every object is detected in every view that sees it, unless the detector misses it. An outlier replaces the box, and
/// the ellipse by the one inscribed in the wrong box.
///
/// # Errors
/// [`SyntheticError`] when an option is out of its range, or if an object does not lie in front of a camera (on
/// trajectories that require it).
pub fn generate(options: &SyntheticOptions) -> Result<SyntheticScene, SyntheticError> {
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
    let draw = |index| {
        let object = Object::draw(index, options.trajectory, options.cube_side, &mut rng);
        if options.standing { object.standing() } else { object }
    };
    let objects: Vec<Object> = (0..options.objects).map(draw).collect();
    let truth: Vec<(String, Body)> = objects
        .iter()
        .enumerate()
        .map(|(k, object)| (format!("object_{k:03}"), object.body(options.kind_of(k), options.scale, &options.offset)))
        .collect();
    let found = detect(options, &objects, &truth, &frames, &projections)?;
    let names = names(options, &found, &truth);
    for (detection, name) in found.iter().zip(&names) {
        builder.add_detection(&DetectionInput {
            frame: &frames[detection.frame].id,
            object: name.as_deref(),
            bounding_box: detection.bounding_box,
            ellipse: detection.ellipse,
            ..Default::default()
        })?;
    }
    Ok(SyntheticScene {
        scene: builder.build(),
        truth,
        frames,
        outliers: found.iter().map(|f| f.is_outlier).collect(),
        true_objects: found.iter().map(|f| f.object).collect(),
    })
}

/// All detections: of the objects, then the false ones and duplicates.
fn detect(
    options: &SyntheticOptions,
    objects: &[Object],
    truth: &[(String, Body)],
    frames: &[SyntheticFrame],
    projections: &[Projection],
) -> Result<Vec<Found>, SyntheticError> {
    let [width, height] = cameras::image_size(options.trajectory);
    let image = Vector2::new(f64::from(width), f64::from(height));
    let is_free = options.trajectory.is_free();
    let bodies: Vec<Body> =
        objects.iter().enumerate().map(|(k, o)| o.body(options.kind_of(k), 1.0, &Vector3::zeros())).collect();
    // The exact boxes of visible objects, by object and frame.
    let mut exact_boxes = vec![vec![None; projections.len()]; bodies.len()];
    for (object, body) in bodies.iter().enumerate() {
        for (frame, projection) in projections.iter().enumerate() {
            exact_boxes[object][frame] = match project_bounding_box(projection, body) {
                Ok(exact) => {
                    let is_near = projection.depth(&body.center()) <= options.trajectory.range();
                    (!is_free || is_near && detector::is_in_image(&exact, image)).then_some(exact)
                }
                Err(_) if is_free => None,
                Err(reason) => {
                    let (object, frame) = (truth[object].0.clone(), frames[frame].id.clone());
                    return Err(SyntheticError::NotInView { object, frame, reason });
                }
            };
        }
    }
    let covered = if options.detector.occlusion { covered(&bodies, projections, &exact_boxes) } else { Vec::new() };
    let mut noise = NoiseSource::new(options, FIRST_NOISE_STREAM);
    let mut biases = random::stream(options.seed, EDGE_BIAS_STREAM);
    let mut detector = DetectorSource::new(options.detector, options.seed, FIRST_DETECTOR_STREAM);
    let measured = |bounding_box: BoundingBox| {
        let ellipse = options.observations.ellipses().then(|| Ellipse::inscribed_in(&bounding_box));
        (options.observations.boxes().then_some(bounding_box), ellipse)
    };
    let (mut found, mut duplicates) = (Vec::new(), Vec::new());
    let mut boxes_in: Vec<Vec<BoundingBox>> = vec![Vec::new(); projections.len()];
    for (object, body) in bodies.iter().enumerate() {
        let bias = [(); 4].map(|()| options.edge_bias * random::normal(&mut biases));
        for (frame, projection) in projections.iter().enumerate() {
            let Some(exact_box) = exact_boxes[object][frame] else { continue };
            // All random numbers are drawn, even if unused, so that options are independent.
            let outlier = noise.outlier(&exact_box)?;
            let mut bounding_box = exact_box;
            if options.observations.boxes() {
                let noisy = noise.bounding_box(&exact_box, &bias)?;
                bounding_box = outlier.unwrap_or(noisy);
            }
            let mut ellipse = None;
            if options.observations.ellipses() {
                let not_in_view = |reason| SyntheticError::NotInView {
                    object: truth[object].0.clone(),
                    frame: frames[frame].id.clone(),
                    reason,
                };
                let exact = project_ellipsoid(projection, &body.ellipsoid()).map_err(not_in_view)?;
                let noisy = noise.ellipse(&exact)?;
                ellipse = Some(outlier.as_ref().map_or(noisy, Ellipse::inscribed_in));
            }
            let is_missed = detector.misses();
            let duplicate = detector.duplicate(&bounding_box);
            let is_covered = covered.get(object).is_some_and(|by_frame| by_frame[frame]);
            if is_missed || is_covered {
                continue;
            }
            if is_free {
                let Some(inside) = detector::cut(&bounding_box, image) else { continue };
                bounding_box = inside;
            }
            boxes_in[frame].push(bounding_box);
            let duplicate = if is_free { duplicate.and_then(|d| detector::cut(&d, image)) } else { duplicate };
            duplicates.extend(duplicate.map(|d| (frame, d)));
            let bounding_box = options.observations.boxes().then_some(bounding_box);
            found.push(Found { frame, object: Some(object), bounding_box, ellipse, is_outlier: outlier.is_some() });
        }
    }
    let all: Vec<BoundingBox> = boxes_in.iter().flatten().copied().collect();
    let mut others = duplicates;
    for (frame, in_frame) in boxes_in.iter().enumerate() {
        let made = detector.false_boxes(in_frame, &all, projections.len(), image)?;
        others.extend(made.into_iter().map(|b| (frame, b)));
    }
    others.sort_by_key(|&(frame, _)| frame);
    for (frame, bounding_box) in others {
        let (bounding_box, ellipse) = measured(bounding_box);
        found.push(Found { frame, object: None, bounding_box, ellipse, is_outlier: false });
    }
    Ok(found)
}

/// Which objects are covered by nearer ones, by object and frame.
fn covered(bodies: &[Body], projections: &[Projection], boxes: &[Vec<Option<BoundingBox>>]) -> Vec<Vec<bool>> {
    let mut covered = vec![vec![false; projections.len()]; bodies.len()];
    for (frame, projection) in projections.iter().enumerate() {
        let in_view: Vec<usize> = (0..bodies.len()).filter(|&object| boxes[object][frame].is_some()).collect();
        let with_depth = in_view
            .iter()
            .filter_map(|&object| Some((boxes[object][frame]?, projection.depth(&bodies[object].center()))));
        for (&object, hidden) in in_view.iter().zip(detector::covered(&with_depth.collect::<Vec<_>>())) {
            covered[object][frame] = hidden;
        }
    }
    covered
}

/// The id of each detection.
fn names(options: &SyntheticOptions, found: &[Found], truth: &[(String, Body)]) -> Vec<Option<String>> {
    match options.ids {
        SyntheticIds::True => found.iter().map(|f| f.object.map(|object| truth[object].0.clone())).collect(),
        SyntheticIds::Absent => vec![None; found.len()],
        SyntheticIds::Tracks { fragments, switches } => {
            let tracked = found.iter().enumerate().filter_map(|(detection, f)| {
                let outline = f.ellipse.as_ref().map(|e| e.center);
                let place = f.bounding_box.as_ref().map(BoundingBox::center).or(outline)?;
                Some(Tracked { detection, frame: f.frame, object: f.object?, place })
            });
            let mut rng = random::stream(options.seed, TRACK_STREAM);
            let mut names = vec![None; found.len()];
            for (detection, track) in tracks(tracked.collect(), fragments, switches, &mut rng) {
                names[detection] = Some(format!("track_{track:04}"));
            }
            names
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BoundingBox, ConvexBody, ProjectionError};
    use crate::solve::BodyKind;
    use proptest::prelude::*;

    fn options() -> SyntheticOptions {
        SyntheticOptions { seed: 5, objects: 8, views: 6, observations: Observations::Both, ..Default::default() }
    }

    /// Options with every kind of noise, and outliers.
    fn noisy() -> SyntheticOptions {
        let noise = vec![
            Noise::Rotation(20.0),
            Noise::Size(0.1),
            Noise::SizePerAxis(0.1),
            Noise::Translation(0.1),
            Noise::TranslationFullAxis(0.1),
            Noise::BoxEdges(0.05),
        ];
        SyntheticOptions { noise, outlier_share: 0.2, ..options() }
    }

    /// Largest difference in pixels between the detections of a scene and the projections of its truth.
    fn largest_error(synthetic: &SyntheticScene) -> f64 {
        let scene = &synthetic.scene;
        let mut largest = 0.0f64;
        for detection in &scene.detections {
            let projection = &scene.frames[detection.frame_index as usize].projection;
            let object = detection.object_index.unwrap() as usize;
            let (id, body) = &synthetic.truth[object];
            assert_eq!(*id, scene.object_ids[object]);
            if let Some(measured) = detection.bounding_box {
                let expected = project_bounding_box(projection, body).unwrap().edges();
                let difference = |k: usize| (measured.edges()[k] - expected[k]).abs();
                largest = (0..4).map(difference).fold(largest, f64::max);
            }
            if let Some(measured) = detection.ellipse {
                let expected = project_ellipsoid(projection, &body.ellipsoid()).unwrap();
                largest = largest.max((measured.center - expected.center).norm());
                let root = |e: &Ellipse| e.shape().determinant().powf(0.25);
                largest = largest.max((measured.shape() - expected.shape()).norm() / root(&expected));
            }
        }
        largest
    }

    fn measurements(synthetic: &SyntheticScene) -> Vec<(Option<BoundingBox>, Option<Ellipse>)> {
        synthetic.scene.detections.iter().map(|d| (d.bounding_box, d.ellipse)).collect()
    }

    #[test]
    fn without_noise_the_measurements_are_the_projections_of_the_truth() {
        let synthetic = generate(&options()).unwrap();
        assert_eq!(synthetic.scene.detections.len(), 48);
        assert_eq!(largest_error(&synthetic), 0.0);
        for body in [BodyKind::Cuboid, BodyKind::Superellipsoid(1.3)] {
            let boxes = SyntheticOptions { body, observations: Observations::Boxes, ..options() };
            let synthetic = generate(&boxes).unwrap();
            assert_eq!(largest_error(&synthetic), 0.0);
            assert!(synthetic.scene.detections.iter().all(|d| d.ellipse.is_none() && d.bounding_box.is_some()));
        }
        let ellipses = generate(&SyntheticOptions { observations: Observations::Ellipses, ..options() }).unwrap();
        assert!(ellipses.scene.detections.iter().all(|d| d.ellipse.is_some() && d.bounding_box.is_none()));
    }

    #[test]
    fn the_default_is_the_set_up_of_the_paper() {
        let synthetic = generate(&SyntheticOptions::default()).unwrap();
        assert_eq!((synthetic.truth.len(), synthetic.frames.len(), synthetic.scene.detections.len()), (50, 20, 1000));
        assert_eq!((synthetic.truth[7].0.as_str(), synthetic.frames[19].id.as_str()), ("object_007", "000019"));
        assert_eq!(synthetic.scene.up.unwrap().into_inner(), Vector3::z());
        // The cube's diagonal and the longest object stay well inside the image.
        for detection in &synthetic.scene.detections {
            let edges = detection.ellipse.unwrap().bounding_box().edges();
            assert!(edges[0] > 400.0 && edges[1] > 250.0 && edges[2] < 880.0 && edges[3] < 710.0, "{edges:?}");
        }
    }

    #[test]
    fn scale_and_offset_leave_the_pixels_alone() {
        let plain = generate(&noisy()).unwrap();
        let exact_plain = generate(&options()).unwrap();
        for (scale, offset) in
            [(1.0, Vector3::new(1e6, -1e6, 1e6)), (1e-3, Vector3::zeros()), (1e3, Vector3::new(4e5, 5e6, 120.0))]
        {
            let moved = generate(&SyntheticOptions { scale, offset, ..noisy() }).unwrap();
            assert_eq!(measurements(&moved), measurements(&plain));
            let exact = generate(&SyntheticOptions { scale, offset, ..options() }).unwrap();
            let error = largest_error(&exact);
            assert!(error < 1e-6, "{error:e} px at scale {scale}, offset {offset:?}");
            for ((_, a), (_, b)) in exact.truth.iter().zip(&exact_plain.truth) {
                assert!((a.center() - (b.center() * scale + offset)).norm() < 1e-9 * (1.0 + offset.norm()));
                assert!((a.volume() / b.volume() / scale.powi(3) - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_cameras_are_those_of_the_scene() {
        let synthetic = generate(&SyntheticOptions { offset: Vector3::new(3.0, 4.0, 5.0), ..options() }).unwrap();
        for (frame, in_scene) in synthetic.frames.iter().zip(&synthetic.scene.frames) {
            assert_eq!(frame.id, in_scene.id);
            assert_eq!(Projection::from_camera(&frame.intrinsics, &frame.cam_from_world), in_scene.projection);
            assert_eq!(in_scene.image_size.unwrap(), nalgebra::Vector2::new(1280.0, 960.0));
        }
    }

    #[test]
    fn noise_and_bodies_do_not_change_what_else_is_drawn() {
        let (clean, noisy_scene) = (generate(&options()).unwrap(), generate(&noisy()).unwrap());
        assert_eq!(clean.truth, noisy_scene.truth);
        assert_ne!(measurements(&clean), measurements(&noisy_scene));
        let cuboids = SyntheticOptions { body: BodyKind::Cuboid, observations: Observations::Boxes, ..options() };
        for ((_, cuboid), (_, ellipsoid)) in generate(&cuboids).unwrap().truth.iter().zip(&clean.truth) {
            assert_eq!((cuboid.center(), cuboid.half_extents()), (ellipsoid.center(), ellipsoid.half_extents()));
        }
        // Another amount of one noise: the others, and the outliers, stay.
        let more = SyntheticOptions { noise: vec![Noise::BoxEdges(0.2)], ..noisy() };
        assert_eq!(generate(&more).unwrap().outliers, noisy_scene.outliers);
    }

    #[test]
    fn outliers_are_marked_and_replace_both_measurements() {
        let many = SyntheticOptions { objects: 100, views: 20, outlier_share: 0.3, noise: Vec::new(), ..options() };
        let clean = generate(&SyntheticOptions { outlier_share: 0.0, ..many.clone() }).unwrap();
        let synthetic = generate(&many).unwrap();
        let count = synthetic.outliers.iter().filter(|&&o| o).count();
        // Standard deviation sqrt(2000 * 0.3 * 0.7) = 20.5.
        assert!(count.abs_diff(600) < 82, "{count}");
        for ((&outlier, a), b) in synthetic.outliers.iter().zip(measurements(&synthetic)).zip(measurements(&clean)) {
            assert_eq!(outlier, a != b);
            if outlier {
                assert_eq!(a.1, a.0.as_ref().map(Ellipse::inscribed_in));
            }
        }
    }

    #[test]
    fn senseless_options_are_refused_by_name() {
        let refused = |change: fn(&mut SyntheticOptions)| {
            let mut options = options();
            change(&mut options);
            generate(&options).unwrap_err()
        };
        let out_of_range = |change| match refused(change) {
            SyntheticError::OutOfRange { what, .. } => what,
            other => panic!("{other}"),
        };
        assert_eq!(out_of_range(|o| o.distance = -200.0), "distance");
        assert_eq!(out_of_range(|o| o.scale = f64::NAN), "scale");
        assert_eq!(out_of_range(|o| o.offset.y = f64::INFINITY), "offset");
        assert_eq!(out_of_range(|o| o.outlier_share = 1.5), "outlier share");
        assert_eq!(out_of_range(|o| o.body = BodyKind::Superellipsoid(3.0)), "exponent of the superellipsoid");
        assert_eq!(out_of_range(|o| o.noise = vec![Noise::Size(1.0)]), "size noise");
        assert_eq!(out_of_range(|o| o.noise = vec![Noise::BoxEdges(-0.1)]), "box edge noise");
        assert_eq!(refused(|o| o.body = BodyKind::Cuboid), SyntheticError::NotAnEllipse);
        let boxes_only = refused(|o| {
            o.observations = Observations::Boxes;
            o.noise = vec![Noise::Size(0.1)];
        });
        assert_eq!(boxes_only, SyntheticError::NoiseWithoutObservation("size noise"));
        // So near that the cameras stand among the objects.
        match refused(|o| o.distance = 3.0) {
            SyntheticError::NotInView { object, frame, reason } => {
                assert!(object.starts_with("object_0") && frame.starts_with("00000"));
                assert!(matches!(reason, ProjectionError::BehindCamera | ProjectionError::StraddlesCameraPlane));
            }
            other => panic!("{other}"),
        }
        let endless = Trajectory::Arc { span: f64::INFINITY };
        let mut options = options();
        options.trajectory = endless;
        assert!(matches!(generate(&options), Err(SyntheticError::Camera(_))));
    }

    #[test]
    fn no_objects_or_no_views_give_an_empty_scene() {
        for (objects, views) in [(0, 5), (5, 0)] {
            let synthetic = generate(&SyntheticOptions { objects, views, ..options() }).unwrap();
            assert_eq!((synthetic.truth.len(), synthetic.frames.len()), (objects, views));
            assert!(synthetic.scene.detections.is_empty());
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn the_same_seed_gives_the_same_scene_and_more_objects_only_add(seed: u64, objects in 1..8usize) {
            let few = generate(&SyntheticOptions { seed, objects, ..noisy() }).unwrap();
            let again = generate(&SyntheticOptions { seed, objects, ..noisy() }).unwrap();
            prop_assert_eq!(&few.truth, &again.truth);
            prop_assert_eq!(measurements(&few), measurements(&again));
            let many = generate(&SyntheticOptions { seed, objects: objects + 3, ..noisy() }).unwrap();
            prop_assert_eq!(&few.truth[..], &many.truth[..objects]);
            prop_assert_eq!(&measurements(&few)[..], &measurements(&many)[..few.outliers.len()]);
            let other = generate(&SyntheticOptions { seed: seed.wrapping_add(1), objects, ..noisy() }).unwrap();
            prop_assert_ne!(&few.truth, &other.truth);
        }
    }
}
