//! One program for every target; `QUADLIFT_FUZZ_TARGET` names the one that runs.

#![no_main]

use std::sync::LazyLock;

#[path = "../targets.rs"]
mod targets;

static TARGET: LazyLock<targets::Target> = LazyLock::new(|| {
    let name = std::env::var("QUADLIFT_FUZZ_TARGET").unwrap_or_default();
    let Some((name, target)) = targets::TARGETS.iter().find(|(known, _)| *known == name) else {
        panic!("QUADLIFT_FUZZ_TARGET names no target of fuzz/targets.rs: {name:?}");
    };
    if *name == "parquet" {
        // The hook of libFuzzer ends the process at every panic, also at those of the parquet crate, which the reader catches.
        std::panic::set_hook(Box::new(|_| ()));
    }
    *target
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    TARGET(data);
});
