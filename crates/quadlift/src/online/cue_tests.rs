//! Depths and 3D boxes in the map: kept with the views, used by the estimates, checked.

use nalgebra::{Matrix3, Point3, Rotation3};

use super::tests::numbers;
use super::views::KeptView;
use super::*;
use crate::scene::{Box3dCue, CueError, Cues, DepthCue, NewDetection, Scene};
use crate::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Noise, Observations, ShapeOptions, SyntheticIds, SyntheticOptions,
    SyntheticScene, Trajectory, generate, simulate_cues, simulate_shapes,
};
use crate::{LocalizeOptions, localize};

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

fn detections(scene: &Scene, frame: usize) -> Vec<NewDetection<'_>> {
    let of_frame = scene.detections.iter().filter(|d| d.frame_index as usize == frame);
    of_frame
        .map(|d| NewDetection {
            cues: d.cues.as_deref().copied().unwrap_or_default(),
            ..NewDetection::from_box(d.bounding_box.unwrap())
        })
        .collect()
}

fn map_of(scene: &Scene) -> ObjectMap {
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    for k in 0..scene.frames.len() {
        map.observe(&Frame::of_scene(scene, &scene.frames[k], k as f64), &detections(scene, k)).unwrap();
    }
    map
}

#[test]
fn views_keep_their_cues_in_the_scene() {
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
}

#[test]
fn scales_of_frames_are_those_of_the_map() {
    let (_, scene) = with_cues();
    let mut parts = scene.into_parts();
    // The map numbers sources in the order in which it sees them.
    parts.scaled_by_frame = [1].into();
    let scene = Scene::from_parts(parts).unwrap();
    let map = map_of(&scene);
    let found = map.to_averaged_scene();
    let names: Vec<&str> = found.scaled_by_frame.iter().map(|&k| found.cue_sources[k as usize].as_str()).collect();
    assert_eq!(names, ["box3d"]);
}

