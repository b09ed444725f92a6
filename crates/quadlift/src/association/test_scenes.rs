//! Bodies seen exactly, for the tests of the parts.

use nalgebra::{Point3, Rotation3, Vector3};

use super::input::observations::Observations;
use super::score::scene_statistics::SceneStatistics;
use crate::geometry::{Ellipsoid, project_ellipsoid};
use crate::scene::{Detection, Frame, NewDetection, Scene, SceneBuilder};
use crate::synthetic::{Detector, Noise, SyntheticIds, SyntheticOptions, SyntheticScene, Trajectory, generate};

/// A body somewhere near the middle.
pub(crate) fn ellipsoid() -> Ellipsoid {
    Ellipsoid {
        center: Point3::new(3.0, -2.0, 1.0),
        semi_axes: Vector3::new(3.0, 2.0, 1.5),
        rotation: Rotation3::from_euler_angles(0.3, 0.5, -0.4),
    }
}

/// The exact boxes of a body in so many views around it, and a model with the first noise.
pub(crate) fn seen_by(views: usize, body: &Ellipsoid) -> (Observations, SceneStatistics) {
    let (_, observations, statistics) = of_frames(views, |_| vec![(*body, None)]);
    (observations, statistics)
}

/// Exact boxes of the bodies, with their categories, that each frame has; with the scene.
pub(crate) fn of_frames(
    views: usize,
    shown: impl Fn(usize) -> Vec<(Ellipsoid, Option<&'static str>)>,
) -> (Scene, Observations, SceneStatistics) {
    let make = SyntheticOptions { objects: 0, views, trajectory: Trajectory::Orbit, ..Default::default() };
    let mut builder = SceneBuilder::new("exact boxes");
    for (index, frame) in generate(&make).unwrap().scene.frames.iter().enumerate() {
        builder.add_frame(&frame.id, frame.projection, Some([1280.0, 960.0])).unwrap();
        for (body, category) in shown(index) {
            let bounding_box = Some(project_ellipsoid(&frame.projection, &body).unwrap().bounding_box());
            let detection = NewDetection { frame: &frame.id, category, bounding_box, ..Default::default() };
            builder.add_detection(&detection).unwrap();
        }
    }
    let scene = builder.build();
    let observations = Observations::new(&scene, &(0..scene.detections.len()).collect::<Vec<_>>());
    let unknown_sizes = vec![None; observations.categories.len()];
    let statistics = SceneStatistics::new(&observations, unknown_sizes, 2.0);
    (scene, observations, statistics)
}

/// Ten objects in six views.
pub(crate) fn once(ids: SyntheticIds) -> SyntheticScene {
    let make = SyntheticOptions {
        objects: 10,
        views: 6,
        observations: crate::synthetic::Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        detector: Detector { misses: 0.0, false_boxes: 0.0, ..Default::default() },
        ids,
        ..Default::default()
    };
    generate(&make).unwrap()
}

/// The scene with every frame so many times; the copies of a frame follow it.
pub(crate) fn repeated(scene: &Scene, times: usize) -> Scene {
    let mut parts = scene.clone().into_parts();
    let (frames, detections) = (std::mem::take(&mut parts.frames), std::mem::take(&mut parts.detections));
    for frame in &frames {
        for copy in 0..times {
            parts.frames.push(Frame { id: format!("{} {copy}", frame.id), ..frame.clone() });
        }
    }
    for detection in detections {
        for copy in 0..times {
            let frame_index = detection.frame_index * times as u32 + copy as u32;
            parts.detections.push(Detection { frame_index, ..detection.clone() });
        }
    }
    Scene::from_parts(parts).unwrap()
}
