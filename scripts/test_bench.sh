#!/usr/bin/env bash
# Tests of `bench`: the short form of every experiment with figures within their bounds, and a comparison of the program with
# itself. In release: in the profile of the other tests the numerics take three times as long.
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-$PWD/target}"
# Both in one build: alone, each would give shared dependencies other features.
packages=(--release --locked -p quadlift-bench -p quadlift-cli)
cargo test "${packages[@]}" --lib --test figures --test commands "$@"
cargo build "${packages[@]}" --bins
quadlift="$target/release/quadlift"
"$target/release/quadlift-bench" compare "$quadlift" "$quadlift" --seeds 1
