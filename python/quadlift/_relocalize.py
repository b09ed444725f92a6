"""The camera of an image, from its boxes and a map of objects."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _checks
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ._arrays import LocateQuery


@dataclass(frozen=True, eq=False)
class LocatedPose:
    """A pose that explains the boxes of an image.

    Attributes
    ----------
    cam_from_world : ndarray, shape (3, 4)
        The pose: maps world points to camera points.
    covariance : ndarray, shape (6, 6)
        Covariance of its errors in the axes of the camera: rotation vector (radians), position (world units).
    rotation_sd, position_sd : float
        Standard deviations, root mean squares of the axes: radians, world units.
    evidence : float
        Log odds against boxes that come from nowhere (natural logarithm).
    objects : list
        For each box the id of the object that it shows; None where the pose does not explain it.
    """

    cam_from_world: NDArray[np.float64]
    covariance: NDArray[np.float64]
    rotation_sd: float
    position_sd: float
    evidence: float
    objects: list[Any]


@dataclass(frozen=True, eq=False)
class Location:
    """Where the camera of an image is.

    Attributes
    ----------
    status : str
        ``"ok"``; ``"ambiguous"``: several poses explain the boxes; ``"no_pose"``: none explains them better than
        chance; ``"too_few_objects"``: fewer than three boxes (two with gravity) whose categories are in the map;
        ``"too_many_alike"``: hundreds of boxes may each show hundreds of objects.
    poses : list of LocatedPose
        Poses that explain the boxes, the most probable first. Trust the first one only if `ok`.
    """

    status: str
    poses: list[LocatedPose]

    @property
    def ok(self) -> bool:
        """Whether the first pose can be trusted."""
        return self.status == "ok"

    @property
    def cam_from_world(self) -> NDArray[np.float64] | None:
        """The pose, shape (3, 4), if it can be trusted."""
        return self.poses[0].cam_from_world if self.ok else None

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Its covariance, shape (6, 6)."""
        return self.poses[0].covariance if self.ok else None

    @property
    def objects(self) -> list[Any] | None:
        """For each box the id of the object that it shows, or None."""
        return self.poses[0].objects if self.ok else None

    @classmethod
    def _of(cls, found: dict[str, Any], id_of: Callable[[int], Any]) -> Location:
        def pose(one: dict[str, Any]) -> LocatedPose:
            rotation_sd, position_sd = one.pop("sds").tolist()
            objects = [None if index is None else id_of(index) for index in one.pop("objects")]
            return LocatedPose(rotation_sd=rotation_sd, position_sd=position_sd, objects=objects, **one)

        return cls(found["status"], [pose(one) for one in found["poses"]])


class Relocalizes:
    """Objects by which cameras are located: `Estimates` and `ObjectMap`."""

    def _relocalized(self, query: LocateQuery) -> Location:
        raise NotImplementedError

    def relocalize(
        self,
        boxes: ArrayLike,
        intrinsics: ArrayLike,
        *,
        categories: ArrayLike | None = None,
        image_size: tuple[float, float] | None = None,
        edge_noise: float | None = None,
        up: ArrayLike | None = None,
        up_in_camera: ArrayLike | None = None,
        up_sd_deg: float = 1.0,
        height: tuple[float, float] | None = None,
    ) -> Location:
        """The camera of an image, from its boxes and these objects, like `quadlift relocalize`.

        Appearance and ids are not used: objects are told apart by category, size and place. An `ObjectMap` has
        its confirmed objects, and is not changed.

        Parameters
        ----------
        boxes : array_like, shape (M, 4)
            ``[x0, y0, x1, y1]`` in pixels without lens distortion.
        intrinsics : array_like, shape (3, 3)
            The camera.
        categories : array_like of str or int, shape (M,), optional
            A box shows only objects of its category; without one any object.
        image_size : tuple, optional
            Width and height in pixels: edges at the border may be cut off there.
        edge_noise : float, optional
            Standard deviation of the edges of boxes, relative to their half size. That of the map by default.
        up : str or array_like, shape (3,), optional
            The direction against gravity in the world, for `up_in_camera` and `height`.
        up_in_camera : array_like, shape (3,), optional
            The same in the axes of the camera, where a sensor tells it: two boxes are then enough.
        up_sd_deg : float
            Its standard deviation, degrees.
        height : tuple, optional
            Height of the camera along `up`, from the origin of the world, and its standard deviation, world units.

        Returns
        -------
        Location
        """
        found = _checks.array("boxes", boxes, ("M", 4))
        k = _checks.array("intrinsics", intrinsics, (3, 3))
        if not np.array_equal(k, [[k[0, 0], 0, k[0, 2]], [0, k[1, 1], k[1, 2]], [0, 0, 1]]):
            raise QuadliftError("intrinsics: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        size = None if image_size is None else _checks.array("image_size", image_size, (2,)).tolist()
        if size is not None and min(size) <= 0:
            raise QuadliftError(f"image_size is {image_size!r}; expected width and height above 0")
        query: LocateQuery = {
            "boxes": found,
            "categories": _checks.names("categories", categories, len(found), "boxes"),
            "intrinsics": [k[0, 0], k[1, 1], k[0, 2], k[1, 2]],
            "image_size": size,
            "edge_noise": None if edge_noise is None else _positive("edge_noise", edge_noise),
            "up": _checks.optional(_checks.direction, "up", up),
            "up_in_camera": _checks.optional(_checks.direction, "up_in_camera", up_in_camera),
            "up_sd": math.radians(_positive("up_sd_deg", up_sd_deg)),
            "height": _height(height),
        }
        return self._relocalized(query)


def _positive(name: str, value: Any) -> float:
    found = _checks.number(name, value)
    if found <= 0:
        raise QuadliftError(f"{name} is {value!r}; expected a number above 0")
    return found


def _height(value: tuple[float, float] | None) -> list[float] | None:
    if value is None:
        return None
    found = _checks.array("height", value, (2,))
    return [float(found[0]), _positive("height[1], its standard deviation,", float(found[1]))]
