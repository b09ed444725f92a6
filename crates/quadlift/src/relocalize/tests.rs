//! Images of synthetic rooms are located; hostile maps and images are answered.

use std::f64::consts::TAU;

use nalgebra::{Matrix3x4, Point3, Rotation3, Unit, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::{
    CameraHeight, Gravity, Landmark, LandmarkMap, LocateOptions, LocateStatus, LocatedImage, Query, QueryBox,
    Relocalization, correct,
};
use crate::diagnosis::Correction;
use crate::geometry::rigid::Pose;
use crate::geometry::{
    Body, BodyKind, BoundingBox, CamFromWorld, Ellipsoid, Intrinsics, Projection, project_bounding_box, rotation_vector,
};
use crate::optimize::median::median;
use crate::random::normal;
use crate::scene::Detection;
use crate::solve::{Covariance, CovarianceCoordinates, Matrix9, NoiseModel};
use crate::synthetic::{Noise, Observations, SyntheticOptions, generate};

/// Sizes of the image.
const WIDTH: f64 = 1280.0;
const HEIGHT: f64 = 720.0;

/// A room of 8 x 6 m with objects of so many categories on the floor, on tables and on the walls; z is up.
fn room(rng: &mut ChaCha8Rng, objects: usize, categories: usize) -> Vec<Landmark> {
    room_of(rng, objects, categories, &[BodyKind::Ellipsoid])
}

/// The same of bodies of these kinds, by turns.
fn room_of(rng: &mut ChaCha8Rng, objects: usize, categories: usize, kinds: &[BodyKind]) -> Vec<Landmark> {
    (0..objects)
        .map(|k| {
            let category = k % categories;
            let center =
                Point3::new(rng.random_range(-4.0..4.0), rng.random_range(-3.0..3.0), rng.random_range(0.2..1.6));
            let size = 0.1 + 0.05 * category as f64;
            let shape = Vector3::new(1.0, 0.6 + 0.05 * category as f64, 0.8);
            let semi_axes = shape.map(|x| x * size * rng.random_range(0.9..1.1));
            let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..TAU));
            let kind = kinds[k % kinds.len()];
            Landmark {
                body: Body { center, half_extents: semi_axes, rotation, kind },
                covariance: None,
                category: Some(format!("category {category}")),
                correction: None,
            }
        })
        .collect()
}

/// A camera that looks at the middle of the room from its walls, at the height of a person.
fn camera(rng: &mut ChaCha8Rng) -> CamFromWorld {
    let angle = rng.random_range(0.0..TAU);
    let eye = Point3::new(6.0 * angle.cos(), 5.0 * angle.sin(), rng.random_range(1.3..1.9));
    let target = Point3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.8);
    looking(&eye, &target)
}

fn looking(eye: &Point3<f64>, target: &Point3<f64>) -> CamFromWorld {
    let z = (target - eye).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let y = z.cross(&x);
    let mut matrix = Matrix3x4::zeros();
    for (row, axis) in [x, y, z].iter().enumerate() {
        matrix.fixed_view_mut::<1, 3>(row, 0).copy_from(&axis.transpose());
        matrix[(row, 3)] = -axis.dot(&eye.coords);
    }
    CamFromWorld::new(matrix).unwrap()
}