#[test]
fn outlines_and_oriented_boxes_give_the_lines_of_a_scene() {
    use crate::scene::SceneBuilder;
    let (made, scene) = with_cues();
    let options = ShapeOptions { outline: Some(0.03), oriented_box: Some(Default::default()) };
    let body_of = |index: usize, _: &crate::scene::Detection| Some(made.truth[made.true_objects[index]?].1);
    let shapes = simulate_shapes(&scene, body_of, &options, 3);
    let mut builder = SceneBuilder::new("shapes");
    for frame in &scene.frames {
        let size = frame.image_size.map(Into::into);
        builder.add_frame(&frame.id, frame.projection, size).unwrap();
    }
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    for (k, frame) in scene.frames.iter().enumerate() {
        let mut found = Vec::new();
        for (index, d) in scene.detections.iter().enumerate().filter(|(_, d)| d.frame_index as usize == k) {
            let outline = shapes[index].outline.as_deref().filter(|_| index % 3 != 0);
            let oriented_box = shapes[index].oriented_box.filter(|_| index % 3 == 0);
            let bounding_box = d.bounding_box.filter(|_| index % 3 == 1);
            let input = NewDetection { frame: &frame.id, bounding_box, outline, oriented_box, ..Default::default() };
            builder.add_detection(&input).unwrap();
            found.push(input);
        }
        map.observe(&Frame::of_scene(&scene, frame, k as f64), &found).unwrap();
    }
    let expected = builder.build();
    let (mut turned, mut boxed) = (0, 0);
    let (kept, shapes) = (map.to_scene(), map.shapes_of_scene());
    assert!(kept.detections.len() > 100 && shapes.len() == kept.detections.len());
    for (detection, shape) in kept.detections.iter().zip(&shapes) {
        let frame = &kept.frames[detection.frame_index as usize];
        let edges = detection.bounding_box.unwrap().edges();
        let same = |a: [f64; 4]| a.iter().zip(&edges).all(|(a, b)| (a - b).abs() < 1e-3);
        let is_it = |d: &&crate::scene::Detection| {
            expected.frames[d.frame_index as usize].id == frame.id && same(d.bounding_box.unwrap().edges())
        };
        let given = expected.detections.iter().find(is_it).unwrap().tangent_lines.as_deref().unwrap();
        let found = detection.tangent_lines.as_deref().unwrap();
        assert_eq!(found.count(), given.count());
        for (a, b) in found.lines().zip(given.lines()) {
            assert!((a.reach - b.reach).abs() < 2e-3 && (a.normal - b.normal).norm() < 1e-6, "{a:?} {b:?}");
            assert_eq!(a.end, b.end);
        }
        let shape = shape.as_ref().unwrap();
        assert!(shape.outline().is_none_or(|corners| (3..=16).contains(&corners.len())));
        turned += usize::from(shape.oriented_box().is_some());
        boxed += usize::from(shape.has_box());
    }
    assert!(turned > 20 && boxed > 20, "{turned} {boxed}");
    let flat = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]];
    let frame = Frame { id: "flat".to_owned(), ..Frame::of_scene(&scene, &scene.frames[0], 99.0) };
    let good = NewDetection { cues: Cues::default(), ..detections(&scene, 0)[0] };
    let wrong = NewDetection { outline: Some(&flat), ..good };
    let error = map.observe(&frame, &[good, wrong]).unwrap_err();
    assert!(matches!(error, ObserveError::Outline { detection: 1, .. }), "{error}");
    let error = map.observe(&frame, &[good, NewDetection { bounding_box: None, ..good }]).unwrap_err();
    assert!(matches!(error, ObserveError::NoBox { detection: 1, .. }), "{error}");
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
        let localization = localize(&map_of(scene).to_averaged_scene(), &LocalizeOptions::default()).unwrap();
        let mut errors: Vec<f64> = made
            .truth
            .iter()
            .filter_map(|(_, body)| {
                let truth = body.closest_ellipsoid();
                let bodies = localization.estimates.iter().filter_map(|e| e.closest_ellipsoid());
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
    let good_frame = Frame::of_scene(&scene, &scene.frames[0], 0.0);
    let with = |cue_sources: &[String]| Frame { cue_sources: cue_sources.to_vec(), ..good_frame.clone() };
    let before = numbers(&map);
    let alone = NewDetection { cues: Cues::default(), ..good[0] };
    let refused = |map: &mut ObjectMap, cues: Cues, cue_sources: &[String]| {
        map.observe(&with(cue_sources), &[alone, NewDetection { cues, ..good[1] }]).unwrap_err()
    };
    let depth = |median, source| Cues { depth: Some(DepthCue { median, sd: None, source }), box3d: None };
    let error = refused(&mut map, depth(-1.0, None), &[]);
    assert!(matches!(error, ObserveError::Cue { detection: 1, error: CueError::Depth(_), .. }), "{error}");
    assert!(error.to_string().contains("the depth is -1"), "{error}");
    let behind = Box3dCue { center: Some(Point3::new(0.0, 0.0, -1.0)), ..Default::default() };
    let error = refused(&mut map, Cues { depth: None, box3d: Some(behind) }, &[]);
    assert!(matches!(error, ObserveError::Cue { error: CueError::BehindCamera(_), .. }), "{error}");
    let error = refused(&mut map, depth(1.0, Some(1)), &["net".to_owned()]);
    assert!(matches!(error, ObserveError::CueSource { source_index: 1, count: 1, .. }), "{error}");
    let names: Vec<String> = (0..=MAX_CUE_SOURCES).map(|k| k.to_string()).collect();
    let many: Vec<NewDetection> =
        (0..names.len()).map(|k| NewDetection { cues: depth(1.0, Some(k as u32)), ..good[0] }).collect();
    assert!(matches!(map.observe(&with(&names), &many), Err(ObserveError::TooManyCueSources { .. })));
    assert_eq!(numbers(&map), before);
    // Those of another list of names are known by their names.
    map.observe(&good_frame, &good).unwrap();
    let again = Frame { id: "again".to_owned(), time: 1.0, ..with(&["other".to_owned(), "depth".to_owned()]) };
    map.observe(&again, &[alone, NewDetection { cues: depth(1.0, Some(1)), ..good[1] }]).unwrap();
    assert_eq!(map.memory.cue_sources, ["depth", "box3d"]);
}

#[test]
fn views_with_wrong_cues_are_not_valid() {
    let (_, scene) = with_cues();
    let map = map_of(&scene);
    let view = map.memory.objects.tracked().find_map(|object| Some(object.views.first()?.clone())).unwrap();
    let good = view.cues.as_deref().copied().unwrap();
    assert!(view.is_valid(1, 2) && !view.is_valid(0, 2));
    let negative = Some(Point3::new(0.0, 0.0, -1.0));
    type Change<'a> = &'a dyn Fn(&mut DepthCue, &mut Box3dCue);
    let wrong: [Change; 5] = [
        &|depth, _| depth.median = f64::NAN,
        &|depth, _| depth.source = Some(2),
        &|_, box3d| box3d.rotation = Some(Rotation3::from_matrix_unchecked(Matrix3::repeat(0.5))),
        &|_, box3d| box3d.center = negative,
        &|_, box3d| box3d.sd.distance = Some(0.0),
    ];
    for change in wrong {
        let (mut depth, mut box3d) = (good.depth.unwrap(), good.box3d.unwrap());
        change(&mut depth, &mut box3d);
        let cues = Some(Box::new(Cues { depth: Some(depth), box3d: Some(box3d) }));
        assert!(!KeptView { cues, ..view.clone() }.is_valid(1, 2));
    }
}
