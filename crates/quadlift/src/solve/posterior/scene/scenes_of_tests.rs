//! Scenes for the tests of this folder.

use crate::observer::{Unobserved, Watch};
use crate::scene::{ObjectViews, Scene};
use crate::solve::options::PosteriorOptions;
use crate::solve::posterior::context::PosteriorContext;
use crate::synthetic::{Noise, Observations, SyntheticOptions, generate};

/// A synthetic scene of boxes with this noise, relative to their half sizes.
pub(super) fn box_scene(noise: f64, options: &SyntheticOptions) -> Scene {
    let noise = vec![Noise::BoxEdges(noise)];
    generate(&SyntheticOptions { observations: Observations::Boxes, noise, ..options.clone() }).unwrap().scene
}

/// Runs a test with the views of each object of a scene, by index, and what the objects share.
pub(super) fn with_scene(
    scene: &Scene,
    options: &PosteriorOptions,
    test: impl FnOnce(&(dyn Fn(usize) -> ObjectViews + Sync), &PosteriorContext),
) {
    let watch = Watch::new(&Unobserved, 1);
    let context = PosteriorContext::of_test(scene, options, &watch);
    let views_of = |object: usize| {
        let of_object = |index: &u32| scene.detections[*index as usize].object_index == Some(object as u32);
        let detections: Vec<u32> = (0..scene.detections.len() as u32).filter(of_object).collect();
        scene.object_views(object, &detections)
    };
    test(&views_of, &context);
}
