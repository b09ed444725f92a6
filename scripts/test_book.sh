#!/usr/bin/env bash
# Builds the book of docs/ into target/book, where a warning is an error, and checks its links, pictures, equations and
# search. The help of the program becomes a page. Installs mdbook below target/ci-tools if it is not there, which takes two minutes of the processor once.
set -euo pipefail
cd "$(dirname "$0")/.."

source scripts/tools.sh
target="${CARGO_TARGET_DIR:-$PWD/target}"
install_mdbook

for page in docs/*.md docs/*/*.md; do
    name=${page#docs/}
    [ "$name" = SUMMARY.md ] || grep -qF "($name)" docs/SUMMARY.md || { echo "error: docs/SUMMARY.md has no $name" >&2; exit 1; }
done
# The page of all options is made from the help of the program.
program=${QUADLIFT_PROGRAM:-$target/debug/quadlift}
[ -x "$program" ] || cargo build --locked
rm -rf target/book target/book-src
cp -r docs target/book-src
python3 scripts/reference.py "$program" >target/book-src/reference.md
sed -i 's|^- \[The program\](cli.md)$|&\n  - [All options](reference.md)|' target/book-src/SUMMARY.md
log=$(mdbook build target/book-src -d "$PWD/target/book" 2>&1) || { echo "$log" >&2; exit 1; }
echo "$log"
if grep -qE '\b(WARN|ERROR)\b' <<<"$log"; then
    echo "error: mdbook warns" >&2
    exit 1
fi
python3 scripts/check_book.py target/book
