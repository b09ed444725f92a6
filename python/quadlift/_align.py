"""Two maps of one place, brought together by their objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ._scene import Scene


@dataclass(frozen=True, eq=False)
class MapTransform:
    """A transform that brings two maps together.

    Attributes
    ----------
    a_from_b : ndarray, shape (4, 4)
        Maps points of the second map to the first one: ``[[s R, t], [0, 1]]``.
    scale : float
        How long a unit of the second map is in units of the first one.
    quaternion : ndarray, shape (4,)
        The rotation: a unit quaternion, w first.
    translation : ndarray, shape (3,)
        Where the origin of the second map is, in the first one.
    covariance : ndarray, shape (7, 7)
        Covariance of the motion that is left, in the frame of the first map about `pivot`: rotation vector (radians),
        translation, logarithm of the scale. With a known scale its row and column are 0.
    pivot : ndarray, shape (3,)
        The middle of the matched objects, in the first map.
    rotation_sd, position_sd, log_scale_sd : float
        Standard deviations, of rotation (radians) and position root mean squares of the axes.
    evidence : float
        Log odds against maps that have nothing in common (natural logarithm).
    matches : list of tuple of str
        Which object of the first map is which one of the second: their ids.
    """

    a_from_b: NDArray[np.float64]
    scale: float
    quaternion: NDArray[np.float64]
    translation: NDArray[np.float64]
    covariance: NDArray[np.float64]
    pivot: NDArray[np.float64]
    rotation_sd: float
    position_sd: float
    log_scale_sd: float
    evidence: float
    matches: list[tuple[str, str]]

    @classmethod
    def _of(cls, record: dict[str, Any]) -> MapTransform:
        of_b = record["a_from_b"]
        w, x, y, z = of_b["rotation"]
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        a_from_b = np.eye(4)
        a_from_b[:3, :3] = of_b["scale"] * rotation
        a_from_b[:3, 3] = of_b["translation"]
        return cls(
            a_from_b=a_from_b,
            scale=of_b["scale"],
            quaternion=np.array(of_b["rotation"]),
            translation=np.array(of_b["translation"]),
            covariance=np.array(record["covariance"]),
            pivot=np.array(record["pivot"]),
            rotation_sd=record["rotation_sd"],
            position_sd=record["position_sd"],
            log_scale_sd=record["log_scale_sd"],
            evidence=record["evidence"],
            matches=[(match["a"], match["b"]) for match in record["matches"]],
        )


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where one map lies in another.

    Attributes
    ----------
    status : str
        ``"ok"``; ``"ambiguous"``: the objects do not decide it; ``"no_alignment"``: no transform explains the maps
        better than chance; ``"too_few_objects"``: fewer than three objects (two with a common vertical) of categories
        of both.
    reason : str or None
        Why it is ambiguous: ``"several"`` (different transforms explain the maps about as well), ``"rotation_open"``
        (as objects in one row leave it), ``"scale_open"`` or ``"not_searched"`` (too many objects are alike).
    contradiction : str or None
        ``"scale"``: by the objects it is another one than the known one; ``"up"``: only without `up` the maps can be
        aligned; ``"mirrored"``: the mirror image of the second map fits clearly better.
    transforms : list of MapTransform
        Transforms that explain the maps, the most probable first. Trust the first one only if `ok`.
    merged : Scene or None
        Both maps in the frame of the first one, if `ok`: matched objects have one id.
    """

    status: str
    reason: str | None
    contradiction: str | None
    transforms: list[MapTransform]
    merged: Scene | None

    @property
    def ok(self) -> bool:
        """Whether the first transform can be trusted."""
        return self.status == "ok"

    @property
    def consistent(self) -> bool:
        """Whether neither units nor `up` contradict the objects."""
        return self.contradiction is None

    @property
    def a_from_b(self) -> NDArray[np.float64] | None:
        """The transform, shape (4, 4), if it can be trusted."""
        return self.transforms[0].a_from_b if self.ok else None

    @property
    def matches(self) -> list[tuple[str, str]] | None:
        """Ids of objects of the first and the second map that are one."""
        return self.transforms[0].matches if self.ok else None

    @classmethod
    def _of(cls, record: dict[str, Any], merged: Scene | None) -> Alignment:
        records = record.get("alternatives", [])
        if "a_from_b" in record:
            records = [record, *records]
        transforms = [MapTransform._of(one) for one in records]
        return cls(record["status"], record.get("reason"), record["contradiction"], transforms, merged)
