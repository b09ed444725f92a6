"""Fixed cameras from the boxes of what stands or walks by."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _checks, _core
from ._core import QuadliftError
from ._estimates import InconsistentSceneWarning

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from . import _arrays


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """A fixed camera.

    Attributes
    ----------
    status : str
        ``"ok"``; ``"given"``: it had a pose; ``"not_connected"``: it sees fewer than five bodies together with the
        calibrated cameras; ``"inconsistent"``: the others contradict its boxes; ``"ambiguous"``: two poses fit;
        ``"undetermined"``: its boxes leave the pose open.
    cam_from_world : ndarray, shape (3, 4), or None
        The pose, if the status is ``"ok"`` or ``"given"``.
    covariance : ndarray, shape (6, 6), or None
        Covariance of its errors relative to the reference camera, in the axes of the camera: rotation vector (radians),
        position (world units). None of the reference and of given cameras.
    rotation_sd, position_sd : float or None
        Standard deviations, root mean squares of the axes: radians, world units.
    time_steps : int
        Time steps at which it sees bodies together with calibrated cameras.
    residual_px : float or None
        Root mean square distance of measured and predicted edges, pixels.
    edge_noise : float or None
        Standard deviation of its edges, relative to the mean half size of their boxes.
    contradiction : str or None
        What speaks against it: ``"other_bodies"``, ``"noise"``, ``"focal_length"``, ``"late"``, ``"mirrored"`` or
        ``"given_poses"``.
    """

    status: str
    cam_from_world: NDArray[np.float64] | None
    covariance: NDArray[np.float64] | None
    rotation_sd: float | None
    position_sd: float | None
    time_steps: int
    residual_px: float | None
    edge_noise: float | None
    contradiction: str | None

    @property
    def ok(self) -> bool:
        """Whether it has a pose."""
        return self.cam_from_world is not None


@dataclass(frozen=True, eq=False)
class RigCalibration:
    """The cameras of a rig.

    Attributes
    ----------
    cameras : list of CalibratedCamera
        In the order of the input.
    reference : int or None
        The camera in whose frame the others were found; None if a pose was given, or no two cameras see the same.
    scale : str
        What tells the unit: ``"given_poses"``, ``"baselines"``, ``"sizes"`` (meters), or ``"arbitrary"``: the object
        that is seen most is one unit high.
    scale_sd : float or None
        Relative standard deviation of the scale, where sizes tell it.
    up : ndarray, shape (3,), or None
        Upwards in the world, where upright bodies tell it: then z, with the origin on the floor below the reference.
    up_sd : float or None
        Its standard deviation, each way, radians.
    edge_noise : float or None
        Standard deviation of the edges of boxes as it was estimated, relative to their mean half size.
    consistent : bool
        Whether no camera contradicts the others.
    """

    cameras: list[CalibratedCamera]
    reference: int | None
    scale: str
    scale_sd: float | None
    up: NDArray[np.float64] | None
    up_sd: float | None
    edge_noise: float | None
    consistent: bool

    @property
    def ok(self) -> bool:
        """Whether all cameras have poses."""
        return all(camera.ok for camera in self.cameras)


def calibrate_rig(
    boxes: ArrayLike,
    cameras: ArrayLike,
    time_steps: ArrayLike,
    intrinsics: ArrayLike,
    *,
    objects: ArrayLike | None = None,
    categories: ArrayLike | None = None,
    image_sizes: ArrayLike | None = None,
    cam_from_world: ArrayLike | None = None,
    baselines: Sequence[tuple[int, int, float]] = (),
    sizes: str | None = "builtin",
    upright: Sequence[str] = (),
    static: Sequence[str] = (),
    seed: int = 0,
) -> RigCalibration:
    """Poses of fixed, synchronized cameras from what stands or walks by, like `quadlift calibrate-rig`.

    Parameters
    ----------
    boxes : array, shape (M, 4)
        Left, top, right, bottom in pixels, without lens distortion.
    cameras, time_steps : arrays of M integers
        The camera of each box, from 0, and its time step: the same number for all cameras, in the order of time.
    intrinsics : array, shape (C, 3, 3)
        ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` of each camera.
    objects : M names, optional
        The same in all cameras and at all time steps; None where it is not known. Boxes without one are matched by
        where they are.
    categories : M names, optional
        Categories; boxes without one are taken as those of people of unknown size.
    image_sizes : array, shape (C, 2), optional
        Width and height of the images: boxes at the border are cut off there.
    cam_from_world : array, shape (C, 3, 4), optional
        Poses that are known and kept; NaN for cameras that are sought.
    baselines : sequence of (camera, camera, length)
        Known baselines between the centers of two cameras: they tell the scale.
    sizes : "builtin" or None
        Whether usual sizes of categories, in meters, tell the scale. Say None if baselines or poses have another unit.
    upright, static : sequences of categories
        Which bodies are upright (default: people, road vehicles and furniture of the built-in priors), and which stay
        where they are.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    RigCalibration
        Cameras whose boxes leave the pose open have none, and a status that says why.

    Warns
    -----
    InconsistentSceneWarning
        Cameras contradict each other; the message names them.

    Raises
    ------
    QuadliftError
        The message names the invalid argument.
    """
    found = _checks.array("boxes", boxes, ("M", 4))
    k = _checks.array("intrinsics", intrinsics, ("C", 3, 3))
    for index, matrix in enumerate(k):
        if not np.array_equal(matrix, [[matrix[0, 0], 0, matrix[0, 2]], [0, matrix[1, 1], matrix[1, 2]], [0, 0, 1]]):
            raise QuadliftError(f"intrinsics[{index}]: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    count = len(k)
    numbers = {}
    for name, value in (("cameras", cameras), ("time_steps", time_steps)):
        numbers[name] = _checks.indices(name, value)
        _checks.rows(name, numbers[name], "boxes", len(found))
    if sizes not in ("builtin", None):
        raise QuadliftError(f'sizes is {sizes!r}; expected "builtin" or None')
    arrays: _arrays.RigArrays = {
        "boxes": found,
        "cameras": numbers["cameras"],
        "time_steps": numbers["time_steps"],
        "objects": _checks.names("objects", objects, len(found), "boxes"),
        "categories": _checks.names("categories", categories, len(found), "boxes"),
        "intrinsics": k,
        "image_sizes": None if image_sizes is None else _checks.array("image_sizes", image_sizes, (count, 2)),
        "cam_from_world": (
            None if cam_from_world is None else _checks.array("cam_from_world", cam_from_world, (count, 3, 4), nan=True)
        ),
        "baselines": [_distance(index, known, count) for index, known in enumerate(baselines)],
        "builtin_sizes": sizes is not None,
        "upright": [_checks.text("upright", name) for name in upright],
        "still": [_checks.text("static", name) for name in static],
        "seed": _checks.whole("seed", seed, 0),
    }
    answer: dict[str, Any] = _core.calibrate_rig(arrays)
    if (words := answer.pop("contradictions")) is not None:
        warnings.warn(f"the cameras are inconsistent: {words}", InconsistentSceneWarning, stacklevel=2)
    answer["cameras"] = [CalibratedCamera(**camera) for camera in answer["cameras"]]
    return RigCalibration(**answer)


def _distance(index: int, known: tuple[int, int, float], count: int) -> tuple[int, int, float]:
    name = f"baselines[{index}]"
    if len(known) != 3:
        raise QuadliftError(f"{name} is {known!r}; expected (camera, camera, length)")
    first, second = (_checks.whole(name, camera, 0, count - 1) for camera in known[:2])
    length = _checks.number(name, known[2])
    if first == second or not length > 0:
        raise QuadliftError(f"{name} is {known!r}; expected two different cameras and a length above 0")
    return first, second, length