/// The boxes of an image: noise relative to the half size, misses, and false boxes in the place of so many.
fn image(rng: &mut ChaCha8Rng, room: &[Landmark], pose: &CamFromWorld, noise: f64, missed: f64, wrong: f64) -> Query {
    let intrinsics = Intrinsics::new(900.0, 900.0, WIDTH / 2.0, HEIGHT / 2.0).unwrap();
    let projection = Projection::from_camera(&intrinsics, pose);
    let mut boxes = Vec::new();
    for landmark in room {
        let Ok(b) = project_bounding_box(&projection, &landmark.body) else { continue };
        let center = b.center();
        let inside = center.x > 0.0 && center.x < WIDTH && center.y > 0.0 && center.y < HEIGHT;
        if !inside || rng.random_range(0.0..1.0) < missed {
            continue;
        }
        let sd = noise * b.mean_half_size();
        let mut edge = |at: f64, low: f64, high: f64| (at + sd * normal(rng)).clamp(low, high);
        let edges = [edge(b.x0, 0.0, WIDTH), edge(b.y0, 0.0, HEIGHT), edge(b.x1, 0.0, WIDTH), edge(b.y1, 0.0, HEIGHT)];
        let Ok(bounding_box) = BoundingBox::new(edges) else { continue };
        boxes.push(QueryBox { bounding_box, box_in_image: None, category: landmark.category.clone() });
        if rng.random_range(0.0..1.0) < wrong {
            let (x, y) = (rng.random_range(0.0..WIDTH - 100.0), rng.random_range(0.0..HEIGHT - 100.0));
            let size = rng.random_range(20.0..100.0);
            let category = room[rng.random_range(0..room.len())].category.clone();
            let bounding_box = BoundingBox::new([x, y, x + size, y + size]).unwrap();
            boxes.push(QueryBox { bounding_box, box_in_image: None, category });
        }
    }
    Query { intrinsics, image_size: Some([WIDTH, HEIGHT].into()), boxes }
}

/// Errors of the position (meters) and the rotation (degrees).
fn errors(found: &CamFromWorld, truth: &CamFromWorld) -> (f64, f64) {
    let [a, b] = [found, truth].map(Pose::from);
    ((a.center() - b.center()).norm(), a.angle_to(&b).to_degrees())
}

/// Shares of images that are located, and of those that claim to be and are not; `gravity` is known to 1 degree.
fn shares(images: usize, categories: usize, kinds: &[BodyKind], gravity: bool) -> (f64, f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut right, mut wrong) = (0, 0);
    for _ in 0..images {
        let landmarks = room_of(&mut rng, 30, categories, kinds);
        let pose = camera(&mut rng);
        let query = image(&mut rng, &landmarks, &pose, 0.03, 0.2, 0.2);
        let up_in_camera = Unit::new_normalize(pose.matrix().fixed_columns::<3>(0) * Vector3::z());
        let known = Gravity { up_in_world: Vector3::z_axis(), up_in_camera, sd: 0.017 };
        let options = LocateOptions { gravity: gravity.then_some(known), ..Default::default() };
        let found = LandmarkMap::new(landmarks).relocalize(&query, &options);
        if found.status == LocateStatus::Ok {
            let (position, angle) = errors(&found.poses[0].cam_from_world, &pose);
            let near = position < 0.1 && angle < 5.0;
            right += usize::from(near);
            wrong += usize::from(!near);
        }
    }
    (right as f64 / images as f64, wrong as f64 / images as f64)
}

#[test]
fn rooms_are_found_again() {
    use BodyKind::{Cuboid, Cylinder, Ellipsoid};
    let boxes = [Cuboid, Cuboid, Cylinder, Cuboid, Cuboid];
    for (categories, gravity, kinds) in [
        (30, false, &[Ellipsoid][..]),
        (6, false, &[Ellipsoid]),
        (6, true, &[Ellipsoid]),
        (30, false, &boxes),
        (6, false, &boxes),
    ] {
        let (right, wrong) = shares(20, categories, kinds, gravity);
        assert!(right >= 0.9 && wrong == 0.0, "{categories} {gravity} {kinds:?}: {right} {wrong}");
    }
}

/// Four to six things on a table, which has one depth nearly, are located as often where gravity is known.
#[test]
fn gravity_makes_nothing_worse() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut located = [0, 0];
    let images = 40;
    for k in 0..images {
        let mut landmarks = room(&mut rng, 4 + k % 3, 30);
        for landmark in &mut landmarks {
            let place = Point3::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5), 0.8);
            landmark.body = Body { center: place, half_extents: landmark.body.half_extents * 0.4, ..landmark.body };
        }
        let eye = Point3::new(1.5, rng.random_range(-1.0..1.0), rng.random_range(1.0..1.6));
        let pose = looking(&eye, &Point3::new(0.0, 0.0, 0.8));
        let query = image(&mut rng, &landmarks, &pose, 0.05, 0.0, 0.0);
        let up_in_camera = Unit::new_normalize(pose.matrix().fixed_columns::<3>(0) * Vector3::z());
        let known = Gravity { up_in_world: Vector3::z_axis(), up_in_camera, sd: 0.017 };
        let map = LandmarkMap::new(landmarks);
        for (gravity, located) in [None, Some(known)].into_iter().zip(&mut located) {
            let found = map.relocalize(&query, &LocateOptions { gravity, ..Default::default() });
            let is_right = |pose: &CamFromWorld, truth| errors(pose, truth).1 < 5.0;
            let best = found.poses.first().filter(|_| found.status == LocateStatus::Ok);
            *located += usize::from(best.is_some_and(|best| is_right(&best.cam_from_world, &pose)));
        }
    }
    assert!(located[1] >= located[0] && located[1] * 10 >= images * 9, "{located:?} of {images}");
}

