"""Files as instruments write them: text of vendors, libraries' formats, plain columns.

To add an instrument, add an entry to `vendors.LAYOUTS`, or a file here, of any name, with a
`Layout`:

    def _read(path: Path, selection: Selection) -> Recording:
        ...  # named columns in the units of the file; BadInput with file and row

    LAYOUT = Layout(name="mine", read=_read, recognises=lambda head: head.text.startswith("MINE"))

It is found by being here: a campaign may state ``layout = "mine"`` at once, and `layout_of` knows
it by the first bytes of a file (``head.data``; ``head.text`` where they are text). Which column is
the frequency and which the amplitude is decided for all layouts in `roles`. A library that a layout
needs is imported within its reader, under `fitting.campaign.instruments.libraries.understood`.

`fitting.campaign.recognised` describes to people what a file is, and guesses what its columns are.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

from fitting.campaign.instruments.foreign import foreign_kind, refuse_foreign
from fitting.campaign.instruments.recording import (
    Channel,
    Columns,
    ComplexColumns,
    Head,
    Layout,
    RawTrace,
    Recording,
    Selection,
    check_axis,
    head_of,
    own_estimates,
    unit_of,
)
from fitting.campaign.instruments.roles import trace_of
from fitting.text.errors import BadInput, did_you_mean

__all__ = [
    "LAYOUTS",
    "PLAIN",
    "Channel",
    "Columns",
    "ComplexColumns",
    "Head",
    "Layout",
    "RawTrace",
    "Recording",
    "Selection",
    "foreign_kind",
    "head_of",
    "layout_in",
    "layout_of",
    "matching_layouts",
    "own_estimates",
    "read_recording",
    "read_trace",
    "unit_of",
]

#: The layout of plain text, which every file is taken for that no other one recognises.
PLAIN = "csv"


def matching_layouts() -> dict[str, Layout]:
    """Layouts by name of all files of this package, the plain one first."""
    modules = [
        importlib.import_module(f"{__name__}.{m.name}") for m in pkgutil.iter_modules(__path__)
    ]
    result = [layout for module in modules for layout in getattr(module, "LAYOUTS", ())]
    result += [module.LAYOUT for module in modules if hasattr(module, "LAYOUT")]
    return {one.name: one for one in sorted(result, key=lambda one: (one.name != PLAIN, one.name))}


LAYOUTS: dict[str, Layout] = matching_layouts()


def layout_of(path: Path) -> str:
    """The name of the layout that a file is written in, by its content.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, not readable, or of a kind that holds no measurement.
    """
    head = head_of(path)
    special = [layout for layout in LAYOUTS.values() if layout.name != PLAIN]
    result = next((layout.name for layout in special if layout.recognises(head)), None)
    if result is not None:
        return result
    refuse_foreign(head)
    return PLAIN


def layout_in(path: Path, selection: Selection) -> str:
    """The name of the layout that a file is read in: columns of text, if their head is stated.

    Args:
        path: of the file.
        selection: what is taken from it.

    Raises:
        BadInput: as `layout_of`.
    """
    if selection.header_row is None:
        return layout_of(path)
    refuse_foreign(head_of(path))
    return PLAIN


def read_recording(
    path: Path, layout: str | None = None, selection: Selection | None = None
) -> Recording:
    """The columns of a file.

    Args:
        path: of the file.
        layout: that it is written in; None: recognised by its content.
        selection: of one of its traces, where it holds several; None: the first.

    Raises:
        BadInput: unreadable, of another kind, or without what the layout has to hold.
    """
    selection = selection or Selection()
    if layout is not None and layout not in LAYOUTS:
        raise BadInput(f"{path}: unknown layout '{layout}'{did_you_mean(layout, list(LAYOUTS))}")
    if layout == PLAIN:
        refuse_foreign(head_of(path))
    name = layout or layout_in(path, selection)
    for key in selection.parts:
        if key not in LAYOUTS[name].keys:
            raise BadInput(f"{path}: is read as layout '{name}'; '{key}' has no meaning with it")
    return LAYOUTS[name].read(path, selection)


def read_trace(path: Path, layout: str | None, selection: Selection | None = None) -> RawTrace:
    """Read one trace and check its frequency axis: finite, strictly rising, enough points.

    Args:
        path: of the file.
        layout: that it is written in; None: recognised by its content.
        selection: what to take from the file.

    Raises:
        BadInput: unreadable, missing column or unit, text or NaN in a cell, frequencies unsorted or
            twice, fewer than 3 points.
    """
    selection = selection or Selection()
    trace = trace_of(read_recording(path, layout, selection), selection)
    check_axis(trace.path, trace.frequency, trace.frequency_unit, trace.places)
    return trace
