//! Maps of synthetic rooms are aligned; hostile maps are answered.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Rotation3, Unit, Vector3};
use proptest::prelude::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::{AlignOptions, AlignStatus, Alignment, Ambiguity, CommonUp, MapObject, align};
use crate::geometry::{Ellipsoid, Similarity, rotation_vector};
use crate::random::{normal, rotation};
use crate::solve::{Covariance, CovarianceCoordinates, Matrix9};

/// A room of 8 x 6 m with objects of so many categories; z is up.
fn room(rng: &mut ChaCha8Rng, objects: usize, categories: usize) -> Vec<MapObject> {
    (0..objects)
        .map(|k| {
            let category = k % categories;
            let center =
                Point3::new(rng.random_range(-4.0..4.0), rng.random_range(-3.0..3.0), rng.random_range(0.2..1.6));
            let size = 0.1 + 0.01 * category as f64;
            let semi_axes = Vector3::new(1.0, 0.7, 0.8).map(|x| x * size * rng.random_range(0.9..1.1));
            let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..TAU));
            MapObject {
                ellipsoid: Ellipsoid { center, semi_axes, rotation },
                covariance: None,
                category: Some(format!("category {category}")),
            }
        })
        .collect()
}

/// The objects as they are seen from one side: centers with 2 cm of error along the direction from there and 5 mm across, sizes with 5 %.
fn seen_from(rng: &mut ChaCha8Rng, objects: &[MapObject], eye: Point3<f64>) -> Vec<MapObject> {
    objects
        .iter()
        .map(|object| {
            let along = (object.ellipsoid.center - eye).normalize();
            let across = 0.005 * 0.005;
            let of_center = Matrix3::from_diagonal_element(across) + along * along.transpose() * (0.02 * 0.02 - across);
            let factor = of_center.cholesky().unwrap().l();
            let error = factor * Vector3::from_fn(|_, _| normal(rng));
            let semi_axes = object.ellipsoid.semi_axes.map(|x| x * (0.05 * normal(rng)).exp());
            let mut matrix = Matrix9::from_diagonal_element(0.05 * 0.05);
            matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&of_center);
            let center = object.ellipsoid.center + error;
            MapObject {
                ellipsoid: Ellipsoid { center, semi_axes, ..object.ellipsoid },
                covariance: Some(Covariance { coordinates: CovarianceCoordinates::CenterRotationLogAxes, matrix }),
                category: object.category.clone(),
            }
        })
        .collect()
}

/// The objects in another frame.
fn moved(objects: &[MapObject], by: &Similarity) -> Vec<MapObject> {
    let one = |object: &MapObject| {
        let covariance = object.covariance.map(|covariance| {
            let mut matrix = covariance.matrix;
            let of_center = matrix.fixed_view::<3, 3>(0, 0).into_owned();
            let turned = by.rotation * of_center * by.rotation.matrix().transpose() * by.scale * by.scale;
            matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned);
            Covariance { matrix, ..covariance }
        });
        MapObject { ellipsoid: by.ellipsoid(&object.ellipsoid), covariance, category: object.category.clone() }
    };
    objects.iter().map(one).collect()
}

/// A motion anywhere; about the vertical, or any.
fn any_similarity(rng: &mut ChaCha8Rng, upright: bool, rigid: bool) -> Similarity {
    let turn = if upright {
        Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..TAU))
    } else {
        rotation(rng)
    };
    let scale = if rigid { 1.0 } else { rng.random_range(-2.0f64..2.0).exp() };
    Similarity { scale, rotation: turn, translation: Vector3::from_fn(|_, _| rng.random_range(-20.0..20.0)) }
}

/// Two maps of a room from opposite sides, of which the second one is moved: a third of the objects are in the first, a third in the
/// second, and two fifths of the whole room in both.
fn two_maps(rng: &mut ChaCha8Rng, categories: usize, b_from_room: &Similarity) -> [Vec<MapObject>; 2] {
    let mut all = room(rng, 30, categories);
    // Categories do not tell which map an object is in.
    for k in (1..all.len()).rev() {
        all.swap(k, rng.random_range(0..=k));
    }
    let common = &all[..12];
    let a = seen_from(rng, &[common, &all[12..21]].concat(), Point3::new(0.0, -6.0, 1.6));
    let b = seen_from(rng, &[common, &all[21..]].concat(), Point3::new(0.0, 6.0, 1.6));
    [a, moved(&b, b_from_room)]
}

