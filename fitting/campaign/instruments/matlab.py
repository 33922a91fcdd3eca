"""MATLAB's .mat files of versions 4 to 7 (scipy); those of 7.3 are HDF5."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

from fitting.campaign.instruments.arrays import columns_of, flattened, recording_of
from fitting.campaign.instruments.library import understood
from fitting.campaign.instruments.recording import Recording
from fitting.campaign.instruments.trace import Head, Layout, Selection

KIND = "a MATLAB file"
LONGEST_NAME = 64
#: Version 4 tells order of bytes, precision and type of matrix by a number of four digits.
MOST_KIND = 4100


def _read_matlab(path: Path, selection: Selection) -> Recording:
    """Vectors and narrow matrices of one length; fields of structures as "structure/field"."""
    with understood(path, KIND):
        from scipy.io import loadmat

        values = loadmat(path, simplify_cells=True)
        arrays = [column for name, a in flattened(values) for column in columns_of(name, a)]
    return recording_of(path, arrays, "MATLAB", selection)


def _recognises(head: Head) -> bool:
    if head.data.startswith(b"MATLAB 5.0"):
        return True
    if len(head.data) < 20 or head.path.suffix.lower() != ".mat":
        return False
    return any(_is_version_4(struct.unpack(f"{order}5i", head.data[:20])) for order in "<>")


def _is_version_4(numbers: Sequence[int]) -> bool:
    """Whether the first five numbers are those of a matrix in version 4, which has no signature."""
    kind, rows, columns, imaginary, length = numbers
    sizes = rows >= 0 and columns >= 0 and 0 < length < LONGEST_NAME
    return kind % 10 in (0, 1) and 0 <= kind < MOST_KIND and imaginary in (0, 1) and sizes


LAYOUT = Layout(name="matlab", read=_read_matlab, recognises=_recognises)
