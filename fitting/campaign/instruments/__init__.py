"""Files as instruments write them: each layout is one file of this package.

To add an instrument, add a file here, of any name, with a `Layout`:

    def _read(path: Path, selection: Selection) -> RawTrace:
        ...  # one trace in the units of the file; BadInput with file and row

    LAYOUT = Layout(name="mine", read=_read, recognises=lambda text: text.startswith("MINE"))

It is found by being here: a campaign may say ``layout = "mine"`` at once, and `layout_of` tells it
by the content of a file.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

from fitting.campaign.instruments.trace import (
    Layout,
    RawTrace,
    Selection,
    check_axis,
    own_estimates,
    unit_of,
)
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.tables import read_text

__all__ = [
    "LAYOUTS",
    "PLAIN",
    "Layout",
    "RawTrace",
    "Selection",
    "found_layouts",
    "layout_of",
    "own_estimates",
    "read_trace",
    "unit_of",
]

#: The layout of plain text, which every file is taken for that no other one recognises.
PLAIN = "csv"


def found_layouts() -> dict[str, Layout]:
    """Layouts by name of all files of this package, the plain one first."""
    modules = [
        importlib.import_module(f"{__name__}.{m.name}") for m in pkgutil.iter_modules(__path__)
    ]
    found = [module.LAYOUT for module in modules if hasattr(module, "LAYOUT")]
    return {layout.name: layout for layout in sorted(found, key=_plain_first)}


def _plain_first(layout: Layout) -> tuple[bool, str]:
    return layout.name != PLAIN, layout.name


LAYOUTS: dict[str, Layout] = found_layouts()


def layout_of(path: Path) -> str:
    """The name of the layout that a file is written in, by its content.

    Raises:
        BadInput: no such file, or not readable.
    """
    text = read_text(path)
    special = [layout for layout in LAYOUTS.values() if layout.name != PLAIN]
    return next((layout.name for layout in special if layout.recognises(text)), PLAIN)


def read_trace(path: Path, layout: str, selection: Selection | None = None) -> RawTrace:
    """Read one trace and check its frequency axis: finite, strictly rising, enough points.

    Raises:
        BadInput: unreadable, missing column or unit, text or NaN in a cell, frequencies unsorted or
            twice, fewer than 3 points.
    """
    if layout not in LAYOUTS:
        raise BadInput(f"{path}: unknown layout '{layout}'{did_you_mean(layout, list(LAYOUTS))}")
    trace = LAYOUTS[layout].read(path, selection or Selection())
    check_axis(trace)
    return trace