/// Cuboids whose map has ellipsoids: their boxes correct them.
#[test]
fn corrected_landmarks_locate_more_exactly() {
    let made = generate(&SyntheticOptions {
        objects: 10,
        views: 24,
        seed: 3,
        body: BodyKind::Cuboid,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.01)],
        ..Default::default()
    });
    let made = made.unwrap();
    let of_map = |frame: usize| frame.is_multiple_of(2);
    let mut scene = made.scene.clone();
    scene.edit(|parts| parts.detections.retain(|d| of_map(d.frame_index as usize))).unwrap();
    let landmark = |(id, body): &(String, Body)| Landmark {
        body: body.closest_ellipsoid().into(),
        covariance: None,
        category: Some(id.clone()),
        correction: None,
    };
    let plain: Vec<Landmark> = made.truth.iter().map(landmark).collect();
    let mut corrected = plain.clone();
    let place = |(id, _): &(String, Body)| scene.object_ids.iter().position(|other| other == id).unwrap();
    correct(&mut corrected, &scene, &made.truth.iter().map(place).collect::<Vec<_>>());
    let levels = NoiseModel::new([("edge_noise", 0.1)]).unwrap();
    let mut degrees = [plain, corrected].map(|landmarks| {
        let options = LocateOptions::with_noise(&levels, &landmarks);
        let map = LandmarkMap::new(landmarks);
        let mut degrees = Vec::new();
        for (index, frame) in made.frames.iter().enumerate().filter(|(index, _)| !of_map(*index)) {
            let of_frame = made.scene.detections.iter().zip(&made.true_objects);
            let of_frame = of_frame.filter(|(d, _)| d.frame_index as usize == index);
            let query_box = |(d, object): (&Detection, &Option<usize>)| QueryBox {
                bounding_box: d.bounding_box.unwrap(),
                box_in_image: None,
                category: object.map(|object| made.truth[object].0.clone()),
            };
            let boxes = of_frame.map(query_box).collect();
            let query = Query { intrinsics: frame.intrinsics, image_size: None, boxes };
            let found = map.relocalize(&query, &options);
            assert_eq!(found.status, LocateStatus::Ok);
            degrees.push(errors(&found.poses[0].cam_from_world, &frame.cam_from_world).1);
        }
        degrees
    });
    let [plain, corrected] = degrees.each_mut().map(|all| median(all).unwrap());
    assert!(corrected < 0.6 * plain, "{plain} {corrected}");
}

fn relocalize(landmarks: Vec<Landmark>, query: &Query) -> Relocalization {
    LandmarkMap::new(landmarks).relocalize(query, &LocateOptions::default())
}

