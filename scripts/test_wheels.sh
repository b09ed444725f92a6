#!/usr/bin/env bash
# Tests what is published on PyPI: builds the source distribution, builds a wheel from it as pip does, for the C library of
# 2014 (manylinux2014, with zig as linker), audits the wheel with auditwheel, and localizes an object with it in a fresh
# environment that holds nothing else but numpy. The build is not optimized: only the package is tested here. Needs
# Linux, Rust, Python 3.10 or later with venv, and PyPI.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "$(uname -s)" != Linux ]; then
    echo "skipped: manylinux wheels are built on Linux"
    exit 0
fi
target="${CARGO_TARGET_DIR:-$PWD/target}"
tools="$target/wheels-venv"
fresh="$target/wheels-fresh-venv"
dist="$target/wheels-dist"
python3 -m venv "$tools"
"$tools/bin/python" -m pip install --quiet --disable-pip-version-check -r scripts/test_wheels_requirements.txt
rm -rf "$dist"

"$tools/bin/maturin" sdist --out "$dist"
sdist=$(echo "$dist"/quadlift-*.tar.gz)
names=$(tar -tzf "$sdist")
for name in Cargo.lock LICENSE-MIT LICENSE-APACHE python/README.md python/quadlift/py.typed python/quadlift/_rerun_log.py crates/quadlift-report/assets/viewer.html; do
    grep -q "/$name\$" <<<"$names" || { echo "error: the source distribution has no $name" >&2; exit 1; }
done
if grep -E '/(tests|docs|fuzz)/.*(json|png|jpg|txt)$' <<<"$names"; then
    echo "error: the source distribution holds data of tests" >&2
    exit 1
fi

arguments="--profile dev --zig --compatibility manylinux2014 --config 'profile.dev.package.\"*\".opt-level=0'"
PATH="$tools/bin:$PATH" CARGO_TARGET_DIR="$target/wheels" CARGO_INCREMENTAL=0 \
    CARGO_PROFILE_DEV_OPT_LEVEL=0 CARGO_PROFILE_DEV_DEBUG=false \
    "$tools/bin/python" -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir "$dist" \
    --config-settings build-args="$arguments" "$sdist"
rm -rf "$target/wheels"
wheel=$(echo "$dist"/quadlift-*.whl)

audit=$(PATH="$tools/bin:$PATH" "$tools/bin/auditwheel" show "$wheel")
echo "$audit"
grep -Eq 'tag: *"manylinux_2_17_' <(tr '\n' ' ' <<<"$audit") || { echo "error: $wheel is no manylinux2014 wheel" >&2; exit 1; }

python3 -m venv --clear "$fresh"
"$fresh/bin/python" -m pip install --quiet --disable-pip-version-check "$wheel"
check="$PWD/scripts/check_wheel.py"
(cd "$dist" && "$fresh/bin/python" -I "$check")
ls -l "$sdist" "$wheel"
rm -rf "$fresh"
