"""How what matplotlib has drawn looks, in Bokeh's words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import Collection, PathCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.lines import Line2D

#: Pixels of a point of print.
PIXELS = 1.35
MARKERS = {
    "o": "circle",
    ".": "circle",
    "^": "triangle",
    "p": "square_pin",
    "D": "diamond",
    "s": "square",
    "v": "inverted_triangle",
    "h": "hex",
    "P": "cross",
    "X": "x",
    "*": "star",
    "<": "triangle_dot",
    ">": "square_dot",
    "_": "dash",
    "+": "cross",
    "x": "x",
}
_NO_COLOUR = (0.0, 0.0, 0.0, 0.0)
_DASHES = {"-": "solid", "--": "dashed", ":": "dotted", "-.": "dashdot"}


@dataclass(frozen=True)
class Look:
    """Colours (hex), marker (empty: none), dash (empty: no line), sizes in pixels, opacity."""

    colour: str
    fill: str = ""
    marker: str = ""
    dash: str = ""
    size: float = 0.0
    width: float = 0.0
    alpha: float = 1.0

    @property
    def line(self) -> dict[str, Any]:
        """Properties of a line."""
        return {
            "line_color": self.colour,
            "line_dash": self.dash or "solid",
            "line_width": self.width,
            "line_alpha": self.alpha,
        }

    @property
    def marks(self) -> dict[str, Any]:
        """Properties of markers."""
        return {
            "marker": self.marker,
            "size": self.size,
            "line_color": self.colour,
            "fill_color": self.fill or None,
            "line_alpha": self.alpha,
            "fill_alpha": self.alpha,
        }


def look_of(artist: Artist) -> Look:
    """The look of a line, of markers, or of a collection of them.

    Args:
        artist: as it is drawn.
    """
    if isinstance(artist, Line2D):
        return _of_line(artist)
    if isinstance(artist, Collection):
        return _of_collection(artist)
    face = artist.get_facecolor() if hasattr(artist, "get_facecolor") else "black"
    return Look(to_hex(face), fill=to_hex(face), alpha=_alpha(artist, face))


def _of_line(line: Line2D) -> Look:
    marker = MARKERS.get(str(line.get_marker()), "")
    edge = line.get_markeredgecolor() if marker else line.get_color()
    open_ = line.get_fillstyle() == "none" or to_rgba(line.get_markerfacecolor())[3] == 0.0
    return Look(
        colour=to_hex(line.get_color() if line.get_linestyle() in _DASHES else edge),
        fill="" if open_ or not marker else to_hex(line.get_markerfacecolor()),
        marker=marker,
        dash=_DASHES.get(str(line.get_linestyle()), ""),
        size=PIXELS * line.get_markersize(),
        width=max(1.0, PIXELS * line.get_linewidth()),
        alpha=_alpha(line, line.get_color()),
    )


def _of_collection(found: Collection) -> Look:
    edge, face = _first(found.get_edgecolor()), _first(found.get_facecolor())
    edge = edge or face or _NO_COLOUR
    sizes = [float(v) for v in found.get_sizes()] if isinstance(found, PathCollection) else []
    widths = np.atleast_1d(np.asarray(found.get_linewidth(), float))
    return Look(
        colour=to_hex(edge),
        fill=to_hex(face) if face and face[3] > 0.0 else "",
        marker="circle" if sizes else "",
        dash="dashed" if any(pattern for _, pattern in _dashes(found)) else "solid",
        size=PIXELS * math.sqrt(sizes[0]) if sizes else 0.0,
        width=max(1.0, PIXELS * float(widths[0])) if widths.size else 1.0,
        alpha=(face and face[3]) or edge[3],
    )


def _dashes(found: Collection) -> list[Any]:
    """Offset and pattern (None: whole lines) of every dash of a collection."""
    return list(found.get_linestyle())


def _first(colours: Any) -> tuple[float, float, float, float] | None:
    """The first of the colours of a collection; None where it has none."""
    rows = np.asarray(colours, float).reshape(-1, 4)
    return None if rows.size == 0 else to_rgba(tuple(rows[0].tolist()))


def _alpha(artist: Artist, colour: Any) -> float:
    own = artist.get_alpha()
    return float(to_rgba(colour)[3]) if own is None else float(own)
