//! Times of input that is meant to take long: masses of boxes in a frame, without ids;
//! `cargo bench -p quadlift-bench --features timings --bench crowds`.

#![allow(missing_docs, dead_code, clippy::expect_used, clippy::print_stdout)]

mod common;

use std::time::Instant;

use common::{frames, observe};
use quadlift::association::{AssociateOptions, associate};
use quadlift::geometry::BoundingBox;
use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::scene::{NewDetection, Scene, SceneBuilder};
use quadlift::synthetic::{SyntheticOptions, generate};

/// Boxes anywhere in the image, by a simple sequence.
fn anywhere(count: usize, seed: usize) -> Vec<[f64; 4]> {
    let fraction = |k: usize| (((k + seed * 977) * 2_654_435_761) % 1_000_003) as f64 / 1_000_003.0;
    let one = |k: usize| {
        let (x, y, s) = (1200.0 * fraction(3 * k), 900.0 * fraction(3 * k + 1), 10.0 + 60.0 * fraction(3 * k + 2));
        [x, y, x + s, y + s]
    };
    (0..count).map(one).collect()
}

/// A scene without objects whose frames have these boxes.
fn scene_of(views: usize, boxes: impl Fn(usize) -> Vec<[f64; 4]>) -> Scene {
    let empty = generate(&SyntheticOptions { objects: 0, views, ..Default::default() }).expect("the options are valid");
    let mut builder = SceneBuilder::new("crowd");
    for (index, frame) in empty.scene.frames.iter().enumerate() {
        builder.add_frame(&frame.id, frame.projection, frame.image_size.map(Into::into)).expect("a new frame");
        for edges in boxes(index) {
            let bounding_box = Some(BoundingBox::new(edges).expect("a box"));
            let detection = NewDetection { frame: &frame.id, bounding_box, ..Default::default() };
            builder.add_detection(&detection).expect("its frame is there");
        }
    }
    builder.build()
}

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
