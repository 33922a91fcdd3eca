"""MATLAB's .mat files of versions 4 to 7 (scipy); those of 7.3 are HDF5."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.arrays import columns_of, flattened, recording_of
from fitting.campaign.instruments.library import understood
from fitting.campaign.instruments.recording import Recording, channel_of
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.units import same_kind

KIND = "a MATLAB file"
LONGEST_NAME = 64
#: Names in a file of trajectories, and what it is, in words.
TRAJECTORIES = {"Aclass", "name", "description", "dataInfo", "data_1", "data_2"}
RESULTS = "results of a simulation, as Dymola and OpenModelica write them"
_IN_BRACKETS = re.compile(r"\[(?P<unit>[^\[\]|#:]+)[^\[\]]*\]\s*$")
#: Version 4 tells order of bytes, precision and type of matrix by a number of four digits.
MOST_KIND = 4100


def _read_matlab(path: Path, selection: Selection) -> Recording:
    """Vectors and narrow matrices of one length; fields of structures as "structure/field"."""
    with understood(path, KIND):
        from scipy.io import loadmat

        values = loadmat(path, simplify_cells=True)
        if set(values) >= TRAJECTORIES:
            return _trajectories(path, loadmat(path, chars_as_strings=False))
        arrays = [column for name, a in flattened(values) for column in columns_of(name, a)]
    return recording_of(path, arrays, "MATLAB", selection)


def _trajectories(path: Path, values: Mapping[str, np.ndarray]) -> Recording:
    """Results of a simulation as Dymola, OpenModelica and OMSimulator write them.

    ``dataInfo`` tells for every name the table, 1 or 2, and with its sign the row that holds it;
    the first table has two times for what is constant. Units stand in the descriptions, as "[m/s]".
    """
    turned = "".join(values["Aclass"][-1]).strip().lower() == "bintrans"
    tables = {k: _rows(values, f"data_{k}", turned=turned) for k in (1, 2)}
    info = _rows(values, "dataInfo", turned=turned).T.astype(int)
    names, about = (_texts(values, key, turned=turned) for key in ("name", "description"))
    times = tables[2][0]
    channels = [channel_of(names[0], _unit(about[0]) or "s", times)]
    for name, words, (table, row, *_) in list(zip(names, about, info, strict=False))[1:]:
        column = np.sign(row) * tables[int(table) or 2][abs(row) - 1]
        held = column if column.size == times.size else np.full(times.size, column[0])
        channels.append(channel_of(name, _unit(words), held))
    places = tuple(f"point {k + 1}" for k in range(times.size))
    return Recording(path=path, channels=tuple(channels), places=places, words=RESULTS)


def _rows(values: Mapping[str, np.ndarray], key: str, *, turned: bool) -> np.ndarray:
    """A matrix with a row for each variable."""
    table = np.atleast_2d(np.asarray(values[key], dtype=float))
    return table if turned else table.T


def _texts(values: Mapping[str, np.ndarray], key: str, *, turned: bool) -> list[str]:
    letters = np.atleast_2d(values[key])
    return ["".join(row).strip("\0 ") for row in (letters.T if turned else letters)]


def _unit(words: str) -> str | None:
    match = _IN_BRACKETS.search(words)
    return match["unit"] if match is not None and same_kind(match["unit"], match["unit"]) else None


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
