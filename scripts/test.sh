#!/usr/bin/env bash
# Installs what the tests need and runs them all: unit tests, end-to-end tests, examples in the documentation.
#
# They need a Rust toolchain and nothing else; cargo fetches the rest. Arguments go to cargo (scripts/test.sh --release).
# Tests on real data are skipped unless that is at hand, see CONTRIBUTING.md.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v cargo >/dev/null; then
    echo "cargo is not installed; see https://rustup.rs" >&2
    exit 1
fi
# A changed snapshot is a failure here, never a file to be reviewed later.
export INSTA_UPDATE=no
# Without -p: all scripts build the default members of the workspace, so that nothing is compiled twice (-p quadlift-cli alone
# gives its dependencies other features). `bench` is not one of them: scripts/test_bench.sh.
cargo test --locked --no-run "$@"
# A test that hangs is a failure: cargo names those that have been running for more than a minute.
limit=()
if command -v timeout >/dev/null; then
    limit=(timeout --verbose --kill-after=30 "${QUADLIFT_TEST_MINUTES:-90}m")
fi
"${limit[@]}" cargo test --locked --no-fail-fast "$@"
if [ $# -eq 0 ]; then
    scripts/test_examples.sh
fi
