#!/usr/bin/env bash
# The ROS 2 node: format, lints, licenses, tests; with --release also its documentation and the oldest compiler. It is a
# package of its own (ARCHITECTURE.md). The node and a robot
# talk in a network namespace; where none can be had, the tests say so and use recorded messages alone. If the program is there
# (target/debug/quadlift), the node's maps are compared with its own.
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-$PWD/target}"
package=(--manifest-path crates/quadlift-ros2/Cargo.toml)
export CARGO_INCREMENTAL=0
if [ -x "$target/debug/quadlift" ]; then
    export QUADLIFT_PROGRAM="$target/debug/quadlift"
fi
export CARGO_TARGET_DIR="$target/ros2"
cargo fmt "${package[@]}" --check
cargo clippy "${package[@]}" --all-targets --locked -- -D warnings
if cargo deny --version 2>/dev/null; then
    cargo deny "${package[@]}" --locked --config deny.toml check bans licenses sources
fi
cargo test "${package[@]}" --locked -- --nocapture
python3 examples/ros2/test_ros2.py
[ "${1:-}" = --release ] || exit 0
RUSTDOCFLAGS="-D warnings" cargo doc "${package[@]}" --no-deps --locked
version=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' crates/quadlift-ros2/Cargo.toml)
if cargo "+$version" --version 2>/dev/null; then
    cargo "+$version" check "${package[@]}" --locked --target-dir "$target/msrv-ros2"
    rm -rf "$target/msrv-ros2"
fi
