"""Files of Keysight's network analysers and of Nanonis, from the file to the line and a draft."""

from __future__ import annotations

import struct
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.draft.api import init
from fitting.text.errors import BadInput

pytestmark = pytest.mark.usefixtures("swift_models")

HEAD = (
    "!CSV A.01.01\n!Keysight Technologies,N5247B,US56070639,A.17.30.08\n"
    "!Date: Friday, September 11, 2026 14:48:21\n!Source: Standard\n\nBEGIN CH1_DATA\n"
)
PROBE = (
    "Experiment\tFrequency Sweep\t\nSaved Date\t11.09.2026 14:48:21\t\nUser\t\t\n"
    "Date\t11.09.2026\t\n\n[DATA]\n"
)


def line(f_hz: Any, centre_hz: float, q: float) -> Any:
    """A line in closed form, phases falling over it, and noise of 1/400 of its height."""
    draw = np.random.default_rng(4)
    noise = draw.standard_normal(f_hz.size) + 1j * draw.standard_normal(f_hz.size)
    return 0.4 / (1.0 + 2j * q * (f_hz / centre_hz - 1.0)) + 1e-3 * noise


def rows(between: str, *columns: Any) -> str:
    pairs = zip(*columns, strict=True)
    return "".join(between.join(f"{v:.10g}" for v in row) + "\n" for row in pairs)


def db(s: Any) -> Any:
    return 20.0 * np.log10(np.abs(s))


Write = Callable[[Any, Any], str]
ANALYSER: dict[str, Write] = {
    "parts, and another parameter": lambda f, s: (
        "Freq(Hz),S21(REAL),S21(IMAG),S11(REAL),S11(IMAG)\n"
        + rows(",", f, s.real, s.imag, 0.1 + 0.0 * f, 0.2 + 0.0 * f)
    ),
    "decibels": lambda f, s: "Freq(Hz),S21 Log Mag(dB)\n" + rows(",", f, db(s)),
    "decibels and phases": lambda f, s: (
        "Freq(Hz),S21 Log Mag(dB),S21 Phase(deg)\n" + rows(",", f, db(s), np.degrees(np.angle(s)))
    ),
    "magnitudes": lambda f, s: "Freq(Hz),S21 Lin Mag(U)\n" + rows(",", f, np.abs(s)),
    "capitals and tabs": lambda f, s: (
        "FREQ(HZ)\tS11(REAL)\tS11(IMAG)\n" + rows("\t", f, s.real, s.imag)
    ),
}
SCANNER: dict[str, Write] = {
    "frequencies": lambda f, s: (
        "Frequency (Hz)\tAmplitude (V)\tPhase (deg)\n"
        + rows("\t", f, np.abs(s), np.degrees(np.angle(s)))
    ),
    "shifts": lambda f, s: (
        "Frequency Shift (Hz)\tAmplitude (m)\tPhase (deg)\tExcitation (V)\tCenter Frequency (Hz)\n"
        + rows(
            "\t", f - 30300.0, np.abs(s), np.degrees(np.angle(s)), 0.0 * f + 1e-3, 0.0 * f + 30300.0
        )
    ),
}


def drafted(path: Path, centre_hz: float, q: float) -> None:
    """`line` finds the line, and `init` begins there."""
    found = ff.line(path)
    assert found.frequency.value == pytest.approx(centre_hz, abs=4.0 * found.frequency.std)
    assert found.q.value == pytest.approx(q, rel=0.02)
    made, _ = init(path, out=path.parent / "o")
    starts = {p["name"]: p["start"] for p in tomllib.loads(made.read_text("utf-8"))["parameters"]}
    assert starts["f1"] == pytest.approx(centre_hz, rel=1e-5)
    assert starts["d1"] == pytest.approx(centre_hz / q, rel=0.02)


def sample(names: Iterable[str], *kept: str) -> list[Any]:
    """All names, those that are not kept for the night."""
    marks = {name: () if name in kept else (pytest.mark.nightly,) for name in names}
    return [pytest.param(name, marks=mark) for name, mark in marks.items()]


@pytest.mark.parametrize("name", sample(ANALYSER, "decibels and phases", "capitals and tabs"))
def test_a_network_analyser_from_its_file_to_a_draft(name: str, tmp_path: Path) -> None:
    f = np.linspace(4.99e9, 5.01e9, 201)
    path = tmp_path / "a.csv"
    path.write_text(HEAD + ANALYSER[name](f, line(f, 5e9, 5000.0)) + "END\n")
    drafted(path, 5e9, 5000.0)


@pytest.mark.parametrize("name", sample(SCANNER, "shifts"))
def test_a_sweep_of_nanonis_from_its_file_to_a_draft(name: str, tmp_path: Path) -> None:
    f = np.linspace(30000.0, 30600.0, 301)
    path = tmp_path / "a.dat"
    path.write_text(PROBE + SCANNER[name](f, line(f, 30300.0, 800.0)))
    drafted(path, 30300.0, 800.0)


def test_a_recording_of_nanonis_is_a_ringdown(tmp_path: Path) -> None:
    """It was refused, as no sweep of the frequency."""
    t = np.arange(600) * 1e-4
    y = np.exp(-60.0 * t) * np.cos(2.0 * np.pi * 910.0 * t)
    y += 1e-3 * np.random.default_rng(2).standard_normal(t.size)
    path = tmp_path / "a.dat"
    head = PROBE.replace("Frequency Sweep", "History Data")
    path.write_text(head + "Time (s)\tCurrent (A)\n" + rows("\t", t, 1e-9 * y))
    found = ff.ringdown(path)
    assert found.frequency.value == pytest.approx(910.0, abs=0.1)
    assert found.width.value == pytest.approx(60.0 / np.pi, rel=0.02)
    made, _ = init(path, out=tmp_path / "o")
    [trace] = tomllib.loads(made.read_text("utf-8"))["trace"]
    assert trace["columns"] == {"time": "Time", "output": "Current"}


@pytest.mark.parametrize(
    ("name", "head", "told"),
    [
        (
            "a.sxm",
            b":NANONIS_VERSION:\n2\n:SCANIT_TYPE:\n FLOAT MSBFIRST\n:SCANIT_END:\n\n\n\x1a\x04",
            r"a\.sxm: .*image.*\.dat",
        ),
        (
            "a.3ds",
            b'Grid dim="2 x 2"\r\nGrid settings=0;0;1;1;0\r\n:HEADER_END:\r\n',
            r"a\.3ds: .*grid.*\.dat",
        ),
    ],
)
def test_images_and_grids_of_nanonis_are_called_so(
    name: str, head: bytes, told: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(head + struct.pack(">16f", *range(16)))
    for read in (ff.line, lambda p: init(p, out=tmp_path / "o")):
        with pytest.raises(BadInput, match=told):
            read(path)
