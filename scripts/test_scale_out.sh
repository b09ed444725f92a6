#!/usr/bin/env bash
# Runs the recipes of docs/scale-out.md on Spark, Ray and Daft: builds the wheel and installs it with them, 1.3 GB, into target/scale-out.
# Needs Rust, Python 3.10 or later with venv, PyPI and Java 17 or 21, without which the test is skipped. Arguments go to
# pytest.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! "${JAVA_HOME:+$JAVA_HOME/bin/}java" -version >/dev/null 2>&1; then
    echo "skipped: there is no Java, which Spark needs"
    exit 0
fi
target="${CARGO_TARGET_DIR:-$PWD/target}"
environment="$target/scale-out"
python="$environment/bin/python"
python3 -m venv "$environment"
"$python" -m pip install --quiet --disable-pip-version-check -r scripts/test_scale_out_requirements.txt
wheels="$target/scale-out-wheels"
rm -rf "$wheels"
"$environment/bin/maturin" build --profile dev --locked --interpreter "$python" --out "$wheels"
"$python" -m pip install --quiet --disable-pip-version-check --no-deps --force-reinstall "$wheels"/quadlift-*.whl
if [ -z "${QUADLIFT:-}" ]; then
    cargo build --bin quadlift --locked
    export QUADLIFT="$target/debug/quadlift"
fi
# Everything stays on this machine, and nobody is told.
export RAY_USAGE_STATS_ENABLED=0 DAFT_ANALYTICS_ENABLED=0 SPARK_LOCAL_IP=127.0.0.1
"$python" -m pytest --quiet -p no:cacheprovider -m scale_out python/tests/test_scale_out.py "$@"
