"""Objects a second on Spark, from Parquet to Parquet, beside the program on the same detections.

    cargo build --release -p quadlift-cli
    python bench/python/spark_throughput.py target/release/quadlift [OBJECTS]

Needs the package with its extra `spark` (a release build) and Java. 100,000 objects (or as many as are asked for) in
10 views each, a hundred objects to a frame; local[2], all on this machine. Prints seconds and objects a second of a
first and a second run with noise levels given, of one that finds them, with the cameras joined, and without occluded
edges, the peak memory of the Python workers and of the JVM, and the same of the program, whose answers are compared
bit by bit.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyspark.sql import SparkSession
from python_overhead import IMAGE, Data

import quadlift.spark

VIEWS, PER_FRAME = 10, 100
NOISE_MODEL = {"edge_noise": 0.035, "edge_noise_px": 0.35, "edge_correlation": 0.0, "occluded_edge_noise": 0.05}
BODY = "ellipsoid"


def make_tables(objects: int, folder: Path) -> None:
    """Writes detections and cameras, as Parquet and as a scene file."""
    data = Data(objects, VIEWS, noise=0.05)
    # Each hundred objects have frames of their own, from the same places.
    frame = data.frames + VIEWS * (data.objects // PER_FRAME)
    frames = int(frame.max()) + 1
    boxes = dict(zip(("x0", "y0", "x1", "y1"), data.boxes.T, strict=True))
    table = pa.table({"frame": frame, "object": data.objects, **boxes})
    # As they come: frame by frame.
    pq.write_table(table.sort_by("frame"), folder / "detections.parquet", row_group_size=100_000)
    projections = [data.projections[k % VIEWS] for k in range(frames)]
    size = {name: np.full(frames, side) for name, side in zip(("width", "height"), IMAGE, strict=True)}
    flat = pa.array([matrix.ravel().tolist() for matrix in projections])
    pq.write_table(pa.table({"frame": np.arange(frames), "projection": flat, **size}), folder / "cameras.parquet")
    width, height = IMAGE.tolist()
    scene = {
        "format": "quadlift.scene",
        "version": 1,
        "frames": [
            {"id": str(k), "projection": matrix.tolist(), "width": width, "height": height}
            for k, matrix in enumerate(projections)
        ],
        "detections": [
            {"frame": str(f), "object": str(o), "box": box}
            for f, o, box in zip(frame.tolist(), data.objects.tolist(), data.boxes.tolist(), strict=True)
        ],
    }
    (folder / "scene.json").write_text(json.dumps(scene))


class Memory:
    """Peak memory of the JVM and of the Python workers below this process."""

    def __init__(self) -> None:
        self.peaks: dict[str, float] = {}
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Memory:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(0.2):
            parents, found = {}, []
            for path in Path("/proc").glob("[0-9]*"):
                try:
                    status = dict(line.split(":", 1) for line in (path / "status").read_text().splitlines())
                    command = (path / "cmdline").read_bytes()
                except OSError:
                    continue
                pid = int(path.name)
                parents[pid] = int(status["PPid"])
                kind = "worker" if b"pyspark.daemon" in command else "JVM" if b"java" in command else None
                if kind and "VmHWM" in status:
                    found.append((pid, kind, int(status["VmHWM"].split()[0]) / 1024))
            for pid, kind, peak in found:
                above = pid
                while above in parents and above != os.getpid():
                    above = parents[above]
                if above == os.getpid():
                    self.peaks[kind] = max(self.peaks.get(kind, 0.0), peak)


def run_program(program: str, objects: int, folder: Path) -> dict[str, Any]:
    """Times the program; its estimates by id."""
    levels = ",".join(f"{name}={value}" for name, value in NOISE_MODEL.items())
    command = [program, "localize", "-q", "scene.json", "-o", "result.json", "--body", BODY, "--noise-model", levels]
    start = time.perf_counter()
    subprocess.run(command, cwd=folder, check=True)
    told("program, two threads, JSON to JSON", time.perf_counter() - start, objects)
    return {o["id"]: o for o in json.loads((folder / "result.json").read_text())["objects"]}


def told(name: str, seconds: float, objects: int) -> None:
    """A row of the table."""
    print(f"| {name} | {seconds:.1f} s | {objects / seconds:,.0f} |", flush=True)


def main() -> None:
    """Everything."""
    program, objects = str(Path(sys.argv[1]).resolve()), int(sys.argv[2]) if len(sys.argv) > 2 else 100_000
    os.environ["PYSPARK_PYTHON"] = sys.executable
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_tables(objects, folder)
        print(f"{objects:,} objects x {VIEWS} views\n\n| | time | objects/s |\n| --- | --- | --- |")
        by_id = run_program(program, objects, folder)
        settings: dict[str, Any] = {
            "spark.ui.enabled": "false",
            "spark.log.level": "ERROR",
            "spark.driver.memory": "4g",
            "spark.driver.host": "127.0.0.1",
            "spark.driver.bindAddress": "127.0.0.1",
            "spark.sql.shuffle.partitions": "16",
        }
        spark = SparkSession.builder.master("local[2]").config(map=settings).getOrCreate()
        given: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": BODY}
        with Memory() as memory:
            for number, (label, options) in enumerate(
                {
                    "Spark, first run": given,
                    "second run": given,
                    "noise levels from a sample": {},
                    "cameras joined": {**given, "broadcast_cameras": 0},
                    "without occluded edges": {**given, "occluded_edges": False},
                }.items()
            ):
                start = time.perf_counter()
                detections, cameras = (
                    spark.read.parquet(str(folder / f"{table}.parquet")) for table in ("detections", "cameras")
                )
                found = quadlift.spark.localize(detections, cameras, **options)
                found.write.parquet(str(folder / f"objects{number}"))
                told(label, time.perf_counter() - start, objects)
        print("\npeak memory: " + ", ".join(f"{kind} {peak:,.0f} MB" for kind, peak in memory.peaks.items()))
        for number in (0, 1, 3):
            rows = pq.read_table(folder / f"objects{number}", columns=["object", "status", "center"]).to_pylist()
            assert len(rows) == objects == len(by_id)
            for row in rows:
                theirs = by_id[str(row["object"])]
                assert (row["status"], row["center"]) == (theirs["status"], theirs.get("center")), row
        print("the same centers, bit by bit")
        spark.stop()


if __name__ == "__main__":
    main()
