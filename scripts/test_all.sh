#!/usr/bin/env bash
# All tests: those of the library and the program, and those that need more than Rust. Each part installs what it needs
# below target/ (Chromium with apt); needs a Rust toolchain, Python 3.10 or later with venv, Node 20.19 or newer (without it
# the reports in a browser are skipped), crates.io, PyPI and npm's registry. Without Java, Spark, Ray and Daft are
# skipped. With QUADLIFT_DISCARD=1 (CI) what a part has installed and nobody else needs is removed after it: together the parts
# need 6 GB.
set -uo pipefail
cd "$(dirname "$0")/.."
source scripts/sections.sh

target="${CARGO_TARGET_DIR:-$PWD/target}"
# part NAME SCRIPT [FOLDER...]: a section that leaves these folders below target/.
part() {
    local name=$1 script=$2
    shift 2
    section "$name" "$script"
    [ -z "${QUADLIFT_DISCARD:-}" ] || rm -rf "${@/#/$target/}"
}

section "Rust tests" scripts/test.sh
section "experiments" scripts/test_bench.sh
part "exports" scripts/test_exports.sh exports-venv cameras-venv
part "ROS 2" scripts/test_ros2.sh ros2
part "Python" scripts/test_python.sh python
part "wheels" scripts/test_wheels.sh wheels-venv wheels-dist
part "Spark, Ray and Daft" scripts/test_scale_out.sh scale-out
section "reports in a browser" scripts/test_viewer.sh
part "recordings for Rerun" scripts/test_rerun.sh rerun-venv
sections_end
