"""The numbers that a figure shows, as CSV: what was drawn, in the units of its axes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.figure import Figure

from fitting.text.arrays import FloatArray
from fitting.text.tables import csv_text

#: Where the values of cells were taken, (n, 2): a mesh itself knows their edges alone.
PLACES: WeakKeyDictionary[QuadMesh, FloatArray] = WeakKeyDictionary()
HEADS = ("panel", "series", "along x", "along y", "x", "y")
#: Further columns of a figure with a map: what its colours stand for.
MAP_HEADS = ("colours", "value")
#: What BokehJS would load MathJax for.
_MATHEMATICS = re.compile(r"[$\\]")


@dataclass(frozen=True)
class Shown:
    """What one artist shows at places along both axes: `parts` of (n, 2) points, `label`, `artist`.

    `values` (n,) are those of a map at its points, `colours` what they represent.
    """

    label: str
    artist: Artist
    parts: tuple[FloatArray, ...]
    values: FloatArray
    colours: str = ""

    @property
    def points(self) -> FloatArray:
        """All points, (n, 2)."""
        return np.concatenate([np.empty((0, 2)), *self.parts])


def figure_csv(figure: Figure) -> str:
    """All points of lines, markers, bars and maps of a figure, a row each; bands are left out.

    Columns: the panel by its title (else its number), the series by its label, both axes by
    theirs, which hold offset and unit, and the point; of a figure with a map also what its colours
    represent, and the value.

    Args:
        figure: as it is drawn.
    """
    rows: list[list[str]] = []
    for number, axes in panels_of(figure):
        head = [panel_name(axes, number)]
        along = along_axes(axes)
        for shown in shown_in(axes):
            name = [*head, shown.label, *along]
            places = [[repr(x), repr(y)] for x, y in shown.points.tolist()]
            values = [[shown.colours, repr(v)] for v in shown.values.tolist()] or [[]] * len(places)
            rows += [[*name, *p, *v] for p, v in zip(places, values, strict=True)]
    wide = max(map(len, rows), default=0)
    heads = (*HEADS, *MAP_HEADS) if wide > len(HEADS) else HEADS
    return csv_text([heads, *(row + [""] * (len(heads) - len(row)) for row in rows)])


def panels_of(figure: Figure) -> list[tuple[int, Axes]]:
    """Axes that show something, with their numbers; not the bars that explain colours.

    Args:
        figure: as it is drawn.
    """
    bars = [m.colorbar.ax for axes in figure.axes for m in axes.collections if m.colorbar]
    shown = (axes for axes in figure.axes if axes not in bars)
    return [(k, axes) for k, axes in enumerate(shown, start=1) if axes.get_visible()]


def along_axes(axes: Axes) -> list[str]:
    """What both axes are labelled with, there or where panels share them.

    Args:
        axes: a panel.
    """
    x = [other.get_xlabel() for other in axes.get_shared_x_axes().get_siblings(axes)]
    y = [other.get_ylabel() for other in axes.get_shared_y_axes().get_siblings(axes)]
    own = (axes.get_xlabel(), axes.get_ylabel())
    return [
        bare(next(filter(None, (label, *sorted(others))), ""))
        for label, others in zip(own, (x, y), strict=True)
    ]


def panel_name(axes: Axes, number: int) -> str:
    """Title of a panel, else its number.

    Args:
        axes: a panel.
        number: of the panel.
    """
    titles = (bare(axes.get_title(loc=place)) for place in ("left", "center", "right"))
    return next(filter(None, titles), str(number))


def shown_in(axes: Axes) -> Iterator[Shown]:
    """What is drawn at places along both axes; whatever is not finite is left out.

    Args:
        axes: a panel.
    """
    none = np.empty(0)
    for line in axes.get_lines():
        if line.get_transform() == axes.transData:  # no lines from edge to edge
            yield Shown(_label(line.get_label()), line, _finite([line.get_xydata()]), none)
    for result in axes.collections:
        label = _label(result.get_label())
        if isinstance(result, PathCollection):
            yield Shown(label, result, _finite([np.ma.getdata(result.get_offsets())]), none)
        elif isinstance(result, LineCollection) and result.get_transform() == axes.transData:
            yield Shown(label, result, _finite(result.get_segments()), none)
        elif isinstance(result, QuadMesh) and result in PLACES:
            values = np.asarray(result.get_array(), float).ravel()
            # one bar explains the meshes of all columns
            bars = (m.colorbar for m in axes.collections if m.colorbar)
            colours = next((bare(bar.ax.get_ylabel()) for bar in bars), "")
            yield Shown(label, result, (PLACES[result],), values, colours)


def _finite(parts: Iterable[object]) -> tuple[FloatArray, ...]:
    points = [np.asarray(part, dtype=float).reshape(-1, 2) for part in parts]
    return tuple(p[np.all(np.isfinite(p), axis=1)] for p in points)


def _label(label: object) -> str:
    text = str(label)
    return "" if text.startswith("_") else bare(text)


def bare(text: str) -> str:
    """A label on one line, without signs that other programs read as those of mathematics.

    Args:
        text: as matplotlib sets it.
    """
    return " ".join(_MATHEMATICS.sub("", text).split())
