"""Checks of arguments: every message names the argument, what was found and what was expected."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterable, Sequence, Sized
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from . import _core
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import NDArray


Checked = TypeVar("Checked")
Path = str | os.PathLike[str]
Shape = tuple[int | str, ...]
"""A shape; letters stand for any length."""


def array(name: str, value: Any, shape: Shape, *others: Shape, nan: bool = False) -> NDArray[np.float64]:
    """Numbers of a shape, without a copy if they are float64 already. An empty list matches any shape without rows.

    Parameters
    ----------
    name : str
        The argument, for messages.
    value : array_like
        The value of the argument.
    shape, *others : tuple
        The expected shapes.
    nan : bool
        Whether NaN is allowed.
    """
    found = _as_array(name, value)
    if found.dtype.kind == "O" and hasattr(value, "to_numpy"):
        # A pandas table whose columns may have missing values.
        with contextlib.suppress(ValueError, TypeError):
            found = value.to_numpy(dtype=np.float64, na_value=np.nan)
    if found.dtype.kind not in "fiu":
        raise QuadliftError(f"{name} has the dtype {found.dtype}; expected real numbers")
    if found.shape == (0,) and isinstance(shape[0], str):
        found = found.reshape(tuple(0 if isinstance(size, str) else size for size in shape))
    if not any(_fits(found.shape, wanted) for wanted in (shape, *others)):
        expected = " or ".join(_words(wanted) for wanted in (shape, *others))
        raise QuadliftError(f"{name} has the shape {_words(found.shape)}; expected {expected}")
    numbers = np.asarray(found, dtype=np.float64)
    wrong = np.isinf(numbers) if nan else ~np.isfinite(numbers)
    if wrong.any():
        place = [int(i) for i in np.argwhere(wrong)[0]]
        raise QuadliftError(f"{name}{place} is {numbers[tuple(place)]}; expected a finite number")
    return numbers


def _fits(shape: tuple[int, ...], wanted: Shape) -> bool:
    return len(shape) == len(wanted) and all(
        isinstance(size, str) or found == size for found, size in zip(shape, wanted, strict=True)
    )


def indices(name: str, value: Any) -> NDArray[np.int64]:
    """Whole numbers of the shape (M,), also as floats, to which tables convert them."""
    found = _as_array(name, value)
    if found.ndim != 1:
        raise QuadliftError(f"{name} has the shape {_words(found.shape)}; expected (M,)")
    if found.size == 0:
        return np.zeros(0, dtype=np.int64)
    if found.dtype.kind == "f":
        wrong = np.flatnonzero(~np.isfinite(found) | (found != np.floor(found)))
        if wrong.size:
            raise QuadliftError(f"{name}[{wrong[0]}] is {found[wrong[0]]}; expected a whole number")
    elif found.dtype.kind not in "iu":
        raise QuadliftError(f"{name} has the dtype {found.dtype}; expected whole numbers")
    if found.dtype.kind == "u" and found.max() > np.iinfo(np.int64).max:
        raise QuadliftError(f"{name} holds {found.max()}; expected numbers below 2^63")
    return found.astype(np.int64, copy=False)


def places(name: str, value: Any, ids: list[str]) -> NDArray[np.int64]:
    """Indices, or ids as indices into a list of them; of the shape (M,)."""
    found = _as_array(name, value)
    if found.dtype.kind not in "UO" or found.ndim != 1 or not all(isinstance(item, str) for item in found):
        return indices(name, found)
    place = {id: k for k, id in enumerate(ids)}
    for row, item in enumerate(found):
        if item not in place:
            some = ", ".join(ids[:5])
            raise QuadliftError(f'{name}[{row}]: unknown frame "{item}"; the scene has {len(ids)} frames: {some}')
    return np.array([place[item] for item in found], dtype=np.int64)


def rows(name: str, value: Sized, like: str, expected: int) -> None:
    """Raises an error if two arguments have different numbers of rows."""
    if len(value) != expected:
        shape = value.shape if isinstance(value, np.ndarray) else (len(value),)
        words = f"{_words(shape)}; expected {_words((expected, *shape[1:]))}, as many rows as {like}"
        raise QuadliftError(f"{name} has the shape {words}")


def names(name: str, value: Any, count: int, like: str) -> tuple[NDArray[np.int64] | None, list[str]]:
    """Whole numbers or texts of the shape (M,) as indices into a list of texts; -1 for none.

    None, NaN, negative numbers and the empty text mean none.
    """
    if value is None:
        return None, []
    found = _as_array(name, value)
    if found.ndim != 1:
        raise QuadliftError(f"{name} has the shape {_words(found.shape)}; expected (M,)")
    rows(name, found, like, count)
    if found.size == 0:
        return np.zeros(0, dtype=np.int64), []
    if found.dtype.kind == "f":
        none = np.isnan(found)
        if not np.all(none | (found == np.floor(found))) or np.isinf(found).any():
            raise QuadliftError(f"{name} has the dtype {found.dtype}; expected whole numbers or texts")
        found = np.where(none, -1.0, found).astype(np.int64)
    if found.dtype.kind == "u" and found.max() > np.iinfo(np.int64).max:
        raise QuadliftError(f"{name} holds {found.max()}; expected numbers below 2^63, or texts")
    if found.dtype.kind in "iu":
        values, codes = np.unique(found, return_inverse=True)
        codes = codes.reshape(-1).astype(np.int64)
        codes[found < 0] = -1
        return codes, [str(v) for v in values]
    if found.dtype.kind not in "UO":
        raise QuadliftError(f"{name} has the dtype {found.dtype}; expected whole numbers or texts")
    index: dict[str, int] = {}
    codes = np.full(found.shape[0], -1, dtype=np.int64)
    for row, item in enumerate(found):
        if _is_none(item):
            continue
        if not isinstance(item, str | int | np.integer) or isinstance(item, bool):
            raise QuadliftError(f"{name}[{row}] is {item!r}; expected a whole number, a text or None")
        codes[row] = index.setdefault(text(f"{name}[{row}]", str(item)), len(index))
    return codes, list(index)


def _is_none(item: Any) -> bool:
    if item is None or type(item).__name__ == "NAType":
        # The latter is pandas.NA, which is neither equal nor unequal to anything.
        return True
    return (isinstance(item, float) and math.isnan(item)) or bool(item == "")


_AXES = {f"{sign}{axis}": k for k, axis in enumerate("xyz") for sign in ("", "-")}


def direction(name: str, value: Any) -> list[float]:
    """A direction: an axis such as ``"-y"``, or three numbers."""
    if isinstance(value, str):
        if value not in _AXES:
            raise QuadliftError(f"{name} is {value!r}; expected x, y, z, -x, -y, -z or three numbers")
        axis = [0.0, 0.0, 0.0]
        axis[_AXES[value]] = -1.0 if value.startswith("-") else 1.0
        return axis
    numbers: list[float] = array(name, value, (3,)).tolist()
    return numbers


def optional(check: Callable[[str, Any], Checked], name: str, value: Any) -> Checked | None:
    """None, or the checked value."""
    return None if value is None else check(name, value)


def scene(name: str, value: Any) -> _core.Scene:
    """The core of a `Scene`."""
    core = getattr(value, "_core", None)
    if isinstance(core, _core.Scene):
        return core
    hint = " (its to_scene())" if hasattr(value, "to_scene") else ""
    raise QuadliftError(f"{name} is a {type(value).__name__}; expected a quadlift.Scene{hint}")


def whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """A whole number in a range."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):
        words = f"from {least} to {most}" if most is not None else f"of at least {least}"
        raise QuadliftError(f"{name} is {value!r}; expected a whole number {words}")
    return int(value)


