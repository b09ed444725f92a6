#!/usr/bin/env bash
# Makes the moving picture of the README, docs/images/demo.gif: takes frames of the report of the demo, of rendered images, in
# a headless Chromium (viewer/tests/motion.ts). Needs Node 20.19 or newer, Chromium, ffmpeg and cargo. Look at the result.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ -z "${QUADLIFT:-}" ]; then
    cargo build --bin quadlift --locked
fi
frames=$(mktemp -d)
trap 'rm -rf "$frames"' EXIT
(
    cd viewer
    [ -d node_modules ] || npm ci --silent
    rm -rf .tests
    npm run --silent motion -- "$frames"
)
# All colors of all frames, without dithering, which would flicker and be large.
filter='scale=960:-1:flags=lanczos,split[a][b];[a]palettegen=stats_mode=diff[p];[b][p]paletteuse=dither=none:diff_mode=rectangle'
ffmpeg -v error -y -framerate 12 -i "$frames/%03d.png" -vf "$filter" -loop 0 docs/images/demo.gif
size=$(wc -c <docs/images/demo.gif)
echo "docs/images/demo.gif: $size bytes"
if [ "$size" -gt 3000000 ]; then
    echo "error: more than 3 MB" >&2
    exit 1
fi
