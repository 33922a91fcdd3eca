"""What a notebook shows of a result that has no table."""

from __future__ import annotations

import html


class HtmlText:
    """A record that a notebook shows as it is printed."""

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"
