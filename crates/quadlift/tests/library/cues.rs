//! Depths and 3D boxes beside boxes, one view, wrong scales, outliers.

use nalgebra::{Rotation2, Vector2, Vector3};
use quadlift::geometry::{BodyKind, project_ellipsoid};
use quadlift::metrics::iou3d_ellipsoids;
use quadlift::scene::{Box3dSd, Cues, DepthCue, Detection, NewDetection, Scene, SceneBuilder, SceneParts};
use quadlift::solve::{CueScale, NoiseModel, PosteriorOptions, ScaledQuantity, Status, Warning};
use quadlift::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate,
    simulate_cues,
};
use quadlift::{Localization, LocalizeOptions, localize};

fn made(views: usize) -> SyntheticScene {
    generate(&SyntheticOptions {
        objects: 30,
        views,
        cube_side: 10.0,
        distance: 25.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        seed: 5,
        ..Default::default()
    })
    .unwrap()
}

fn with_cues(made: &SyntheticScene, depth: Option<DepthNoise>, box3d: Option<Box3dNoise>) -> Scene {
    let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
    simulate_cues(&made.scene, body_of, &CueOptions { depth, box3d }, 3).unwrap()
}

fn options() -> LocalizeOptions {
    PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() }.into()
}

/// What a source measures on average where the true depth is this one.
fn expected(scale: &CueScale, depth: f64) -> f64 {
    scale.factor * depth + scale.shift.map_or(0.0, |shift| shift.value)
}

/// Mean O3D, 0 without an answer, and the median error of the center in mean semi-axes.
fn scores(made: &SyntheticScene, found: &Localization, scene: &Scene) -> (f64, f64) {
    let (mut sum, mut errors) = (0.0, Vec::new());
    for estimate in found.estimates.iter().filter(|estimate| estimate.status == Status::Ok) {
        let id = &scene.object_ids[estimate.object_index];
        let truth = made.truth.iter().find(|(name, _)| name == id).unwrap().1.closest_ellipsoid();
        let body = estimate.closest_ellipsoid().unwrap();
        sum += iou3d_ellipsoids(&body, &truth);
        errors.push((body.center - truth.center).norm() / truth.semi_axes.mean());
    }
    errors.sort_by(f64::total_cmp);
    (sum / made.truth.len() as f64, errors.get(errors.len() / 2).copied().unwrap_or(f64::INFINITY))
}

#[test]
fn one_view_needs_to_know_how_far_the_object_is() {
    let made = made(1);
    let alone = localize(&made.scene, &options()).unwrap();
    assert!(alone.estimates.iter().all(|estimate| estimate.status == Status::TooFewViews));
    let exact = DepthNoise { noise: 0.01, scale: 1.0, outliers: 0.0, ..Default::default() };
    for (depth, box3d) in [(Some(exact), None), (None, Some(Box3dNoise::default()))] {
        let scene = with_cues(&made, depth, box3d);
        let found = localize(&scene, &options()).unwrap();
        let good = found.estimates.iter().filter(|estimate| estimate.status == Status::Ok).count();
        assert!(good >= 27, "{good} of 30");
        for estimate in found.estimates.iter().filter(|estimate| estimate.status == Status::Ok) {
            assert!(estimate.warnings.contains(&Warning::OneView), "{:?}", estimate.warnings);
            assert!(estimate.covariance.is_some());
        }
        let (_, error) = scores(&made, &found, &scene);
        assert!(error < 0.8, "{error}");
        // An exact fit to few boxes asks for more than one view.
        let three = LocalizeOptions { min_views: 3, ..options() };
        let refused = localize(&scene, &three).unwrap();
        assert!(refused.estimates.iter().all(|estimate| estimate.status == Status::TooFewViews));
    }
}

#[test]
fn three_d_boxes_help_and_never_harm() {
    for (views, gain) in [(2, 0.08), (5, 0.04), (20, 0.0)] {
        let made = made(views);
        let (boxes, _) = scores(&made, &localize(&made.scene, &options()).unwrap(), &made.scene);
        let scene = with_cues(&made, Some(DepthNoise::default()), Some(Box3dNoise::default()));
        let (both, _) = scores(&made, &localize(&scene, &options()).unwrap(), &scene);
        assert!(both > boxes + gain, "{views} views: {boxes} {both}");
    }
}

