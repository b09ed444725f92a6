"""The main entry point: arrays in, arrays out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from . import _options
from ._scene import Estimates, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from ._cues import Boxes3d, Depths


def localize(
    intrinsics: ArrayLike | None = None,
    cam_from_world: ArrayLike | None = None,
    boxes: ArrayLike | None = None,
    frames: ArrayLike | None = None,
    objects: ArrayLike | None = None,
    *,
    projections: ArrayLike | None = None,
    image_sizes: ArrayLike | None = None,
    ellipses: ArrayLike | None = None,
    masks: Sequence[Any] | None = None,
    outlines: Sequence[ArrayLike | None] | None = None,
    oriented_boxes: ArrayLike | None = None,
    scores: ArrayLike | None = None,
    categories: ArrayLike | None = None,
    depths: Depths | ArrayLike | None = None,
    boxes3d: Boxes3d | None = None,
    orientation: int | str | None = None,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    **options: Unpack[_options.Options],
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
    frames : array_like of int, shape (M,)
        Indices of the detections' frames, 0 to F - 1.
    objects : array_like of int or str, shape (M,), optional
        The objects of the detections; negative numbers, None and "" mean unknown. If any is unknown, or without this
        argument, the detections are associated first.
    projections : array_like, shape (F, 3, 4)
        World to pixels, in the place of `intrinsics` and `cam_from_world`.
    image_sizes : array_like, shape (2,) or (F, 2), optional
        Width and height in pixels. Without them box edges at the image border are not treated as cut off.
    ellipses : array_like, shape (M, 5), optional
        Center x and y, two semi-axes, and the angle of the first (radians, from x towards y); pixels. A row of NaN
        means none. Each detection needs a box, an ellipse, an outline or a turned box.
    masks : sequence of (H, W) arrays or None, length M, optional
        Non-zero pixels are the object; for ``measurement="mask"``.
    outlines : sequence of (K, 2) array_like or None, length M, optional
        Corners of the outlines in pixels, polygons. A detection without a box has the box around its outline.
    oriented_boxes : array_like, shape (M, 5), optional
        Turned boxes: center x and y, width, height, and the angle of the width (radians, from x towards y); pixels. A
        row of NaN means none. With an outline it is not used.
    scores : array_like, shape (M,), optional
        Scores of the detector; NaN means none.
    categories : array_like of int or str, shape (M,), optional
        Categories, by number or name; unknown values as for objects.
    depths : Depths or array_like, shape (M,), optional
        Median depth of the visible surface along the optical axis, world units; NaN means none. As a mapping with
        `median`, and `sd` and `source` if known.
    boxes3d : Boxes3d, optional
        3D boxes from single images: a mapping with any of `center`, `half_extents` and `rotation`, and `frame`, `sd`,
        `covariance`, `source`. With a center a detection needs neither a box nor an ellipse.
    orientation : int or str, optional
        EXIF orientation of the pictures that the detector saw, 1 to 8, if the cameras are those of the pictures as
        stored: 6 for a phone held upright. ``"6-fractions"`` if the boxes were fractions of the turned pictures,
        multiplied by width and height of the cameras' images.
    up : str or array_like, shape (3,), optional
        World direction against gravity: an axis such as ``"-y"``, or a direction.
    length_unit : str, optional
        World unit; ``"m"`` is required for ``priors="builtin"``.
    **options : Options
        The options of the program with its defaults; `quadlift.Options` lists them.

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
        If poses, cameras and boxes are inconsistent: no object is ``"ok"`` then. Names the mistake and its correction.

    Notes
    -----
    Releases the GIL; Ctrl-C works.
    """
    keywords, threads, progress = _options.split(options, "localize")
    scene = Scene.from_arrays(
        projections=projections,
        intrinsics=intrinsics,
        cam_from_world=cam_from_world,
        image_sizes=image_sizes,
        up=up,
        length_unit=length_unit,
    ).with_detections(
        frames=frames,
        boxes=boxes,
        ellipses=ellipses,
        masks=masks,
        outlines=outlines,
        oriented_boxes=oriented_boxes,
        objects=objects,
        scores=scores,
        categories=categories,
        depths=depths,
        boxes3d=boxes3d,
        orientation=orientation,
    )
    localized = scene._core.localize(keywords, threads, progress)
    ids = "found"
    if objects is not None and not localized.associated:
        ids = "numbers" if np.asarray(objects).dtype.kind in "iuf" else "texts"
    return Estimates._of(localized, ids)._warned(2)
