#!/usr/bin/env bash
# Packs every crate as `cargo publish` would and checks the packages: what they hold and their sizes; with --compile also that
# they compile without the repository and without the network. The unpacked crates are then compiled as a workspace of
# their own (`cargo check`, with the dependencies of the other checks); `cargo package` without --no-verify builds
# each crate from nothing instead, in three and a half minutes of the processor.
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-$PWD/target}"
# A crate is published with what it needs to be built, and without tests and data: bytes of a package (code grows; crates.io
# takes 10 MB), and the kinds of its files. The program contains the demo's photographs and what belongs to them.
limit=1000000
kinds='\.(rs|toml|md|html|py|lock)$|/LICENSE-(MIT|APACHE)$|/Cargo\.toml\.orig$|/\.cargo_vcs_info\.json$'
kinds+='|^quadlift-cli-[^/]*/assets/demo/'

rm -rf "$target/package"
cargo fetch --locked
cargo package --workspace --exclude quadlift-py --exclude quadlift-bench --no-verify --allow-dirty --offline

unpacked="$target/package/unpacked"
mkdir -p "$unpacked"
failed=0
problem() {
    echo "error: $1" >&2
    failed=1
}
for package in "$target"/package/*.crate; do
    name=$(basename "$package" .crate)
    # With the time of now: packages have a fixed one, by which cargo would take an older build for theirs.
    tar -xzmf "$package" -C "$unpacked"
    for file in README.md LICENSE-MIT LICENSE-APACHE Cargo.lock; do
        [ -s "$unpacked/$name/$file" ] || problem "$name has no $file"
    done
    for file in $(tar -tzf "$package" | grep -vE "$kinds" || true); do
        problem "$name holds $file, which is neither code nor documentation"
    done
    for file in $(cd "$unpacked/$name" && find . -name tests.rs -o -name '*_tests.rs'); do
        problem "$name holds $file; see \`exclude\` in its Cargo.toml"
    done
    [ ! -e "$unpacked/$name/tests" ] || problem "$name holds its tests; see \`exclude\` in its Cargo.toml"
    for field in description repository readme keywords categories license rust-version; do
        grep -q "^$field = " "$unpacked/$name/Cargo.toml" || problem "the Cargo.toml of $name has no field \`$field\`"
    done
    size=$(wc -c <"$package")
    printf '%9d bytes  %s\n' "$size" "$name"
    [ "$size" -le "$limit" ] || problem "$name has $size bytes, more than $limit"
done
[ "$failed" -eq 0 ] || exit 1
if [ "${1:-}" != --compile ]; then
    rm -rf "$target/package"
    exit 0
fi

# The same profile as that of the repository, so that dependencies need not be built again.
{
    printf '[workspace]\nresolver = "3"\nmembers = ["quadlift*"]\n\n[patch.crates-io]\n'
    for folder in "$unpacked"/quadlift*/; do
        folder=$(basename "$folder")
        printf '%s = { path = "%s" }\n' "${folder%-[0-9]*}" "$folder"
    done
    echo
    sed -n '/^\[profile\.dev\]/,$p' Cargo.toml
} >"$unpacked/Cargo.toml"
cp Cargo.lock "$unpacked/Cargo.lock"
cargo check --workspace --offline --manifest-path "$unpacked/Cargo.toml" --target-dir "$target"
rm -rf "$target/package"