#[test]
fn what_cannot_be_told_is_not() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let all = room(&mut rng, 30, 6);
    let pose = camera(&mut rng);
    let query = image(&mut rng, &all, &pose, 0.02, 0.0, 0.0);
    assert_eq!(relocalize(Vec::new(), &query).status, LocateStatus::TooFewObjects);
    let nothing = Query { boxes: Vec::new(), ..query.clone() };
    assert_eq!(relocalize(all.clone(), &nothing).status, LocateStatus::TooFewObjects);
    // Two objects.
    let two = all[..2].to_vec();
    assert_eq!(
        relocalize(two.clone(), &image(&mut rng, &two, &pose, 0.02, 0.0, 0.0)).status,
        LocateStatus::TooFewObjects
    );
    // A map of another room, in other units: no pose, or one that is not sure.
    let other = room(&mut rng, 30, 6);
    assert_ne!(relocalize(other, &query).status, LocateStatus::Ok);
    // A ring of equal objects looks the same from six sides.
    let ring: Vec<Landmark> = (0..6)
        .map(|k| {
            let angle = TAU / 6.0 * f64::from(k);
            let center = Point3::new(angle.cos(), angle.sin(), 0.5);
            let ellipsoid = Ellipsoid { center, semi_axes: Vector3::repeat(0.2), rotation: Rotation3::identity() };
            Landmark { body: ellipsoid.into(), covariance: None, category: None, correction: None }
        })
        .collect();
    let query = image(&mut rng, &ring, &pose, 0.01, 0.0, 0.0);
    let found = relocalize(ring, &query);
    assert_eq!(found.status, LocateStatus::Ambiguous);
    assert!(found.poses.len() >= 6, "{}", found.poses.len());
    // Objects on one table, of different categories: one pose, which is right.
    let table: Vec<Landmark> = (0..6)
        .map(|k| {
            let mut landmark = all[k].clone();
            landmark.body.center = Point3::new(0.4 * k as f64 - 1.0, 0.3 * (k * k % 5) as f64, 0.7);
            landmark
        })
        .collect();
    let found = relocalize(table.clone(), &image(&mut rng, &table, &pose, 0.01, 0.0, 0.0));
    assert_eq!(found.status, LocateStatus::Ok);
    let (position, angle) = errors(&found.poses[0].cam_from_world, &pose);
    assert!(position < 0.2 && angle < 3.0, "{position} {angle}");
    // Hundreds of equal objects: whatever the answer, it ends.
    let many: Vec<Landmark> = room(&mut rng, 300, 1);
    let query = image(&mut rng, &many[..40], &pose, 0.02, 0.0, 0.0);
    assert!(query.boxes.len() > 20);
    let _ = relocalize(many, &query);
    // Numbers that are none.
    let mut broken = all;
    broken[0].body.center.x = f64::NAN;
    broken[1].body.half_extents.x = 0.0;
    let _ = relocalize(broken, &query);
}

#[test]
fn edges_behind_other_objects_are_one_sided() {
    // A wall of objects in the background, halves of which nearer ones hide.
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let ball = |x: f64, y: f64, z: f64, radius: f64, name: &str| Landmark {
        body: Ellipsoid {
            center: Point3::new(x, y, z),
            semi_axes: Vector3::repeat(radius),
            rotation: Rotation3::identity(),
        }
        .into(),
        covariance: None,
        category: Some(name.to_owned()),
        correction: None,
    };
    let landmarks = vec![
        ball(-0.5, 1.0, 0.3, 0.2, "a"),
        ball(0.1, 1.2, 0.3, 0.2, "b"),
        ball(0.7, 1.1, 0.3, 0.2, "c"),
        ball(0.4, 0.8, 0.9, 0.2, "d"),
        ball(-0.62, 0.0, 0.45, 0.15, "e"),
        ball(0.3, -0.1, 0.45, 0.15, "f"),
        ball(-0.1, 0.2, 0.8, 0.15, "g"),
    ];
    let pose = looking(&Point3::new(0.0, -4.0, 1.0), &Point3::new(0.0, 0.5, 0.4));
    let mut query = image(&mut rng, &landmarks, &pose, 1e-6, 0.0, 0.0);
    assert_eq!(query.boxes.len(), landmarks.len());
    // The box of each object ends where a nearer one begins.
    let boxes: Vec<BoundingBox> = query.boxes.iter().map(|b| b.bounding_box).collect();
    let mut cut = 0;
    for (far, near) in [(0, 4), (1, 5)] {
        let b = &mut query.boxes[far].bounding_box;
        let (a, c) = (b.x0, boxes[near].x1);
        if a < c && c < b.center().x {
            *b = BoundingBox::new([c, b.y0, b.x1, b.y1]).unwrap();
            cut += 1;
        } else if boxes[near].x0 < b.x1 && boxes[near].x0 > b.center().x {
            *b = BoundingBox::new([b.x0, b.y0, boxes[near].x0, b.y1]).unwrap();
            cut += 1;
        }
    }
    assert_eq!(cut, 2);
    let found = relocalize(landmarks, &query);
    assert_eq!(found.status, LocateStatus::Ok);
    assert_eq!(found.poses[0].matches.len(), 7);
    let (position, angle) = errors(&found.poses[0].cam_from_world, &pose);
    assert!(position < 1e-3 && angle < 0.02, "{position} {angle}");
}

