"""The program ``quadlift``, as the command of this package and as ``python -m quadlift``."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from pathlib import Path

from ._core import run_program


def _command() -> list[str]:
    """The words by which a shell calls this program, for the commands that it suggests."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return sys.orig_argv[: 1 - len(sys.argv)] if len(sys.argv) > 1 else sys.orig_argv
    # The environment of `uvx` is on the search path of this process alone.
    if "archive-v0" in called.parts:
        return ["uvx", "quadlift"]
    found = shutil.which("quadlift")
    # Without suffixes: on Windows the script's name has none.
    is_on_path = found is not None and Path(found).resolve().with_suffix("") == called.resolve().with_suffix("")
    return ["quadlift"] if is_on_path else [str(called)]


def main() -> int:
    """Run the program with the arguments of this process, and return its exit code."""
    # The program handles Ctrl-C itself, unless it is ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # As a Rust program does at its start: what is written to a closed stream must not get into a file with its number.
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # `--rerun` needs a Python that has Rerun's SDK, which this one may have.
    if sys.executable:
        os.environ.setdefault("QUADLIFT_PYTHON", sys.executable)
    return run_program(_command(), sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
