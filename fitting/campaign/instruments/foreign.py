"""Files that hold no columns of numbers: named by their kind, with what to do."""

from __future__ import annotations

import re

from fitting.campaign.instruments.recording import Head
from fitting.text.errors import BadInput

_AS_TEXT = "export the sweep as text (CSV) in the program that wrote it"
_AS_TOUCHSTONE = "export it as Touchstone (.s2p) in the program that wrote it"
_PICTURE = "a picture; wanted the numbers: " + _AS_TEXT

_NANONIS = "wanted a sweep of the frequency or a recording over time, which Nanonis saves as .dat"

#: First bytes, the kind that they tell, and what to do.
KINDS: tuple[tuple[bytes, str], ...] = (
    (b":NANONIS_VERSION:", "an image of a scan by Nanonis (.sxm); " + _NANONIS),
    (b"Grid dim=", "a grid of spectra by Nanonis (.3ds); " + _NANONIS),
    (b"\x89PNG\r\n", _PICTURE),
    (b"\xff\xd8\xff", _PICTURE),
    (b"GIF8", _PICTURE),
    (b"II*\0", _PICTURE),
    (b"MM\0*", _PICTURE),
    (b"BM", _PICTURE),
    (b"%PDF", "a PDF document; wanted the numbers: " + _AS_TEXT),
    (b"%!PS", "a PostScript document; wanted the numbers: " + _AS_TEXT),
    (b"\xd0\xcf\x11\xe0", "an old Excel or Word file; save the sheet as CSV"),
    (b"\x1f\x8b", "compressed (gzip); unpack it first"),
    (b"BZh", "compressed (bzip2); unpack it first"),
    (b"\xfd7zXZ", "compressed (xz); unpack it first"),
    (b"7z\xbc\xaf", "an archive (7z); unpack it and name the file with the sweep"),
    (b"\x93NUMPY", "an array of NumPy; write it with numpy.savetxt, with a head of columns"),
    (b"SQLite format 3", "a database (SQLite); export the sweep as CSV, as from QCoDeS"),
    (b"<?xml", "XML; " + _AS_TEXT),
    (b"<html", "a web page; wanted the numbers: download the data file itself"),
    (b"<!DOC", "a web page; wanted the numbers: download the data file itself"),
)
_JSON = re.compile(rb'(\xef\xbb\xbf)?\s*(\{\s*"|\[\s*[\[{])')
_MDIF = re.compile(r"BEGIN\s+[A-Z]\w*\s*", re.IGNORECASE)
#: A CITIfile says so in its head, below remarks.
FIRST_LINES = 50
_ZIP = b"PK\x03\x04"


def refuse_foreign(head: Head) -> None:
    """Refuse a file of a known kind that holds no columns of numbers.

    Args:
        head: beginning of the file.

    Raises:
        BadInput: names the kind, and what to do.
    """
    kind = _kind(head)
    if kind:
        raise BadInput(f"{head.path}: is {kind}")


def foreign_kind(head: Head) -> str:
    """Which kind a file without columns of numbers is, as "a picture"; empty: none that is known.

    Args:
        head: beginning of the file.
    """
    return _kind(head).partition("; ")[0]


def _kind(head: Head) -> str:
    """The kind, and what to do; empty for one that is not known, or may hold columns."""
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
    known = next((kind for start, kind in KINDS if data.startswith(start)), "")
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
