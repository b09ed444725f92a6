//! What scenes hold, what changes them and what does not.

use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::geometry::BodyKind;
use crate::geometry::{
    BoundingBox, ConvexBody, Ellipse, Projection, ProjectionError, project_bounding_box, project_ellipsoid,
};

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
            let expected = project_ellipsoid(projection, &body.closest_ellipsoid()).unwrap();
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
        assert_eq!((cuboid.center(), cuboid.half_extents), (ellipsoid.center(), ellipsoid.half_extents));
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
    #![proptest_config(crate::test_cases::cases(16))]
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