/// Whether a transform is within 2 % of the scale, 2 degrees, and 10 cm in the middle of the room.
fn is_right(found: &Similarity, b_from_room: &Similarity) -> bool {
    let room = found.after(b_from_room);
    let middle = Point3::new(0.0, 0.0, 0.8);
    (room.scale.ln()).abs() < 0.02 && room.angle().to_degrees() < 2.0 && (room.point(&middle) - middle).norm() < 0.1
}

fn options(upright: bool, rigid: bool) -> AlignOptions {
    let up = CommonUp { up_in_a: Vector3::z_axis(), up_in_b: Vector3::z_axis(), sd: 0.02 };
    AlignOptions { scale: rigid.then_some(1.0), up: upright.then_some(up) }
}

/// How many draws are right, and how many claim to be and are not.
fn tally(draws: u64, categories: usize, upright: bool, rigid: bool) -> (u64, u64) {
    let (mut right, mut wrong) = (0, 0);
    for seed in 0..draws {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let b_from_room = any_similarity(&mut rng, upright, rigid);
        let [a, b] = two_maps(&mut rng, categories, &b_from_room);
        let found = align(&a, &b, &options(upright, rigid));
        if found.status == AlignStatus::Ok {
            let is_right = is_right(&found.transforms[0].a_from_b, &b_from_room);
            right += u64::from(is_right);
            wrong += u64::from(!is_right);
        }
    }
    (right, wrong)
}

#[test]
fn rooms_that_overlap_are_aligned() {
    for (categories, upright, rigid) in
        [(30, false, false), (6, false, false), (3, false, true), (1, false, true), (1, true, false), (1, true, true)]
    {
        let (right, wrong) = tally(12, categories, upright, rigid);
        assert!(right >= 11 && wrong == 0, "{categories} {upright} {rigid}: {right} right, {wrong} wrong");
    }
}

#[test]
fn rooms_that_have_nothing_in_common_are_not() {
    for (categories, upright, rigid) in
        [(30, false, false), (6, true, true), (3, false, true), (1, true, false), (1, true, true)]
    {
        for seed in 0..8 {
            let mut rng = ChaCha8Rng::seed_from_u64(100 + seed);
            let [a, b] = [0, 1].map(|_| {
                let objects = room(&mut rng, 21, categories);
                seen_from(&mut rng, &objects, Point3::new(0.0, -6.0, 1.6))
            });
            let found = align(&a, &b, &options(upright, rigid));
            assert_ne!(
                found.status,
                AlignStatus::Ok,
                "{categories} {upright} {rigid} {seed}: {:?}",
                found.transforms[0]
            );
        }
    }
}

#[test]
fn exact_maps_give_the_exact_transform() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for (upright, rigid) in [(false, false), (false, true), (true, false), (true, true)] {
        let a = room(&mut rng, 12, 6);
        let b_from_a = any_similarity(&mut rng, upright, rigid);
        let mut b = moved(&a, &b_from_a);
        b.reverse();
        let found = align(&a, &b, &options(upright, rigid));
        assert_eq!(found.status, AlignStatus::Ok);
        let best = &found.transforms[0];
        let off = best.a_from_b.matrix() - b_from_a.inverse().matrix();
        assert!(off.norm() < 1e-6, "{off}");
        assert_eq!(best.matches, (0..12).map(|k| (k, 11 - k)).collect::<Vec<_>>());
        let known = best.covariance.row(6).iter().all(|x| *x == 0.0);
        assert_eq!(known, rigid);
    }
}

fn ball(x: f64, y: f64, z: f64) -> MapObject {
    let ellipsoid =
        Ellipsoid { center: Point3::new(x, y, z), semi_axes: Vector3::repeat(0.1), rotation: Rotation3::identity() };
    MapObject { ellipsoid, covariance: None, category: None }
}

