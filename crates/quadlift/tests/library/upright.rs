//! Objects that stand upright, and those that do not, in scenes whose `up` is known.

use nalgebra::{Unit, Vector3};
use quadlift::geometry::{BodyKind, ConvexBody};
use quadlift::metrics::iou3d_bodies;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};
use quadlift::{LocalizeOptions, localize};

struct Case {
    body: BodyKind,
    views: usize,
    noise: f64,
    standing: bool,
    up: [f64; 3],
}

/// Mean IoU without and with the search for upright objects.
fn without_and_with(case: &Case) -> [f64; 2] {
    let trajectory = Trajectory::Arc { span: 60.0 };
    let scenes: Vec<_> = (31..34)
        .map(|seed| {
            let options = SyntheticOptions {
                seed,
                objects: 12,
                body: case.body,
                standing: case.standing,
                views: case.views,
                trajectory,
                observations: Observations::Boxes,
                noise: vec![Noise::BoxEdges(case.noise)],
                ..Default::default()
            };
            let mut synthetic = generate(&options).unwrap();
            synthetic.scene.edit(|parts| parts.up = Some(Unit::new_normalize(Vector3::from(case.up)))).unwrap();
            synthetic
        })
        .collect();
    [false, true].map(|upright| {
        let mut options = LocalizeOptions::default();
        options.method.posterior_options_mut().unwrap().body = Some(case.body);
        options.method.posterior_options_mut().unwrap().upright = upright;
        let ious = scenes.iter().flat_map(|synthetic| {
            let localization = localize(&synthetic.scene, &options).unwrap();
            let iou = |estimate: &quadlift::solve::Estimate| {
                let truth = synthetic.truth[estimate.object_index].1;
                estimate.body.map_or(0.0, |body| iou3d_bodies(&body, &truth))
            };
            localization.estimates.iter().map(iou).collect::<Vec<_>>()
        });
        let ious: Vec<f64> = ious.collect();
        ious.iter().sum::<f64>() / ious.len() as f64
    })
}

const TRUE_UP: [f64; 3] = [0.0, 0.0, 1.0];

#[test]
fn standing_cuboids_in_few_views_come_out_much_better() {
    let case = Case { body: BodyKind::Cuboid, views: 6, noise: 0.02, standing: true, up: TRUE_UP };
    let [without, with] = without_and_with(&case);
    println!("{without} {with}");
    assert!(with > without + 0.1 && with > 0.85, "{without} {with}");
}

#[test]
fn standing_ellipsoids_in_few_views_come_out_better() {
    let case = Case { body: BodyKind::Ellipsoid, views: 6, noise: 0.02, standing: true, up: TRUE_UP };
    let [without, with] = without_and_with(&case);
    println!("{without} {with}");
    assert!(with > without + 0.02, "{without} {with}");
}

#[test]
fn objects_that_lie_anyhow_are_left_as_they_are() {
    for body in [BodyKind::Cuboid, BodyKind::Ellipsoid] {
        let [without, with] = without_and_with(&Case { body, views: 8, noise: 0.02, standing: false, up: TRUE_UP });
        println!("{body:?} {without} {with}");
        assert!(with > without - 0.015, "{body:?} {without} {with}");
    }
}

#[test]
fn a_wrong_up_does_little_harm() {
    for (body, up) in [(BodyKind::Cuboid, [0.5, 0.4, 0.75]), (BodyKind::Ellipsoid, [0.5, 0.4, 0.75])] {
        let [without, with] = without_and_with(&Case { body, views: 8, noise: 0.02, standing: true, up });
        println!("{body:?} {without} {with}");
        assert!(with > without - 0.02, "{body:?} {without} {with}");
    }
}

#[test]
fn synthetic_objects_stand_on_the_ground() {
    let options = SyntheticOptions { standing: true, ..Default::default() };
    for (_, body) in generate(&options).unwrap().truth {
        let lowest = body.center().z - body.support(&-Vector3::z());
        assert!(lowest.abs() < 1e-9, "{lowest}");
    }
}

#[test]
fn an_edge_bias_is_the_same_in_all_boxes_of_an_object() {
    let boxes = |edge_bias| {
        let observations = Observations::Boxes;
        let options = SyntheticOptions { objects: 3, views: 6, edge_bias, observations, seed: 2, ..Default::default() };
        generate(&options).unwrap().scene.detections.iter().map(|d| d.bounding_box.unwrap()).collect::<Vec<_>>()
    };
    let (exact, biased) = (boxes(0.0), boxes(0.04));
    let bias = |k: usize, edge: usize| (biased[k].edges()[edge] - exact[k].edges()[edge]) / exact[k].mean_half_size();
    let mut differ = 0;
    for object in 0..3 {
        for edge in 0..4 {
            let first = bias(6 * object, edge);
            assert!((1..6).all(|view| (bias(6 * object + view, edge) - first).abs() < 1e-9));
            differ += usize::from(first.abs() > 0.005 && (first - bias(0, 0)).abs() > 1e-6);
        }
    }
    assert!(differ > 6, "{differ}");
}
