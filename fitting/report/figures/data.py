"""The numbers that a figure shows, as CSV: what was drawn, in the units of its axes."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure

from fitting.text.arrays import FloatArray

HEADS = ("panel", "series", "along x", "along y", "x", "y")
#: What matplotlib's mathematics adds to a name.
_MARKUP = re.compile(r"\\mathrm|[${}\\]")


def figure_csv(figure: Figure) -> str:
    """All points of lines, markers and bars of a figure, a row each; bands and maps are left out.

    Columns: the panel by its title (else its number), the series by its label, both axes by
    theirs, which hold offset and unit, and the point.

    Args:
        figure: as it is drawn.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADS)
    for number, axes in enumerate(figure.axes, start=1):
        if not axes.get_visible():
            continue
        head = _panel(axes, number)
        along = _along(axes)
        for label, points in _series(axes):
            writer.writerows([head, label, *along, repr(x), repr(y)] for x, y in points.tolist())
    return text.getvalue()


def _along(axes: Axes) -> list[str]:
    """What both axes are labelled with, there or where panels share them."""
    x = [other.get_xlabel() for other in axes.get_shared_x_axes().get_siblings(axes)]
    y = [other.get_ylabel() for other in axes.get_shared_y_axes().get_siblings(axes)]
    own = (axes.get_xlabel(), axes.get_ylabel())
    return [
        _bare(next(filter(None, (label, *sorted(others))), ""))
        for label, others in zip(own, (x, y), strict=True)
    ]


def _panel(axes: Axes, number: int) -> str:
    titles = (_bare(axes.get_title(loc=place)) for place in ("left", "center", "right"))
    return next(filter(None, titles), str(number))


def _series(axes: Axes) -> Iterator[tuple[str, FloatArray]]:
    """Label and points (n, 2) of what is drawn at places along both axes."""
    for line in axes.get_lines():
        if line.get_transform() == axes.transData:  # no lines from edge to edge
            yield _label(line.get_label()), _finite([line.get_xydata()])
    for found in axes.collections:
        if isinstance(found, PathCollection):
            yield _label(found.get_label()), _finite([np.ma.getdata(found.get_offsets())])
        elif isinstance(found, LineCollection) and found.get_transform() == axes.transData:
            yield _label(found.get_label()), _finite(found.get_segments())


def _finite(parts: Iterable[object]) -> FloatArray:
    points = [np.asarray(part, dtype=float).reshape(-1, 2) for part in parts]
    joined = np.concatenate(points) if points else np.empty((0, 2))
    return np.asarray(joined[np.all(np.isfinite(joined), axis=1)])


def _label(label: object) -> str:
    text = str(label)
    return "" if text.startswith("_") else _bare(text)


def _bare(text: str) -> str:
    """A label without the marks of mathematics, on one line."""
    return " ".join(_MARKUP.sub("", text).split())
