//! Synthetic scenes ([`quadlift::synthetic`]) as scene files.

use quadlift::geometry::Intrinsics;
use quadlift::synthetic::SyntheticScene;

use crate::scene_file::{CameraRecord, DetectionRecord, FrameRecord, ObjectRecord, SceneFile};

/// The same scene whose detections name the true objects.
pub fn with_true_ids(mut file: SceneFile, synthetic: &SyntheticScene) -> SceneFile {
    for (record, object) in file.detections.iter_mut().zip(&synthetic.true_objects) {
        record.object = object.map(|index| synthetic.truth[index].0.as_str().into());
    }
    file
}

fn rounded(x: f64, steps: f64) -> f64 {
    (x * steps).round() / steps
}

/// The scene with its cameras, points, detections and, as `objects`, the truth.
pub fn scene_file(synthetic: &SyntheticScene) -> SceneFile {
    let scene = &synthetic.scene;
    // One record for each kind of camera; the first one is simply called "camera".
    let mut kinds: Vec<(Intrinsics, [u32; 2])> = Vec::new();
    let name = |index: usize| if index == 0 { "camera".to_owned() } else { format!("camera_{index}") };
    let mut file = SceneFile {
        name: Some(scene.name.clone()),
        length_unit: scene.length_unit.clone(),
        up: scene.up.map(|up| up.into_inner().into()),
        ..Default::default()
    };
    let mut observed: Vec<(Vec<u32>, Vec<[f64; 2]>)> = vec![Default::default(); synthetic.frames.len()];
    for frame in &synthetic.frames {
        let kind = (frame.intrinsics, [frame.width, frame.height]);
        let camera = kinds.iter().position(|k| *k == kind).unwrap_or_else(|| {
            kinds.push(kind);
            kinds.len() - 1
        });
        let pose = frame.cam_from_world.matrix();
        file.frames.push(FrameRecord {
            id: frame.id.clone(),
            camera: Some(name(camera)),
            cam_from_world: Some(std::array::from_fn(|i| std::array::from_fn(|j| pose[(i, j)]))),
            ..Default::default()
        });
    }
    for point in &scene.points {
        let number = file.points.len() as u32;
        file.points.push(point.position.coords.map(|x| rounded(x, 1e6)).into());
        for seen in &point.observations {
            let (points, pixels) = &mut observed[seen.frame_index as usize];
            points.push(number);
            pixels.push(seen.pixel.map(|x| rounded(x, 100.0)).into());
        }
    }
    for (frame, (points, pixels)) in file.frames.iter_mut().zip(observed).filter(|(_, (points, _))| !points.is_empty())
    {
        (frame.observed_points, frame.observed_pixels) = (Some(points.into()), Some(pixels.into()));
    }
    for (index, (intrinsics, [width, height])) in kinds.iter().enumerate() {
        file.cameras.push(CameraRecord {
            id: name(index),
            model: "PINHOLE".to_owned(),
            width: Some(f64::from(*width)),
            height: Some(f64::from(*height)),
            params: vec![intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy],
            ..Default::default()
        });
    }
    // True categories are no measurements.
    let record = |detection| DetectionRecord { category: None, ..DetectionRecord::of_scene(scene, detection) };
    file.detections.extend(scene.detections.iter().map(record));
    for (id, body) in &synthetic.truth {
        let mut object = ObjectRecord { id: id.clone(), ..Default::default() };
        object.set_true_body(body);
        file.objects.push(object);
    }
    file
}
