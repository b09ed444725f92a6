//! Memory of the object map; `cargo bench -p quadlift-bench --features timings --bench online_memory`.

#![allow(missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod common;

use common::{frames, observe, street};
use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::synthetic::SyntheticIds;

#[global_allocator]
static ALLOCATOR: dhat::Alloc = dhat::Alloc;

fn main() {
    let _profiler = dhat::Profiler::builder().testing().build();
    let synthetic = street(2000, 6000, SyntheticIds::Absent);
    let frames = frames(&synthetic.scene);
    let before = dhat::HeapStats::get().curr_bytes;
    let mut map = ObjectMap::new(OnlineOptions::default()).expect("the options are valid");
    for frame in &frames {
        observe(&mut map, frame);
    }
    let bytes = dhat::HeapStats::get().curr_bytes - before;
    let objects = map.objects().count() + map.tentative_objects().count();
    let views: usize = map.objects().map(|object| object.kept_views).sum();
    println!(
        "{objects} objects with {views} views in {} frames: {bytes} bytes, {} each",
        map.keyframes(),
        bytes / objects
    );
}