fn status(a: &[MapObject], b: &[MapObject], upright: bool, rigid: bool) -> AlignStatus {
    align(a, b, &options(upright, rigid)).status
}

#[test]
fn what_maps_do_not_decide_is_ambiguous() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let by = any_similarity(&mut rng, true, true);
    // A ring of equal balls, whose eight turns are all alike.
    let ring: Vec<MapObject> =
        (0..8).map(|k| TAU / 8.0 * f64::from(k)).map(|angle| ball(2.0 * angle.cos(), 2.0 * angle.sin(), 0.5)).collect();
    for (upright, rigid) in [(false, false), (false, true), (true, true), (true, false)] {
        let found = align(&ring, &moved(&ring, &by), &options(upright, rigid));
        assert_eq!(found.status, AlignStatus::Ambiguous(Ambiguity::Several), "{upright} {rigid}");
        assert_eq!(found.transforms.len(), 8, "{upright} {rigid}");
    }
    // A row of balls that are unlike each other: the rotation about it is open, unless the vertical is known.
    let mut row: Vec<MapObject> =
        [0.0, 1.0, 2.5, 3.1, 4.9, 7.0, 7.7, 9.6, 10.1, 12.3].map(|x| ball(x, 0.0, 0.5)).into();
    row.iter_mut().enumerate().for_each(|(k, object)| object.category = Some(k.to_string()));
    let turned = moved(&row, &by);
    for rigid in [false, true] {
        let found = status(&row, &turned, false, rigid);
        assert!(matches!(found, AlignStatus::Ambiguous(_)), "{found:?}");
        assert_eq!(status(&row, &turned, true, rigid), AlignStatus::Ok, "{rigid}");
    }
    // Objects on the floor: a mirror is no motion, so they decide.
    let floor: Vec<MapObject> = room(&mut rng, 12, 12)
        .into_iter()
        .map(|mut object| {
            object.ellipsoid.center.z = 0.0;
            object
        })
        .collect();
    assert_eq!(status(&floor, &moved(&floor, &by), false, true), AlignStatus::Ok);
    // A grid of equal balls agrees with itself in many places.
    let grid: Vec<MapObject> = (0..36).map(|k| ball(f64::from(k % 6), f64::from(k / 6), 0.5)).collect();
    for rigid in [true, false] {
        let found = status(&grid, &moved(&grid, &by), true, rigid);
        assert_eq!(found, AlignStatus::Ambiguous(Ambiguity::Several), "{rigid}");
    }
}

#[test]
fn maps_without_enough_objects_are_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let all = room(&mut rng, 20, 20);
    let few = AlignStatus::TooFewObjects;
    assert_eq!(status(&[], &[], false, false), few);
    assert_eq!(status(&all, &[], false, true), few);
    assert_eq!(status(&all, &all[..2], false, false), few);
    assert_eq!(status(&all, &all[..1], true, true), few);
    // Two objects decide nothing beyond chance, even with a known vertical.
    assert_ne!(status(&all[..2], &all[..2], true, true), AlignStatus::Ok);
    let other: Vec<MapObject> = all.iter().map(|o| MapObject { category: Some("none".into()), ..o.clone() }).collect();
    assert_eq!(status(&all, &other, false, false), few);
}

#[test]
fn units_are_told_by_objects() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let all = room(&mut rng, 20, 5);
    let millimeters =
        Similarity { scale: 1000.0, rotation: rotation(&mut rng), translation: Vector3::new(5000.0, -300.0, 0.0) };
    let b = moved(&all, &millimeters);
    let found = align(&all, &b, &options(false, false));
    assert_eq!(found.status, AlignStatus::Ok);
    assert!((found.transforms[0].a_from_b.scale - 1e-3).abs() < 1e-9);
    // A known scale that is wrong finds nothing.
    assert_ne!(status(&all, &b, false, true), AlignStatus::Ok);
    let known = AlignOptions { scale: Some(1e-3), up: None };
    assert_eq!(align(&all, &b, &known).status, AlignStatus::Ok);
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_ne!(align(&all, &all, &AlignOptions { scale: Some(scale), up: None }).status, AlignStatus::Ok);
    }
}

