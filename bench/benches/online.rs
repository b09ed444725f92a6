//! Times of the object map, frame by frame; `cargo bench -p quadlift-bench --features timings --bench online`.

#![allow(missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod common;

use std::time::{Duration, Instant};

use common::{frames, observe, street};
use quadlift::association::{AssociateOptions, IdPolicy, associate};
use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::synthetic::SyntheticIds;

fn main() {
    for (name, ids) in
        [("without ids", IdPolicy::Ignore), ("ids of a tracker", IdPolicy::Evidence), ("trusted ids", IdPolicy::Trust)]
    {
        let given = if ids == IdPolicy::Ignore { SyntheticIds::Absent } else { SyntheticIds::True };
        let synthetic = street(3000, 9000, given);
        let frames = frames(&synthetic.scene);
        let mut map = ObjectMap::new(OnlineOptions { ids, ..Default::default() }).expect("the options are valid");
        let times: Vec<Duration> = frames
            .iter()
            .map(|frame| {
                let start = Instant::now();
                observe(&mut map, frame);
                start.elapsed()
            })
            .collect();
        let boxes = synthetic.scene.detections.len();
        let total: Duration = times.iter().sum();
        println!("{name}: {boxes} boxes, {} frames, {} objects", frames.len(), map.objects().count());
        println!("  {:.0} boxes/s", boxes as f64 / total.as_secs_f64());
        let quantile = |times: &[Duration], share: f64| {
            let mut sorted = times.to_vec();
            sorted.sort_unstable();
            sorted[((sorted.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3
        };
        println!(
            "  a frame: median {:.3} ms, 99 % {:.3} ms, longest {:.1} ms",
            quantile(&times, 0.5),
            quantile(&times, 0.99),
            quantile(&times, 1.0)
        );
        let quarters: Vec<String> =
            times.chunks(times.len() / 4).take(4).map(|part| format!("{:.3}", quantile(part, 0.5))).collect();
        println!("  medians of the quarters: {} ms", quarters.join(", "));
    }
    let synthetic = street(3000, 9000, SyntheticIds::Absent);
    let start = Instant::now();
    let found = associate(&synthetic.scene, &AssociateOptions::default()).expect("the options are valid");
    let boxes = synthetic.scene.detections.len() as f64;
    println!(
        "associate, all frames at once: {:.0} boxes/s, {} objects",
        boxes / start.elapsed().as_secs_f64(),
        found.objects.len()
    );
}
