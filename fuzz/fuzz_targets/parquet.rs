#![no_main]

#[path = "../targets.rs"]
#[allow(dead_code)]
mod targets;

static QUIET: std::sync::Once = std::sync::Once::new();

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    // The hook of libFuzzer ends the process at every panic, also at those of the parquet crate, which the reader catches.
    QUIET.call_once(|| std::panic::set_hook(Box::new(|_| ())));
    targets::parquet(data);
});
