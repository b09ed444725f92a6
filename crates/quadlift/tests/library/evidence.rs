//! The estimator of scenes of boxes by one likelihood, one scan and one evidence (docs/method.md, section 24).

use nalgebra::{Matrix4, Rotation3, Vector3};
use quadlift::geometry::{Body, BodyKind, Projection};
use quadlift::metrics::{iou3d_bodies, squared_errors};
use quadlift::scene::Scene;
use quadlift::solve::{Estimate, PosteriorOptions, Status, Warning};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{Localization, localize};

/// Quantile of chi-square with 3 degrees of freedom at 95 %.
const LIMIT: f64 = 7.815;

const KINDS: [BodyKind; 3] = [BodyKind::Ellipsoid, BodyKind::Cuboid, BodyKind::Cylinder];

fn made(noise: f64, seed: u64, options: SyntheticOptions) -> SyntheticScene {
    let (observations, noise) = (Observations::Boxes, vec![Noise::BoxEdges(noise)]);
    generate(&SyntheticOptions { observations, noise, seed, ..options }).unwrap()
}

fn run(scene: &Scene, by_evidence: bool, body: Option<BodyKind>) -> Localization {
    localize(scene, &PosteriorOptions { by_evidence, body, ..Default::default() }.into()).unwrap()
}

fn mean_iou(made: &SyntheticScene, found: &Localization) -> f64 {
    let iou = |estimate: &Estimate| {
        let truth = &made.truth[estimate.object_index].1;
        estimate.body.map_or(0.0, |body| iou3d_bodies(&body, truth))
    };
    found.estimates.iter().map(iou).sum::<f64>() / found.estimates.len() as f64
}

#[test]
fn exact_boxes_give_exact_bodies_of_their_kinds() {
    for (kind, least) in [(BodyKind::Ellipsoid, 0.999), (BodyKind::Cuboid, 0.99), (BodyKind::Cylinder, 0.999)] {
        let made = made(0.0, 3, SyntheticOptions { objects: 12, body: kind, ..Default::default() });
        let found = run(&made.scene, true, None);
        assert!(mean_iou(&made, &found) > least, "{kind:?}: {}", mean_iou(&made, &found));
        assert!(found.estimates.iter().all(|estimate| estimate.body.unwrap().kind == kind), "{kind:?}");
    }
    let rounded = BodyKind::Rounded(0.5);
    let made = made(0.0, 1, SyntheticOptions { objects: 10, body: rounded, ..Default::default() });
    // Whatever roundness is given, it is fitted.
    let found = run(&made.scene, true, Some(BodyKind::Rounded(0.9)));
    assert!(mean_iou(&made, &found) > 0.99, "{}", mean_iou(&made, &found));
}

#[test]
fn wrong_boxes_among_few_views_do_less_harm_than_to_the_other_estimator() {
    let mut sums = [0.0; 2];
    for seed in 0..3 {
        let options =
            SyntheticOptions { objects: 30, views: 4, outlier_share: 0.3, kinds: KINDS.to_vec(), ..Default::default() };
        let made = made(0.02, 40 + seed, options);
        for (k, by_evidence) in [false, true].into_iter().enumerate() {
            sums[k] += mean_iou(&made, &run(&made.scene, by_evidence, None)) / 3.0;
        }
    }
    println!("mean IoU {sums:.3?}");
    assert!(sums[1] > 0.55 && sums[1] > sums[0] + 0.15, "{sums:?}");
}

fn arc(noise: f64, edge_bias: f64) -> SyntheticScene {
    let trajectory = Trajectory::Arc { span: 60.0 };
    let mut options = SyntheticOptions { objects: 60, trajectory, ..Default::default() };
    options.edge_bias = edge_bias;
    made(noise, 0, options)
}

#[test]
fn regions_hold_with_and_without_systematic_errors() {
    for (noise, edge_bias, least) in [(0.05, 0.0, 0.93), (0.02, 0.04, 0.87)] {
        let made = arc(noise, edge_bias);
        let found = run(&made.scene, true, Some(BodyKind::Ellipsoid));
        let inside = found.estimates.iter().filter(|estimate| {
            let truth = &made.truth[estimate.object_index].1;
            squared_errors(&estimate.body.unwrap(), &estimate.covariance.unwrap(), truth).unwrap().center <= LIMIT
        });
        let share = inside.count() as f64 / found.estimates.len() as f64;
        assert!(share >= least, "noise {noise}, bias {edge_bias}: {share}");
    }
    // Exact boxes leave small regions.
    let exact = arc(0.0, 0.0);
    for estimate in &run(&exact.scene, true, Some(BodyKind::Ellipsoid)).estimates {
        let size = exact.truth[estimate.object_index].1.closest_ellipsoid().semi_axes.min();
        assert!(estimate.center_sd().unwrap() < 5e-3 * size, "{:?} of {size}", estimate.center_sd());
    }
}