#[test]
fn numbers_that_are_none_are_left_out() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let objects = room(&mut rng, 20, 5);
    let mut all = seen_from(&mut rng, &objects, Point3::new(0.0, -6.0, 1.0));
    all[0].ellipsoid.center.x = f64::NAN;
    all[1].ellipsoid.semi_axes.x = 0.0;
    all[2].covariance.as_mut().unwrap().matrix[(0, 0)] = f64::INFINITY;
    all[3].covariance.as_mut().unwrap().matrix[(1, 1)] = -1.0;
    all[4].ellipsoid.semi_axes = Vector3::repeat(1e300);
    all[5].ellipsoid.center.y = 1e300;
    let found = align(&all, &all, &options(false, true));
    if found.status == AlignStatus::Ok {
        assert!(found.transforms[0].matches.iter().all(|&(a, b)| a == b && a > 3));
    }
    assert_eq!(status(&all[..4], &all, false, false), AlignStatus::TooFewObjects);
}

#[test]
fn large_maps_of_equal_objects_are_answered() {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let many: Vec<MapObject> = room(&mut rng, 400, 1);
    let by = any_similarity(&mut rng, false, false);
    // Not all pairs can be examined: whatever the answer, it is not wrong, and not that there is none.
    let found = align(&many, &moved(&many, &by), &options(false, false));
    assert_ne!(found.status, AlignStatus::NoAlignment);
    assert!(found.status != AlignStatus::Ok || is_right(&found.transforms[0].a_from_b, &by));
}

#[test]
fn an_object_that_is_there_twice_is_found() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let mut all = room(&mut rng, 20, 5);
    assert_eq!(super::same_place(&all), []);
    let mut again = all[7].clone();
    again.ellipsoid.center.x += 0.01;
    all.push(again.clone());
    again.category = Some("another one".into());
    all.push(again);
    assert_eq!(super::same_place(&all), [(7, 20)]);
}

#[test]
fn objects_without_a_category_may_be_any() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let by = any_similarity(&mut rng, false, true);
    let [mut a, mut b] = two_maps(&mut rng, 6, &by);
    a.iter_mut().step_by(2).for_each(|object| object.category = None);
    b.iter_mut().step_by(3).for_each(|object| object.category = None);
    let found = align(&a, &b, &options(false, true));
    assert_eq!(found.status, AlignStatus::Ok);
    assert!(is_right(&found.transforms[0].a_from_b, &by) && found.transforms[0].matches.len() >= 11);
}

