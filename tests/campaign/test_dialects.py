"""Columns of text in any spelling: the resonance that was written is found, or the row is named."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.campaign.instruments import read_trace
from fitting.campaign.instruments.recording import Recording, Selection
from fitting.campaign.recognised import recognised
from fitting.measurements.complex_sweep import read_complex
from fitting.text.errors import BadInput
from tests.support.recognised import is_complex, is_sweep, seeming_selection, without_unit
from tests.support.written_resonance import AXIS_HZ, F_HZ, VALUES, WIDTH_HZ, found_line


def selection_of(columns: dict[str, Any]) -> Selection:
    """The same names of columns for a sweep of amplitudes."""
    names = (columns.get(key, "") for key in ("frequency", "amplitude", "phase", "x", "y"))
    frequency, amplitude, phase, x, y = names
    return Selection(frequency=frequency, amplitude=amplitude, phase=phase, x=x, y=y)


def rows(form: str, delimiter: str = ",") -> list[str]:
    """Lines of the resonance: a number format of the columns named in ``form``."""
    columns = {
        "f": AXIS_HZ,
        "M": AXIS_HZ / 1e6,
        "x": VALUES.real,
        "y": VALUES.imag,
        "r": np.abs(VALUES),
        "p": np.rad2deg(np.angle(VALUES)),
        "m": 1e3 * VALUES.imag,
        "d": 20 * np.log10(np.abs(VALUES)),
    }
    return [delimiter.join(f"{columns[c][i]:.12e}" for c in form) for i in range(AXIS_HZ.size)]


def text(head: str, form: str, delimiter: str = ",") -> str:
    return "\n".join([*([head] if head else []), *rows(form, delimiter), ""])


COMPLEX = "\n".join(
    f"{f!r},{v.real:.12e}{v.imag:+.12e}j" for f, v in zip(AXIS_HZ.tolist(), VALUES, strict=True)
)
#: Files, and what the campaign has to say of them.
FILES: dict[str, tuple[bytes, dict[str, Any]]] = {
    "tab": (text("frequency (Hz)\tX (V)\tY (V)", "fxy", "\t").encode(), {}),
    "semicolon, decimal comma": (
        text("frequency (MHz);x (V);y (V)", "Mxy", ";").replace(".", ",").encode(),
        {},
    ),
    "units that differ": (text("frequency (Hz),X (V),Y (mV)", "fxm").encode(), {}),
    "blanks": (text("freq_hz   re_v   im_v", "fxy", "   ").encode(), {}),
    "blanks, decimal comma": (
        text("frequency (Hz)  X (V)  Y (V)", "fxy", "  ").replace(".", ",").encode(),
        {},
    ),
    "# before the names": (text("# f/Hz, I/V, Q/V", "fxy").encode(), {}),
    "% before the names": (
        ("% Model: plate\n" + text("% freq (Hz)    real (V)    imag (V)", "fxy", " ")).encode(),
        {},
    ),
    "settings above": (
        ("Device,7\nGain,1.5\n\n" + text("Frequency [Hz],R [V],Phase [deg]", "frp")).encode(),
        {},
    ),
    "units in a row": (text("Freq,R,Theta\nMHz,V,deg", "Mrp").encode(), {}),
    "dB and degrees": (text("f (Hz),dB (dB),phase (deg)", "fdp").encode(), {}),
    "no names": (
        text("", "fxy").encode(),
        {"frequency": "column 1 (Hz)", "x": "column 2 (V)", "y": "column 3 (V)"},
    ),
    "no names, amplitude and phase": (
        text("", "frp", "\t").encode(),
        {
            "frequency": "column 1 (Hz)",
            "amplitude": "column 2 (V)",
            "phase": "column 3 (deg)",
        },
    ),
    "no units": (
        text("frequency,amplitude,phase", "Mrp").encode(),
        {
            "frequency": "frequency (MHz)",
            "amplitude": "amplitude (V)",
            "phase": "phase (deg)",
        },
    ),
    "complex values": (("f (Hz),S (V)\n" + COMPLEX).encode(), {}),
    "complex in brackets, i": (
        ("f (Hz),S (V)\n" + COMPLEX.replace("j", "i)").replace(",", ",(").replace("(S", "S"))
        .replace(",(S", ",S")
        .encode(),
        {},
    ),
    "UTF-8 with a mark": (text("f (Hz),x (V),y (V)", "fxy").encode("utf-8-sig"), {}),
    "UTF-16 with a mark": (text("f (Hz),x (V),y (V)", "fxy").encode("utf-16"), {}),
    "UTF-16 without": (text("f (Hz),x (V),y (V)", "fxy").encode("utf-16-le"), {}),
    "Latin-1": (text("# Güte: µ\nf (Hz),x (V),y (V)", "fxy").encode("latin-1"), {}),
    "lines of Windows, END": (
        (text("f (Hz),x (V),y (V)", "fxy") + "END\n").replace("\n", "\r\n").encode(),
        {},
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_the_resonance_is_found_in_any_spelling(name: str, tmp_path: Path) -> None:
    data, columns = FILES[name]
    if name == "lines of Windows, END":
        data = data.replace(b"f (Hz),x (V),y (V)", b"Rec 7\r\nf (Hz),x (V),y (V)")
    path = tmp_path / "sweep.txt"
    path.write_bytes(data)
    measured = read_complex(path, None, Selection(**columns))
    f, width = found_line(measured.u_hz, measured.y)
    assert f == pytest.approx(F_HZ, abs=1e-6)
    assert width == pytest.approx(WIDTH_HZ, rel=1e-6)
    np.testing.assert_allclose(measured.y, VALUES, atol=1e-9 * np.max(np.abs(VALUES)))
    trace = read_trace(path, None, selection_of(columns))
    np.testing.assert_allclose(
        trace.amplitude if trace.amplitude_unit == "V" else 10 ** (trace.amplitude / 20),
        np.abs(VALUES),
        rtol=1e-9,
    )


def seen(path: Path, data: str | bytes) -> Recording:
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return recognised(path)


@pytest.mark.parametrize("name", FILES)
def test_roles_are_seen_or_guessed(name: str, tmp_path: Path) -> None:
    found = seen(tmp_path / "sweep.txt", FILES[name][0])
    assert is_sweep(found)
    assert is_complex(found)
    assert found.layout == "csv"
    assert len(found.places) == AXIS_HZ.size
    assert f"{AXIS_HZ.size} points" in found.words
    axis = found.role("frequency")
    assert axis is not None
    told = "no names" in name or name == "no units"
    assert (axis.unit is None) == told
    assert axis.guessed == ("no names" in name)
    assert ("frequency" in without_unit(found)) == told


def test_what_is_guessed_is_said(tmp_path: Path) -> None:
    found = seen(tmp_path / "a.txt", text("", "frp", " "))
    assert "57 points" in found.words
    assert found.remarks[0].startswith("column 'column 1' ")
    assert re.search(r"\bdeg\b", found.remarks[2])
    assert seeming_selection(found).phase == "column 3"
    unusual = seen(tmp_path / "b.csv", text("drive (kHz),lock-in (mV),arg (deg)", "Mrp"))
    assert [c.role for c in unusual.channels] == ["frequency", "amplitude", "phase"]
    assert all(c.guessed for c in unusual.channels)
    assert unusual.words.endswith("row 1, 57 points, kHz")


def test_a_recording_over_time_is_said(tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    found = seen(path, "time (s),C1 (V)\n0,1\n1e-3,2\n2e-3,1\n")
    assert not is_sweep(found)
    assert found.role("time") is not None
    assert len(found.remarks) >= 1
    with pytest.raises(BadInput, match=r"scope\.csv: .*\(column 'time'\)"):
        read_trace(path, None)


def test_columns_without_names_or_units_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text("", "fr", " "))
    with pytest.raises(
        BadInput,
        match=r"frequencies; .* = \"column 1 \(Hz\)",
    ):
        read_trace(path, None)
    with pytest.raises(BadInput, match=r"'column 9 \(Hz\)'"):
        read_trace(path, None, Selection(frequency="column 9 (Hz)"))
    path.write_text(text("frequency (Hz),level (mV)", "fr"))
    with pytest.raises(BadInput, match=r"'level' .* mV; .* V\b"):
        read_trace(path, None, Selection(amplitude="level (V)"))


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (
            lambda t: t.replace("\n6.8", "\n6.8x", 1),
            r"row 2, column 'freq_hz': found '6.8x.*wanted a finite number",
        ),
        (lambda t: t + "7.1e3 1 2\n", r"row 59 has 3 cells, the rows above it 2"),
        (lambda t: t + "second sweep\n", r"row 59 .*wanted|row 59, column"),
        (lambda t: t[:-30] + "nan\n", r"row 58.*(nan|cells)"),
    ],
)
def test_a_broken_row_is_named(change: Callable[[str], str], wanted: str, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(change(text("freq_hz  r_v", "fr", "  ")))
    with pytest.raises(BadInput, match=wanted):
        read_trace(path, None)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "picture"),
        (b"%PDF-1.7\n", "PDF"),
        (b"PK\x03\x04....xl/workbook.xml", r"\(.xlsx\)"),
        (b"PK\x03\x04....a.csv", r"\(zip\)"),
        (b"\x1f\x8b\x08", r"\(gzip\)"),
        (b"\x93NUMPY\x01\0", "NumPy"),
        (b'{"f_hz": [1.0, 2.0], "a_v": [3.0, 4.0]}', "JSON"),
        (b"[[1.0, 2.0], [3.0, 4.0]]", "JSON"),
        (bytes(range(256)) * 4, "not text"),
    ],
)
@pytest.mark.parametrize("layout", [None, "csv"])
def test_other_files_are_called_by_their_kind(
    data: bytes, words: str, layout: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "sweep.csv"
    path.write_bytes(data)
    with pytest.raises(BadInput, match=words):
        read_trace(path, layout)
