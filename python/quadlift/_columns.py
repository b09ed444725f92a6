"""Columns of tables of detections and cameras as arrays for the core."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core, _outlines
from ._arrow import pa, pc
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ._arrays import DetectionArrays, FrameArrays, Names
    from ._cues import CueArrays

BOX = ("x0", "y0", "x1", "y1")
ORIENTED_BOX = tuple(f"oriented_box_{name}" for name in ("x", "y", "width", "height", "angle"))
BOX3D = {"center": 3, "half_extents": 3, "rotation": 4, "covariance": 81}
"""Lists of a 3D box, and their lengths."""
DEVIATIONS = ("distance", "direction", "size", "rotation")
CAMERA = {"projection": 12, "intrinsics": 4, "cam_from_world": 12}
"""Lists of a camera, and their lengths."""
EDGES, LINES = 2 ** np.arange(4), 2 ** np.arange(8)
"""Bits of the columns `occluded_edges` (left, top, right, bottom) and `occluded_lines`."""


def table(rows: Any, name: str, wanted: tuple[str, ...] = ()) -> Any:
    """A pyarrow table without chunks that has these columns; those of pandas are converted."""
    if hasattr(rows, "to_dict") and hasattr(rows, "iloc"):
        rows = pa.Table.from_pandas(rows, preserve_index=False)
    if isinstance(rows, pa.RecordBatch):
        rows = pa.Table.from_batches([rows])
    if not isinstance(rows, pa.Table):
        raise QuadliftError(f"{name} is a {type(rows).__name__}; expected a table of pyarrow or pandas")
    for column in wanted:
        if column not in rows.column_names:
            found = ", ".join(rows.column_names) or "none"
            raise QuadliftError(f"{name} has no column {column!r}; found {found}")
    return rows.combine_chunks()


def values(rows: Any, name: str) -> Any:
    """The one chunk of a column."""
    chunks = rows.column(name).chunks
    return chunks[0] if chunks else pa.array([], rows.column(name).type)


def is_given(rows: Any, name: str) -> bool:
    """Whether there is a column with other values than null."""
    if name not in rows.column_names:
        return False
    return rows.column(name).null_count < len(rows) or not (len(rows) or pa.types.is_null(rows.schema.field(name).type))


def ids(rows: Any, name: str) -> Any:
    """Ids as int64 or string; of a table without the column zeros."""
    if name not in rows.column_names:
        return pa.array(np.zeros(len(rows), dtype=np.int64))
    found = values(rows, name)
    if pa.types.is_dictionary(found.type):
        found = found.dictionary_decode()
    kind = found.type
    is_text = (pa.types.is_string(kind), pa.types.is_large_string(kind), pa.types.is_string_view(kind))
    if pa.types.is_null(kind) or any(is_text):
        return found.cast(pa.string())
    try:
        # pandas makes floating point of whole numbers of which some are missing.
        if pa.types.is_integer(kind) or pa.types.is_floating(kind):
            return found.cast(pa.int64())
    except pa.ArrowInvalid as error:
        raise QuadliftError(f"{name}: {error}; expected whole numbers or texts") from error
    raise QuadliftError(f"{name} has the type {kind}; expected whole numbers or texts")


def known(found: Any) -> Any:
    """The distinct ids in ascending order, without null."""
    unsorted = pc.unique(found).drop_null()
    return unsorted.take(pc.sort_indices(unsorted))


def places(found: Any, among: Any, name: str) -> NDArray[np.int64]:
    """Indices of ids, -1 if null or unknown."""
    if found.type != among.type:
        if found.null_count == len(found) or not len(among):
            return np.full(len(found), -1)
        raise QuadliftError(f"{name} is {found.type} in the detections and {among.type} in the cameras")
    at: NDArray[np.int64] = pc.index_in(found, among, skip_nulls=True).cast(pa.int64()).fill_null(-1).to_numpy()
    return at


def numbers(found: Any, name: str) -> NDArray[np.float64]:
    """Numbers as float64, NaN for null."""
    kind = found.type
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)):
        raise QuadliftError(f"{name} has the type {kind}; expected numbers")
    cast: NDArray[np.float64] = found.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return cast


def lists(rows: Any, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Lengths of lists of numbers, 0 for null; and their numbers, one after the other."""
    found = values(rows, name)
    kind = found.type
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        raise QuadliftError(f"{name} has the type {kind}; expected lists of numbers")
    lengths: NDArray[np.int64] = pc.list_value_length(found).cast(pa.int64()).fill_null(0).to_numpy()
    return lengths, numbers(pc.list_flatten(found), name)


