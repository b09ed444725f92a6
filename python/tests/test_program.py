"""The program in the package: the command `quadlift` and `python -m quadlift`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path
from typing import Any

import pytest

import quadlift
from conftest import RENDERED, Program

SCRIPT = Path(sysconfig.get_path("scripts")) / ("quadlift.exe" if sys.platform == "win32" else "quadlift")
MODULE = [sys.executable, "-m", "quadlift"]

UNIX = pytest.mark.skipif(sys.platform == "win32", reason="there are no signals and descriptors on Windows")

SECONDS = 120
"""How long a process may take."""


def run(
    folder: Path, *arguments: str, command: list[str] | None = None, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Runs the command in a folder."""
    return subprocess.run(
        [*(command or [str(SCRIPT)]), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=SECONDS,
        **options,
    )


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A folder with a scene, and with one whose poses are wrong."""
    assert run(tmp_path, "synth", "-q", "-o", "scene.json", "--objects", "6", "--views", "10").returncode == 0
    wrong = json.loads((tmp_path / "scene.json").read_text())
    for frame in wrong["frames"]:
        # OpenGL's axes.
        frame["cam_from_world"][1:3] = [[-x for x in row] for row in frame["cam_from_world"][1:3]]
    (tmp_path / "wrong.json").write_text(json.dumps(wrong))
    return tmp_path


@pytest.mark.parametrize("command", [[str(SCRIPT)], MODULE], ids=["script", "module"])
def test_the_package_brings_the_program(command: list[str], tmp_path: Path) -> None:
    assert run(tmp_path, "--version", command=command).stdout == f"quadlift {quadlift.__version__}\n"
    done = run(tmp_path, "demo", command=command)
    assert done.returncode == 0, done.stderr
    assert "Localized 13 of 13 objects" in done.stdout
    assert (tmp_path / "quadlift-demo/report.html").stat().st_size > 100_000
    assert run(tmp_path, "info", "quadlift-demo/scene.json", command=command).returncode == 0


def test_results_are_those_of_the_program(program: Program, scene: Path) -> None:
    arguments = ["localize", "scene.json", "-o"]
    ours = run(scene, *arguments, "ours.json", "--verbose")
    assert ours.returncode == 0, ours.stderr
    theirs = run(scene, *arguments, "theirs.json", "--verbose", command=[str(program.path)])
    assert (scene / "ours.json").read_bytes() == (scene / "theirs.json").read_bytes()
    assert ours.stdout.splitlines()[:5] == theirs.stdout.splitlines()[:5]
    to_stdout = run(scene, *arguments, "-")
    assert to_stdout.stdout == (scene / "ours.json").read_text()


def test_exit_codes_and_messages_are_those_of_the_program(program: Program, scene: Path) -> None:
    cases = {
        "info scene.json": 0,
        "--help": 0,
        "info missing.json": 1,
        "localize scene.json -o missing/objects.json": 1,
        "localiz scene.json --json": 2,
        "info scene.json --max-pixels 0": 2,
        "localize wrong.json -o objects.json --json": 3,
    }
    for text, code in cases.items():
        ours = run(scene, *text.split())
        theirs = run(scene, *text.split(), command=[str(program.path)])
        assert (ours.returncode, theirs.returncode) == (code, code), (text, ours.stderr)
        assert ours.stderr == theirs.stderr, text
        if code:
            assert ours.stdout == theirs.stdout, text


def test_suggested_commands_work_as_printed(scene: Path) -> None:
    def suggested(**options: Any) -> str:
        out = run(scene, "info", "scene.json", **options).stdout
        return next(line for line in out.splitlines() if " localize scene.json " in line).strip()

    without = {**os.environ, "PATH": os.defpath}
    with_script = {**os.environ, "PATH": os.pathsep.join([str(SCRIPT.parent), os.defpath])}
    assert suggested(env=with_script).split("  ")[-1].strip().startswith("quadlift localize")
    assert f" {SCRIPT} localize" in suggested(env=without)
    assert f" {sys.executable} -m quadlift localize" in suggested(command=MODULE)
    assert f" {sys.executable} -I -m quadlift localize" in suggested(command=[sys.executable, "-I", "-m", "quadlift"])
    # `uvx` puts an environment of its own on the search path.
    kept = scene / "archive-v0/Ab1/bin/quadlift"
    kept.parent.mkdir(parents=True)
    shutil.copy(SCRIPT, kept)
    env = {**os.environ, "PATH": os.pathsep.join([str(kept.parent), os.environ["PATH"]])}
    if sys.platform != "win32":
        assert suggested(command=[str(kept)], env=env).endswith(" uvx quadlift localize scene.json -o objects.json")


def lines_of(scene: dict[str, Any]) -> str:
    """The frames of a scene as a stream."""
    lines: list[dict[str, Any]] = [{"up": scene["up"], "cameras": scene["cameras"]}]
    for time_, frame in enumerate(scene["frames"]):
        detections = [{"box": found["box"]} for found in scene["detections"] if found["frame"] == frame["id"]]
        same = {name: frame[name] for name in ("camera", "cam_from_world")}
        lines.append({"frame": frame["id"], "time": time_, **same, "detections": detections})
    return "".join(json.dumps(line) + "\n" for line in lines)


@UNIX
def test_ctrl_c_ends_a_stream_and_the_map_is_written(scene: Path) -> None:
    lines = lines_of(json.loads((scene / "scene.json").read_text()))
    streaming = subprocess.Popen(
        [*MODULE, "stream", "--map", "map.json"], cwd=scene, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert streaming.stdin
    assert streaming.stdout
    streaming.stdin.write(lines)
    streaming.stdin.flush()
    for _ in range(10):
        assert '"frame"' in streaming.stdout.readline()
    # The input stays open: the program waits for a line.
    os.kill(streaming.pid, signal.SIGINT)
    streaming.stdout.read()
    assert streaming.wait(SECONDS) == 0
    assert json.loads((scene / "map.json").read_text())["localization"]["stream"]["frames"] == 10


@UNIX
def test_signals_end_the_program_without_temporary_files(tmp_path: Path) -> None:
    # An export of many images takes a while.
    path = Path(shutil.copytree(RENDERED, tmp_path / "r")) / "scene.json"
    scene = json.loads(path.read_text())
    scene["frames"] += [{**scene["frames"][0], "id": f"copy {k}"} for k in range(2000)]
    path.write_text(json.dumps(scene))
    for number in (signal.SIGINT, signal.SIGTERM):
        exporting = subprocess.Popen(
            [*MODULE, "export", "rerun", "r/scene.json", "-o", "recording"],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        start = time.monotonic()
        while not list(tmp_path.glob(".quadlift-*")):
            assert exporting.poll() is None, "nothing temporary"
            assert time.monotonic() < start + SECONDS, "nothing temporary"
            time.sleep(0.002)
        exporting.send_signal(number)
        _, told = exporting.communicate(timeout=SECONDS)
        assert exporting.returncode == -number
        assert "Traceback" not in told
        assert [path.name for path in tmp_path.iterdir()] == ["r"]


@UNIX
def test_a_closed_pipe_is_no_error(scene: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    for arguments in ("info scene.json", "--help", "localize -q scene.json -o -", "completions bash"):
        done = subprocess.run(
            [SCRIPT, *arguments.split()], cwd=scene, stdout=write, stderr=subprocess.PIPE, text=True, timeout=SECONDS
        )
        assert (done.returncode, done.stderr) == (0, ""), arguments
    os.close(write)


@UNIX
def test_reports_do_not_get_into_files_if_the_output_is_closed(scene: Path) -> None:
    done = subprocess.run(["sh", "-c", f"'{SCRIPT}' localize scene.json -o objects.json >&- 2>&- <&-"], cwd=scene)
    assert done.returncode == 0
    result = json.loads((scene / "objects.json").read_text())
    assert len(result["objects"]) == 6


def test_what_the_program_starts_is_this_python(scene: Path) -> None:
    (scene / "packages").mkdir()
    (scene / "packages/rerun.py").write_text("raise ImportError('no such package')\n")
    env = {**os.environ, "PYTHONPATH": str(scene / "packages")}
    env.pop("QUADLIFT_PYTHON", None)
    done = run(scene, "stream", "--rerun=map.rrd", env=env, input="")
    assert done.returncode == 1
    assert f"{sys.executable} -m pip install rerun-sdk" in done.stderr
