#!/usr/bin/env bash
# Tests the reports in a headless Chromium: checks that the committed page is what viewer/ gives, builds the program and
# runs viewer/tests. Needs Node 20.19 or newer and cargo; npm fetches the rest. Chromium is installed with apt where it
# is absent (CHROMIUM names another one). Reports of real scenes are skipped without the data, see CONTRIBUTING.md.
set -euo pipefail
cd "$(dirname "$0")/.."

enough='const [a, b] = process.versions.node.split(".").map(Number); process.exit(a > 20 || (a === 20 && b >= 19) ? 0 : 1)'
if ! node -e "$enough" 2>/dev/null; then
    echo "skipped: Node 20.19 or newer is not installed"
    exit 0
fi

if [ -z "${CHROMIUM:-}" ] && [ ! -x /usr/bin/chromium ]; then
    apt-get update -qq && apt-get install -y --no-install-recommends chromium
fi
scripts/build_viewer.sh --check
if [ -z "${QUADLIFT:-}" ]; then
    cargo build --bin quadlift --locked
fi
cd viewer
rm -rf .tests
npm run --silent test
