"""The main entry point: arrays in, arrays out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from . import _options
from ._arrays import SceneFields
from ._scene import Estimates, Scene

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack


class LocalizeArguments(SceneFields, _options.Options, total=False):
    """Arguments of `localize`."""


def localize(
    intrinsics: ArrayLike | None = None,
    cam_from_world: ArrayLike | None = None,
    boxes: ArrayLike | None = None,
    frames: ArrayLike | None = None,
    objects: ArrayLike | None = None,
    **arguments: Unpack[LocalizeArguments],
) -> Estimates:
    """Localizes all objects of M detections in F posed images.

    Parameters
    ----------
    intrinsics : array_like, shape (3, 3) or (F, 3, 3)
        Pinhole cameras ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` in pixels: one for all frames or one for each.
    cam_from_world : array_like, shape (F, 3, 4) or (F, 4, 4)
        Poses ``[R | t]``, world to camera, OpenCV's axes.
    boxes : array_like, shape (M, 4), optional
        ``[x0, y0, x1, y1]`` in pixels; a row of NaN means none.
    frames : array_like of int or str, shape (M,)
        The detections' frames: indices, 0 to F - 1, or ids.
    objects : array_like of int or str, shape (M,), optional
        The objects of the detections; negative numbers, None and "" mean unknown. If any is unknown, or without this
        argument, the detections are associated first.
    **arguments : LocalizeArguments
        Frames, see `quadlift.FrameFields`: ``projections``, ``distortion``, ``image_sizes``, ``frame_ids``, ``images``,
        ``name``, ``up``, ``length_unit``. Detections, see `quadlift.DetectionFields`: ``ellipses``, ``masks``,
        ``outlines``, ``oriented_boxes``, ``scores``, ``categories``, ``depths``, ``boxes3d``, ``orientation``. The
        options of the program with its defaults, see `quadlift.Options`.

    Returns
    -------
    Estimates
        In ascending order of the objects if all were given.

    Raises
    ------
    QuadliftError
        Names the argument, what was found and what was expected. A single object that cannot be solved is not an error;
        its status gives the reason.

    Warns
    -----
    InconsistentSceneWarning
        If poses, cameras and boxes are inconsistent: no object is ``"ok"`` then, and without ids there may be none.
        Names the mistake and its correction, such as ``corrected("poses=opengl")``: `Estimates.corrected`.

    Notes
    -----
    Releases the GIL; Ctrl-C works.
    """
    given = cast("dict[str, Any]", arguments)
    arrays = {name: given.pop(name) for name in SceneFields.__annotations__ if name in given}
    keywords, threads, progress = _options.split(cast("_options.Options", given), "localize")
    scene = Scene.from_arrays(intrinsics, cam_from_world, boxes, frames, objects, **arrays)
    localized = scene._core.localize(keywords, threads, progress)
    ids = "found"
    if objects is not None and not localized.associated:
        ids = "numbers" if np.asarray(objects).dtype.kind in "iuf" else "texts"
    return Estimates._of(localized, ids)._warned(2)
