//! Sizes of categories that are learned from the objects of the scene.

use quadlift::geometry::{Body, BodyKind};
use quadlift::metrics::{iou3d_bodies, nees};
use quadlift::scene::Scene;
use quadlift::solve::{CategoryPrior, PosteriorOptions, SizePrior};
use quadlift::synthetic::{
    CategoryOptions, CategorySizes, Noise, Observations, SyntheticOptions, SyntheticScene, generate_categories,
};
use quadlift::{Localization, localize};

/// 32 objects of four categories.
fn made(seed: u64, views: usize, sizes: CategorySizes, standing: bool, body: BodyKind) -> SyntheticScene {
    let options = SyntheticOptions {
        seed,
        objects: 32,
        views,
        body,
        standing,
        cube_side: 10.0,
        distance: 40.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        ..Default::default()
    };
    generate_categories(&options, &CategoryOptions { categories: 4, sizes }).unwrap()
}

fn localized(scene: &Scene, learn_sizes: bool, body: BodyKind) -> Localization {
    // By the same estimator with and without.
    let options = PosteriorOptions { learn_sizes, body: Some(body), by_evidence: false, ..Default::default() };
    localize(scene, &options.into()).unwrap()
}

/// Mean IoU over so many scenes, without and with learned sizes, and the medians of the NEES.
fn without_and_with(
    scenes: u64,
    views: usize,
    sizes: CategorySizes,
    standing: bool,
    body: BodyKind,
) -> [(f64, f64); 2] {
    [false, true].map(|learn| {
        let (mut sum, mut count, mut errors) = (0.0, 0.0, Vec::new());
        for seed in 41..41 + scenes {
            let made = made(seed, views, sizes, standing, body);
            for estimate in &localized(&made.scene, learn, body).estimates {
                let truth = &made.truth[estimate.object_index].1;
                sum += estimate.body.map_or(0.0, |body| iou3d_bodies(&body, truth));
                count += 1.0;
                let ellipsoid = |body: &Body| (body.kind == BodyKind::Ellipsoid).then(|| body.inscribed());
                if let (Some(found), Some(truth), Some(covariance)) =
                    (estimate.body.as_ref().and_then(ellipsoid), ellipsoid(truth), estimate.covariance)
                {
                    errors.extend(nees(&found, &truth, &covariance.matrix));
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        (sum / count, errors.get(errors.len() / 2).copied().unwrap_or(0.0))
    })
}

#[test]
fn things_of_the_same_size_help_each_other() {
    for (views, gain) in [(2, 0.01), (3, 0.01)] {
        let [(without, _), (with, nees)] =
            without_and_with(3, views, CategorySizes::Alike(0.05), false, BodyKind::Ellipsoid);
        assert!(with > without + gain, "{views} views: {without} {with}");
        assert!(nees < 9.5, "{views} views: {nees}");
    }
    let [(without, _), (with, _)] = without_and_with(3, 2, CategorySizes::Alike(0.05), true, BodyKind::Cuboid);
    assert!(with > without + 0.03, "cuboids: {without} {with}");
}

#[test]
fn a_category_that_is_a_name_only_does_no_harm() {
    for (views, standing) in [(2, false), (2, true), (3, false)] {
        // One object that turns over makes a difference of .004 in three scenes.
        let [(without, _), (with, _)] = without_and_with(10, views, CategorySizes::Any, standing, BodyKind::Ellipsoid);
        assert!(with > without - 0.005, "{views} views, standing {standing}: {without} {with}");
    }
}

#[test]
fn what_is_learned_is_reported_and_the_same_every_time() {
    let made = made(41, 4, CategorySizes::Alike(0.05), false, BodyKind::Ellipsoid);
    let found = localized(&made.scene, true, BodyKind::Ellipsoid);
    assert_eq!(found.learned_sizes.len(), 4);
    for learned in &found.learned_sizes {
        let members = (0..32).filter(|k| k % 4 == learned.category).count();
        assert_eq!(learned.objects, members);
        assert!((3.0..8.0).contains(&learned.well_determined), "{learned:?}");
        let SizePrior { mean, sd } = learned.size.unwrap();
        let mut truth: Vec<f64> =
            (made.truth[learned.category].1.closest_ellipsoid().semi_axes * 2.0).iter().copied().collect();
        truth.sort_by(|a, b| b.total_cmp(a));
        let mut sorted = mean;
        sorted.sort_by(|a, b| b.total_cmp(a));
        for (found, truth) in sorted.iter().zip(truth) {
            assert!((found / truth).ln().abs() < 0.25, "{learned:?} {truth}");
        }
        assert!(sd.iter().zip(mean).all(|(sd, mean)| (0.05..0.4).contains(&(sd / mean))), "{learned:?}");
    }
    let again = localized(&made.scene, true, BodyKind::Ellipsoid);
    assert_eq!(again.learned_sizes, found.learned_sizes);
    assert!(found.estimates.iter().zip(&again.estimates).all(|(a, b)| a == b));
}

#[test]
fn single_objects_and_given_sizes_are_left_as_they_are() {
    // Each object has a category of its own.
    let options = SyntheticOptions {
        objects: 6,
        views: 3,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        ..Default::default()
    };
    let categories = CategoryOptions { categories: 6, sizes: CategorySizes::Any };
    let made = generate_categories(&options, &categories).unwrap();
    let (without, with) = (
        localized(&made.scene, false, BodyKind::Ellipsoid).solution.estimates,
        localized(&made.scene, true, BodyKind::Ellipsoid),
    );
    assert!(without == with.estimates);
    assert!(with.learned_sizes.iter().all(|learned| learned.size.is_none() && learned.objects == 1));

    // A size that is given wins.
    let made = self::made(41, 3, CategorySizes::Alike(0.05), false, BodyKind::Ellipsoid);
    let mut options = PosteriorOptions { learn_sizes: true, body: Some(BodyKind::Ellipsoid), ..Default::default() };
    let size = SizePrior { mean: [5.0, 4.0, 3.0], sd: [1.0, 0.8, 0.6] };
    let prior = CategoryPrior { size: Some(size), ..Default::default() };
    options.priors.by_category.insert("category_1".to_owned(), prior);
    let found = localize(&made.scene, &options.into()).unwrap();
    let learned: Vec<&str> =
        found.learned_sizes.iter().map(|learned| made.scene.categories[learned.category].as_str()).collect();
    assert_eq!(learned, ["category_0", "category_2", "category_3"]);
}
