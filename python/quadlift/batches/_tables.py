"""Columns of Arrow tables as arrays: ids, numbers, and lists with one entry per view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._arrow import pa, pc
from .._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .. import _arrays

BOX = ("x0", "y0", "x1", "y1")


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
    found = column(rows, name)
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
    values = lists(rows, name)
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
