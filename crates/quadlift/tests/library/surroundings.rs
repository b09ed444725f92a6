//! What the surroundings of objects tell: the border of the image, the ground, the height of the cameras, and edges that
//! err by pixels. Real scenes need all of it; these synthetic ones show what each is worth by itself.

use nalgebra::{Matrix3x4, Point3, Rotation3, Vector2, Vector3};
use quadlift::geometry::{Body, BodyKind, BoundingBox, CamFromWorld, Intrinsics, Projection, project_bounding_box};
use quadlift::metrics::iou3d_bodies;
use quadlift::scene::{NewDetection, Scene, SceneBuilder};
use quadlift::solve::{CategoryPrior, CategoryPriors, Estimate, PosteriorOptions, SizePrior, Status};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{LocalizeOptions, localize};

fn ellipsoids() -> PosteriorOptions {
    PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() }
}

/// Mean volume IoU and mean distance of the centers, of the objects that have a body.
fn score(synthetic: &SyntheticScene, map: PosteriorOptions) -> (f64, f64) {
    let estimates = localize(&synthetic.scene, &LocalizeOptions::from(map)).unwrap().solution.estimates;
    let count = estimates.iter().filter(|estimate| estimate.body.is_some()).count() as f64;
    let (mut iou, mut distance) = (0.0, 0.0);
    for estimate in estimates.iter().filter(|estimate| estimate.body.is_some()) {
        let id = &synthetic.scene.object_ids[estimate.object_index];
        let (_, truth) = synthetic.truth.iter().find(|(name, _)| name == id).unwrap();
        let body = estimate.body.unwrap();
        iou += iou3d_bodies(&body, truth) / count;
        distance += (body.closest_ellipsoid().center - truth.closest_ellipsoid().center).norm() / count;
    }
    (iou, distance)
}

/// Means over some scenes with and without something.
fn compare(scenes: &[SyntheticScene], with: &PosteriorOptions, without: &PosteriorOptions) -> [(f64, f64); 2] {
    let mean = |map: &PosteriorOptions| {
        let all: Vec<(f64, f64)> = scenes.iter().map(|scene| score(scene, map.clone())).collect();
        let count = all.len() as f64;
        (all.iter().map(|s| s.0).sum::<f64>() / count, all.iter().map(|s| s.1).sum::<f64>() / count)
    };
    let both = [mean(with), mean(without)];
    println!("IoU and distance with {:.3?}, without {:.3?}", both[0], both[1]);
    both
}

#[test]
fn objects_reach_beyond_the_border_that_detectors_keep_a_little_away_from() {
    // In two of three views the image ends before the object does, and the box some pixels before the image.
    let mut synthetic = generate(&SyntheticOptions {
        objects: 8,
        trajectory: Trajectory::Orbit,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        ..Default::default()
    })
    .unwrap();
    // One object in each frame, whose image may then end anywhere.
    let mut scene = synthetic.scene.into_parts();
    let frames = scene.frames.clone();
    scene.frames.clear();
    for detection in &mut scene.detections {
        let index = scene.frames.len();
        let mut frame = frames[detection.frame_index as usize].clone();
        frame.id = index.to_string();
        detection.frame_index = index as u32;
        if !index.is_multiple_of(3) {
            let [x0, y0, x1, y1] = detection.bounding_box.unwrap().edges();
            let end = (x1 - 0.2 * (x1 - x0)).round();
            frame.image_size = Some(Vector2::new(end, 960.0));
            detection.bounding_box = BoundingBox::new([x0, y0, end - 6.0, y1]).ok();
        }
        scene.frames.push(frame);
    }
    synthetic.scene = quadlift::scene::Scene::from_parts(scene).unwrap();
    let [with, without] =
        compare(&[synthetic], &ellipsoids(), &PosteriorOptions { border_margin: 0.0, ..ellipsoids() });
    assert!(with.0 > 0.95 && without.0 < 0.85, "{with:?} {without:?}");
}

/// Streets of parked cars, seen from a car that drives by.
fn streets(views: usize, noise: f64) -> Vec<SyntheticScene> {
    let make = |seed| SyntheticOptions {
        seed,
        views,
        objects: 12,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(noise)],
        ..Default::default()
    };
    (0..8).map(|seed| generate(&make(seed)).unwrap()).collect()
}

#[test]
fn objects_on_a_common_ground_are_found_better() {
    let on_ground = PosteriorOptions { ground_plane: true, ..ellipsoids() };
    let [with, without] = compare(&streets(4, 0.1), &on_ground, &ellipsoids());
    assert!(with.0 > without.0 + 0.015 && with.1 < 0.9 * without.1, "{with:?} {without:?}");
}

#[test]
fn the_height_of_the_cameras_tells_where_the_ground_is() {
    let scenes = streets(3, 0.1);
    let height = scenes[0].scene.frames[0].projection.center_in_world().unwrap().z;
    let on_ground = PosteriorOptions { ground_plane: true, ..ellipsoids() };
    let [with, without] =
        compare(&scenes, &PosteriorOptions { camera_height: Some(height), ..on_ground.clone() }, &on_ground);
    assert!(with.0 > without.0 + 0.03 && with.1 < 0.8 * without.1, "{with:?} {without:?}");
}

