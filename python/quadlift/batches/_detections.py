"""Detections in tables whose rows are objects or scenes: options, reading, validation."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from .. import _checks, _core, _cues, _options, _outlines, _run_options
from .._arrow import pa, pc
from .._core import QuadliftError
from . import _tables
from ._cameras import Cameras

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from .._arrays import DetectionArrays, FrameArrays, Names

OF_OBJECTS = _run_options.OF_OBJECTS | {"priors"}
"""Options for tables of objects."""
OF_SCENES = frozenset(_run_options.KINDS) - {
    "source",
    "observations",
    "max_occluded",
    "max_truncated",
    "cross_validate",
}
OF_SCENES |= {"priors"}
"""Options for tables of scenes."""
EDGES = np.array([1, 2, 4, 8])
"""Bits of left, top, right and bottom in a column `occluded_edges`."""


@dataclass(frozen=True)
class Settings:
    """Checked options."""

    keywords: dict[str, Any]
    up: list[float] | None
    length_unit: str | None

    @classmethod
    def of(
        cls, options: Mapping[str, Any], known: frozenset[str], up: ArrayLike | None, length_unit: str | None
    ) -> Settings:
        for name in options:
            if name in OF_SCENES - known:
                raise QuadliftError(
                    f"{name} is an option of whole scenes, whose objects share it; tables of objects, which are solved "
                    "one by one, do not take it"
                )
            if name not in known:
                raise QuadliftError(f"there is no option {name!r} here; expected one of {', '.join(sorted(known))}")
        # The consistency check and the detection of upright objects need whole scenes: objects that are solved one by
        # one do not depend on them.
        of_objects: dict[str, Any] = {"associate": "never", "allow_inconsistent": True}
        if options.get("method", "posterior") == "posterior":
            of_objects["upright"] = False
        of_kind = of_objects if known == OF_OBJECTS else {"associate": "auto"}
        given = cast("_options.Options", {**of_kind, **options})
        settings = cls(
            _options.split(given, "localize")[0],
            _checks.optional(_checks.direction, "up", up),
            _checks.optional(_checks.text, "length_unit", length_unit),
        )
        if known == OF_OBJECTS and up is not None and _may_share_ground(options.get("priors")):
            raise QuadliftError(
                "priors: those with on_ground=True let objects share a ground where up is given; tables of objects, "
                "which are solved one by one, take a mapping of priors without on_ground, or no up"
            )
        # Parts of a table are not scenes: there are no messages about scenes.
        settings.run["cross_validate"] = None
        # One valid detection: only the options can be invalid.
        probe = Detections(np.array([0]), np.array([0]), np.array([[0.0, 0.0, 1.0, 1.0]]), None, (None, []), None)
        settings.localized(_PROBE, probe.dictionary(np.array([0]), ["probe"], None))
        return settings

    def localized(self, frames: FrameArrays, detections: DetectionArrays) -> _core.Localized:
        """The result for detections in frames, both in the form of the core."""
        scene = _core.Scene.from_frames({**frames, "up": self.up, "length_unit": self.length_unit})
        return scene.with_detections(detections, None).localize(self.keywords, 1, None)

    @property
    def run(self) -> dict[str, Any]:
        """The options of the run that are given."""
        run: dict[str, Any] = self.keywords["run"]
        return run

    @property
    def is_map(self) -> bool:
        """Whether the method is `map`."""
        return bool(self.run.get("method", "posterior") == "posterior")

    def is_complete(self) -> bool:
        """Whether nothing has to be estimated from all objects together."""
        is_given = self.run.get("noise_model") is not None and self.run.get("body", "auto") != "auto"
        return is_given or not self.is_map


_PROBE: FrameArrays = {"frame_ids": ["0"], "projections": np.eye(3, 4)[np.newaxis]}


def _may_share_ground(priors: Any) -> bool:
    if isinstance(priors, Mapping):
        return any(isinstance(prior, Mapping) and prior.get("on_ground") for prior in priors.values())
    return priors is not None


# Detections


@dataclass(frozen=True)
class Detections:
    """M detections of rows that are objects or scenes."""

    row: NDArray[np.int64]
    """The row of each, (M,)."""
    camera: NDArray[np.int64]
    """Indices into `Cameras`, (M,); -1 for none."""
    boxes: NDArray[np.float64]
    """Pixels, (M, 4)."""
    scores: NDArray[np.float64] | None
    """(M,)"""
    category: Names
    hidden: NDArray[np.int64] | None
    """Sums of `EDGES`, (M,)."""
    cues: _cues.CueArrays | None = None
    outlines: _outlines.OutlineArrays | None = None

    def take(self, places: NDArray[np.int64] | NDArray[np.bool_]) -> Detections:
        """The detections at some indices, or where a mask is true."""
        codes, names = self.category
        return replace(
            self,
            row=self.row[places],
            camera=self.camera[places],
            boxes=self.boxes[places],
            scores=None if self.scores is None else self.scores[places],
            category=(None if codes is None else codes[places], names),
            hidden=None if self.hidden is None else self.hidden[places],
            cues=None if self.cues is None else _cues.taken(self.cues, places),
            outlines=None if self.outlines is None else _outlines.taken(self.outlines, places),
        )

    def dictionary(
        self, frame: NDArray[np.int64], names: list[str] | None, occluded_edges: NDArray[np.bool_] | None
    ) -> DetectionArrays:
        """Detections for the core; with names, the names of the rows are the object ids.

        Without occluded edges, these and occluded lines are computed from the other detections.
        """
        outlines = None if self.outlines is None else self.outlines.copy()
        if outlines is not None and occluded_edges is None:
            outlines["occluded_lines"] = None
        elif outlines is not None and outlines["occluded_lines"] is None:
            outlines["occluded_lines"] = np.zeros((len(frame), 8), dtype=np.bool_)
        return {
            "frames": frame,
            "boxes": np.ascontiguousarray(self.boxes),
            "objects": (None, []) if names is None else (self.row, names),
            "categories": self.category,
            "scores": self.scores,
            "occluded_edges": occluded_edges,
            "outlines": outlines,
            "cues": self.cues,
        }


@dataclass(frozen=True, order=True)
class Problem:
    """A problem of a row; the smallest one is reported, which does not depend on the order of its detections."""

    rank: int
    """0 lists, 1 object, 2 no detections, 3 to 5 frame and camera, 6 twice in a frame, 7 box."""
    frame: Any
    text: str


class Problems:
    """Problems of single detections and of rows."""

    def __init__(self, frame: Any) -> None:
        self._frame = frame
        self.of_row: dict[int, Problem] = {}
        self.of_detection: dict[int, Problem] = {}

    def add_row(self, row: int, rank: int, text: str) -> None:
        self.of_row[row] = min(Problem(rank, -1, text), self.of_row.get(row, _LAST))

    def add_detections(self, places: NDArray[np.int64], rank: int, text: str | Sequence[str]) -> None:
        """`text` follows the name of the frame."""
        names = self._frame.take(pa.array(places)).to_pylist()
        for k, (place, name) in enumerate(zip(places.tolist(), names, strict=True)):
            words = text if isinstance(text, str) else text[k]
            words = words if name is None else f"frame {json.dumps(name, ensure_ascii=False)}: {words}"
            # One table has frames of one type.
            found = Problem(rank, -1 if name is None else name, words)
            self.of_detection[place] = min(found, self.of_detection.get(place, _LAST))

    def spread(self, row: NDArray[np.int64]) -> None:
        """A problem of a detection is a problem of its row."""
        for place, problem in self.of_detection.items():
            k = int(row[place])
            self.of_row[k] = min(problem, self.of_row.get(k, _LAST))

    def by_row(self, row: NDArray[np.int64]) -> dict[int, list[str]]:
        """The problems of each scene, as text."""
        texts = {k: [problem.text] for k, problem in self.of_row.items()}
        by_row: dict[int, list[Problem]] = {}
        for place, problem in self.of_detection.items():
            by_row.setdefault(int(row[place]), []).append(problem)
        for k, found in by_row.items():
            count = "1 detection takes" if len(found) == 1 else f"{len(found)} detections take"
            texts.setdefault(k, []).append(f"{count} no part: {min(found).text}")
        return texts


_LAST = Problem(100, "", "")


def read(rows: Any, cameras: Cameras | Any | None) -> tuple[Cameras, Detections, Problems]:
    """The detections of a table; those with invalid frames are among the problems."""
    names = rows.column_names
    _tables.require(names, ["frame", *_tables.BOX], "rows")
    others = ("category", "score", "occluded_edges", "occluded_lines", *_tables.SHAPES, *_tables.CUES)
    views = _tables.Views(rows, ["frame", *_tables.BOX, *(n for n in others if n in names)])
    frame = _tables.ids(views["frame"], "frame")
    scene = _tables.column(rows, "scene") if "scene" in names else None
    if cameras is None:
        cameras, scene = _own_cameras(rows), pa.array(np.arange(len(rows)))
    elif not isinstance(cameras, Cameras):
        cameras = Cameras(cameras)
    camera = cameras.find(scene, views.row, frame)
    found = Problems(frame)
    for row, text in views.ragged.items():
        found.add_row(row, 0, text)
    is_null = frame.is_null().to_numpy(zero_copy_only=False)
    found.add_detections(np.flatnonzero(is_null), 3, "a detection has no frame")
    found.add_detections(np.flatnonzero((camera < 0) & ~is_null), 4, "there is no such camera")
    if cameras.broken:
        broken = np.flatnonzero(np.isin(camera, list(cameras.broken)))
        found.add_detections(broken, 5, [cameras.broken[int(camera[place])] for place in broken])
    hidden = _tables.numbers(views["occluded_edges"], "occluded_edges") if "occluded_edges" in views else None
    detections = Detections(
        row=views.row,
        camera=camera,
        boxes=views.boxes(),
        scores=_tables.numbers(views["score"], "score") if "score" in views else None,
        category=views.codes("category"),
        hidden=None if hidden is None else np.nan_to_num(hidden).astype(np.int64),
        cues=views.cues(),
        outlines=views.outlines(),
    )
    return cameras, detections, found


def _own_cameras(rows: Any) -> Cameras:
    """The cameras in the rows; their scenes are the row numbers."""
    _tables.require(rows.column_names, ["cameras"], "rows, without an argument cameras,")
    values = _tables.lists(rows, "cameras")
    of_row = np.repeat(np.arange(len(rows)), _tables.lengths(values))
    structs = pc.list_flatten(values)
    if not pa.types.is_struct(structs.type):
        raise QuadliftError(f"the column cameras has lists of {structs.type}; expected lists of structs")
    fields = {structs.type.field(k).name: values for k, values in enumerate(structs.flatten())}
    return Cameras(pa.table({**fields, "scene": of_row}))


def no_object(objects: Any) -> Any:
    """Which ids mean no object: null, "" and negative numbers, as in `quadlift.localize`."""
    unknown = pc.equal(objects, "") if pa.types.is_string(objects.type) else pc.less(objects, 0)
    return unknown.fill_null(True)


def objects_of(table: Any, cameras: Cameras | Any | None) -> tuple[Cameras, Detections, dict[int, Problem]]:
    """The detections of objects without problems, in the order of the rows and of the frames; the problems of rows."""
    _tables.require(table.column_names, ["object"], "rows")
    cameras, detections, problems = read(table, cameras)
    objects = _tables.ids(_tables.column(table, "object"), "object")
    for row in np.flatnonzero(no_object(objects).to_numpy(zero_copy_only=False)):
        problems.add_row(int(row), 1, "these detections have no object id")
    counts = np.bincount(detections.row, minlength=len(table))
    for row in np.flatnonzero(counts == 0):
        problems.add_row(int(row), 2, "there are no detections")
    order = np.lexsort((detections.camera, detections.row))
    rows, camera = detections.row[order], detections.camera[order]
    twice = (np.diff(rows) == 0) & (np.diff(camera) == 0) & (camera[1:] >= 0)
    problems.add_detections(order[1:][twice], 6, "the object is in it twice")
    problems.spread(detections.row)
    order = order[~np.isin(rows, list(problems.of_row))]
    kept = check_boxes(cameras, detections, order, problems)
    problems.spread(detections.row)
    return cameras, kept.take(~np.isin(kept.row, list(problems.of_row))), problems.of_row


def check_boxes(cameras: Cameras, detections: Detections, order: NDArray[np.int64], problems: Problems) -> Detections:
    """The detections in this order with valid boxes, outlines, depths and 3D boxes."""
    absent = np.isnan(detections.boxes[order]).all(axis=1)
    centers = None if detections.cues is None else detections.cues["center"]
    if centers is not None:
        absent &= np.isnan(centers[order]).any(axis=1)
    if detections.outlines is not None:
        absent &= np.isnan(_outlines.around(detections.outlines)[order]).any(axis=1)
    problems.add_detections(order[absent], 7, "there is no box")
    order = order[~absent]
    kept = detections.take(order)
    # Their frames are valid already: any frame works here, except for 3D boxes in the world.
    frames, frame = _PROBE, np.zeros(len(order), dtype=np.int64)
    if kept.cues is not None and len(order):
        used, number = np.unique(kept.camera, return_inverse=True)
        frames, frame = cameras.frames(used), number.astype(np.int64)
    found = _core.Scene.from_frames(frames).detection_problems(kept.dictionary(frame, None, None))
    for place, text in found:
        problems.add_detections(order[[place]], 7, _tables.without_place(text))
    return kept.take(np.delete(np.arange(len(order)), [place for place, _ in found]))
