"""quadlift lifts 2D detections from posed images to 3D objects.

`localize` takes arrays and gives arrays; `Scene` holds posed frames and detections, reads and writes files and converts
objects of other packages; `ObjectMap` keeps a map of objects while frames arrive. Camera axes are OpenCV's (x right, y
down, z forward), pixels are measured from the corner of the image (the first pixel's center is at 0.5, 0.5), angles are
radians, quaternions have w first, and the world unit is arbitrary.
"""

from __future__ import annotations

from ._align import Alignment, MapTransform
from ._arrays import DetectionFields, FrameFields
from ._calibrate_rig import CalibratedCamera, RigCalibration, calibrate_rig
from ._core import QuadliftError, __version__
from ._cues import Box3dSd, Boxes3d, Depths
from ._estimates import Alternative, AssociatedObject, Estimate, Evaluation, InconsistentSceneWarning
from ._formats import CameraOptions, DetectionOptions, ExportOptions
from ._limits import set_max_pixels
from ._localize import localize
from ._object_map import FrameUpdate, MapObject, MapObjects, ObjectMap
from ._options import AssociateOptions, ObjectMapOptions, Options, Prior, SegmentOptions
from ._relocalize import LocatedPose, Location
from ._rerun import log_recording
from ._scene import Estimates, Scene

__all__ = [
    "Alignment",
    "Alternative",
    "AssociateOptions",
    "AssociatedObject",
    "Box3dSd",
    "Boxes3d",
    "CalibratedCamera",
    "CameraOptions",
    "Depths",
    "DetectionFields",
    "DetectionOptions",
    "Estimate",
    "Estimates",
    "Evaluation",
    "ExportOptions",
    "FrameFields",
    "FrameUpdate",
    "InconsistentSceneWarning",
    "LocatedPose",
    "Location",
    "MapObject",
    "MapObjects",
    "MapTransform",
    "ObjectMap",
    "ObjectMapOptions",
    "Options",
    "Prior",
    "QuadliftError",
    "RigCalibration",
    "Scene",
    "SegmentOptions",
    "__version__",
    "calibrate_rig",
    "localize",
    "log_recording",
    "set_max_pixels",
]
