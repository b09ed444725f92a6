#!/usr/bin/env bash
# Tests `quadlift export rerun`, `quadlift stream --rerun`, `to_rerun` and the importer of the Python package, and
# examples/to_rerun.py: makes recordings, checks them with `rerun rrd verify` and reads them back. rerun-sdk is installed into target/rerun-venv (790 MB) if it is not there;
# QUADLIFT_SKIP_RERUN=1 skips the test.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ -n "${QUADLIFT_SKIP_RERUN:-}" ]; then
    echo "skipped: QUADLIFT_SKIP_RERUN is set"
    exit 0
fi
# The version that the test reads recordings with; the package itself works with others too.
RERUN_VERSION=0.41.0
target="${CARGO_TARGET_DIR:-$PWD/target}"
python="$target/rerun-venv/bin/python"
if ! "$python" -c "import rerun; assert rerun.__version__ == '$RERUN_VERSION'" 2>/dev/null; then
    python3 -m venv "$target/rerun-venv"
    "$python" -m pip install --quiet "rerun-sdk==$RERUN_VERSION"
fi
maturin=$(grep '^maturin==' scripts/test_python_requirements.txt)
"$python" -m pip install --quiet --disable-pip-version-check "$maturin"
rm -rf "$target/rerun-wheels"
"$target/rerun-venv/bin/maturin" build --profile dev --locked --interpreter "$python" --out "$target/rerun-wheels"
"$python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$target/rerun-wheels"/quadlift-*.whl
if [ -z "${QUADLIFT:-}" ]; then
    cargo build --bin quadlift --locked
    QUADLIFT="$target/debug/quadlift"
fi
export QUADLIFT
"$python" examples/test_to_rerun.py
"$python" examples/test_stream_rerun.py
"$python" examples/test_object_map_rerun.py
