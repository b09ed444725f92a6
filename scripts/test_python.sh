#!/usr/bin/env bash
# Tests the Python package: builds the wheel, installs it into a fresh virtual environment, runs python/tests against it
# and the program, and checks style, types and stubs. Needs Rust, Python 3.10 or later with venv, and PyPI. Arguments go to
# pytest.
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-$PWD/target}"
environment="$target/python"
python3 -m venv --clear "$environment"
python="$environment/bin/python"
"$python" -m pip install --quiet --disable-pip-version-check -r scripts/test_python_requirements.txt
# In the profile of the other tests, whose build is there already.
rm -rf "$target/python-wheels"
"$environment/bin/maturin" build --profile dev --locked --interpreter "$python" --out "$target/python-wheels"
"$python" -m pip install --quiet --disable-pip-version-check --no-deps "$target/python-wheels"/quadlift-*.whl
if [ -z "${QUADLIFT:-}" ]; then
    cargo build --bin quadlift --locked
    export QUADLIFT="$target/debug/quadlift"
fi
"$environment/bin/ruff" format --check
"$environment/bin/ruff" check
"$environment/bin/mypy"
# The stubs of the extension module against the module itself.
"$environment/bin/stubtest" quadlift._core --mypy-config-file pyproject.toml
"$python" -m pytest --quiet -p no:cacheprovider "$@"
