"""Columns of Arrow tables as arrays: ids, numbers, and lists with one entry per view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _cues, _outlines
from .._arrow import pa, pc
from .._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .. import _arrays

BOX = ("x0", "y0", "x1", "y1")
DEVIATIONS = ("box3d_sd_distance", "box3d_sd_direction", "box3d_sd_size", "box3d_sd_rotation")
LISTS = {"box3d_center": 3, "box3d_half_extents": 3, "box3d_rotation": 4, "box3d_covariance": 81}
"""Columns of lists, and the lengths of these."""
CUES = ("depth_median", "depth_sd", "depth_source", *LISTS, "box3d_frame", *DEVIATIONS, "box3d_source")
"""Columns of depths and 3D boxes, as in the tables of `quadlift export parquet`."""

ORIENTED_BOX = tuple(f"oriented_box_{name}" for name in ("x", "y", "width", "height", "angle"))
SHAPES = ("outline", *ORIENTED_BOX)
"""Columns of outlines and turned boxes, as in these tables."""
LINES = 2 ** np.arange(8)
"""Bits of the supporting lines in a column `occluded_lines`."""


def table(rows: Any, name: str) -> Any:
    """A table with one chunk, from a table or a batch."""
    if isinstance(rows, pa.RecordBatch):
        return pa.Table.from_batches([rows])
    if not isinstance(rows, pa.Table):
        raise QuadliftError(f"{name} is a {type(rows).__name__}; expected a pyarrow.Table or a pyarrow.RecordBatch")
    return rows.combine_chunks()


def require(found: Sequence[str], wanted: Sequence[str], name: str) -> None:
    """Raises an error if a column is missing."""
    missing = [column for column in wanted if column not in found]
    if missing:
        raise QuadliftError(f"{name} has no column {missing[0]!r}; found {', '.join(found) or 'none'}")


def column(rows: Any, name: str) -> Any:
    """The one chunk of a column."""
    chunks = rows.column(name).chunks
    return chunks[0] if chunks else pa.array([], rows.column(name).type)


def ids(values: Any, name: str) -> Any:
    """Ids as int64 or string."""
    if pa.types.is_dictionary(values.type):
        values = values.dictionary_decode()
    kind = values.type
    try:
        if pa.types.is_integer(kind):
            return values.cast(pa.int64())
        if pa.types.is_null(kind) or pa.types.is_string(kind) or pa.types.is_large_string(kind):
            return values.cast(pa.string())
        if pa.types.is_string_view(kind):
            return values.cast(pa.string())
    except pa.ArrowInvalid as error:
        raise QuadliftError(f"{name}: {error}") from error
    raise QuadliftError(f"{name} has the type {kind}; expected whole numbers or texts")


def without_place(problem: str) -> str:
    """A message of the core about an array, without the index in the array, which is meaningless to the user."""
    return problem.partition("]: ")[2] or problem


def numbers(values: Any, name: str) -> NDArray[np.float64]:
    """Numbers as float64, NaN for none."""
    kind = values.type
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)):
        raise QuadliftError(f"{name} has the type {kind}; expected numbers")
    found: NDArray[np.float64] = values.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return found


def lists(rows: Any, name: str) -> Any:
    """A column of lists."""
    return as_lists(column(rows, name), name)


def as_lists(found: Any, name: str) -> Any:
    """Values that are lists."""
    kind = found.type
    if pa.types.is_null(kind):
        return found.cast(pa.list_(pa.null()))
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        raise QuadliftError(f"{name} has the type {kind}; expected lists")
    return found


def lengths(values: Any) -> NDArray[np.int64]:
    """Lengths of lists, 0 for null."""
    found: NDArray[np.int64] = pc.list_value_length(values).cast(pa.int64()).fill_null(0).to_numpy()
    return found


def vectors(rows: Any, name: str, width: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Lists of `width` numbers as rows, and which of them are valid; the others are NaN."""
    return vectors_of(column(rows, name), name, width)


