"""Reports in notebooks."""

from __future__ import annotations

import html


def in_notebook(page: str) -> str:
    """An HTML report for the cell of a notebook."""
    return (
        f'<iframe srcdoc="{html.escape(page)}" sandbox="allow-scripts allow-downloads" loading="lazy" '
        'style="width: 100%; height: 640px; border: 0"></iframe>'
    )
