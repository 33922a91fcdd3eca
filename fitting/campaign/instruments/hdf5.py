"""HDF5 files of measurement programs, MATLAB 7.3 among them (h5py)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.arrays import NamedArray, columns_of, recording_of
from fitting.campaign.instruments.library import needed, understood
from fitting.campaign.instruments.recording import Recording
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.files import read_head

KIND = "an HDF5 file"
SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Where the signature may stand: other programs put a text before it.
_OFFSETS = (0, 512, 1024, 2048)
_UNITS = ("unit", "units", "Unit", "Units", "unit_string")


def _read_hdf5(path: Path, selection: Selection) -> Recording:
    """Datasets of one length; units of their attribute ``unit`` or ``units``, or in their names."""
    with needed(path, KIND, "hdf5"):
        import h5py
    found: list[NamedArray] = []

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufcV" and item.size:
            found.extend(columns_of(name, item[()], _unit(item)))

    with understood(path, KIND), h5py.File(path, "r") as file:
        file.visititems(visit)
    is_matlab = read_head(path, 10).startswith(b"MATLAB")
    return recording_of(path, found, "MATLAB 7.3" if is_matlab else "HDF5", selection)


def _unit(item: Any) -> str | None:
    for name in _UNITS:
        value = item.attrs.get(name)
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.item()
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str) and value.strip():
            return value.strip()
    return None


def _recognises(head: Head) -> bool:
    return any(head.data[at : at + len(SIGNATURE)] == SIGNATURE for at in _OFFSETS)


LAYOUT = Layout(name="hdf5", read=_read_hdf5, recognises=_recognises)
