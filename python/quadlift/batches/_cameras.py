"""Tables of cameras, for lookup by detections."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from .._arrow import pa, pc
from .._core import QuadliftError
from . import _tables

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .._arrays import FrameArrays

CAMERA = ("projection", "intrinsics", "cam_from_world", "width", "height")


class Cameras:
    """The cameras of the frames of one scene or many.

    Parameters
    ----------
    table : pyarrow.Table
        One row per frame, with the columns

        - `scene` (only if the detections have scenes) and `frame`: whole numbers or texts,
        - `projection`: 12 numbers, the rows of the 3x4 matrix from the world to pixels; or `intrinsics`
          ``[fx, fy, cx, cy]`` in pixels and `cam_from_world`, 12 numbers, the rows of the 3x4 pose ``[R | t]``
          (OpenCV's axes),
        - `width` and `height` of the image in pixels, optional.

    Raises
    ------
    QuadliftError
        Names a column that is missing or has a wrong type. A single invalid camera is not an error: it makes its
        objects invalid.

    Notes
    -----
    The frames of a scene are ordered by their ids, because errors of neighboring views are correlated: numbers as
    numbers, texts as texts ("10" before "9"). Identical duplicate cameras are ignored.
    """

    def __init__(self, table: pa.Table) -> None:
        table = _tables.table(table, "cameras")
        names = table.column_names
        _tables.require(names, ["frame"], "cameras")
        if "projection" in names:
            if "intrinsics" in names or "cam_from_world" in names:
                raise QuadliftError("cameras: expected either projection, or intrinsics and cam_from_world; found both")
        else:
            _tables.require(names, ["intrinsics", "cam_from_world"], "cameras")
        if ("width" in names) != ("height" in names):
            found = "width" if "width" in names else "height"
            raise QuadliftError(f"cameras: expected width and height, or none of them; found {found} alone")
        self.has_scenes = "scene" in names
        self._table = table.select([name for name in ("scene", "frame", *CAMERA) if name in names])
        frame = _tables.ids(_tables.column(table, "frame"), "frame of cameras")
        scene = pa.array(np.zeros(len(table), dtype=np.int64))
        if self.has_scenes:
            scene = _tables.ids(_tables.column(table, "scene"), "scene of cameras")
        self._scenes, self._frames = _tables.different(scene), _tables.different(frame)
        keys = self._key(scene, np.arange(len(table)), frame)
        order = np.argsort(keys, kind="stable")
        order = order[np.count_nonzero(keys < 0) :]
        self._keys, first, place = np.unique(keys[order], return_index=True, return_inverse=True)
        numbers, problems = _numbers(table)
        self._numbers = {name: values[order[first]] for name, values in numbers.items()}
        self.broken: dict[int, str] = {}
        """Invalid cameras, with reasons."""
        for name, values in numbers.items():
            copies = values[order]
            same = (copies == self._numbers[name][place]) | np.isnan(copies)
            for index in np.unique(place[~same.all(axis=1)]):
                self.broken[int(index)] = "it has several cameras, which differ"
        rows = order[first]
        for index in np.flatnonzero(np.isin(rows, list(problems))):
            self.broken.setdefault(int(index), problems[int(rows[index])])
        good = np.delete(np.arange(len(self)), list(self.broken))
        for index, text in _core.frame_problems(self.frames(good)):
            self.broken.setdefault(int(good[index]), _tables.without_place(text))

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._keys)

    def __repr__(self) -> str:
        return f"<quadlift.batches.Cameras: {len(self)} frames>"

    def __reduce__(self) -> tuple[type[Cameras], tuple[Any]]:
        return Cameras, (self._table,)

    def find(self, scene: Any, row: NDArray[np.int64], frame: Any) -> NDArray[np.int64]:
        """Indices of the cameras of M frames, -1 for none; those of a scene are in the order of its frames.

        Parameters
        ----------
        scene : pyarrow.Array or None
            The scene of each row.
        row : ndarray, shape (M,)
            The row of each frame.
        frame : pyarrow.Array, length M
            The frames.
        """
        if (scene is not None) != self.has_scenes:
            some, others = ("cameras", "detections") if self.has_scenes else ("detections", "cameras")
            raise QuadliftError(f"the {some} have a column 'scene', the {others} have none")
        if scene is None:
            scene = pa.array(np.zeros(int(row.max(initial=-1)) + 1, dtype=np.int64))
        if not len(self):
            return np.full(len(row), -1)
        keys = self._key(_tables.ids(scene, "scene"), row, _tables.ids(frame, "frame"))
        places = np.minimum(np.searchsorted(self._keys, keys), len(self) - 1)
        return np.where(self._keys[places] == keys, places, -1)

    def of_scene(self, scene: Any) -> NDArray[np.int64]:
        """Indices of the valid cameras of a scene; `scene` is a scalar, or None without scenes."""
        number = 0 if scene is None else pc.index_in(scene, self._scenes).as_py()
        if number is None:
            return np.zeros(0, dtype=np.int64)
        ends = np.searchsorted(self._keys, np.array([number, number + 1]) * len(self._frames))
        return np.array([k for k in range(*ends) if k not in self.broken], dtype=np.int64)

    def frames(self, indices: NDArray[np.int64]) -> FrameArrays:
        """Cameras for the core."""
        numbers = {name: values[indices] for name, values in self._numbers.items()}
        intrinsics = numbers.get("intrinsics")
        if intrinsics is not None:
            fx, fy, cx, cy = intrinsics.T
            zero, one = np.zeros(len(indices)), np.ones(len(indices))
            intrinsics = np.stack([fx, zero, cx, zero, fy, cy, zero, zero, one], axis=1).reshape(-1, 3, 3)
        return {
            "frame_ids": [str(k) for k in range(len(indices))],
            "projections": _matrices(numbers.get("projection")),
            "intrinsics": intrinsics,
            "cam_from_world": _matrices(numbers.get("cam_from_world")),
            "image_sizes": numbers.get("size"),
        }

    def _key(self, scene: Any, row: NDArray[np.int64], frame: Any) -> NDArray[np.int64]:
        """Numbers of pairs of scene and frame, in their order; -1 if either is null or unknown."""
        scenes = _places(scene, self._scenes, "scene")[row]
        frames = _places(frame, self._frames, "frame")
        return np.where((scenes < 0) | (frames < 0), -1, scenes * len(self._frames) + frames)


def _places(values: Any, known: Any, name: str) -> NDArray[np.int64]:
    """Indices of the detections' ids among those of the cameras, -1 if null or unknown."""
    if values.type != known.type:
        if values.null_count == len(values) or not len(known):
            return np.full(len(values), -1)
        raise QuadliftError(f"{name} is {values.type} in the detections and {known.type} in the cameras")
    return _tables.index_in(values, known)


def _numbers(table: Any) -> tuple[dict[str, NDArray[np.float64]], dict[int, str]]:
    """The parameters of the cameras by name, and rows with missing values."""
    numbers: dict[str, NDArray[np.float64]] = {}
    problems: dict[int, str] = {}
    for name, width in (("projection", 12), ("intrinsics", 4), ("cam_from_world", 12)):
        if name in table.column_names:
            numbers[name], fits = _tables.vectors(table, name, width)
            problems |= {int(row): f"{name} does not have {width} numbers" for row in np.flatnonzero(~fits)}
    if "width" in table.column_names:
        sides = [_tables.numbers(_tables.column(table, name), name) for name in ("width", "height")]
        size = np.column_stack(sides)
        if not np.isnan(size).all():
            numbers["size"] = size
            wrong = np.flatnonzero(~(np.isfinite(size) & (size > 0.0)).all(axis=1))
            problems |= {int(row): "width and height are not positive numbers" for row in wrong}
    return numbers, problems


def _matrices(rows: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """(F, 3, 4) of (F, 12)."""
    return None if rows is None else rows.reshape(-1, 3, 4)
