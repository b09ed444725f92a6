"""Depths and 3D boxes of detections as arrays for the core."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from . import _checks
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Required

Names = tuple["NDArray[np.int64] | None", list[str]]
"""Indices into a list of texts, shape (M,), -1 for none; None if no row has one."""


class Depths(TypedDict, total=False):
    """Depths of M detections: how far the visible surface is along the optical axis, in world units; NaN means none."""

    median: Required[ArrayLike]
    """(M,): median depth of the visible surface."""
    sd: ArrayLike
    """(M,) or one number: standard deviation."""
    source: str | ArrayLike
    """The depth network or sensor, one for all or one for each (None: unknown). Depths of a source share a scale."""


class Boxes3d(TypedDict, total=False):
    """3D boxes of M detections, each from one image; any of `center`, `half_extents`, `rotation`. NaN means none."""

    center: ArrayLike
    """(M, 3), world units."""
    half_extents: ArrayLike
    """(M, 3): half the length, width and height, along the axes of `rotation`."""
    rotation: ArrayLike
    """(M, 4): unit quaternions, w first, from the axes of the box to those of `frame`."""
    frame: str | ArrayLike
    """``"camera"`` (x right, y down, z forward; the default) or ``"world"``, one for all or one for each."""
    sd: Box3dSd
    """Standard deviations of the errors."""
    covariance: ArrayLike
    """(M, 9, 9), of center, rotation vector and logarithms of the half extents; takes the place of `sd`."""
    source: str | ArrayLike
    """The 3D detector, one for all or one for each (None: unknown). Boxes of a source share factors."""


class Box3dSd(TypedDict, total=False):
    """Standard deviations of 3D boxes: (M,) or one number; NaN means unknown."""

    distance: ArrayLike
    """Of the center along the ray, relative to its distance."""
    direction: ArrayLike
    """Of the direction of the center, each way, radians."""
    size: ArrayLike
    """Of the logarithm of an extent."""
    rotation: ArrayLike
    """Of the rotation about each axis, radians."""


class CueArrays(TypedDict):
    """The input of the core, as read by `crates/quadlift-py`; NaN for none."""

    depth: NDArray[np.float64] | None
    """(M,)."""
    depth_sd: NDArray[np.float64] | None
    """(M,)."""
    depth_source: Names
    center: NDArray[np.float64] | None
    """(M, 3)."""
    half_extents: NDArray[np.float64] | None
    """(M, 3)."""
    rotation: NDArray[np.float64] | None
    """(M, 4)."""
    frame: Names
    sd: NDArray[np.float64] | None
    """(M, 4)."""
    covariance: NDArray[np.float64] | None
    """(M, 81)."""
    source: Names


_NO_NAMES: Names = (None, [])


def cues(depths: Any, boxes3d: Any, count: int, like: str) -> CueArrays | None:
    """The depths and 3D boxes of `count` detections, as many as the argument `like`; None without any."""
    if depths is None and boxes3d is None:
        return None
    found: CueArrays = {
        "depth": None,
        "depth_sd": None,
        "depth_source": _NO_NAMES,
        "center": None,
        "half_extents": None,
        "rotation": None,
        "frame": _NO_NAMES,
        "sd": None,
        "covariance": None,
        "source": _NO_NAMES,
    }
    if depths is not None:
        _add_depths(found, depths, count, like)
    if boxes3d is not None:
        _add_boxes3d(found, boxes3d, count, like)
    return found


def _add_depths(found: CueArrays, depths: Any, count: int, like: str) -> None:
    fields = depths if isinstance(depths, Mapping) else {"median": depths}
    _known("depths", fields, ("median", "sd", "source"))
    if fields.get("median") is None:
        raise QuadliftError('depths has no "median"; expected the depths of the detections')
    name = 'depths["median"]' if fields is depths else "depths"
    found["depth"] = _rows(name, fields["median"], count, like)
    found["depth_sd"] = _of_all('depths["sd"]', fields.get("sd"), count, like)
    found["depth_source"] = _sources('depths["source"]', fields.get("source"), count, like)


def _add_boxes3d(found: CueArrays, boxes3d: Any, count: int, like: str) -> None:
    known = ("center", "half_extents", "rotation", "frame", "sd", "covariance", "source")
    if not isinstance(boxes3d, Mapping):
        raise QuadliftError(f"boxes3d is a {type(boxes3d).__name__}; expected a mapping with {', '.join(known[:3])}")
    _known("boxes3d", boxes3d, known)
    if all(boxes3d.get(name) is None for name in known[:3]):
        raise QuadliftError("boxes3d has neither center nor half_extents nor rotation; expected one of them")
    frame = _sources('boxes3d["frame"]', boxes3d.get("frame"), count, like)
    for name in frame[1]:
        if name not in ("camera", "world"):
            raise QuadliftError(f'boxes3d["frame"] has {name!r}; expected "camera" or "world"')

    def rows(name: str, *width: int) -> NDArray[np.float64] | None:
        value = boxes3d.get(name)
        return None if value is None else _rows(f'boxes3d["{name}"]', value, count, like, *width)

    covariance = rows("covariance", 9, 9)
    found["center"], found["half_extents"], found["rotation"] = (
        rows("center", 3),
        rows("half_extents", 3),
        rows("rotation", 4),
    )
    found["frame"] = frame
    found["sd"] = _deviations(boxes3d.get("sd"), count, like)
    found["covariance"] = None if covariance is None else covariance.reshape(count, 81)
    found["source"] = _sources('boxes3d["source"]', boxes3d.get("source"), count, like)


def _deviations(sd: Any, count: int, like: str) -> NDArray[np.float64] | None:
    """(M, 4)."""
    if sd is None:
        return None
    known = ("distance", "direction", "size", "rotation")
    if not isinstance(sd, Mapping):
        raise QuadliftError(f'boxes3d["sd"] is a {type(sd).__name__}; expected a mapping with {", ".join(known)}')
    _known('boxes3d["sd"]', sd, known)
    of_kind = [_of_all(f'boxes3d["sd"]["{name}"]', sd.get(name), count, like) for name in known]
    return np.column_stack([np.full(count, np.nan) if values is None else values for values in of_kind])


def _known(name: str, fields: Mapping[str, Any], known: tuple[str, ...]) -> None:
    unknown = [field for field in fields if field not in known]
    if unknown:
        raise QuadliftError(f"{name} has the field {unknown[0]!r}; expected {', '.join(map(repr, known))}")


def _rows(name: str, value: Any, count: int, like: str, *width: int) -> NDArray[np.float64]:
    numbers = _checks.array(name, value, ("M", *width), nan=True)
    _checks.rows(name, numbers, like, count)
    return numbers


def _of_all(name: str, value: Any, count: int, like: str) -> NDArray[np.float64] | None:
    """(M,) of (M,) or one number."""
    if value is None:
        return None
    numbers = _checks.array(name, value, ("M",), (), nan=True)
    if numbers.ndim == 0:
        return np.full(count, numbers.item())
    _checks.rows(name, numbers, like, count)
    return numbers


def _sources(name: str, value: Any, count: int, like: str) -> Names:
    if isinstance(value, str) and value:
        return np.zeros(count, dtype=np.int64), [_checks.text(name, value)]
    return _checks.names(name, value or None if isinstance(value, str) else value, count, like)