def vectors(rows: Any, name: str, width: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Lists of `width` numbers, shape (M, width), NaN for others; and the lengths of all."""
    lengths, flat = lists(rows, name)
    fits = lengths == width
    found = np.full((len(lengths), width), np.nan)
    found[fits] = flat[np.repeat(fits, lengths)].reshape(-1, width)
    return found, lengths


def _numbers_of(rows: Any, name: str) -> NDArray[np.float64] | None:
    return numbers(values(rows, name), name) if is_given(rows, name) else None


def _side_by_side(rows: Any, names: tuple[str, ...]) -> NDArray[np.float64] | None:
    """Columns of numbers, NaN for a missing one; None without any."""
    columns = [_numbers_of(rows, name) for name in names]
    if all(column is None for column in columns):
        return None
    return np.column_stack([np.full(len(rows), np.nan) if column is None else column for column in columns])


def _names_of(rows: Any, name: str) -> Names:
    """Texts as indices into a sorted list of them."""
    if not is_given(rows, name):
        return None, []
    found = ids(rows, name).cast(pa.string())
    among = known(found)
    return places(found, among, name), among.to_pylist()


def boxes(rows: Any) -> NDArray[np.float64]:
    """(M, 4)."""
    return np.column_stack([numbers(values(rows, name), name) for name in BOX])


def outlines(rows: Any) -> _outlines.OutlineArrays | None:
    """Outlines and oriented boxes; None without any."""
    turned = [numbers(values(rows, name), name) for name in ORIENTED_BOX if name in rows.column_names]
    if turned and len(turned) < len(ORIENTED_BOX):
        missing = next(name for name in ORIENTED_BOX if name not in rows.column_names)
        raise QuadliftError(f"there is no column {missing!r}; expected all of {', '.join(ORIENTED_BOX)}")
    if not turned and not is_given(rows, "outline"):
        return None
    found: _outlines.OutlineArrays = {
        "corners": None,
        "offsets": None,
        "oriented_boxes": np.column_stack(turned) if turned else None,
        "occluded_lines": None,
    }
    if is_given(rows, "outline"):
        lengths, flat = lists(rows, "outline")
        odd = np.flatnonzero(lengths % 2)
        if len(odd):
            raise QuadliftError(f"outline has a list of {lengths[odd[0]]} numbers; expected x and y of each corner")
        found["corners"], found["offsets"] = flat.reshape(-1, 2), np.concatenate([[0], np.cumsum(lengths // 2)])
    return found


def _cues(rows: Any) -> CueArrays | None:
    """Depths and 3D boxes; None without any."""
    given = [name for name in BOX3D if is_given(rows, f"box3d_{name}")]
    if not given and not is_given(rows, "depth_median"):
        return None
    of_box: dict[str, NDArray[np.float64] | None] = dict.fromkeys(BOX3D)
    for name in given:
        width = BOX3D[name]
        of_box[name], lengths = vectors(rows, f"box3d_{name}", width)
        wrong = lengths[(lengths != width) & (lengths > 0)]
        if len(wrong):
            raise QuadliftError(f"box3d_{name} has a list of {wrong[0]} numbers; expected lists of {width} numbers")
    return {
        "depth": _numbers_of(rows, "depth_median"),
        "depth_sd": _numbers_of(rows, "depth_sd"),
        "depth_source": _names_of(rows, "depth_source"),
        "center": of_box["center"],
        "half_extents": of_box["half_extents"],
        "rotation": of_box["rotation"],
        "frame": _names_of(rows, "box3d_frame"),
        "sd": _side_by_side(rows, tuple(f"box3d_sd_{name}" for name in DEVIATIONS)),
        "covariance": of_box["covariance"],
        "source": _names_of(rows, "box3d_source"),
    }


def _bits(rows: Any, name: str, bits: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Bits of a column, none without it."""
    found = np.nan_to_num(numbers(values(rows, name), name)) if name in rows.column_names else np.zeros(len(rows))
    is_set: NDArray[np.bool_] = (found.astype(np.int64)[:, np.newaxis] & bits) != 0
    return is_set


def detections(rows: Any, frames: NDArray[np.int64], objects: Names, own: bool) -> DetectionArrays:
    """Detections for the core. `own`: occluded edges are those of the table; otherwise found by the core."""
    found: DetectionArrays = {
        "frames": frames.astype(np.int64),
        "boxes": boxes(rows),
        "objects": objects,
        "categories": _names_of(rows, "category"),
        "scores": _numbers_of(rows, "score"),
        "outlines": outlines(rows),
        "cues": _cues(rows),
    }
    if own:
        # Edges that are not marked count as visible: other boxes of the frame may be in other tables.
        found["occluded_edges"] = _bits(rows, "occluded_edges", EDGES)
        if found["outlines"] is not None:
            found["outlines"]["occluded_lines"] = _bits(rows, "occluded_lines", LINES)
    return found


class Cameras:
    """The cameras of a table, in the order of scenes and frames; equal ones of one frame count once."""

    def __init__(self, rows: Any) -> None:
        self.has_scenes = "scene" in rows.column_names
        scenes, frames = ids(rows, "scene"), ids(rows, "frame")
        self._scenes, self._frames = known(scenes), known(frames)
        keys = self._keys_of(scenes, frames)
        order = np.argsort(keys, kind="stable")
        order = order[np.count_nonzero(keys < 0) :]
        self._keys, first, place = np.unique(keys[order], return_index=True, return_inverse=True)
        self.broken: dict[int, str] = {}
        """Invalid cameras, with reasons."""
        self._numbers: dict[str, NDArray[np.float64]] = {}
        problems: dict[int, str] = {}
        for name, found in _camera_numbers(rows, problems).items():
            copies, self._numbers[name] = found[order], found[order[first]]
            same = (copies == self._numbers[name][place]) | np.isnan(copies)
            for index in np.unique(place[~same.all(axis=1)]):
                self.broken[int(index)] = "it has several cameras, which differ"
        for index in np.flatnonzero(np.isin(order[first], list(problems))):
            self.broken.setdefault(int(index), problems[int(order[first][index])])
        good = np.delete(np.arange(len(self._keys)), list(self.broken))
        for index, text in _core.frame_problems(self.frames(good)):
            self.broken.setdefault(int(good[index]), without_place(text))

    def _keys_of(self, scenes: Any, frames: Any) -> NDArray[np.int64]:
        """Numbers of pairs of scene and frame, in their order; -1 if either is null or unknown."""
        scene, frame = places(scenes, self._scenes, "scene"), places(frames, self._frames, "frame")
        return np.where((scene < 0) | (frame < 0), -1, scene * len(self._frames) + frame)

    def find(self, rows: Any) -> NDArray[np.int64]:
        """Indices of the cameras of detections, -1 for none."""
        keys = self._keys_of(ids(rows, "scene"), ids(rows, "frame"))
        if not len(self._keys):
            return np.full(len(keys), -1)
        at = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        return np.where(self._keys[at] == keys, at, -1)

    def of_scene(self, scene: Any) -> NDArray[np.int64]:
        """Indices of the valid cameras of a scene, an array with its id."""
        first = int(places(scene, self._scenes, "scene")[0]) * len(self._frames)
        begin, end = np.searchsorted(self._keys, [first, first + len(self._frames)])
        return np.setdiff1d(np.arange(begin, end), list(self.broken))

    def frames(self, indices: NDArray[np.int64]) -> FrameArrays:
        """Frames for the core."""
        found: FrameArrays = {"frame_ids": [str(k) for k in range(len(indices))]}
        rows = {name: of_all[indices] for name, of_all in self._numbers.items()}
        if "size" in rows:
            found["image_sizes"] = rows["size"]
        if "projection" in rows:
            found["projections"] = rows["projection"].reshape(-1, 3, 4)
        else:
            found["cam_from_world"] = rows["cam_from_world"].reshape(-1, 3, 4)
            matrices = np.tile(np.eye(3), (len(indices), 1, 1))
            matrices[:, [0, 1, 0, 1], [0, 1, 2, 2]] = rows["intrinsics"]
            found["intrinsics"] = matrices
        return found


def _camera_numbers(rows: Any, problems: dict[int, str]) -> dict[str, NDArray[np.float64]]:
    """The numbers of cameras by name; rows that lack some are added to the problems."""
    found: dict[str, NDArray[np.float64]] = {}
    of_projection = is_given(rows, "projection")
    for name in ("projection",) if of_projection else ("intrinsics", "cam_from_world"):
        if not is_given(rows, name):
            raise QuadliftError(f"cameras: expected projection, or intrinsics and cam_from_world; {name!r} is missing")
        found[name], lengths = vectors(rows, name, CAMERA[name])
        for row in np.flatnonzero(lengths != CAMERA[name]):
            problems.setdefault(int(row), f"{name} does not have {CAMERA[name]} numbers")
    size = _side_by_side(rows, ("width", "height"))
    if size is not None and not np.isnan(size).all():
        found["size"] = size
        for row in np.flatnonzero(~(np.isfinite(size) & (size > 0.0)).all(axis=1)):
            problems.setdefault(int(row), "width and height are not positive numbers")
    return found


def without_place(problem: str) -> str:
    """A message of the core about an array, without the index in the array, which is meaningless to the user."""
    return problem.partition("]: ")[2] or problem
