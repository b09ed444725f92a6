"""pyarrow, for modules that are of no use without it."""

from __future__ import annotations

try:
    import pyarrow as pa
    import pyarrow.compute as pc
except ImportError as error:
    raise ImportError("tables need pyarrow: pip install pyarrow") from error

__all__ = ["pa", "pc"]
