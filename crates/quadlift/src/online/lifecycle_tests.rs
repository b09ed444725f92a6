//! What clear, covered and missed views do to one object of a map.

use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};

use super::*;
use crate::association::score::object::Prediction;
use crate::geometry::{BoundingBox, Ellipsoid, Projection, project_bounding_box};
use crate::online::{Frame, ObjectMap, OnlineOptions};
use crate::scene::NewDetection;

/// A camera at `x` that looks along the world's z axis.
fn projection(x: f64) -> Projection {
    let p = Matrix3x4::new(500.0, 0.0, 320.0, -500.0 * x, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    Projection::from_matrix(p).unwrap()
}

/// Frame `k` of a walk to and fro.
fn frame(k: u32) -> Frame {
    let image_size = Some([640.0, 480.0].into());
    Frame { image_size, ..Frame::new(format!("{k}"), f64::from(k), projection(x_of(k))) }
}

fn x_of(k: u32) -> f64 {
    // Evenly to and fro: frames of which two show the same image would be one view.
    (0.3 * f64::from(k + 1)).sin().asin() / std::f64::consts::FRAC_PI_2
}

/// A ball.
fn ball(x: f64, y: f64, z: f64, radius: f64) -> Ellipsoid {
    let center = Point3::new(x, y, z);
    Ellipsoid { center, semi_axes: Vector3::repeat(radius), rotation: Rotation3::identity() }
}

fn box_of(k: u32, ball: &Ellipsoid) -> BoundingBox {
    project_bounding_box(&projection(x_of(k)), ball).unwrap()
}

fn observe(map: &mut ObjectMap, k: u32, boxes: &[BoundingBox]) -> FrameUpdate {
    let detections: Vec<NewDetection> = boxes.iter().map(|b| NewDetection::from_box(*b)).collect();
    map.observe(&frame(k), &detections).unwrap()
}

/// A map that has seen these balls in so many frames.
fn map_of(balls: &[Ellipsoid], frames: u32, options: OnlineOptions) -> ObjectMap {
    let mut map = ObjectMap::new(options).unwrap();
    for k in 0..frames {
        let boxes: Vec<BoundingBox> = balls.iter().map(|ball| box_of(k, ball)).collect();
        observe(&mut map, k, &boxes);
    }
    assert_eq!(map.memory.objects.tracked().count(), balls.len());
    map
}

fn only(map: &ObjectMap) -> &Tracked {
    map.memory.objects.tracked().next().unwrap()
}

/// Removals of a frame.
fn removals(update: &FrameUpdate) -> Vec<Removal> {
    let reason = |event: &Event| if let Event::Removed { reason, .. } = event { Some(*reason) } else { None };
    update.events.iter().filter_map(reason).collect()
}

#[test]
fn each_clear_view_without_a_detection_takes_what_its_probability_says() {
    let mut map = map_of(&[ball(0.0, 0.0, 4.0, 0.4)], 20, OnlineOptions::default());
    let tracked = only(&map);
    assert_eq!((tracked.presence, tracked.log_odds), (Presence::Confirmed, 6.9));
    let (mut clear, detected) = (f64::from(tracked.clear), f64::from(tracked.clear_detected));
    assert!(clear > 0.0 && clear == detected);
    let mut expected = 6.9;
    for k in 20..23 {
        observe(&mut map, k, &[]);
        clear += 1.0;
        // Of all objects: 80 % of eight views beforehand. Of this one: that rate counts as four views.
        let usual = (detected + 6.4) / (clear + 8.0);
        expected += (1.0 - (detected + 4.0 * usual) / (clear + 4.0)).ln();
        assert!((only(&map).log_odds - expected).abs() < 1e-12, "{k}: {} {expected}", only(&map).log_odds);
    }
    // The log odds of a gone object have a lower bound.
    let gone: Vec<Removal> = (23..50).flat_map(|k| removals(&observe(&mut map, k, &[]))).collect();
    assert_eq!(gone, [Removal::Gone]);
    assert_eq!((only(&map).presence, only(&map).log_odds), (Presence::Gone, -5.5));
}

#[test]
fn a_covered_object_is_hardly_missed() {
    let target = ball(0.0, 0.0, 4.0, 0.4);
    let map = map_of(&[target], 8, OnlineOptions::default());
    let tracked = only(&map);
    let share_of = |clear: f64| {
        let detected = f64::from(tracked.clear_detected);
        let usual = (detected + 6.4) / (clear + 8.0);
        (detected + 4.0 * usual) / (clear + 4.0)
    };
    let b = box_of(8, &target);
    // A box of something else over this share of it from the left, much higher than it is.
    let beside = |share: f64| {
        let x1 = b.x0() + share * (b.x1() - b.x0());
        BoundingBox::new([x1 - 300.0, b.y0() - 100.0, x1, b.y1() + 120.0]).unwrap()
    };
    for (covered, clear) in [(0.1, 1.0), (0.4, 0.0), (0.7, 0.0)] {
        let mut map = map.clone();
        let before = only(&map).log_odds;
        let update = observe(&mut map, 8, &[beside(covered)]);
        assert_eq!(update.objects, [None]);
        let visible = 1.0 - covered;
        // Only a view of which at most a fifth is covered tells the detection rate.
        let share = share_of(f64::from(tracked.clear) + clear);
        let expected = f64::ln(1.0 - share * visible * visible);
        let found = only(&map).log_odds - before;
        assert!((found / expected - 1.0).abs() < 0.03, "{covered}: {found} {expected}");
        assert_eq!(f64::from(only(&map).clear - tracked.clear), clear);
    }
}

#[test]
fn only_nearer_objects_cover_an_object() {
    // Two balls one behind the other: the near one is left, so that the far one looks out.
    let balls = [ball(-0.19, 0.0, 4.0, 0.4), ball(0.0, 0.0, 8.0, 0.8)];
    let map = map_of(&balls, 8, OnlineOptions::default());
    let id_of = |map: &ObjectMap, z: f64| {
        let at = |t: &&Tracked| (t.object.center.z + map.memory.origin.z - z).abs() < 0.5;
        map.memory.objects.tracked().find(at).unwrap().id
    };
    let drop_of = |missed: usize| {
        let mut map = map.clone();
        let id = id_of(&map, balls[missed].center.z);
        let odds = |map: &ObjectMap| map.memory.objects.tracked().find(|t| t.id == id).unwrap().log_odds;
        let before = odds(&map);
        let update = observe(&mut map, 8, &[box_of(8, &balls[1 - missed])]);
        assert!(update.objects[0].is_some_and(|found| found != id));
        before - odds(&map)
    };
    let (near, far) = (drop_of(0), drop_of(1));
    assert!(near > -f64::ln(1.0 - 0.8), "the far ball covers nothing: {near}");
    let [a, b] = [box_of(8, &balls[0]), box_of(8, &balls[1])];
    let covered = (a.x1().min(b.x1()) - a.x0().max(b.x0())) / (b.x1() - b.x0());
    assert!((0.3..0.8).contains(&covered), "{covered}");
    // The near ball is as high as the far one in the image. The rate of detection lies between these.
    let drop = |share: f64| -f64::ln(1.0 - share * (1.0 - covered) * (1.0 - covered));
    assert!((drop(0.8)..drop(0.97)).contains(&far), "{covered}: {far}");
}

#[test]
fn tentative_objects_die_of_more_than_four_misses_and_more_than_their_detections() {
    let target = [ball(0.0, 0.0, 4.0, 0.4)];
    for (detections, misses) in [(2, 5), (4, 5), (6, 7)] {
        let options = OnlineOptions { min_views: 20, ..Default::default() };
        let mut map = map_of(&target, detections, options);
        assert_eq!((only(&map).presence, only(&map).object.views()), (Presence::Tentative, detections as usize));
        for k in 1..misses {
            assert_eq!(removals(&observe(&mut map, detections + k, &[])), [], "{detections} {k}");
        }
        assert_eq!(removals(&observe(&mut map, detections + misses, &[])), [Removal::Weak], "{detections}");
    }
}

#[test]
fn confirmed_objects_of_little_evidence_die_of_their_fourth_miss() {
    let mut map = map_of(&[ball(0.0, 0.0, 4.0, 0.4)], 2, OnlineOptions::default());
    let slot = map.memory.objects.slots()[0];
    let tracked = map.memory.objects.get_mut(slot).unwrap();
    (tracked.presence, tracked.log_odds) = (Presence::Confirmed, 6.9);
    for k in 3..6 {
        assert_eq!(removals(&observe(&mut map, k, &[])), [], "{k}");
    }
    assert!(map.memory.evidence_of(only(&map)) < 5.0);
    assert_eq!(removals(&observe(&mut map, 6, &[])), [Removal::Weak]);
}

#[test]
fn a_frame_contradicts_the_map_if_all_objects_would_be_missed_once_in_160_000_times() {
    let balls: Vec<Ellipsoid> = (0..4).map(|k| ball(-1.2 + 0.9 * f64::from(k), 0.0, 5.0, 0.3)).collect();
    let mut map = map_of(&balls, 8, OnlineOptions::default());
    let slots: Vec<u32> = map.memory.objects.slots();
    let seen = |slot: &u32| Seen { slot: *slot, prediction: Prediction { edges: [0.0; 4], depth: 1.0 } };
    let mut matched = Matched { pairs: Vec::new(), seen: slots.iter().map(seen).collect() };
    for &slot in &slots {
        let tracked = map.memory.objects.get_mut(slot).unwrap();
        assert_eq!(tracked.presence, Presence::Confirmed);
        (tracked.clear, tracked.clear_detected) = (0, 0);
    }
    // The four are detected with this probability: 12 nats are 95.02 %.
    let mut disagreement = |rate: f64, matched: &Matched| {
        (map.memory.running.clear, map.memory.running.clear_detected) = (1e9, rate * 1e9);
        disagreement(&map.memory.objects, &map.memory.running, matched, 1)
    };
    let rate = 1.0 - (-3.0f64).exp();
    assert_eq!(disagreement(rate + 0.002, &matched), Some(4));
    assert_eq!(disagreement(rate - 0.002, &matched), None);
    // Three that are detected with the largest probability, 97 %: 10.5 nats.
    matched.seen.pop();
    assert_eq!(disagreement(0.999, &matched), None);
}
