#!/usr/bin/env bash
# scripts/release.sh VERSION: makes every edit of a release, commits them and tags the commit; pushing both is left to a person.
# Needs git and Python. See RELEASING.md.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() {
    echo "error: $1" >&2
    exit 1
}

[ $# -eq 1 ] || fail "expected one argument, the version, such as 0.2.0"
version=$1
number='(0|[1-9][0-9]*)'
[[ $version =~ ^$number\.$number\.$number(-(alpha|beta|rc)\.$number)?$ ]] ||
    fail "\"$version\" is no version; expected one such as 0.2.0 or 0.2.0-rc.1"
[ -z "$(git status --porcelain)" ] || fail "there are changes that are not committed"
tagged() { git rev-parse --quiet --verify "refs/tags/v$1" >/dev/null; }
! tagged "$version" || fail "there is a tag v$version already"

earlier=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml)
# The version that is in the files may be released if it has not been, as the first one.
if [ "$version" != "$earlier" ] || tagged "$earlier"; then
    python3 - "$version" "$earlier" <<'PYTHON' || fail "$version is not greater than $earlier"
import sys

def key(version):
    numbers, _, stage = version.partition("-")
    name, _, count = stage.partition(".")
    # A version comes after its own candidates, whose names are in the order of the alphabet.
    return [int(number) for number in numbers.split(".")], name or "~", int(count or 0)

sys.exit(key(sys.argv[1]) <= key(sys.argv[2]))
PYTHON
fi

python3 - "$version" "$earlier" "$(date -u +%F)" <<'PYTHON'
import re
import sys
from pathlib import Path

new, old, date = sys.argv[1:]
quoted = re.escape(old)
changed = {}


def edit(path, pattern, replacement):
    """Replaces all matches of a pattern, of which there is at least one."""
    text = changed.get(path) or Path(path).read_text()
    changed[path], count = re.subn(pattern, replacement, text, flags=re.MULTILINE)
    if count == 0:
        sys.exit(f"error: {path} has nothing like {pattern}")


for manifest in ("Cargo.toml", "crates/quadlift-ros2/Cargo.toml"):
    edit(manifest, rf'^version = "{quoted}"$', f'version = "{new}"')
    edit(manifest, rf'^(quadlift[\w-]* = {{ path = "[^"]*", version = )"{quoted}"', rf'\g<1>"{new}"')
for lock in ("Cargo.lock", "crates/quadlift-ros2/Cargo.lock", "fuzz/Cargo.lock"):
    edit(lock, rf'^(name = "quadlift[\w-]*"\nversion = )"{quoted}"$', rf'\g<1>"{new}"')
edit("CITATION.cff", r"^version: .*(\ndate-released: .*)?$", f"version: {new}\ndate-released: {date}")
edit("packaging/conda/recipe.yaml", rf'^  version: "{quoted}"$', f'  version: "{new}"')
edit("packaging/homebrew/quadlift.rb", rf"/v{quoted}\.tar\.gz", f"/v{new}.tar.gz")
edit("CHANGELOG.md", r"^## \[Unreleased\]\n(?=\n+[^\n#]|\n+###)", f"## [Unreleased]\n\n## [{new}] - {date}\n")
# Only now: all of them or none.
for path, text in changed.items():
    Path(path).write_text(text)
PYTHON

git commit --quiet --all --message "Release $version"
git tag --annotate --message "quadlift $version" "v$version"
echo "Look at it with \`git show\`, then: git push origin HEAD v$version"
