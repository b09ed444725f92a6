//! One program for every target; `QUADLIFT_FUZZ_TARGET` names the one that runs.

#![no_main]

use std::sync::LazyLock;

#[path = "../targets.rs"]
mod targets;

static TARGET: LazyLock<targets::Target> = LazyLock::new(|| {
    let name = std::env::var("QUADLIFT_FUZZ_TARGET").unwrap_or_default();
    let Some((_, target)) = targets::TARGETS.iter().find(|(known, _)| *known == name) else {
        panic!("QUADLIFT_FUZZ_TARGET names no target of fuzz/targets.rs: {name:?}");
    };
    *target
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    TARGET(data);
});
