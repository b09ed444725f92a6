#!/usr/bin/env bash
# Lints and tests of the feature `parquet`, which is one of its own because it takes a minute and a half of processor time
# to build.
set -euo pipefail
cd "$(dirname "$0")/.."

feature=(-p quadlift-io -p quadlift-cli --features quadlift-cli/parquet --locked)
cargo clippy "${feature[@]}" --all-targets -- -D warnings
cargo test "${feature[@]}" --lib --test fuzz_seeds
cargo test "${feature[@]}" --test program -- export