#[test]
fn the_scale_of_a_source_is_found_whatever_its_unit() {
    let made = made(4);
    // By the estimator that takes depths.
    let of_depths = PosteriorOptions { body: Some(BodyKind::Ellipsoid), by_evidence: false, ..Default::default() };
    let (boxes, _) = scores(&made, &localize(&made.scene, &of_depths.into()).unwrap(), &made.scene);
    // Depths in millimeters, where the world is in meters.
    for scale in [0.8, 1.0, 1000.0] {
        let scene =
            with_cues(&made, Some(DepthNoise { noise: 0.02, scale, outliers: 0.1, ..Default::default() }), None);
        let found = localize(&scene, &options()).unwrap();
        let [depth] = found.cue_scales[..] else { panic!("{:?}", found.cue_scales) };
        assert_eq!((depth.quantity, depth.source), (ScaledQuantity::Depth, Some(0)));
        // The objects are all about as far: where they are it is known, the factor and the shift one by one are not.
        let error = expected(&depth, 25.0) / (25.0 * scale) - 1.0;
        assert!(error.abs() < 0.03 && depth.log_sd < 0.06, "{scale}: {error} {depth:?}");
        let shift = depth.shift.unwrap();
        assert!(shift.value.abs() < 2.0 * shift.sd && shift.sd < 0.05 * 25.0 * scale, "{scale}: {depth:?}");
        let (with, _) = scores(&made, &found, &scene);
        assert!(with > boxes - 0.005, "{scale}: {boxes} {with}");
    }
}

#[test]
fn a_camera_that_stands_still_sees_objects_with_depths() {
    let made = made(1);
    let scene =
        with_cues(&made, Some(DepthNoise { noise: 0.01, scale: 1.0, outliers: 0.0, ..Default::default() }), None);
    let mut parts = scene.into_parts();
    for k in 1..4 {
        let mut frame = parts.frames[0].clone();
        frame.id = format!("again_{k}");
        parts.frames.push(frame);
        let again: Vec<Detection> = parts.detections[..30].to_vec();
        parts.detections.extend(again.into_iter().map(|d| Detection { frame_index: k, ..d }));
    }
    let scene = Scene::from_parts(parts).unwrap();
    // The consistency check takes repeated poses for a mistake.
    let found = localize(&scene, &LocalizeOptions { allow_inconsistent: true, ..options() }).unwrap();
    let (_, error) = scores(&made, &found, &scene);
    assert!(error < 0.8, "{error}");
    assert!(found.estimates.iter().filter(|estimate| estimate.status == Status::Ok).count() >= 27);
}

/// Detections of a 3D detector alone, without boxes in the image.
#[test]
fn three_d_boxes_alone_are_fused() {
    let made = made(8);
    let mut scene = with_cues(&made, None, Some(Box3dNoise::default()));
    let (one, _) = scores(&made, &localize(&scene, &options()).unwrap(), &scene);
    scene.edit(|parts| parts.detections.iter_mut().for_each(|d| d.bounding_box = None)).unwrap();
    let found = localize(&scene, &options()).unwrap();
    assert_eq!(found.skipped.beyond_lens, 0);
    assert!(found.estimates.iter().all(|estimate| estimate.covariance.is_some()), "{:?}", found.estimates[0]);
    let (alone, error) = scores(&made, &found, &scene);
    assert!(alone > 0.55 && alone < one && error < 0.3, "{alone} {one} {error}");
    // The closed forms need boxes.
    let planes = localize(&scene, &LocalizeOptions::from(quadlift::solve::Method::Planes)).unwrap();
    assert!(planes.estimates.iter().all(|estimate| estimate.body.is_none()));
}

