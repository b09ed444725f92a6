//! Cuboids that fit their boxes in two ways: both are reported, and the uncertainty holds both.

use quadlift::geometry::{Body, BodyKind};
use quadlift::metrics::iou3d_bodies;
use quadlift::solve::Warning;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, generate};
use quadlift::{Localization, LocalizeOptions, localize};

/// Cuboids seen over 60 degrees, with their estimates.
fn cuboids(views: usize, noise: f64, seed: u64) -> (Vec<Body>, Localization) {
    let options = SyntheticOptions {
        seed,
        objects: 50,
        views,
        body: BodyKind::Cuboid,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(noise)],
        ..Default::default()
    };
    let scene = generate(&options).unwrap();
    let mut options = LocalizeOptions::default();
    options.method.posterior_options_mut().unwrap().body = Some(BodyKind::Cuboid);
    let localization = localize(&scene.scene, &options).unwrap();
    (scene.truth.into_iter().map(|(_, body)| body).collect(), localization)
}

#[test]
fn most_cuboids_that_came_out_wrong_have_another_answer_and_few_of_the_others() {
    let (mut wrong, mut wrong_with, mut right, mut right_with, mut recovered) = (0, 0, 0, 0, 0);
    for seed in [20, 21] {
        let (truth, localization) = cuboids(8, 0.03, seed);
        for estimate in &localization.estimates {
            let iou = |body: &Body| {
                assert_eq!(body.kind, BodyKind::Cuboid);
                iou3d_bodies(body, &truth[estimate.object_index])
            };
            let own = iou(estimate.body.as_ref().unwrap());
            // Those that are about as probable come with a warning.
            let is_ambiguous = estimate.warnings.iter().any(|w| matches!(w, Warning::Ambiguous { .. }));
            assert_eq!(is_ambiguous, estimate.alternatives.first().is_some_and(|other| other.log_odds > -0.5));
            let has_other = !estimate.alternatives.is_empty();
            assert!(estimate.alternatives.iter().all(|other| other.log_odds > -3.0));
            assert!(estimate.alternatives.windows(2).all(|pair| pair[0].log_odds >= pair[1].log_odds));
            let (number, with) = if own < 0.6 { (&mut wrong, &mut wrong_with) } else { (&mut right, &mut right_with) };
            *number += 1;
            *with += usize::from(has_other);
            recovered +=
                usize::from(own < 0.6 && estimate.alternatives.iter().any(|other| iou(&other.body) > own + 0.1));
        }
    }
    assert!(wrong >= 3, "{wrong}");
    assert!(2 * wrong_with > wrong, "{wrong_with} of {wrong}");
    assert!(recovered > 0, "no other answer is better than a wrong one");
    assert!(2 * right_with < right, "{right_with} of {right}");
}

/// With exact boxes an answer that fits less well has no odds at all; of one of these objects two cuboids have the same boxes.
#[test]
fn exact_boxes_leave_one_answer_unless_two_are_exact() {
    let (_, localization) = cuboids(20, 0.0, 22);
    let two = localization.estimates.iter().filter(|estimate| !estimate.alternatives.is_empty());
    let odds: Vec<f64> = two.flat_map(|estimate| &estimate.alternatives).map(|other| other.log_odds).collect();
    assert!(odds.len() <= 1 && odds.iter().all(|odds| odds.abs() < 1.0), "{odds:?}");
}
