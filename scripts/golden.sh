#!/usr/bin/env bash
# Shows what a change does to the output of the program: hashes of output, messages and exit codes of every command, over the
# real scenes (where they are at hand), the files in docs, the examples of all formats, and synthetic scenes.
#
#   scripts/golden.sh record                 keep the output of the release build in target/golden
#   scripts/golden.sh compare                run it again and list what differs (exit code 1)
#   scripts/golden.sh record PROGRAM         that of another program; also: compare PROGRAM
#
# Outputs are kept in target/golden/*/NAME, so that diff explains each line. QUADLIFT_PYTHON names a Python that has the package,
# whose answers are then compared, too. Hashes hold for one machine only: the last digits depend on its mathematical functions.
set -euo pipefail
cd "$(dirname "$0")/.."

program="${2:-}"
if [ -z "$program" ]; then
    cargo build --release --locked -p quadlift-cli
    program="${CARGO_TARGET_DIR:-target}/release/quadlift"
fi
exec python3 scripts/golden.py "${1:-}" "$program" "${CARGO_TARGET_DIR:-target}/golden"
