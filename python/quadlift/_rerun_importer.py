"""The executable ``rerun-importer-quadlift``, through which Rerun opens files of quadlift.

Rerun's viewer (0.32 or later) and ``rerun.log_file_from_path`` call every executable of the PATH whose name begins with
``rerun-importer-`` for every file that they open. It writes a recording to standard output, or exits with 66 if the
file is of another program.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

from ._core import QuadliftError
from ._rerun import log_folder, log_recorded, rerun_sdk
from ._scene import Scene

# What Rerun expects for files of others (EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE): its SDK is slow to import.
NOT_OURS = 66

# Every file that is opened comes by here; those of other programs are not read any further.
HEAD = 65536


class _Below:
    """Rerun's SDK, which logs below a path."""

    def __init__(self, rr: Any, prefix: str) -> None:
        self.rr, self.prefix = rr, prefix.strip("/")

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rr, name)

    def log(self, path: str, *values: Any, **options: Any) -> None:
        self.rr.log(f"{self.prefix}/{path}", *values, **options)


def _format(path: Path) -> str | None:
    """The format that a file names at its beginning: "scene", "recording" or None."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            found = re.search(rb'"format"\s*:\s*"quadlift\.(scene|recording)"', file.read(HEAD))
    except OSError:
        return None
    return found[1].decode() if found else None


def main() -> int:
    """Imports a file."""
    parser = argparse.ArgumentParser(
        prog="rerun-importer-quadlift",
        description="Writes a scene file, a result, a map or a recording folder of quadlift to standard output as a "
        "recording of Rerun. Rerun's viewer calls it. Exit codes: 0 written; 1 the file cannot be read; 66 the file is "
        "not one of quadlift.",
    )
    parser.add_argument("path", type=Path, help="the file, or the folder of `quadlift export rerun`")
    parser.add_argument("--application-id", metavar="ID", default="quadlift", help="application of the recording")
    parser.add_argument("--recording-id", metavar="ID", help="recording that the data belong to")
    parser.add_argument("--entity-path-prefix", metavar="PATH", default="", help="entity that all others are below")
    # Frames have times of their own: what else Rerun says of times and open recordings does not matter.
    args, _ = parser.parse_known_args()
    path: Path = args.path / "recording.json" if args.path.is_dir() else args.path
    found = _format(path)
    if found is None:
        return NOT_OURS
    try:
        rr = rerun_sdk()
        scene = Scene.read(path) if found == "scene" else None
        stream = rr.RecordingStream(args.application_id, recording_id=args.recording_id)
        stream.send_recording_name((scene.name if scene else None) or args.path.name)
        stream.stdout()
        sdk = _Below(rr, args.entity_path_prefix) if args.entity_path_prefix else rr
        with stream:
            if scene is None:
                log_folder(path.parent, None, sdk=sdk)
            else:
                log_recorded(scene._core.recording(scene.name or "quadlift"), scene._core, None, sdk=sdk)
        stream.flush()
        stream.disconnect()
    except (QuadliftError, ImportError, OSError) as error:
        print(f"rerun-importer-quadlift: {error}", file=sys.stderr)
        return 1
    return 0
