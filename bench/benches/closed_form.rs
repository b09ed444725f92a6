//! The closed forms on one object and one thread, beside the dense singular value decomposition that they replace.
//!
//! `cargo bench -p quadlift-bench --features timings --bench closed_form`

#![allow(missing_docs, clippy::unwrap_used)]

#[path = "../../crates/quadlift/tests/library/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::{Views, dense_system, scene};
use criterion::{BenchmarkId, Criterion};
use quadlift::solve::{RegOptions, lfd, pfd, reg};

/// The paper's own computation, with a fast singular value decomposition.
fn dense_pfd(views: &Views) -> Vec<f64> {
    let m = dense_system(views);
    let svd = faer::Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)]).thin_svd().unwrap();
    let last = svd.V().ncols() - 1;
    (0..m.ncols()).map(|i| svd.V()[(i, last)]).collect()
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("closed_form");
    for count in [20, 100, 1000] {
        let (views, _) = scene(count, 0.05, 1);
        group.bench_with_input(BenchmarkId::new("pfd", count), &views, |b, views| b.iter(|| pfd(black_box(views))));
        group.bench_with_input(BenchmarkId::new("lfd", count), &views, |b, views| b.iter(|| lfd(black_box(views))));
        group.bench_with_input(BenchmarkId::new("reg", count), &views, |b, views| {
            b.iter(|| reg(black_box(views), &RegOptions::default()))
        });
        // At 1000 views the dense decomposition takes more than a second.
        if count <= 100 {
            group.sample_size(10);
            group.bench_with_input(BenchmarkId::new("dense", count), &views, |b, views| {
                b.iter(|| dense_pfd(black_box(views)))
            });
            group.sample_size(100);
        }
    }
    group.finish();
    criterion.final_summary();
}
