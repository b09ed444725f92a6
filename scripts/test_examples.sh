#!/usr/bin/env bash
# Builds and runs the examples of the crates, in the build of the other tests. An example that fails, prints nothing or
# does not write its files is an error.
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-$PWD/target}"
cargo build --examples --locked
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# run EXAMPLE [ARGUMENT...]: the files among the arguments that are in $folder must be there afterwards.
examples=0
run() {
    local name=$1 output argument
    shift
    printf -- '-- %s\n' "$name"
    output=$("$target/debug/examples/$name" "$@")
    echo "$output"
    [ -n "$output" ] || { echo "error: $name prints nothing" >&2; exit 1; }
    for argument in "$@"; do
        [ -s "$argument" ] || [ -d "$argument" ] || { echo "error: $name has not written $argument" >&2; exit 1; }
    done
    examples=$((examples + 1))
}

tutorial=docs/data/tutorial-colmap-yolo
run localize
run one_object
run colmap_and_yolo "$tutorial/sparse/0" "$tutorial/labels" "$folder/scene.json"
sed -n '/^```json cup.json$/,/^```$/{/^```/d;p}' README.md >"$folder/cup.json"
run localize_file "$folder/cup.json" "$folder/objects.json"
run report "$folder/report.html" "$folder/frame.svg"
# Those of the program make files of the tutorial.
all=$(find crates -path '*/examples/*.rs' -not -path 'crates/quadlift-cli/*' | wc -l)
[ "$examples" -eq "$all" ] || { echo "error: $all examples, $examples of them run here" >&2; exit 1; }
