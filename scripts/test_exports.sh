#!/usr/bin/env bash
# Exported files are read by the packages that people use for them, whose versions are pinned; they are installed into
# target/exports-venv. Then cameras that other packages write are read; nuscenes-devkit needs an older numpy, so that these are
# installed apart, into target/cameras-venv (560 MB).
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-$PWD/target}"
python3 -m venv "$target/exports-venv"
python="$target/exports-venv/bin/python"
"$python" -m pip install --quiet --disable-pip-version-check -r scripts/check_exports_requirements.txt
cargo build --bin quadlift --locked
"$python" scripts/check_exports.py "$target/debug/quadlift"
"$python" scripts/check_mcap.py "$target/debug/quadlift"
python3 -m venv "$target/cameras-venv"
cameras="$target/cameras-venv/bin/python"
"$cameras" -m pip install --quiet --disable-pip-version-check -r scripts/check_cameras_requirements.txt
"$cameras" scripts/check_cameras.py "$target/debug/quadlift"
