"""Options: types and kinds, written from crates/quadlift-io/src/options by the tests of the program.

Do not edit; after a change of a table: ``QUADLIFT_UPDATE_DOCS=1 cargo test --test program python_options``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypedDict


class RunOptions(TypedDict, total=False):
    """Options of a run, as the program has them."""

    method: Literal["posterior", "planes", "lfd", "pfd", "reg"]
    """Estimator: posterior (refinement, the best), planes, lfd and pfd (closed forms), reg (the regularized one).
    Default: "posterior"."""
    reg_weight: float | None
    """Weight of the regularizer [default: 1e16]."""
    body: Literal["auto", "ellipsoid", "cuboid", "cylinder", "rounded"]
    """Kind of body to fit: ellipsoid, cuboid, cylinder, rounded (between cuboid and ellipsoid), or auto: selected
    for each object, an ellipsoid without evidence for another kind. Default: "auto"."""
    source: str | None
    """Use only the detections of this source; required if the scene has several."""
    measurement: Literal["auto", "box", "ellipse", "box+ellipse", "mask"]
    """Measurements to use: auto (what a detection has; if both, the box for position and size, the ellipse for
    shape), box, ellipse, box+ellipse, or mask (its outline, with posterior and planes; also outlines and oriented
    boxes). Detections without the selected measurement are skipped. Default: "auto"."""
    associate: Literal["auto", "never", "always"]
    """Associate detections that show the same object first: auto (if any lack an id), never or always. Default:
    "auto"."""
    ids: Literal["trust", "evidence", "ignore"] | None
    """How far to trust existing ids: trust, evidence or ignore [default: trust; evidence if all detections are
    associated]."""
    min_views: int
    """Skip objects with fewer views; planes, lfd and pfd need three. Default: 2."""
    max_occluded: float | None
    """Skip detections that are more occluded (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown)."""
    max_truncated: float | None
    """Skip detections that are more truncated (KITTI: 0 entirely inside the image)."""
    learn_sizes: bool
    """Learn the size of each category from its other objects; sizes of priors win."""
    upright: bool
    """Detect which objects stand upright (with an axis along the scene's `up`). Default: True."""
    ground_plane: bool
    """All objects stand on a common ground plane, which is estimated (the scene needs `up`)."""
    camera_height: float | None
    """Height of the cameras above the ground plane in world units, if known, such as 1.5."""
    refine_poses: Literal["auto", "independent", "slow"] | None
    """Correct the poses together with the objects. Errors of frames are independent, or slow (GPS, drifting
    odometry); auto decides by the boxes. Results have the corrected poses."""
    fixed_extrinsics: bool
    """Take the places of cameras in their rig as exact: refined poses are those of the rig alone (frames with the
    same `rig_frame` are taken by one rig)."""
    pose_noise: tuple[float, float] | None
    """Correct the poses: standard deviations of the rotation (radians) and shift (world units) of each frame, such
    as 0.01,0.05."""
    noise_model: Mapping[str, float] | None
    """Use given noise levels instead of estimating them, by name (edge_noise=0.03,edge_noise_px=2), or those of an
    earlier result. Objects are then estimated independently of each other."""
    cross_validate: bool
    """Leave out each view of each object, predict its box from the others, and report the agreement: a measure of
    quality without ground truth. Takes several times as long; the summary always checks a sample of views."""
    enclosing: bool
    """Add to each object the ellipsoid that encloses it, parts of which may lie outside of its body: that of the
    paper's tables."""
    allow_inconsistent: bool
    """Continue with an inconsistent scene."""


RUN_KINDS = {
    "method": "text",
    "reg_weight": "number",
    "body": "text",
    "source": "text",
    "measurement": "text",
    "associate": "text",
    "ids": "text",
    "min_views": "whole",
    "max_occluded": "number",
    "max_truncated": "number",
    "learn_sizes": "flag",
    "upright": "flag",
    "ground_plane": "flag",
    "camera_height": "number",
    "refine_poses": "text",
    "fixed_extrinsics": "flag",
    "pose_noise": "numbers",
    "noise_model": "levels",
    "cross_validate": "flag",
    "enclosing": "flag",
    "allow_inconsistent": "flag",
}
"""The kind of value of each of them."""

OF_OBJECTS = frozenset(
    {
        "method",
        "reg_weight",
        "body",
        "min_views",
        "noise_model",
    }
)
"""Those that concern single objects."""


class AssociationOptions(TypedDict, total=False):
    """Options of an association."""

    source: str | None
    """Use only the detections of this source; required if the scene has several."""
    ids: Literal["trust", "evidence", "ignore"]
    """How far to trust existing ids: trust (keep them), evidence (they may be wrong) or ignore. Default:
    "evidence"."""
    thorough: bool
    """Search from several starts: takes about four times as long, better with few views."""
    min_views: int
    """Skip objects with fewer views. Default: 3."""
    min_score: float | None
    """Skip detections with a lower score, such as 0.5."""
    max_overlap: float | None
    """Skip detections that overlap a better one of the same frame and category by more than this (intersection over
    union)."""
    edge_noise_px: float | None
    """Error of box edges that does not depend on the size of the box, in pixels [default: 2, 4 or 8, the largest
    that the evidence supports]."""


ASSOCIATION_KINDS = {
    "source": "text",
    "ids": "text",
    "thorough": "flag",
    "min_views": "whole",
    "min_score": "number",
    "max_overlap": "number",
    "edge_noise_px": "number",
}
"""The kind of value of each of them."""


class SegmentationOptions(TypedDict, total=False):
    """Options of a segmentation."""

    method: Literal["graphcut", "sca", "masks"]
    """Segmentation method: graphcut, sca or masks (those of the scene). Default: "graphcut"."""
    source: str | None
    """Segment only the detections of this source; required if the scene has several."""
    seed: int
    """Seed of the random numbers. Default: 0."""


SEGMENTATION_KINDS = {
    "method": "text",
    "source": "text",
    "seed": "whole",
}
"""The kind of value of each of them."""


class MapOptions(TypedDict, total=False):
    """Options of an object map."""

    ids: Literal["trust", "evidence", "ignore"]
    """How far to trust the ids of detections (of a tracker): trust, evidence or ignore. Default: "evidence"."""
    min_views: int
    """Views that an object needs to be confirmed. Default: 3."""
    min_score: float | None
    """Skip detections with a lower score."""
    edge_noise_px: float | None
    """Error of box edges that does not depend on the size of the box, in pixels [default: 2, 4 or 8, selected as
    the evidence grows]."""
    max_views: int
    """Views that an object keeps; the others are forgotten, those that add least first. Default: 32."""
    max_objects: int
    """Objects that the map keeps. Default: 100000."""


MAP_KINDS = {
    "ids": "text",
    "min_views": "whole",
    "min_score": "number",
    "edge_noise_px": "number",
    "max_views": "whole",
    "max_objects": "whole",
}
"""The kind of value of each of them."""
