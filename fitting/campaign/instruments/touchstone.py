"""Touchstone files of network analysers and field solvers: .s1p, .s2p, ... (scikit-rf)."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.library import needed, understood
from fitting.campaign.instruments.recording import Recording, channel_of
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.tables import read_text

KIND = "a Touchstone file"
_OPTIONS = re.compile(r"#(\s+([kmg]?hz|[syzgh]|ma|db|ri|r|[\d.e+-]+))+\s*(!.*)?", re.IGNORECASE)
#: Ports by the numbers in a row of frequency and values, where the file's name does not tell.
_PORTS = {3: 1, 9: 2}
MOST_PORTS = 9


def _read_touchstone(path: Path, _: Selection) -> Recording:
    """Touchstone 1.1 and 2.0: S parameters as complex columns "S11", "S21", ... over Hz."""
    with needed(path, KIND, "touchstone"):
        from skrf.io.touchstone import Touchstone
    text = read_text(path)
    file = io.StringIO(text)
    with understood(path, KIND):
        file.name = _name(path, text)
        network = Touchstone(file)
        f, s = np.asarray(network.f, dtype=float), np.asarray(network.s, dtype=complex)
    if network.parameter != "s":
        raise BadInput(
            f"{path}: is {KIND} of {str(network.parameter).upper()} parameters; wanted S parameters"
        )
    if s.shape[1] > MOST_PORTS:
        raise BadInput(f"{path}: is {KIND} of {s.shape[1]} ports; wanted at most {MOST_PORTS}")
    pairs = [(i, j) for j in range(s.shape[2]) for i in range(s.shape[1])]
    names = [f"S{i + 1}{j + 1}" for i, j in pairs]
    ports = how_many(s.shape[1], "port")
    return Recording(
        path=path,
        channels=(
            channel_of("Frequency", "Hz", f),
            *(channel_of(n, "1", s[:, i, j]) for n, (i, j) in zip(names, pairs, strict=True)),
        ),
        places=tuple(f"point {k + 1}" for k in range(f.size)),
        words=f"Touchstone, {ports}, {', '.join(names[:4])}{', ...' if len(names) > 4 else ''}",
    )


def _name(path: Path, text: str) -> str:
    """A file name whose ending tells the ports, as the library wants it."""
    lines = [line.partition("!")[0].split() for line in text.splitlines()]
    if "[version]" in {line[0].lower() for line in lines if line}:
        return "network.ts"
    if re.fullmatch(r"\.s\d+p", path.suffix.lower()):
        return f"network{path.suffix.lower()}"
    first = next((line for line in lines if line and line[0][0] not in "#["), [])
    return f"network.s{_PORTS.get(len(first), 1)}p"


def _recognises(head: Head) -> bool:
    kept = (line.strip() for line in head.lines if line.strip() and line.strip()[0] != "!")
    first = next(kept, "")
    return first.lower().startswith("[version]") or (
        len(first.split()) > 2 and bool(_OPTIONS.fullmatch(first))
    )


LAYOUT = Layout(name="touchstone", read=_read_touchstone, recognises=_recognises)