/// The objects of a map with errors: of centers relative to sizes, and of the logarithms of sizes.
fn with_errors(rng: &mut ChaCha8Rng, landmarks: &[Landmark], [of_center, of_size]: [f64; 2]) -> Vec<Landmark> {
    let of = |landmark: &Landmark| {
        let body = &landmark.body;
        let size = body.half_extents.mean();
        let mut matrix = Matrix9::zeros();
        for k in 0..9 {
            // How the bodies are turned is known.
            matrix[(k, k)] = [of_center * size, 1e-9, of_size][k / 3].powi(2);
        }
        let center = body.center + Vector3::from_fn(|_, _| of_center * size * normal(rng));
        let half_extents = body.half_extents.map(|x| x * (of_size * normal(rng)).exp());
        let covariance = Covariance { coordinates: CovarianceCoordinates::CenterRotationLogAxes, matrix };
        Landmark { body: Body { center, half_extents, ..*body }, covariance: Some(covariance), ..landmark.clone() }
    };
    landmarks.iter().map(of).collect()
}

/// The mean normalized squared error of located poses (six parameters), with such errors of boxes and of the map.
fn mean_nees(box_noise: f64, map_noise: [f64; 2]) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut all = Vec::new();
    for _ in 0..60 {
        let landmarks = room(&mut rng, 30, 30);
        let pose = camera(&mut rng);
        let query = image(&mut rng, &landmarks, &pose, box_noise, 0.2, 0.0);
        let map = with_errors(&mut rng, &landmarks, map_noise);
        let options = LocateOptions { edge_noise: box_noise, ..Default::default() };
        let found = LandmarkMap::new(map).relocalize(&query, &options);
        let Some(best) = found.poses.first().filter(|_| found.status == LocateStatus::Ok) else { continue };
        let [a, b] = [&best.cam_from_world, &pose].map(Pose::from);
        // The motion that leads from the estimate to the truth.
        let turn = b.rotation * a.rotation.transpose();
        let shift = b.translation - turn * a.translation;
        let turn = rotation_vector(&Rotation3::from_matrix_unchecked(turn));
        let error = nalgebra::Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        all.push(error.dot(&(best.covariance.try_inverse().unwrap() * error)));
    }
    assert!(all.len() >= 50, "{}", all.len());
    all.iter().sum::<f64>() / all.len() as f64
}

#[test]
fn the_covariance_is_that_of_the_errors() {
    // 50 chi-square numbers with six degrees of freedom have a mean of 6 +- 0.5. If the edges of a box shared no errors of the map,
    // the last two would be 8.5 and 3.7.
    for (box_noise, map_noise) in [(0.05, [0.0, 0.0]), (0.03, [0.1, 0.0]), (0.03, [0.0, 0.1])] {
        let mean = mean_nees(box_noise, map_noise);
        assert!((4.8..7.5).contains(&mean), "boxes {box_noise}, map {map_noise:?}: {mean}");
    }
}

#[test]
fn a_known_height_is_kept_to() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let landmarks = room(&mut rng, 30, 6);
    let pose = camera(&mut rng);
    let query = image(&mut rng, &landmarks, &pose, 0.05, 0.2, 0.0);
    let map = LandmarkMap::new(landmarks);
    let height_of = |pose: &CamFromWorld| Pose::from(pose).center().z;
    let free = map.relocalize(&query, &LocateOptions::default());
    let known = CameraHeight { up_in_world: Vector3::z_axis(), height: height_of(&pose), sd: 1e-3 };
    let held = map.relocalize(&query, &LocateOptions { height: Some(known), ..Default::default() });
    let [free, held] = [&free, &held].map(|found| {
        assert_eq!(found.status, LocateStatus::Ok);
        let best = &found.poses[0];
        let up = best.cam_from_world.matrix().fixed_columns::<3>(0) * Vector3::z();
        let sd = up.dot(&(best.covariance.fixed_view::<3, 3>(3, 3) * up)).sqrt();
        (height_of(&best.cam_from_world) - known.height, sd)
    });
    assert!(free.1 > 5e-3 && held.1 < 1.01e-3, "{free:?} {held:?}");
    assert!(free.0.abs() < 4.0 * free.1 && held.0.abs() < 4.0 * held.1, "{free:?} {held:?}");
    // A height that contradicts the boxes makes the pose less probable.
    let wrong = CameraHeight { height: known.height + 1.0, ..known };
    let found = map.relocalize(&query, &LocateOptions { height: Some(wrong), ..Default::default() });
    assert!(found.status != LocateStatus::Ok || found.poses[0].evidence < free_evidence(&map, &query) - 50.0);
}

