"""From detections to one row per object, scene or frame, and back; occluded edges of the boxes of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import _core, _outlines
from .._arrow import pa
from .._core import QuadliftError
from . import _tables
from ._detections import EDGES


def group(table: Any, by: Sequence[str]) -> Any:
    """One row per distinct value of some columns, the other columns as lists.

    Parameters
    ----------
    table : pyarrow.Table or pyarrow.RecordBatch
        For example detections.
    by : sequence of str
        Columns of whole numbers or texts; null counts as a value.

    Returns
    -------
    pyarrow.Table
        In ascending order of these columns.
    """
    table = _tables.table(table, "table")
    if isinstance(by, str) or not by:
        raise QuadliftError(f"by is {by!r}; expected a list of at least one column")
    _tables.require(table.column_names, by, "table")
    codes = []
    for name in by:
        values = _tables.ids(_tables.column(table, name), name)
        codes.append(_tables.index_in(values, _tables.different(values)))
    order = np.lexsort(codes[::-1])
    changed = np.zeros(len(order), dtype=np.bool_)
    changed[:1] = True
    for code in codes:
        changed[1:] |= np.diff(code[order]) != 0
    first = np.flatnonzero(changed)
    offsets = pa.array(np.append(first, len(order)).astype(np.int32))
    columns = {}
    for name in table.column_names:
        values = _tables.column(table, name).take(pa.array(order[first] if name in by else order))
        columns[name] = values if name in by else pa.ListArray.from_arrays(offsets, values)
    return pa.table(columns)


def ungroup(rows: Any) -> Any:
    """One row per entry of the list columns: the inverse of `group`.

    Parameters
    ----------
    rows : pyarrow.Table or pyarrow.RecordBatch
        With at least one column of lists, which have equal lengths in each row.

    Returns
    -------
    pyarrow.Table
        The same columns, in the order of the rows; rows with empty lists (or null) are dropped.
    """
    rows = _tables.table(rows, "rows")
    of_lists = [name for name in rows.column_names if pa.types.is_nested(rows.schema.field(name).type)]
    if not of_lists:
        raise QuadliftError(f"rows has no column of lists; found {', '.join(rows.column_names) or 'none'}")
    views = _tables.Views(rows, of_lists)
    views.refuse_ragged()
    parents = pa.array(views.row)
    return pa.table({n: views[n] if n in views else _tables.column(rows, n).take(parents) for n in rows.column_names})


def with_occluded_edges(rows: Any) -> Any:
    """Detects box edges that are probably hidden by another box of the frame; they have a separate noise level.

    Parameters
    ----------
    rows : pyarrow.Table or pyarrow.RecordBatch
        One row for each frame (see `group`), with lists `x0`, `y0`, `x1`, `y1` of all its boxes, of any object, and
        optionally of their outlines and turned boxes. Invalid boxes neither hide nor are hidden.

    Returns
    -------
    pyarrow.Table
        The rows with one more column, `occluded_edges`: lists of int8, 1 for a hidden left edge plus 4 for a right one.
        With a column `outline` also `occluded_lines`: lists of int16, with a bit for each supporting line that another
        outline may hide.
    """
    rows = _tables.table(rows, "rows")
    _tables.require(rows.column_names, _tables.BOX, "rows")
    views = _tables.Views(rows, [*_tables.BOX, *(name for name in _tables.SHAPES if name in rows.column_names)])
    views.refuse_ragged()
    boxes, outlines = views.boxes(), views.outlines()
    if outlines is not None:
        boxes = np.where(np.isnan(boxes).all(axis=1, keepdims=True), _outlines.around(outlines), boxes)
    hidden = _core.occluded_edges(views.row, np.ascontiguousarray(boxes))
    offsets = pa.array(np.searchsorted(views.row, np.arange(len(rows) + 1)).astype(np.int32))
    masks = pa.array((hidden @ EDGES).astype(np.int8))
    rows = rows.append_column("occluded_edges", pa.ListArray.from_arrays(offsets, masks))
    if outlines is None or outlines["corners"] is None:
        return rows
    lines = _core.occluded_lines(views.row, outlines) @ _tables.LINES
    return rows.append_column("occluded_lines", pa.ListArray.from_arrays(offsets, pa.array(lines.astype(np.int16))))
