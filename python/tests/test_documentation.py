"""The Python code of the README and of the manual runs as shown."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import ROOT, Program


@pytest.mark.parametrize("page", ["README.md", "python/README.md", "docs/python.md"])
def test_code_runs(page: str, program: Program, tmp_path: Path) -> None:
    text = (ROOT / page).read_text()
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert blocks, page
    # A scene for those that read one.
    program("synth", "-q", "-o", tmp_path / "scene.json", "--objects", "4", "--views", "10", "--noise", "box:0.02")
    # The pages are read from top to bottom.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-I", "-c", "\n".join(blocks)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
