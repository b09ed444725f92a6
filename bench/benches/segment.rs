//! One object by its number of views, and the methods side by side, at the default grid and on one thread.
//!
//! `cargo bench -p quadlift-bench --features timings --bench segment`. Times are per object with all its views; the time
//! per frame and object is one over the throughput. On Linux they are of the processor, so that other programs do not
//! disturb.

#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput};
use quadlift_bench::render::{RenderOptions, render};
use quadlift_segment::{Crop, CropOptions, SegmentMethod, SegmentOptions, segment_object};

const VIEWS: usize = 40;

/// How long the processor has worked for this thread; where the system does not say, how long the program runs.
fn worked() -> Duration {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|first| first.parse().ok());
    nanoseconds.map_or_else(|| START.elapsed(), Duration::from_nanos)
}

/// Time of segmenting an object so many times.
fn time(crops: &[Crop], options: &SegmentOptions, times: u64) -> Duration {
    let start = worked();
    for _ in 0..times {
        black_box(segment_object(black_box(crops), options).unwrap());
    }
    worked() - start
}

fn main() {
    let mut criterion = Criterion::default().sample_size(10).configure_from_args();
    let rendered = render(&RenderOptions { objects: 1, views: VIEWS, box_noise: 0.1, ..Default::default() }).unwrap();
    let crops: Vec<Crop> = rendered
        .synthetic
        .scene
        .detections
        .iter()
        .map(|d| (&rendered.images[d.frame_index as usize], d.bounding_box.unwrap()))
        .map(|(image, bounding_box)| Crop::cut(image, &bounding_box, &CropOptions::default()).unwrap())
        .collect();
    // One object is seen in all views; of fewer an evenly spread choice is taken.
    assert_eq!(crops.len(), VIEWS);
    let spread = |views: usize| -> Vec<Crop> { crops.iter().step_by(VIEWS / views).cloned().collect() };

    let mut group = criterion.benchmark_group("graphcut_by_views");
    for views in [5, 10, 20, 40] {
        group.throughput(Throughput::Elements(views as u64));
        group.bench_with_input(BenchmarkId::from_parameter(views), &spread(views), |b, crops| {
            b.iter_custom(|times| time(crops, &SegmentOptions::default(), times))
        });
    }
    group.finish();

    let mut group = criterion.benchmark_group("methods_20_views");
    group.throughput(Throughput::Elements(20));
    for method in SegmentMethod::ALL {
        let options = SegmentOptions { method, ..Default::default() };
        group.bench_with_input(method.name(), &spread(20), |b, crops| {
            b.iter_custom(|times| time(crops, &options, times))
        });
    }
    group.finish();
    criterion.final_summary();
}
