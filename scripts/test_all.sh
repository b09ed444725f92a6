#!/usr/bin/env bash
# All tests: those of the library and the program, and those that need more than Rust. Each part installs what it needs
# below target/ (Chromium with apt); needs a Rust toolchain, Python 3.10 or later with venv, Node 20.19 or newer (without it
# the reports in a browser are skipped), crates.io, PyPI and npm's registry. Without Java, Spark, Ray and Daft are
# skipped.
set -uo pipefail
cd "$(dirname "$0")/.."
source scripts/sections.sh

section "Rust tests" scripts/test.sh
section "experiments" scripts/test_bench.sh
section "Parquet" scripts/test_parquet.sh
section "exports" scripts/test_exports.sh
section "ROS 2" scripts/test_ros2.sh
section "Python" scripts/test_python.sh
section "wheels" scripts/test_wheels.sh
section "Spark, Ray and Daft" scripts/test_scale_out.sh
section "reports in a browser" scripts/test_viewer.sh
section "recordings for Rerun" scripts/test_rerun.sh
sections_end