/// Two cameras a thousandth of the distance apart say nothing about the depth.
#[test]
fn an_object_without_a_baseline_is_undetermined() {
    let trajectory = Trajectory::Arc { span: 0.05 };
    let made = made(0.03, 5, SyntheticOptions { objects: 6, views: 4, trajectory, ..Default::default() });
    for estimate in &run(&made.scene, true, None).estimates {
        assert!(estimate.status == Status::Undetermined || estimate.status == Status::Degenerate, "{estimate:?}");
    }
}

/// The scene with its world moved by a similarity, and its frames in the opposite order.
fn changed(scene: &Scene, rotation: &Rotation3<f64>, shift: &Vector3<f64>, scale: f64) -> Scene {
    let mut scene = scene.clone();
    scene
        .edit(|parts| {
            let mut world = Matrix4::identity();
            world.fixed_view_mut::<3, 3>(0, 0).copy_from(&(rotation.inverse().matrix() / scale));
            world.fixed_view_mut::<3, 1>(0, 3).copy_from(&(rotation.inverse() * (-shift / scale)));
            for frame in &mut parts.frames {
                frame.projection = Projection::from_matrix(frame.projection.matrix() * world).unwrap();
            }
            parts.up = parts.up.map(|up| rotation * up);
            parts.detections.reverse();
        })
        .unwrap();
    scene
}

#[test]
fn nothing_depends_on_the_frame_of_the_world_or_the_order_of_detections() {
    let (rotation, shift, scale) = (Rotation3::from_euler_angles(0.4, -1.0, 2.0), Vector3::new(3.0, -5.0, 2.0), 1.7);
    let options = SyntheticOptions { objects: 24, views: 8, kinds: KINDS.to_vec(), ..Default::default() };
    let made = made(0.05, 6, options);
    let (before, after) =
        (run(&made.scene, true, None), run(&changed(&made.scene, &rotation, &shift, scale), true, None));
    for (a, b) in before.estimates.iter().zip(&after.estimates) {
        let (a, b) = (a.body.unwrap(), b.body.unwrap());
        let moved = Body {
            center: rotation * a.center * scale + shift,
            rotation: rotation * a.rotation,
            half_extents: a.half_extents * scale,
            kind: a.kind,
        };
        assert_eq!(a.kind.name(), b.kind.name());
        assert!((moved.center - b.center).norm() < 1e-5 * moved.half_extents.min(), "{moved:?} {b:?}");
        assert!(iou3d_bodies(&moved, &b) > 0.999);
    }
}

/// With what a scene reports as given levels its objects are the same, each apart from the others.
#[test]
fn given_levels_give_the_same_bodies_apart() {
    let options = SyntheticOptions { objects: 12, views: 10, outlier_share: 0.1, ..Default::default() };
    let made = made(0.05, 2, options);
    let whole = run(&made.scene, true, None);
    let given = |scene: &Scene| {
        let noise_model = Some(whole.noise.clone());
        let options = PosteriorOptions { by_evidence: true, noise_model, occluded_edges: false, ..Default::default() };
        localize(scene, &options.into()).unwrap()
    };
    let together = given(&made.scene);
    let mut same = 0;
    for (k, estimate) in together.estimates.iter().enumerate() {
        let mut alone = made.scene.clone();
        alone.edit(|parts| parts.detections.retain(|d| d.object_index == Some(estimate.object_index as u32))).unwrap();
        let alone = given(&alone);
        assert_eq!((alone.estimates[0].body, alone.estimates[0].status), (estimate.body, estimate.status));
        let (a, b) = (whole.estimates[k].body.unwrap(), estimate.body.unwrap());
        same += usize::from(iou3d_bodies(&a, &b) > 0.95);
    }
    assert!(same >= 11, "{same} of 12");
}

/// Bodies about as probable come with a warning, less probable ones only in the list.
#[test]
fn alternatives_are_sorted_and_the_probable_ones_are_warned_of() {
    let options = SyntheticOptions { objects: 20, views: 4, kinds: KINDS.to_vec(), ..Default::default() };
    let made = made(0.05, 8, options);
    let mut listed = 0;
    for estimate in &run(&made.scene, true, None).estimates {
        let odds: Vec<f64> = estimate.alternatives.iter().map(|other| other.log_odds).collect();
        assert!(odds.windows(2).all(|pair| pair[0] >= pair[1]) && odds.iter().all(|x| *x > -3.0), "{odds:?}");
        let is_ambiguous = estimate.warnings.iter().any(|w| matches!(w, Warning::Ambiguous { .. }));
        assert_eq!(is_ambiguous, odds.first().is_some_and(|first| *first > -0.5));
        listed += odds.len();
    }
    assert!(listed > 0);
}
