//! Maps that are stored and read again, and states that were not written by this program.

use quadlift::diagnosis::{CauseName, Correction, Mistake};
use quadlift::online::{Frame, FrameUpdate};
use quadlift::scene::{Cues, DepthCue, NewDetection, Scene};
use quadlift::synthetic::{Detector, Noise, Observations, SyntheticIds, SyntheticOptions, Trajectory, generate};
use serde_json::json;

use super::*;

fn scene(views: usize) -> Scene {
    let options = SyntheticOptions {
        objects: 8,
        views,
        seed: 4,
        cube_side: 40.0,
        trajectory: Trajectory::Orbit,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: Detector { misses: 0.1, false_boxes: 0.1, ..Default::default() },
        ids: SyntheticIds::Tracks { fragments: 0.05, switches: 0.05 },
        ..Default::default()
    };
    generate(&options).unwrap().scene
}

/// Observes frames, where `has_more` with outlines and depths of a source.
fn observe(map: &mut ObjectMap, scene: &Scene, frames: std::ops::Range<usize>, has_more: bool) -> Vec<FrameUpdate> {
    let corners = |d: &quadlift::scene::Detection| {
        let [x0, y0, x1, y1] = d.bounding_box.unwrap().edges();
        let (x, y) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        vec![[x0, y], [x, y0], [x1, y], [x, y1]]
    };
    let observe = |k: usize| {
        let found: Vec<_> = scene.detections.iter().filter(|d| d.frame_index as usize == k).collect();
        let outlines: Vec<_> = found.iter().map(|d| corners(d)).collect();
        let depth = DepthCue { median: 30.0, sd: Some(3.0), source: Some(0) };
        let detections: Vec<NewDetection> = found
            .iter()
            .zip(&outlines)
            .enumerate()
            .map(|(n, (d, outline))| NewDetection {
                category: Some(if n % 2 == 0 { "cup" } else { "jar" }).filter(|_| has_more),
                object: d.object_index.map(|o| scene.object_ids[o as usize].as_str()),
                outline: Some(outline.as_slice()).filter(|_| has_more),
                cues: Cues { depth: Some(depth).filter(|_| has_more && n % 3 == 0), box3d: None },
                ..NewDetection::from_box(d.bounding_box.unwrap())
            })
            .collect();
        let cue_sources = vec!["net".to_owned()];
        let frame = Frame { cue_sources, ..Frame::of_scene(scene, &scene.frames[k], k as f64) };
        map.observe(&frame, &detections).unwrap()
    };
    frames.map(observe).collect()
}

fn bytes_of(map: &ObjectMap) -> Vec<u8> {
    let state = StreamState { map: map.clone(), scene: StreamedScene::default(), poses_since: 0 };
    let mut bytes = Vec::new();
    write_state(&mut bytes, &state, &Map::new()).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<ObjectMap, ReadError> {
    Ok(parse_state_file(Path::new("state"), bytes, OnlineOptions::default(), &Map::new())?.map)
}

#[test]
fn a_map_that_was_stored_goes_on_as_if_nothing_had_happened() {
    let right = scene(40);
    for (scene, has_more) in [(&right, false), (&right, true), (&Mistake(Correction::OpenGlAxes).apply(&right), false)]
    {
        let mut unbroken = ObjectMap::new(OnlineOptions::default()).unwrap();
        for k in 0..40 {
            observe(&mut unbroken, scene, k..k + 1, has_more);
            if k % 7 == 3 {
                let mut stored = read(&bytes_of(&unbroken)).unwrap();
                assert_eq!(bytes_of(&stored), bytes_of(&unbroken), "frame {k}");
                let mut other = unbroken.clone();
                let next = (k + 1)..(k + 4).min(40);
                let [a, b] =
                    [&mut stored, &mut other].map(|map| (observe(map, scene, next.clone(), has_more), map.settle()));
                assert!(a == b && bytes_of(&stored) == bytes_of(&other), "frame {k}");
            }
        }
        let found = read(&bytes_of(&unbroken)).unwrap();
        let is_wrong = scene.frames[1].projection != right.frames[1].projection;
        assert_eq!(found.consistent(), Some(!is_wrong));
        assert_eq!(found.diagnosis(), unbroken.diagnosis());
        assert_eq!(found.diagnosis().causes.first().map(|cause| cause.name), is_wrong.then_some(CauseName::OpenGlAxes));
    }
}

/// The state with other content, and its checksum.
fn edited(bytes: &[u8], edit: &dyn Fn(&mut Value)) -> Vec<u8> {
    let mut document: Value = serde_json::from_slice(bytes).unwrap();
    document.as_object_mut().unwrap().remove("checksum");
    edit(&mut document["map"]);
    let text = document.to_string();
    let rest = text.trim_start_matches('{');
    format!("{},{rest}\n", checksum_of(rest)).into_bytes()
}

#[test]
fn parts_that_contradict_each_other_are_refused_whatever_the_checksum() {
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    observe(&mut map, &scene(20), 0..20, true);
    let bytes = bytes_of(&map);
    assert!(read(&edited(&bytes, &|_| ())).is_ok());
    fn object(map: &mut Value) -> &mut Value {
        map["objects"]["slots"].as_array_mut().unwrap().iter_mut().find(|slot| !slot.is_null()).unwrap()
    }
    type Edit<'a> = &'a dyn Fn(&mut Value);
    let edits: [Edit; 17] = [
        &|map| map["objects"]["free"] = json!([0]),
        &|map| map["keyframes"]["by_key"] = json!({}),
        &|map| map["categories"] = json!([]),
        &|map| map["cue_sources"] = json!([]),
        &|map| map["scaled_by_frame"] = json!([1_000_000]),
        &|map| map["objects"]["aliases"] = json!({"1": 1}),
        &|map| map["next_key"] = json!(0),
        &|map| map["objects"]["given_ids"] = json!(0),
        &|map| map["running"]["assigned"] = json!(i64::MAX),
        &|map| map["running"]["histogram"] = json!([]),
        &|map| map["objects"]["slots"][1] = map["objects"]["slots"][0].clone(),
        &|map| object(map)["object"]["covariance"] = json!([1.0]),
        &|map| object(map)["object"]["visible"] = json!(usize::MAX),
        &|map| object(map)["object"]["radius"] = json!(0.0),
        &|map| object(map)["views"].as_array_mut().unwrap().reverse(),
        &|map| object(map)["views"][0]["category"] = json!(999),
        &|map| object(map)["views"][0]["edges"] = json!([3.0, 0.0, 1.0, 1e39]),
    ];
    for (k, edit) in edits.iter().enumerate() {
        let problem = read(&edited(&bytes, edit)).expect_err(&format!("edit {k}")).problem;
        assert!(problem.starts_with("the state cannot be read: "), "{k}: {problem}");
    }
}

#[test]
fn another_checksum_is_damage() {
    let bytes = bytes_of(&ObjectMap::new(OnlineOptions::default()).unwrap());
    let text = String::from_utf8(bytes).unwrap().replace("\"given_ids\":0", "\"given_ids\":2");
    assert!(read(text.as_bytes()).unwrap_err().problem.starts_with("the state is damaged: its checksum differs"));
}
