//! The default estimator on whole synthetic scenes: clean, noisy and with outliers, with refined poses, with depths, 3D boxes and
//! outlines, and with many views.
//!
//! `cargo bench -p quadlift-bench --features timings --bench posterior`. One thread: `RAYON_NUM_THREADS=1`. Times are per scene
//! of 50 objects.

#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion};
use quadlift::geometry::{BodyKind, Ellipse, TangentLines, project_ellipsoid};
use quadlift::scene::{Detection, Scene};
use quadlift::solve::{PoseMotion, PosteriorOptions};
use quadlift::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Noise, Observations, SyntheticOptions, Trajectory, generate, simulate_cues,
};
use quadlift::{LocalizeOptions, localize};

/// A scene of boxes, with depths, with 3D boxes, with both, and outlines with and without the boxes.
fn cues(options: &SyntheticOptions) -> Vec<(&'static str, Scene)> {
    let made = generate(options).unwrap();
    let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
    let with = |depth: bool, box3d: bool| {
        let cues = CueOptions { depth: depth.then(DepthNoise::default), box3d: box3d.then(Box3dNoise::default) };
        simulate_cues(&made.scene, body_of, &cues, 1).unwrap()
    };
    let outlines = |beside: bool| {
        let mut parts = made.scene.clone().into_parts();
        let frames = parts.frames.clone();
        for (index, detection) in parts.detections.iter_mut().enumerate() {
            let body = body_of(index, detection).unwrap().closest_ellipsoid();
            let seen = project_ellipsoid(&frames[detection.frame_index as usize].projection, &body).unwrap();
            // Too small and too large in turns.
            let factor = 1.0 + 0.05 * (index % 3) as f64 - 0.05;
            let wrong = Ellipse::new(seen.center(), seen.semi_axes() * factor, seen.angle()).unwrap();
            let lines = TangentLines::of_ellipse(&wrong);
            let lines = if beside { lines.beside_box(&detection.bounding_box.unwrap()) } else { lines };
            detection.bounding_box = lines.bounding_box();
            detection.tangent_lines = Some(Box::new(lines));
        }
        Scene::from_parts(parts).unwrap()
    };
    vec![
        ("boxes", with(false, false)),
        ("boxes and depths", with(true, false)),
        ("boxes and 3D boxes", with(false, true)),
        ("boxes, depths and 3D boxes", with(true, true)),
        ("outlines", outlines(false)),
        ("boxes and outlines", outlines(true)),
    ]
}

fn main() {
    let mut criterion = Criterion::default().sample_size(20).configure_from_args();
    let boxes = |sigma: f64| SyntheticOptions {
        noise: vec![Noise::BoxEdges(sigma)],
        observations: Observations::Boxes,
        ..Default::default()
    };
    let ellipses = |noise: Vec<Noise>| SyntheticOptions { noise, ..Default::default() };
    let mut group = criterion.benchmark_group("map_50_objects");
    for (name, scene, body) in [
        ("boxes exact", boxes(0.0), BodyKind::Ellipsoid),
        ("boxes 0.05", boxes(0.05), BodyKind::Ellipsoid),
        ("ellipses exact", ellipses(vec![]), BodyKind::Ellipsoid),
        ("ellipses TE 0.1", ellipses(vec![Noise::Translation(0.1)]), BodyKind::Ellipsoid),
        ("ellipses SE 0.3", ellipses(vec![Noise::Size(0.3)]), BodyKind::Ellipsoid),
        ("outliers 0.3", SyntheticOptions { outlier_share: 0.3, ..boxes(0.02) }, BodyKind::Ellipsoid),
        ("cuboids 0.05", SyntheticOptions { body: BodyKind::Cuboid, ..boxes(0.05) }, BodyKind::Cuboid),
    ] {
        let scene = generate(&scene).unwrap().scene;
        let options = LocalizeOptions::from(PosteriorOptions { body: Some(body), ..Default::default() });
        group.bench_with_input(name, &scene, |b, scene| b.iter(|| localize(black_box(scene), &options).unwrap()));
    }
    group.finish();
    let mut group = criterion.benchmark_group("refine_poses");
    group.sample_size(10);
    for (name, objects, views) in [("24 objects, 60 frames", 24, 60), ("700 objects, 2000 frames", 700, 2000)] {
        let street = SyntheticOptions { objects, views, trajectory: Trajectory::Street, ..boxes(0.03) };
        let exact = generate(&street).unwrap().scene;
        let wrong = generate(&SyntheticOptions { pose_noise: 0.2, ..street }).unwrap().scene;
        let of = |refine_poses| {
            LocalizeOptions::from(PosteriorOptions {
                body: Some(BodyKind::Ellipsoid),
                refine_poses,
                ..Default::default()
            })
        };
        let auto = Some(PoseMotion::Auto);
        for (what, scene, options) in
            [("as given", &exact, of(None)), ("exact", &exact, of(auto)), ("wrong", &wrong, of(auto))]
        {
            let id = BenchmarkId::new(name, what);
            group.bench_with_input(id, scene, |b, scene| b.iter(|| localize(black_box(scene), &options).unwrap()));
        }
    }
    group.finish();
    let mut group = criterion.benchmark_group("map_50_objects_cues");
    for (name, scene) in cues(&boxes(0.05)) {
        let options = LocalizeOptions::from(PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() });
        group.bench_with_input(name, &scene, |b, scene| b.iter(|| localize(black_box(scene), &options).unwrap()));
    }
    group.finish();
    let mut group = criterion.benchmark_group("map_one_object_by_views");
    group.sample_size(10);
    for views in [10, 100, 1000, 10_000] {
        let scene = generate(&SyntheticOptions { objects: 1, views, ..boxes(0.05) }).unwrap().scene;
        group.bench_with_input(BenchmarkId::from_parameter(views), &scene, |b, scene| {
            b.iter(|| localize(black_box(scene), &LocalizeOptions::default()).unwrap())
        });
    }
    group.finish();
    criterion.final_summary();
}
