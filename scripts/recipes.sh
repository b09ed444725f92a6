#!/usr/bin/env bash
# scripts/recipes.sh ARCHIVE FOLDER: writes the recipes of packaging/ into a folder, with the checksum of the source archive of the
# release. The release workflow calls it when the archive exists; the recipes in the repository have no checksum.
set -euo pipefail
archive=$(realpath "$1") folder=$(realpath "$2")
cd "$(dirname "$0")/.."

none=$(printf '0%.0s' {1..64})
sum=$(sha256sum "$archive" | cut -d ' ' -f 1)
for recipe in packaging/conda/recipe.yaml packaging/homebrew/quadlift.rb; do
    [ "$(grep -c "$none" "$recipe")" -eq 1 ] || { echo "error: $recipe has no place for the checksum" >&2; exit 1; }
    sed "s/$none/$sum/" "$recipe" >"$folder/$(basename "$recipe")"
done