def vectors_of(found: Any, name: str, width: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The same of values."""
    values = as_lists(found, name)
    fits = lengths(values) == width
    found = np.full((len(values), width), np.nan)
    flat = numbers(pc.list_flatten(values.filter(pa.array(fits))), name)
    found[fits] = flat.reshape(-1, width)
    return found, fits


class Views:
    """The views of objects (or detections of scenes) whose columns are lists with one entry for each of them.

    Attributes
    ----------
    row : ndarray of int, shape (M,)
        The row of each view.
    ragged : dict of int to str
        Rows whose lists differ in length, which have no views here.
    """

    def __init__(self, rows: Any, names: Sequence[str]) -> None:
        found = {name: lists(rows, name) for name in names}
        counts = {name: lengths(values) for name, values in found.items()}
        first = next(iter(counts.values()))
        ragged = np.zeros(len(first), dtype=np.bool_)
        for count in counts.values():
            ragged |= count != first
        self.ragged = {
            int(row): "lists of different lengths: " + ", ".join(f"{count[row]} {n}" for n, count in counts.items())
            for row in np.flatnonzero(ragged)
        }
        if self.ragged:
            kept = pa.array(~ragged)
            found = {name: values.filter(kept) for name, values in found.items()}
        self.row: NDArray[np.int64] = np.repeat(np.arange(len(first)), np.where(ragged, 0, first))
        self._flat = {name: pc.list_flatten(values) for name, values in found.items()}

    def __contains__(self, name: str) -> bool:
        return name in self._flat

    def __getitem__(self, name: str) -> Any:
        """All entries of a column, one after the other."""
        return self._flat[name]

    def refuse_ragged(self) -> None:
        """For tables that need all of their rows."""
        for row, problem in self.ragged.items():
            raise QuadliftError(f"row {row} has {problem}")

    def boxes(self) -> NDArray[np.float64]:
        """The boxes, shape (M, 4)."""
        return np.column_stack([numbers(self[name], name) for name in BOX])

    def outlines(self) -> _outlines.OutlineArrays | None:
        """Outlines and turned boxes; None without any."""
        turned = [numbers(self[name], name) for name in ORIENTED_BOX if name in self]
        if turned and len(turned) < len(ORIENTED_BOX):
            missing = next(name for name in ORIENTED_BOX if name not in self)
            raise QuadliftError(f"there is no column {missing!r}; expected all of {', '.join(ORIENTED_BOX)}")
        if not turned and "outline" not in self:
            return None
        found: _outlines.OutlineArrays = {
            "corners": None,
            "offsets": None,
            "oriented_boxes": np.column_stack(turned) if turned else None,
            "occluded_lines": None,
        }
        if "outline" in self:
            values = as_lists(self["outline"], "outline")
            counts = lengths(values)
            odd = np.flatnonzero(counts % 2)
            if len(odd):
                raise QuadliftError(f"outline has a list of {counts[odd[0]]} numbers; expected x and y of each corner")
            found["corners"] = numbers(pc.list_flatten(values), "outline").reshape(-1, 2)
            found["offsets"] = np.concatenate([[0], np.cumsum(counts // 2)])
        if "occluded_lines" in self:
            hidden = np.nan_to_num(numbers(self["occluded_lines"], "occluded_lines")).astype(np.int64)
            found["occluded_lines"] = (hidden[:, np.newaxis] & LINES) != 0
        return found

    def cues(self) -> _cues.CueArrays | None:
        """Depths and 3D boxes; None without any."""

        def column(name: str) -> NDArray[np.float64] | None:
            return numbers(self[name], name) if name in self else None

        def columns(name: str) -> NDArray[np.float64] | None:
            if name not in self:
                return None
            found, fits = vectors_of(self[name], name, LISTS[name])
            wrong = np.flatnonzero(~fits & (lengths(as_lists(self[name], name)) > 0))
            if len(wrong):
                expected = f"lists of {LISTS[name]} numbers"
                raise QuadliftError(f"{name} has a list of {len(self[name][wrong[0]])} numbers; expected {expected}")
            return found

        if not any(name in self for name in ("depth_median", "box3d_center", "box3d_half_extents", "box3d_rotation")):
            return None
        deviations = [column(name) for name in DEVIATIONS]
        none = np.full(len(self.row), np.nan)
        given = any(values is not None for values in deviations)
        sd = np.column_stack([none if values is None else values for values in deviations]) if given else None
        return {
            "depth": column("depth_median"),
            "depth_sd": column("depth_sd"),
            "depth_source": self.codes("depth_source"),
            "center": columns("box3d_center"),
            "half_extents": columns("box3d_half_extents"),
            "rotation": columns("box3d_rotation"),
            "frame": self.codes("box3d_frame"),
            "sd": sd,
            "covariance": columns("box3d_covariance"),
            "source": self.codes("box3d_source"),
        }

    def codes(self, name: str) -> _arrays.Names:
        """Texts of a column as indices into a sorted list of them, -1 for none; None without the column."""
        if name not in self:
            return None, []
        values = ids(self[name], name).cast(pa.string())
        known = different(values)
        return index_in(values, known), known.to_pylist()


def different(values: Any) -> Any:
    """The distinct ids in ascending order, without null."""
    unsorted = pc.unique(values).drop_null()
    return unsorted.take(pc.sort_indices(unsorted))


def index_in(values: Any, known: Any) -> NDArray[np.int64]:
    """Indices of values, -1 if null or unknown."""
    found: NDArray[np.int64] = pc.index_in(values, known, skip_nulls=True).cast(pa.int64()).fill_null(-1).to_numpy()
    return found
