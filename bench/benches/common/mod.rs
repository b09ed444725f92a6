//! The benchmarks are in `benches/`; here is what two of them share.

use quadlift::online::{Frame, FrameUpdate, ObjectMap};
use quadlift::scene::{NewDetection, Scene};
use quadlift::synthetic::{
    Detector, Noise, Observations, SyntheticIds, SyntheticOptions, SyntheticScene, Trajectory, generate,
};

/// A drive along a street: 20 % of the objects missed, 15 % false boxes, 5 % noise of edges.
pub(crate) fn street(objects: usize, views: usize, ids: SyntheticIds) -> SyntheticScene {
    let options = SyntheticOptions {
        objects,
        views,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: Detector { misses: 0.2, false_boxes: 0.15, ..Default::default() },
        ids,
        ..Default::default()
    };
    generate(&options).expect("the options are valid")
}

/// The frames of a scene with their detections, in the order of time.
pub(crate) fn frames(scene: &Scene) -> Vec<(Frame, Vec<NewDetection<'_>>)> {
    let mut frames: Vec<(Frame, Vec<NewDetection>)> = scene
        .frames
        .iter()
        .enumerate()
        .map(|(k, frame)| (Frame::of_scene(scene, frame, k as f64), Vec::new()))
        .collect();
    for detection in &scene.detections {
        let Some(bounding_box) = detection.bounding_box else { continue };
        frames[detection.frame_index as usize].1.push(NewDetection {
            category: detection.category_index.map(|c| scene.categories[c as usize].as_str()),
            score: detection.score,
            object: detection.object_index.map(|o| scene.object_ids[o as usize].as_str()),
            ..NewDetection::from_box(bounding_box)
        });
    }
    frames
}

/// Observes a frame.
pub(crate) fn observe(map: &mut ObjectMap, (frame, detections): &(Frame, Vec<NewDetection>)) -> FrameUpdate {
    map.observe(frame, detections).expect("the frame is valid")
}
