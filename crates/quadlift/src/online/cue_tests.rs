//! Depths and 3D boxes in the map: kept with the views, stored, used by the estimates, checked.

use nalgebra::Point3;

use super::*;
use crate::LocalizeOptions;
use crate::scene::{Box3dCue, CueError, Cues, DepthCue, Scene};
use crate::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Noise, Observations, SyntheticIds, SyntheticOptions, SyntheticScene,
    Trajectory, generate, simulate_cues,
};

/// Objects seen from an arc of few views, with depths and 3D boxes.
fn with_cues() -> (SyntheticScene, Scene) {
    let made = generate(&SyntheticOptions {
        objects: 10,
        views: 14,
        cube_side: 60.0,
        trajectory: Trajectory::Arc { span: 20.0 },
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        ids: SyntheticIds::Absent,
        ..Default::default()
    })
    .unwrap();
    let body_of = |index: usize, _: &crate::scene::Detection| Some(made.truth[made.true_objects[index]?].1);
    let exact = Box3dNoise { size_bias: 1.0, flips: 0.0, outliers: 0.0, ..Default::default() };
    let options = CueOptions { depth: Some(DepthNoise::default()), box3d: Some(exact) };
    let scene = simulate_cues(&made.scene, body_of, &options, 5).unwrap();
    (made, scene)
}

fn detections(scene: &Scene, frame: usize) -> Vec<Detection<'_>> {
    let of_frame = scene.detections.iter().filter(|d| d.frame_index as usize == frame);
    let detection = |d: &'_ crate::scene::Detection| d.bounding_box.unwrap();
    of_frame
        .map(|d| Detection {
            cues: d.cues.as_deref(),
            cue_sources: &scene.cue_sources,
            ..Detection::from_box(detection(d))
        })
        .collect()
}

fn map_of(scene: &Scene) -> ObjectMap {
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    for k in 0..scene.frames.len() {
        map.observe(&Frame::of_scene(&scene.frames[k], k as f64), &detections(scene, k)).unwrap();
    }
    map
}

#[test]
fn views_keep_their_cues_in_the_scene_and_in_the_state() {
    let (_, scene) = with_cues();
    let map = map_of(&scene);
    let kept = map.to_scene();
    assert!(kept.detections.len() > 100 && kept.cue_sources == ["depth", "box3d"], "{}", kept.detections.len());
    for detection in &kept.detections {
        let frame = &kept.frames[detection.frame_index as usize];
        let edges = detection.bounding_box.unwrap().edges();
        let is_it = |d: &&crate::scene::Detection| {
            let same = |a: [f64; 4]| a.iter().zip(&edges).all(|(a, b)| (a - b).abs() < 1e-3);
            scene.frames[d.frame_index as usize].id == frame.id && same(d.bounding_box.unwrap().edges())
        };
        let given = scene.detections.iter().find(is_it).unwrap().cues.as_deref().unwrap();
        let found = detection.cues.as_deref().unwrap();
        assert_eq!(found.depth, given.depth);
        let (found, given) = (found.box3d.unwrap(), given.box3d.unwrap());
        assert_eq!((found.center, found.half_extents, found.source), (given.center, given.half_extents, given.source));
        assert!((found.rotation.unwrap().matrix() - given.rotation.unwrap().matrix()).amax() < 1e-12);
    }
    let again = ObjectMap::from_state(OnlineOptions::default(), map.to_state()).unwrap();
    assert_eq!(again.to_state(), map.to_state());
    assert_eq!(again.to_scene().detections.len(), kept.detections.len());
    for (a, b) in again.to_scene().detections.iter().zip(&kept.detections) {
        assert_eq!(a.cues, b.cues);
    }
}

#[test]
fn estimates_use_the_cues_of_the_views() {
    let (made, scene) = with_cues();
    let without = {
        let mut parts = scene.clone().into_parts();
        parts.detections.iter_mut().for_each(|d| d.cues = None);
        Scene::from_parts(parts).unwrap()
    };
    // Errors of the semi-axes, which boxes from a short arc tell badly.
    let errors = |scene: &Scene| {
        let localization = map_of(scene).localize(&LocalizeOptions::default()).unwrap();
        let mut errors: Vec<f64> = made
            .truth
            .iter()
            .filter_map(|(_, body)| {
                let truth = body.ellipsoid();
                let bodies = localization.estimates.iter().filter_map(|e| e.ellipsoid());
                let nearest = bodies
                    .min_by(|a, b| (a.center - truth.center).norm().total_cmp(&(b.center - truth.center).norm()))?;
                let sorted = |v: nalgebra::Vector3<f64>| {
                    let mut v: [f64; 3] = v.into();
                    v.sort_by(f64::total_cmp);
                    v
                };
                let (a, b) = (sorted(nearest.semi_axes), sorted(truth.semi_axes));
                Some((0..3).map(|k| (a[k] / b[k]).ln().abs()).sum::<f64>() / 3.0)
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        (errors.len(), errors[errors.len() / 2])
    };
    let ((count, with), (_, alone)) = (errors(&scene), errors(&without));
    assert!(count == 10 && with < 0.7 * alone, "{with} {alone}");
}

#[test]
fn cues_out_of_range_are_refused_and_change_nothing() {
    let (_, scene) = with_cues();
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    let good = detections(&scene, 0);
    let frame = Frame::of_scene(&scene.frames[0], 0.0);
    let before = map.to_state();
    let refused = |map: &mut ObjectMap, cues: &Cues, cue_sources: &[String]| {
        map.observe(&frame, &[good[0], Detection { cues: Some(cues), cue_sources, ..good[1] }]).unwrap_err()
    };
    let depth = |median, source| Cues { depth: Some(DepthCue { median, sd: None, source }), box3d: None };
    let error = refused(&mut map, &depth(-1.0, None), &[]);
    assert!(matches!(error, ObserveError::Cue { detection: 1, error: CueError::Depth(_), .. }), "{error}");
    assert!(error.to_string().contains("the depth is -1"), "{error}");
    let behind = Box3dCue { center: Some(Point3::new(0.0, 0.0, -1.0)), ..Default::default() };
    let error = refused(&mut map, &Cues { depth: None, box3d: Some(behind) }, &[]);
    assert!(matches!(error, ObserveError::Cue { error: CueError::BehindCamera(_), .. }), "{error}");
    let error = refused(&mut map, &depth(1.0, Some(1)), &["net".to_owned()]);
    assert!(matches!(error, ObserveError::CueSource { source_index: 1, count: 1, .. }), "{error}");
    let names: Vec<String> = (0..=MAX_CUE_SOURCES).map(|k| k.to_string()).collect();
    let cues: Vec<Cues> = (0..names.len()).map(|k| depth(1.0, Some(k as u32))).collect();
    let many: Vec<Detection> =
        cues.iter().map(|cues| Detection { cues: Some(cues), cue_sources: &names, ..good[0] }).collect();
    assert!(matches!(map.observe(&frame, &many), Err(ObserveError::TooManyCueSources { .. })));
    assert_eq!(map.to_state(), before);
    // Those of another list of names are known by their names.
    let names = ["other".to_owned(), "depth".to_owned()];
    let cues = depth(1.0, Some(1));
    map.observe(&frame, &[good[0], Detection { cues: Some(&cues), cue_sources: &names, ..good[1] }]).unwrap();
    assert_eq!(map.cue_sources, ["depth", "box3d"]);
}
