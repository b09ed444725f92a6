//! Points on known bodies, before and behind them.

use quadlift::geometry::BoundingBox;
use quadlift::random::{normal, stream};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::surface_shots::{SIDE, Shot, patch, shots};

/// So many points of the box: those that are seen, or of all surfaces along the rays; alone or in clusters.
fn points(shot: &Shot, count: usize, hidden: bool, clusters: bool, rng: &mut ChaCha8Rng) -> Vec<ProjectedPoint> {
    let b = &shot.bounding_box;
    let mut found = Vec::new();
    let mut center = [0.0; 2];
    while found.len() < count {
        if !clusters || found.len() % 4 == 0 {
            center = [rng.random_range(b.x0()..b.x1()), rng.random_range(b.y0()..b.y1())];
        }
        let off = if clusters { 0.08 * b.size().x } else { 0.0 };
        let [u, v] = center.map(|x| (x + off * normal(rng)).clamp(0.0, f64::from(SIDE) - 1e-3));
        let all = &shot.all[(v as u32 * SIDE + u as u32) as usize];
        let nearest = all.iter().copied().fold(f64::INFINITY, f64::min);
        let depth = if hidden { all[rng.random_range(0..all.len())] } else { nearest };
        let index = found.len() as u32;
        found.push(ProjectedPoint { pixel: [u, v], depth: depth * (1.0 + 0.005 * normal(rng)), index });
    }
    found
}

/// 68 % of the errors in half sizes; 68 % and 90 % in standard deviations; share with an answer.
fn errors(shots: &[Shot], count: usize, hidden: bool, clusters: bool, masked: bool) -> [f64; 4] {
    let mut rng = stream(count as u64, 72);
    let mut off = Vec::new();
    let mut z = Vec::new();
    for shot in shots {
        let all = points(shot, count, hidden, clusters, &mut rng);
        let p = patch(shot, masked.then_some(&shot.mask));
        let Some(found) = surface_of_points(&all, &p, hidden) else { continue };
        let error = (found.depth.median - shot.truth).abs();
        off.push(error / (shot.truth * shot.half_size));
        z.push(error / found.depth.sd);
    }
    off.sort_by(f64::total_cmp);
    z.sort_by(f64::total_cmp);
    let at = |v: &[f64], share: f64| v.get((share * v.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    [at(&off, 0.683), at(&z, 0.683), at(&z, 0.9), z.len() as f64 / shots.len() as f64]
}

#[test]
fn errors_of_points_that_are_seen_are_as_large_as_their_deviations_say() {
    let shots = shots();
    for masked in [false, true] {
        for count in [4, 10, 40, 100] {
            let [error, normalized, tail, answers] = errors(&shots, count, false, false, masked);
            assert!((0.4..0.8).contains(&normalized) && tail < 1.6, "{masked} {count}: {normalized} {tail}");
            let [_, of_clusters, tail, _] = errors(&shots, count, false, true, masked);
            assert!((0.65..1.1).contains(&of_clusters) && tail < 2.2, "{masked} {count}: {of_clusters} {tail}");
            println!("mask {masked}, {count} points: {error:.3}; {normalized:.2} {of_clusters:.2}");
            // More points tell more, and mostly there is an answer.
            assert!(error < 0.7 / (count as f64).sqrt() && answers > 0.6, "{masked} {count}: {error} {answers}");
        }
    }
}

#[test]
fn hidden_points_do_not_count() {
    let shots = shots();
    for count in [40, 100, 300, 1000] {
        let [error, normalized, _, answers] = errors(&shots, count, true, false, false);
        assert!(error < 0.25 && (0.5..1.1).contains(&normalized) && answers > 0.9, "{count}: {error} {normalized}");
    }
    // The same points as if all were seen.
    let mut rng = stream(9, 73);
    let (mut ours, mut as_seen) = (Vec::new(), Vec::new());
    for shot in &shots {
        let all = points(shot, 300, true, false, &mut rng);
        for (may_be_hidden, errors) in [(true, &mut ours), (false, &mut as_seen)] {
            let found = surface_of_points(&all, &patch(shot, None), may_be_hidden).unwrap().depth.median;
            errors.push((found / shot.truth - 1.0).abs() / shot.half_size);
        }
    }
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(2.0 * mean(&ours) < mean(&as_seen), "{} {}", mean(&ours), mean(&as_seen));
    // Too few to say which are hidden.
    let few = points(&shots[0], 31, true, false, &mut rng);
    assert_eq!(surface_of_points(&few, &patch(&shots[0], None), true), None);
}

#[test]
fn the_points_of_the_median_are_told_and_those_elsewhere_are_not_used() {
    let bounding_box = BoundingBox::new([10.0, 10.0, 30.0, 30.0]).unwrap();
    let at = |index: u32, u: f64, v: f64, depth: f64| ProjectedPoint { pixel: [u, v], depth, index };
    // Three on the object, one behind it, one in a corner of the box and one outside.
    let all = [
        at(5, 20.0, 20.0, 4.0),
        at(7, 18.0, 21.0, 4.1),
        at(8, 22.0, 19.0, 4.2),
        at(9, 21.0, 24.0, 9.0),
        at(2, 10.5, 10.5, 4.1),
        at(3, 31.0, 20.0, 4.1),
    ];
    let patch = Patch { bounding_box, mask: None, image_size: [64.0; 2], half_size: 0.1 };
    let found = surface_of_points(&all, &patch, false).unwrap();
    assert_eq!((found.depth.median, found.points), (4.1, vec![5, 7, 8]));
    assert_eq!(surface_of_points(&all[1..], &patch, false), None);
    // A mask has its own pixels, also beyond the box.
    let mask = Mask::from_fn(64, 64, |x, _| x >= 28);
    assert_eq!(surface_of_points(&all, &Patch { mask: Some(&mask), ..patch }, false), None);
    let mask = Mask::from_fn(64, 64, |x, y| y >= 22 || x >= 30 || y < 12);
    let found = surface_of_points(&all, &Patch { mask: Some(&mask), ..patch }, false).unwrap();
    assert_eq!(found.points, [9, 2, 3]);
}