fn free_evidence(map: &LandmarkMap, query: &Query) -> f64 {
    map.relocalize(query, &LocateOptions::default()).poses[0].evidence
}

#[test]
fn more_landmarks_and_boxes_than_can_be_compared_are_answered() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    // Thousands of equal objects in one row, and a box of each of 60 of them.
    let ball = |k: u32| Landmark {
        body: Ellipsoid {
            center: Point3::new(0.3 * f64::from(k), 0.0, 0.5),
            semi_axes: Vector3::repeat(0.1),
            rotation: Rotation3::identity(),
        }
        .into(),
        covariance: None,
        category: None,
        correction: None,
    };
    let row: Vec<Landmark> = (0..3000).map(ball).collect();
    let pose = looking(&Point3::new(450.0, -9.0, 1.5), &Point3::new(450.0, 0.0, 0.5));
    let query = image(&mut rng, &row[1470..1530], &pose, 0.02, 0.0, 0.0);
    assert!(query.boxes.len() > 20, "{}", query.boxes.len());
    assert_ne!(relocalize(row, &query).status, LocateStatus::Ok);
}

/// An image with a mistake of its boxes, and of its focal length.
fn mistaken(query: &Query, of_edge: impl Fn(f64) -> f64, focal_factor: f64) -> Query {
    let change = |b: &QueryBox| QueryBox {
        bounding_box: BoundingBox::new(b.bounding_box.edges().map(&of_edge)).unwrap(),
        ..b.clone()
    };
    let k = &query.intrinsics;
    Query {
        intrinsics: Intrinsics::new(focal_factor * k.fx, focal_factor * k.fy, k.cx, k.cy).unwrap(),
        boxes: query.boxes.iter().map(change).collect(),
        ..query.clone()
    }
}

#[test]
fn mistakes_of_all_images_are_found_and_right_images_have_none() {
    let check = |seed: u64, categories: usize, of_edge: fn(f64) -> f64, focal_factor: f64| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let landmarks = room(&mut rng, 30, categories);
        let map = LandmarkMap::new(landmarks.clone());
        let mut wrong = || {
            let pose = camera(&mut rng);
            mistaken(&image(&mut rng, &landmarks, &pose, 0.05, 0.2, 0.2), of_edge, focal_factor)
        };
        let images: Vec<Query> = (0..2).map(|_| wrong()).collect();
        let options = LocateOptions::default();
        let all: Vec<Relocalization> = images.iter().map(|query| map.relocalize(query, &options)).collect();
        let image = |(query, located)| LocatedImage { query, options: options.clone(), located };
        map.common_mistake(&images.iter().zip(&all).map(image).collect::<Vec<_>>())
    };
    for (seed, categories) in [(1, 30), (2, 6)] {
        assert_eq!(check(seed, categories, |x| x, 1.0), None);
    }
    let mistake = check(1, 30, |x| x, 0.8).unwrap();
    let Correction::FocalFactor(factor) = mistake.correction else { panic!("{mistake:?}") };
    assert!((factor / 1.25 - 1.0).abs() < 0.06, "{mistake:?}");
    assert!(mistake.corrected_evidence > mistake.evidence + 50.0, "{mistake:?}");
    let mistake = check(2, 6, |x| 0.5 * x, 1.0).unwrap();
    let Correction::ImageScale(factor) = mistake.correction else { panic!("{mistake:?}") };
    assert!((factor / 2.0 - 1.0).abs() < 0.04, "{mistake:?}");
    assert_eq!(LandmarkMap::new(Vec::new()).common_mistake(&[]), None);
}