def number(name: str, value: Any) -> float:
    """A finite number."""
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        raise QuadliftError(f"{name} is {value!r}; expected a finite number")
    return float(value)


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise QuadliftError(f"{name} is {value!r}; expected True or False")
    return bool(value)


def text(name: str, value: Any) -> str:
    """A text."""
    if not isinstance(value, str):
        raise QuadliftError(f"{name} is {value!r}; expected a text")
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise QuadliftError(f"{name} is {value!r}, which is not Unicode text: {error.reason}") from error
    return value


def texts(name: str, value: Any, count: int) -> list[str]:
    """Texts, one for each of `count` frames."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise QuadliftError(f"{name} is {value!r}; expected {count} texts, one for each frame")
    value = list(value)
    if len(value) != count:
        raise QuadliftError(f"{name}: found {len(value)} of them; expected {count} texts, one for each frame")
    return [text(f"{name}[{k}]", item) for k, item in enumerate(value)]


def _as_array(name: str, value: Any) -> NDArray[Any]:
    try:
        return np.asarray(value)
    except (ValueError, TypeError, RuntimeError) as error:
        # Lists of different lengths, tensors that are not in the memory of the CPU or that take part in a gradient.
        raise QuadliftError(f"{name} is not an array: {error}") from error


def _words(shape: Sequence[int | str]) -> str:
    inner = ", ".join(str(size) for size in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
