"""Limits on what files may hold."""

from __future__ import annotations

from . import _checks, _core


def set_max_pixels(pixels: int) -> None:
    """Sets how many pixels an image or mask may have in this process; 160 million at first.

    A file of a few kilobytes can hold an image that fills the memory. Larger ones are refused before they are decoded.

    Parameters
    ----------
    pixels : int
        Width times height.
    """
    _core.set_max_pixels(_checks.whole("pixels", pixels, 1, 2**63 - 1))
