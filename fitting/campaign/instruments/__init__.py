"""Files as instruments write them: text of vendors, libraries' formats, plain columns.

To add an instrument, add an entry to `LAYOUTS` of `vendors` (text) or `libraries` (formats that a
library reads):

    def _read(path: Path, selection: Selection) -> Recording:
        ...  # named columns in the units of the file; BadInput with file and row

    Layout("mine", _read, lambda head: head.text.startswith("MINE"))

A campaign may state ``layout = "mine"`` at once, and `layout_of` knows it by the first bytes of a
file (``head.data``; ``head.text`` where they are text). Which column is the frequency and which the
amplitude is decided for all layouts in `roles`. A library that a layout needs is imported within
its reader, under `fitting.campaign.instruments.libraries.understood`.

A file that no layout recognises is plain text, or of a foreign kind: `KINDS` names those that hold
no columns of numbers, with what to do. `fitting.campaign.recognised` describes to people what a
file is, and guesses what its columns are.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from fitting.campaign.instruments import libraries, plain, vendors
from fitting.campaign.instruments.recording import (
    Head,
    Layout,
    RawTrace,
    Recording,
    Selection,
    check_axis,
    head_of,
)
from fitting.campaign.instruments.roles import trace_of
from fitting.text.errors import BadInput, did_you_mean

PLAIN = plain.LAYOUT.name
#: Layouts by name, first the plain one, for which every file is taken that no other recognises.
LAYOUTS: dict[str, Layout] = {
    one.name: one
    for one in (plain.LAYOUT, *sorted((*vendors.LAYOUTS, *libraries.LAYOUTS), key=lambda o: o.name))
}

_AS_TEXT = "export the sweep as text (CSV) in the program that wrote it"
_AS_TOUCHSTONE = "export it as Touchstone (.s2p) in the program that wrote it"
_PICTURE = "a picture; wanted the numbers: " + _AS_TEXT
_NANONIS = "wanted a sweep of the frequency or a recording over time, which Nanonis saves as .dat"

#: Kinds that the first bytes show, with what to do.
KINDS: Mapping[str, tuple[bytes, ...]] = {
    "an image of a scan by Nanonis (.sxm); " + _NANONIS: (b":NANONIS_VERSION:",),
    "a grid of spectra by Nanonis (.3ds); " + _NANONIS: (b"Grid dim=",),
    _PICTURE: (b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8", b"II*\0", b"MM\0*", b"BM"),
    "a PDF document; wanted the numbers: " + _AS_TEXT: (b"%PDF",),
    "a PostScript document; wanted the numbers: " + _AS_TEXT: (b"%!PS",),
    "an old Excel or Word file; save the sheet as CSV": (b"\xd0\xcf\x11\xe0",),
    "compressed (gzip); unpack it first": (b"\x1f\x8b",),
    "compressed (bzip2); unpack it first": (b"BZh",),
    "compressed (xz); unpack it first": (b"\xfd7zXZ",),
    "an archive (7z); unpack it and name the file with the sweep": (b"7z\xbc\xaf",),
    "an array of NumPy; write it with numpy.savetxt, with a head of columns": (b"\x93NUMPY",),
    "a database (SQLite); export the sweep as CSV, as from QCoDeS": (b"SQLite format 3",),
    "XML; " + _AS_TEXT: (b"<?xml",),
    "a web page; wanted the numbers: download the data file itself": (b"<html", b"<!DOC"),
}
_JSON = re.compile(rb'(\xef\xbb\xbf)?\s*(\{\s*"|\[\s*[\[{])')
_MDIF = re.compile(r"BEGIN\s+[A-Z]\w*\s*", re.IGNORECASE)
#: A CITIfile says so in its head, below remarks.
FIRST_LINES = 50
_ZIP = b"PK\x03\x04"


def foreign_kind(head: Head) -> str:
    """Which kind a file without columns of numbers is, and what to do, as "a picture; wanted ...".

    Empty for a file of a kind that is not known, or that may hold columns.

    Args:
        head: beginning of the file.
    """
    data, suffix = head.data, head.path.suffix.lower()
    if data.startswith(_ZIP):
        if b"xl/" in data or b"[Content_Types].xml" in data:
            return "an Excel workbook (.xlsx); save the sheet as CSV"
        if b".npy" in data:
            return "arrays of NumPy (.npz); write them with numpy.savetxt, with a head of columns"
        if b"modelDescription.xml" in data or suffix == ".fmu":
            return (
                "an FMU; wanted a file of measurements (fmu-fit init FILE --fmu FMU drafts a "
                "campaign of both, fmu-fit check FMU looks at the FMU)"
            )
        return "an archive (zip); unpack it and name the file with the sweep"
    known = next((kind for kind, starts in KINDS.items() if data.startswith(starts)), "")
    if known and not (known == _PICTURE and head.text and data.startswith(b"BM")):
        return known
    if data and not head.text and b"\0" in data:
        return f"not text and of no kind that is known here; {_AS_TEXT}"
    if suffix == ".toml":
        return "a campaign (TOML); wanted a file of measurements (fmu-fit reconstruct fits it)"
    if _JSON.match(data):
        return "JSON; write its lists as columns of text (CSV), with a head of names and units"
    if any(line.upper().startswith("CITIFILE") for line in head.lines[:FIRST_LINES]):
        return f"a CITIfile; {_AS_TOUCHSTONE}"
    if any(_MDIF.fullmatch(line) for line in head.lines):
        return f"an MDIF file; {_AS_TOUCHSTONE}"
    return ""


def layout_of(path: Path, *, plain_text: bool = False) -> str:
    """The name of the layout that a file is written in, by its content.

    Args:
        path: of the file.
        plain_text: whether it is columns of text, as the campaign states: no layout is tried.

    Raises:
        BadInput: no such file, not readable, or of a kind that holds no columns of numbers; names
            the kind, and what to do.
    """
    head = head_of(path)
    for layout in () if plain_text else LAYOUTS.values():
        if layout.name != PLAIN and layout.recognises(head):
            return layout.name
    kind = foreign_kind(head)
    if kind:
        raise BadInput(f"{path}: is {kind}")
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
    name = layout or PLAIN
    if name == PLAIN:
        as_text = layout is not None or selection.header_row is not None
        name = layout_of(path, plain_text=as_text)
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
