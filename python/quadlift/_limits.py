"""Limits on the content of files."""

from __future__ import annotations

from . import _checks, _core


def set_max_pixels(pixels: int) -> None:
    """Sets the maximum number of pixels of an image or mask in this process; the default is 160 million.

    A file of a few kilobytes can contain an image that fills the memory. Larger images are rejected before they are
    decoded.

    Parameters
    ----------
    pixels : int
        Width times height.
    """
    _core.set_max_pixels(_checks.whole("pixels", pixels, 1, 2**63 - 1))
