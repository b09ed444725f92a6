//! The median time in which the camera of an image is found in a map of 30 objects of many or few categories.
//!
//! `cargo bench -p quadlift-bench --features timings --bench relocalize`

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

use std::time::Instant;

use quadlift::relocalize::{Landmark, LandmarkMap, LocateOptions, LocateStatus, Query, QueryBox};
use quadlift::synthetic::{
    CategoryOptions, CategorySizes, Detector, Noise, Observations, SyntheticOptions, Trajectory, generate_categories,
};

fn main() {
    for categories in [30, 6, 3, 1] {
        let options = SyntheticOptions {
            objects: 30,
            views: 40,
            cube_side: 20.0,
            distance: 40.0,
            trajectory: Trajectory::Orbit,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.03)],
            detector: Detector { misses: 0.2, false_boxes: 0.2, ..Default::default() },
            seed: 1,
            ..Default::default()
        };
        let sizes = CategorySizes::Alike(0.1);
        let made = generate_categories(&options, &CategoryOptions { categories, sizes }).unwrap();
        let scene = &made.scene;
        let category_of = |object: usize| {
            let detection = scene.detections.iter().zip(&made.true_objects).find(|(_, shown)| **shown == Some(object));
            detection.and_then(|(d, _)| Some(scene.categories[d.category_index? as usize].clone()))
        };
        let landmarks = made.truth.iter().enumerate().map(|(object, (_, body))| Landmark {
            body: *body,
            covariance: None,
            category: category_of(object),
            correction: None,
        });
        let map = LandmarkMap::new(landmarks.collect());
        let mut times = Vec::new();
        let mut located = 0;
        for (index, frame) in scene.frames.iter().enumerate() {
            let boxes = scene.detections.iter().filter(|d| d.frame_index as usize == index).map(|d| QueryBox {
                bounding_box: d.bounding_box.unwrap(),
                box_in_image: None,
                category: d.category_index.map(|k| scene.categories[k as usize].clone()),
            });
            let intrinsics = frame.projection.intrinsics().unwrap();
            let query = Query { intrinsics, image_size: frame.image_size, boxes: boxes.collect() };
            let start = Instant::now();
            let found = map.relocalize(&query, &LocateOptions { edge_noise: 0.03, ..Default::default() });
            times.push(start.elapsed().as_secs_f64() * 1e3);
            located += usize::from(found.status == LocateStatus::Ok);
        }
        times.sort_by(f64::total_cmp);
        let (median, most) = (times[times.len() / 2], times[times.len() - 1]);
        println!(
            "{categories:2} categories: median {median:.1} ms, longest {most:.0} ms; {located} of {} located",
            times.len()
        );
    }
}