#[test]
fn with_given_levels_objects_are_independent() {
    let made = made(3);
    let scene = with_cues(&made, Some(DepthNoise::default()), Some(Box3dNoise::default()));
    let noise_model = NoiseModel::new([("edge_noise", 0.03), ("depth", 0.1), ("box3d_size", 0.15)]).unwrap();
    let mut options = options();
    let map = options.method.posterior_options_mut().unwrap();
    // Boxes that are removed hide nothing.
    (map.noise_model, map.occluded_edges) = (Some(noise_model), false);
    let all = localize(&scene, &options).unwrap();
    assert!(all.cue_scales.is_empty());
    let mut parts = scene.clone().into_parts();
    parts.detections.retain(|d| d.object_index == Some(7));
    let one = localize(&Scene::from_parts(parts).unwrap(), &options).unwrap();
    let alone = one.estimates.iter().find(|estimate| estimate.object_index == 7).unwrap();
    let among = all.estimates.iter().find(|estimate| estimate.object_index == 7).unwrap();
    assert_eq!(alone.body, among.body);
    assert_eq!(alone.covariance, among.covariance);
}

/// Only the ratios of standard deviations count that are far from the errors, such as those of a source that is too sure of itself.
#[test]
fn a_factor_of_all_standard_deviations_changes_nothing() {
    let made = made(3);
    let scene = with_cues(&made, Some(DepthNoise::default()), Some(Box3dNoise::default()));
    let scaled = |factor: f64| {
        let mut scene = scene.clone();
        let sd = |index: usize, usual: f64| Some(factor * usual * if index.is_multiple_of(2) { 1.5 } else { 0.5 });
        let edit = |parts: &mut SceneParts| {
            for (index, detection) in parts.detections.iter_mut().enumerate() {
                let Some(cues) = &mut detection.cues else { continue };
                if let Some(depth) = &mut cues.depth {
                    depth.sd = sd(index, 0.1 * depth.median);
                }
                if let Some(box3d) = &mut cues.box3d {
                    let (distance, direction) = (sd(index, 0.1), sd(index, 0.02));
                    box3d.sd = Box3dSd { distance, direction, size: sd(index, 0.1), rotation: sd(index, 0.15) };
                }
            }
        };
        scene.edit(edit).unwrap();
        localize(&scene, &options()).unwrap()
    };
    let unsure = scaled(1e4);
    for factor in [1e-9, 1e-5, 1e6] {
        let found = scaled(factor);
        for (a, b) in unsure.estimates.iter().zip(&found.estimates) {
            let (Some(a), Some(b)) = (a.closest_ellipsoid(), b.closest_ellipsoid()) else {
                panic!("{:?} {:?}", a.status, b.status)
            };
            let off = (a.center - b.center).norm() + (a.semi_axes - b.semi_axes).norm();
            assert!(off < 1e-6, "{factor}: {off}");
        }
        // Levels are multiples of what is given.
        for group in ["depth", "box3d_distance", "box3d_size"] {
            let level = |found: &Localization| found.noise.get(group).unwrap();
            let ratio = 1e-4 * factor * level(&found) / level(&unsure);
            assert!((ratio - 1.0).abs() < 1e-6, "{factor} {group}: {ratio}");
        }
    }
}

#[test]
fn the_order_and_place_of_the_world_do_not_matter() {
    let made = made(3);
    let scene = with_cues(&made, Some(DepthNoise::default()), Some(Box3dNoise::default()));
    let moved = generate(&SyntheticOptions {
        objects: 30,
        views: 3,
        cube_side: 10.0,
        distance: 25.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        seed: 5,
        offset: Vector3::new(3000.0, -500.0, 20.0),
        ..Default::default()
    })
    .unwrap();
    let mut parts = moved.scene.clone().into_parts();
    parts.cue_sources.clone_from(&scene.cue_sources);
    for (there, here) in parts.detections.iter_mut().zip(&scene.detections) {
        there.cues.clone_from(&here.cues);
    }
    let there = localize(&Scene::from_parts(parts).unwrap(), &options()).unwrap();
    let here = localize(&scene, &options()).unwrap();
    for (a, b) in here.estimates.iter().zip(&there.estimates) {
        let (Some(a), Some(b)) = (a.closest_ellipsoid(), b.closest_ellipsoid()) else {
            panic!("{:?} {:?}", a.status, b.status)
        };
        let off = (b.center - a.center - Vector3::new(3000.0, -500.0, 20.0)).norm();
        assert!(off < 1e-4 && (a.semi_axes - b.semi_axes).norm() < 1e-4, "{off}");
    }
}