#[test]
fn the_covariance_is_not_smaller_than_the_errors() {
    let mut all = Vec::new();
    for seed in 0..30 {
        let mut rng = ChaCha8Rng::seed_from_u64(300 + seed);
        let b_from_room = any_similarity(&mut rng, false, false);
        let [a, b] = two_maps(&mut rng, 30, &b_from_room);
        let found = align(&a, &b, &options(false, false));
        let Some(best) = found.transforms.first().filter(|_| found.status == AlignStatus::Ok) else { continue };
        // The motion that is left, about the pivot.
        let left = best.a_from_b.after(&b_from_room).inverse();
        let turn = rotation_vector(&left.rotation);
        let shift = left.point(&best.pivot) - best.pivot;
        let error = super::Matrix7::from_fn(|i, _| match i {
            0..3 => turn[i],
            3..6 => shift[i - 3],
            _ => left.scale.ln(),
        })
        .column(0)
        .into_owned();
        all.push(error.dot(&(best.covariance.try_inverse().unwrap() * error)));
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    assert!(all.len() >= 27, "{}", all.len());
    // Seven parameters; errors of bodies that are no ellipsoids are counted, but these are.
    assert!((1.5..8.5).contains(&mean), "{mean}");
}

fn same(found: &Alignment, other: &Alignment, expected: &Similarity) -> bool {
    found.status == other.status
        && match (found.transforms.first(), other.transforms.first()) {
            (Some(p), Some(q)) if found.status == AlignStatus::Ok => {
                (p.evidence - q.evidence).abs() < 1e-3
                    && (q.a_from_b.matrix() - expected.matrix()).norm() < 1e-4 * expected.matrix().norm()
            }
            _ => true,
        }
}

proptest! {
    #![proptest_config(crate::test_cases::cases(12))]

    #[test]
    fn maps_that_are_moved_give_the_transform_that_is_moved(seed in 0u64..1000, rigid: bool) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let b_from_room = any_similarity(&mut rng, false, rigid);
        let [a, b] = two_maps(&mut rng, 6, &b_from_room);
        let found = align(&a, &b, &options(false, rigid));
        let [of_a, of_b] = [0, 1].map(|_| any_similarity(&mut rng, false, rigid));
        let again = align(&moved(&a, &of_a), &moved(&b, &of_b), &options(false, rigid));
        prop_assume!(!found.transforms.is_empty());
        let expected = of_a.after(&found.transforms[0].a_from_b).after(&of_b.inverse());
        prop_assert!(same(&found, &again, &expected), "{:?} {:?}", found.transforms, again.transforms);
    }

    #[test]
    fn the_order_of_objects_and_maps_does_not_matter(seed in 0u64..1000, upright: bool) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let b_from_room = any_similarity(&mut rng, upright, false);
        let [a, b] = two_maps(&mut rng, 6, &b_from_room);
        let found = align(&a, &b, &options(upright, false));
        prop_assume!(!found.transforms.is_empty());
        let [mut c, mut d] = [a.clone(), b.clone()];
        c.reverse();
        d.rotate_left(7);
        let again = align(&c, &d, &options(upright, false));
        prop_assert!(same(&found, &again, &found.transforms[0].a_from_b));
        let swapped = align(&b, &a, &options(upright, false));
        prop_assert_eq!(swapped.status, found.status);
        if found.status == AlignStatus::Ok {
            prop_assert!(is_right(&swapped.transforms[0].a_from_b.inverse(), &b_from_room));
        }
    }

    #[test]
    fn any_numbers_are_answered(numbers in prop::collection::vec(-3.0f64..3.0, 0..60), scale in -30.0f64..30.0) {
        let objects: Vec<MapObject> = numbers
            .chunks_exact(4)
            .map(|n| {
                let mut object = ball(n[0].exp() * 10f64.powf(scale), n[1], (n[2] * 10.0).exp());
                object.ellipsoid.semi_axes = Vector3::new(n[3].exp(), (5.0 * n[3]).exp(), 0.1);
                object
            })
            .collect();
        let half = objects.len() / 2;
        for (upright, rigid) in [(false, false), (true, true)] {
            let found = align(&objects[..half], &objects[half..], &options(upright, rigid));
            prop_assert!(found.transforms.iter().all(|t| t.a_from_b.is_valid() && t.evidence.is_finite()));
            let whole = align(&objects, &objects, &options(upright, rigid));
            prop_assert!(whole.transforms.iter().all(|t| t.a_from_b.is_valid() && t.evidence.is_finite()));
        }
    }
}

#[test]
fn a_known_vertical_is_kept_to() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let by = any_similarity(&mut rng, true, true);
    let [a, b] = two_maps(&mut rng, 6, &by);
    let up = CommonUp { up_in_a: Vector3::z_axis(), up_in_b: Vector3::z_axis(), sd: 1e-4 };
    let found = align(&a, &b, &AlignOptions { scale: None, up: Some(up) });
    assert_eq!(found.status, AlignStatus::Ok);
    let tilt = (found.transforms[0].a_from_b.rotation * Vector3::z()).angle(&Vector3::z());
    assert!(tilt < 4e-4, "{tilt}");
    // A vertical that contradicts the objects is not believed to be right.
    let wrong = CommonUp { up_in_b: Unit::new_normalize(Vector3::new(0.5, 0.0, 1.0)), ..up };
    assert_ne!(align(&a, &b, &AlignOptions { scale: None, up: Some(wrong) }).status, AlignStatus::Ok);
}
