#!/usr/bin/env bash
# Compiles the workspace with the oldest compiler that Cargo.toml promises (`rust-version`), with all features. rustup installs
# that compiler; where it cannot, the check is skipped.
set -euo pipefail
cd "$(dirname "$0")/.."

version=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' Cargo.toml)
if ! cargo "+$version" --version 2>/dev/null; then
    if ! rustup toolchain install "$version" --profile minimal; then
        echo "skipped: there is no Rust $version, and rustup cannot install it"
        exit 0
    fi
fi
target="${CARGO_TARGET_DIR:-$PWD/target}/msrv"
# Only procedural macros and build scripts are run: they need no optimization.
CARGO_INCREMENTAL=0 cargo "+$version" check --workspace --all-features --locked --target-dir "$target" \
    --config 'profile.dev.package."*".opt-level = 0'
rm -rf "$target"