#[test]
fn a_wrong_number_is_an_error() {
    let made = made(1);
    let mut scene = made.scene;
    let wrong = Cues { depth: Some(DepthCue { median: f64::NAN, sd: None, source: None }), box3d: None };
    assert!(scene.edit(|parts| parts.detections[0].cues = Some(Box::new(wrong))).is_err());
    let no_source = Cues { depth: Some(DepthCue { median: 1.0, sd: None, source: Some(3) }), box3d: None };
    assert!(scene.edit(|parts| parts.detections[0].cues = Some(Box::new(no_source))).is_err());
}

/// Depths of a network whose scale and shift are wrong, along a street: near and far objects tell both.
#[test]
fn a_shift_is_found_where_objects_are_near_and_far() {
    let street = generate(&SyntheticOptions {
        objects: 30,
        views: 40,
        standing: true,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        seed: 5,
        ..Default::default()
    })
    .unwrap();
    let score = |shift: f64, is_known: bool| {
        let mut scene = with_cues(&street, Some(DepthNoise { shift, outliers: 0.05, ..Default::default() }), None);
        if is_known {
            scene.edit(|parts| _ = parts.scale_known.insert(0)).unwrap();
        }
        let found = localize(&scene, &options()).unwrap();
        let (o3d, _) = scores(&street, &found, &scene);
        (o3d, found.cue_scales.first().copied())
    };
    let (without, _) = score(0.0, false);
    for shift in [0.0, 1.0, -1.0] {
        let (o3d, scale) = score(shift, false);
        let scale = scale.unwrap();
        let found = scale.shift.unwrap();
        assert!((found.value - shift).abs() < 2.0 * found.sd && found.sd < 0.2, "{shift}: {scale:?}");
        assert!((scale.factor / 1.1).ln().abs() < 2.0 * scale.log_sd && scale.log_sd < 0.02, "{shift}: {scale:?}");
        assert!((o3d - without).abs() < 0.01, "{shift}: {o3d} {without}");
    }
    // Taken for lengths of the world they cost much.
    let (taken, scale) = score(1.0, true);
    assert!(taken < without - 0.05 && scale.is_none(), "{taken} {without} {scale:?}");
}

/// A network that estimates depth up to a scale in each image: half of the objects are seen once, where nothing but the scale that
/// the others tell says how far they are.
#[test]
fn each_frame_has_its_own_scale() {
    let made = made(4);
    let noise = DepthNoise { noise: 0.02, scale: 40.0, outliers: 0.05, frame_scale: 0.3, ..Default::default() };
    let mut scene = with_cues(&made, Some(noise), None);
    let is_seen_once = |object: u32| object % 2 == 1;
    scene
        .edit(|parts| {
            parts.detections.retain(|d| {
                let object = d.object_index.unwrap();
                !is_seen_once(object) || d.frame_index == object / 2 % 4
            });
        })
        .unwrap();
    let error = |scene: &Scene| {
        let found = localize(scene, &options()).unwrap();
        let mut errors = Vec::new();
        for estimate in found.estimates.iter().filter(|e| is_seen_once(e.object_index as u32)) {
            let id = &scene.object_ids[estimate.object_index];
            let truth = made.truth.iter().find(|(name, _)| name == id).unwrap().1.closest_ellipsoid();
            let center = estimate.closest_ellipsoid().map(|body| body.center);
            errors.push(center.map_or(f64::INFINITY, |center| (center - truth.center).norm()));
        }
        errors.sort_by(f64::total_cmp);
        (errors[errors.len() / 2], found)
    };
    let (with, found) = error(&scene);
    let frames: Vec<_> =
        found.cue_scales.iter().filter(|s| matches!(s.quantity, ScaledQuantity::DepthOfFrame { .. })).collect();
    assert_eq!(frames.len(), 4);
    let mut off = Vec::new();
    for scale in &frames {
        let ScaledQuantity::DepthOfFrame { frame } = scale.quantity else { unreachable!() };
        // Measured over true depth of the centers.
        let ratio = |d: &Detection| {
            let id = &scene.object_ids[d.object_index.unwrap() as usize];
            let truth = made.truth.iter().find(|(name, _)| name == id).unwrap().1.closest_ellipsoid();
            d.cues.as_ref().unwrap().depth.unwrap().median / scene.frames[frame].projection.depth(&truth.center)
        };
        let mut ratios: Vec<f64> =
            scene.detections.iter().filter(|d| d.frame_index as usize == frame).map(ratio).collect();
        ratios.sort_by(f64::total_cmp);
        off.push((expected(scale, 25.0) / 25.0 / ratios[ratios.len() / 2]).ln());
        assert!(scale.log_sd < 0.06, "{scale:?}");
    }
    // Surfaces are nearer than centers by a few percent, about the same in all frames.
    let mean = off.iter().sum::<f64>() / 4.0;
    assert!((0.0..0.1).contains(&mean) && off.iter().all(|x| (x - mean).abs() < 0.03), "{off:?}");
    // With one scale for all frames.
    let mut same = scene.clone();
    same.edit(|parts| parts.scaled_by_frame.clear()).unwrap();
    let (without, _) = error(&same);
    assert!(with < 0.5 * without, "{with} {without}");
}

