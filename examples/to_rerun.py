#!/usr/bin/env python3
"""Logs what `quadlift export rerun` has written as a recording for Rerun (https://rerun.io).

    pip install ".[rerun]"
    quadlift export rerun scene.json estimate.json truth.json -o folder
    python3 to_rerun.py folder -o recording.rrd
    rerun recording.rrd

From Python itself it is `quadlift.Scene.read("scene.json").localize().to_rerun("recording.rrd")`.
"""

import argparse
from pathlib import Path

import quadlift


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="what quadlift export rerun has written")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.rrd")
    args = parser.parse_args()
    try:
        quadlift.log_recording(args.folder, args.output)
    except quadlift.QuadliftError as error:
        parser.error(str(error))
    print(args.output)


if __name__ == "__main__":
    main()
