#!/usr/bin/env bash
# Tests scripts/release.sh and scripts/recipes.sh on a copy of the tree in a new repository: what is refused, what a release
# changes, and that the lock files still fit. Needs git, Python and, for the lock files, what cargo has fetched.
set -euo pipefail
cd "$(dirname "$0")/.."

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
copy="$folder/copy"
mkdir "$copy"
git ls-files -z --cached --others --exclude-standard | while IFS= read -r -d '' file; do
    # What is deleted but not committed is still listed.
    [ ! -e "$file" ] && [ ! -L "$file" ] || printf '%s\0' "$file"
done | tar --null --files-from=- --create | tar --extract --directory "$copy"
export GIT_CONFIG_GLOBAL=/dev/null GIT_CONFIG_NOSYSTEM=1
export GIT_AUTHOR_NAME=test GIT_AUTHOR_EMAIL=test@example.org GIT_COMMITTER_NAME=test GIT_COMMITTER_EMAIL=test@example.org
fits() { cargo metadata --manifest-path "$1" --offline --locked --format-version 1 >/dev/null 2>&1; }
manifests=(Cargo.toml crates/quadlift-ros2/Cargo.toml fuzz/Cargo.toml)
fitting=()
for manifest in "${manifests[@]}"; do
    ! fits "$manifest" || fitting+=("$manifest")
done
cd "$copy"
git init --quiet
git add --all
git commit --quiet --message start

fail() {
    echo "error: $1" >&2
    exit 1
}
refuses() {
    local said
    ! said=$(scripts/release.sh "$1" 2>&1) || fail "$1 was taken"
    [[ $said == *"$2"* ]] || fail "$1: $said"
    [ "$(git rev-list --count HEAD)" -eq "$3" ] && [ "$(git tag | wc -l)" -eq $(($3 - 1)) ] || fail "$1 was refused and tagged"
}
current=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml)

for word in 1.2 v1.2.3 1.02.3 1.2.3-dev 1.2.3.4 ""; do
    refuses "$word" "is no version" 1
done
refuses 0.0.9 "0.0.9 is not greater than $current" 1
refuses "$current-rc.1" "is not greater" 1
echo >>README.md
refuses 7.8.9 "not committed" 1
git checkout --quiet README.md
touch new
refuses 7.8.9 "not committed" 1
rm new

change() {
    sed -i.old 's/^## \[Unreleased\]$/&\n\n### Fixed\n\n- All./' CHANGELOG.md && rm CHANGELOG.md.old
    git commit --quiet --all --amend --no-edit
}
# Its version is in the files and not released: the first release.
scripts/release.sh "$current" >/dev/null
refuses "$current" "there is a tag" 2
refuses 7.8.9 "CHANGELOG.md has nothing like" 2
[ -z "$(git status --porcelain)" ] || fail "half a release is left: $(git status --porcelain)"
change
scripts/release.sh 7.8.9-rc.2 >/dev/null
refuses 7.8.9-rc.2 "there is a tag" 3
refuses 7.8.9-rc.1 "is not greater" 3
refuses 7.8.9-beta.3 "is not greater" 3
change
scripts/release.sh 7.8.9 >/dev/null

date=$(date -u +%F)
[ -z "$(git status --porcelain)" ] && [ "$(git rev-parse 'v7.8.9^{commit}')" = "$(git rev-parse HEAD)" ] || fail "no tag"
[ "$(sed -n 's/^## //p' CHANGELOG.md | head -n 3)" = "$(printf '[Unreleased]\n[7.8.9] - %s\n[7.8.9-rc.2] - %s' "$date" "$date")" ] ||
    fail "CHANGELOG.md: $(head -n 20 CHANGELOG.md)"
[ "$(grep -A 1 '^version: ' CITATION.cff)" = "$(printf 'version: 7.8.9\ndate-released: %s' "$date")" ] || fail "CITATION.cff"
[ "$(grep -c date-released CITATION.cff)" -eq 1 ] || fail "CITATION.cff has two dates"
# The earlier version is nowhere left where the release has a version.
left=$(git grep -nE "quadlift.*[\"v]${current//./\\.}[\".]|^ *version *[:=] *\"?${current//./\\.}\"?$" -- \
    Cargo.toml crates/quadlift-ros2/Cargo.toml CITATION.cff packaging || true)
[ -z "$left" ] || fail "the earlier version is left: $left"
for lock in Cargo.lock crates/quadlift-ros2/Cargo.lock fuzz/Cargo.lock; do
    left=$(grep -A 1 '^name = "quadlift' "$lock" | grep '^version' | grep -vE '"(7\.8\.9|0\.0\.0)"' || true)
    [ -z "$left" ] || fail "$lock has $left"
done
for manifest in ${fitting[@]+"${fitting[@]}"}; do
    fits "$manifest" || fail "the lock file of $manifest does not fit"
done

echo source >"$folder/source.tar.gz"
sum=$(sha256sum "$folder/source.tar.gz" | cut -d ' ' -f 1)
mkdir "$folder/recipes"
scripts/recipes.sh "$folder/source.tar.gz" "$folder/recipes"
[ "$(grep -c "$sum" "$folder/recipes/recipe.yaml")$(grep -c "$sum" "$folder/recipes/quadlift.rb")" = 11 ] || fail "no checksums"
grep -q 7.8.9 "$folder/recipes/recipe.yaml" && grep -q v7.8.9.tar.gz "$folder/recipes/quadlift.rb" || fail "no versions"
echo "a release is made on a copy, ${#fitting[@]} of ${#manifests[@]} lock files checked by cargo"