/// Depths in lengths of the world: no scale is estimated, and one view says by more how far objects are.
#[test]
fn a_known_scale_is_not_estimated() {
    let made = made(1);
    let noise = DepthNoise { noise: 0.02, scale: 1.0, ..Default::default() };
    let unknown = with_cues(&made, Some(noise), None);
    let mut known = unknown.clone();
    known.edit(|parts| _ = parts.scale_known.insert(0)).unwrap();
    let [unknown, known] = [unknown, known].map(|scene| localize(&scene, &options()).unwrap());
    assert!(known.cue_scales.is_empty() && unknown.cue_scales.len() == 1, "{:?}", known.cue_scales);
    for (with, without) in known.estimates.iter().zip(&unknown.estimates) {
        let sd = |estimate: &quadlift::solve::Estimate| {
            estimate.covariance.as_ref().unwrap().matrix.fixed_view::<3, 3>(0, 0).trace().sqrt()
        };
        // Ten percent of the distance less (variances).
        let told = (sd(without).powi(2) - sd(with).powi(2)).sqrt();
        let camera = made.scene.frames[0].projection.center_in_world().unwrap();
        let distance = (with.center.unwrap() - camera).norm();
        assert!((0.05..0.15).contains(&(told / distance)), "{told} {distance}");
    }
}

/// Polygons of whole objects that overlap in the image: none ends at another one, and they tell more than boxes.
#[test]
fn polygons_of_a_crowd_are_not_worse_than_boxes() {
    let crowd = SyntheticOptions { objects: 40, views: 3, cube_side: 6.0, distance: 25.0, ..Default::default() };
    let observed = SyntheticOptions { observations: Observations::Boxes, noise: vec![Noise::BoxEdges(0.03)], ..crowd };
    let made = generate(&observed).unwrap();
    let mut builder = SceneBuilder::new("crowd");
    for frame in &made.scene.frames {
        let size = frame.image_size.map(|size| [size.x, size.y]);
        builder.add_frame(&frame.id, frame.projection, size).unwrap();
    }
    for (detection, object) in made.scene.detections.iter().zip(&made.true_objects) {
        let frame = &made.scene.frames[detection.frame_index as usize];
        let (name, body) = &made.truth[object.unwrap()];
        let ellipse = project_ellipsoid(&frame.projection, &body.closest_ellipsoid()).unwrap();
        let corners: Vec<[f64; 2]> = (0..64)
            .map(|k| {
                let (sin, cos) = (f64::from(k) / 64.0 * std::f64::consts::TAU).sin_cos();
                let offset = Vector2::new(ellipse.semi_axes().x * cos, ellipse.semi_axes().y * sin);
                (ellipse.center() + Rotation2::new(ellipse.angle()) * offset).into()
            })
            .collect();
        let bounding_box = detection.bounding_box;
        let outline = Some(corners.as_slice());
        builder
            .add_detection(&NewDetection {
                frame: &frame.id,
                object: Some(name),
                bounding_box,
                outline,
                ..Default::default()
            })
            .unwrap();
    }
    let with = builder.build();
    let (boxes, _) = scores(&made, &localize(&made.scene, &options()).unwrap(), &made.scene);
    let (polygons, _) = scores(&made, &localize(&with, &options()).unwrap(), &with);
    assert!(polygons > boxes, "{boxes} {polygons}");
}
