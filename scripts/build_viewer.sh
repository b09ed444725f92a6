#!/usr/bin/env bash
# Builds the page of the reports from viewer/ into crates/quadlift-report/assets/viewer.html, which is committed, so that
# building the Rust program needs no Node. With --check nothing is written: it fails where the committed page is not
# what its source gives, byte for byte. Needs Node 20.19 or newer; npm fetches the rest in the versions of the lock file.
set -euo pipefail
cd "$(dirname "$0")/../viewer"
asset=../crates/quadlift-report/assets/viewer.html

if [ ! -x node_modules/.bin/vite ] || [ package-lock.json -nt node_modules/.package-lock.json ]; then
    npm ci --no-audit --no-fund
fi
npm run --silent build -- --logLevel warn
if [ "${1:-}" = --check ]; then
    cmp dist/index.html "$asset" || {
        echo "crates/quadlift-report/assets/viewer.html is not what viewer/ gives: run scripts/build_viewer.sh" >&2
        exit 1
    }
else
    cp dist/index.html "$asset"
fi