/// Cars on level ground, from cameras beside each other 80 m above, whose boxes leave the distance to the priors. Length, width and
/// height are 8, 4 and 2 % above those of the prior.
fn cars_from_above(count: usize) -> (Scene, Vec<Body>) {
    let mut scene = SceneBuilder::new("cars");
    scene.up([0.0, 0.0, 1.0]).unwrap();
    let car = |k: usize| Body {
        kind: BodyKind::Cuboid,
        center: Point3::new(9.0 * k as f64 - 8.0, 5.0 - 4.0 * k as f64, 0.765),
        half_extents: Vector3::new(2.16, 0.858, 0.765),
        rotation: Rotation3::from_axis_angle(&Vector3::z_axis(), 0.4 + 1.1 * k as f64),
    };
    let cars: Vec<Body> = (0..count).map(car).collect();
    let intrinsics = Intrinsics::new(1500.0, 1500.0, 960.0, 540.0).unwrap();
    for view in 0..5 {
        let frame = view.to_string();
        let (x, y) = (0.03 * f64::from(view), 0.04 * f64::from(view * 2 % 5));
        let pose = Matrix3x4::new(1.0, 0.0, 0.0, -x, 0.0, -1.0, 0.0, y, 0.0, 0.0, -1.0, 80.0);
        let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap());
        scene.add_frame(&frame, projection, None).unwrap();
        for (k, car) in cars.iter().enumerate() {
            let edges = project_bounding_box(&projection, car).unwrap().edges();
            // Half a pixel of noise, without a generator.
            let noise = |edge: usize| 0.5 * (12.9898 * (20 * k + 4 * view as usize + edge) as f64).sin();
            let found = BoundingBox::new(std::array::from_fn(|edge| edges[edge] + noise(edge))).ok();
            let input = NewDetection {
                frame: &frame,
                object: Some(&k.to_string()),
                category: Some("car"),
                bounding_box: found,
                ..Default::default()
            };
            scene.add_detection(&input).unwrap();
        }
    }
    (scene.build(), cars)
}

/// What an object told of the ground tells nothing of the object; and the size of a car is that of a box.
#[test]
fn an_object_does_not_stand_on_what_it_alone_tells_of_the_ground() {
    let car = |on_ground| {
        let size = SizePrior { mean: [4.0, 1.65, 1.5], sd: [0.36, 0.10, 0.12] };
        let prior = CategoryPrior { size: Some(size), upright_sd: Some(0.01), on_ground };
        CategoryPriors { by_category: [("car".to_owned(), prior)].into() }
    };
    let found = |cars: usize, on_ground: bool, camera_height: Option<f64>| {
        let (scene, truth) = cars_from_above(cars);
        let options = PosteriorOptions { priors: car(on_ground), camera_height, ..Default::default() };
        let estimates = localize(&scene, &LocalizeOptions::from(options)).unwrap().solution.estimates;
        let one = |(estimate, truth): (&Estimate, &Body)| {
            assert_eq!(estimate.status, Status::Ok);
            assert!(estimate.body.is_some_and(|body| body.kind == BodyKind::Cuboid), "{:?}", estimate.body);
            let sd = estimate.covariance.as_ref().unwrap().matrix[(2, 2)].sqrt();
            (sd, (estimate.center.unwrap().z - truth.center.z).abs())
        };
        estimates.iter().zip(&truth).map(one).collect::<Vec<_>>()
    };
    let [alone, in_the_air] = [true, false].map(|on_ground| found(1, on_ground, None)[0]);
    assert!(
        (alone.0 / in_the_air.0 - 1.0).abs() < 1e-6 && (alone.1 - in_the_air.1).abs() < 1e-6,
        "{alone:?} {in_the_air:?}"
    );
    for (sd, off) in found(1, true, None).into_iter().chain(found(3, true, None)) {
        // Of 80 m the size tells 6 %.
        assert!(sd > 2.5 && off < 3.0 * sd && off < 8.0, "{sd} {off}");
    }
    // Where the height is known to 3 % so is the distance.
    let (sd, off) = found(1, true, Some(80.0))[0];
    assert!(sd < 2.6 && off < 2.0, "{sd} {off}");
}

#[test]
fn edges_of_small_boxes_err_by_more_of_their_size() {
    let mut scenes = Vec::new();
    for seed in 0..4 {
        let mut synthetic = generate(&SyntheticOptions {
            seed,
            views: 30,
            objects: 12,
            trajectory: Trajectory::Street,
            observations: Observations::Boxes,
            ..Default::default()
        })
        .unwrap();
        synthetic
            .scene
            .edit(|parts| {
                for (index, detection) in parts.detections.iter_mut().enumerate() {
                    // Three pixels whatever the size is, without a generator.
                    let exact = detection.bounding_box.unwrap().edges();
                    let normal = |k: usize| {
                        let wave = |p: f64| (p * (4 * index + k) as f64 + seed as f64).sin();
                        3.0 * (wave(12.9898) + wave(78.233) + wave(39.425))
                    };
                    let moved: [f64; 4] = std::array::from_fn(|k| exact[k] + normal(k));
                    if moved[2] - moved[0] > 4.0 && moved[3] - moved[1] > 4.0 {
                        detection.bounding_box = BoundingBox::new(moved).ok();
                    }
                }
            })
            .unwrap();
        scenes.push(synthetic);
    }
    let [with, without] = compare(&scenes, &ellipsoids(), &PosteriorOptions { pixel_noise_size: 0.0, ..ellipsoids() });
    assert!(with.0 > 0.735 && with.0 > without.0 + 0.01, "{with:?} {without:?}");
}
