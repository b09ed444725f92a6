"""Pages in notebooks."""

from __future__ import annotations

import html


def in_notebook(page: str) -> str:
    """A page of HTML as it stands in the cell of a notebook."""
    return (
        f'<iframe srcdoc="{html.escape(page)}" sandbox="allow-scripts allow-downloads" loading="lazy" '
        'style="width: 100%; height: 640px; border: 0"></iframe>'
    )
