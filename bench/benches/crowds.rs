//! Times of input that is meant to take long: masses of boxes in a frame, without ids;
//! `cargo bench -p quadlift-bench --features timings --bench crowds`.

#![allow(missing_docs, dead_code, clippy::expect_used, clippy::print_stdout)]

mod common;
#[path = "../../crates/quadlift/src/association/crowd_tests.rs"]
mod crowd_tests;

use std::time::Instant;

use common::{frames, observe};
use crowd_tests::{anywhere, scene_of};
use quadlift::association::{AssociateOptions, associate};
use quadlift::geometry::BoundingBox;
use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::scene::{NewDetection, Scene, SceneBuilder};
use quadlift::synthetic::{SyntheticOptions, generate};

fn main() {
    let crowded = scene_of(10, |frame| anywhere(if frame == 4 { 5000 } else { 20 }, frame));
    let stacked = scene_of(8, |_| vec![[600.0, 400.0, 660.0, 460.0]; 100]);
    for (name, scene) in [("5000 boxes in one of ten frames", crowded), ("100 equal boxes in each of 8", stacked)] {
        let start = Instant::now();
        let found = associate(&scene, &AssociateOptions::default()).expect("the options are valid");
        println!("associate, {name}: {:.2} s, {} objects", start.elapsed().as_secs_f64(), found.objects.len());
        let mut map = ObjectMap::new(OnlineOptions::default()).expect("the options are valid");
        let start = Instant::now();
        for frame in &frames(&scene) {
            observe(&mut map, frame);
        }
        println!("object map, {name}: {:.2} s, {} objects", start.elapsed().as_secs_f64(), map.objects().count());
    }
}
