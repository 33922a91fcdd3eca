"""Tables below settings of any shape: the names above the numbers are found, or told by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest

import fitting as ff
from fitting.campaign.instruments import read_recording, read_trace
from fitting.campaign.instruments.recording import Selection
from fitting.campaign.recognised import recognised
from fitting.measurements.complex_sweep import read_complex
from fitting.resonance.reading import Columns, read_trace_of
from fitting.text.errors import BadInput
from tests.support.in_process import told
from tests.support.recognised import without_unit

AnyArray = npt.NDArray[np.floating]
#: The line of all these files: Hz.
F0, WIDTH = 100_000.0, 120.0
F = F0 + np.linspace(-1000.0, 1000.0, 101)
Z = 1e-3 / (1.0 + 2j * (F - F0) / WIDTH)
R, DEGREES, DB = np.abs(Z), np.rad2deg(np.angle(Z)), 20.0 * np.log10(np.abs(Z))


def rows(*columns: AnyArray, between: str = ",") -> str:
    return "\n".join(between.join(f"{v:.10e}" for v in row) for row in zip(*columns, strict=True))


COUNT = np.arange(1.0, F.size + 1)
#: Files, and the roles of their columns.
FILES: dict[str, tuple[str, Sequence[str]]] = {
    "settings of as many cells as the table": (
        "Model,FSV3007\nMode,SWEEP\nFrequency (Hz),Level (dB)\n" + rows(F, DB),
        ("frequency", "amplitude"),
    ),
    "settings of more cells, numbers among them": (
        "Model,FSV3007\nRBW,100,Hz\nStart,99000,Hz,Stop,101000,Hz\nDetector,SAMPLE\n\n"
        "Frequency (Hz),Level (dB)\n" + rows(F, DB),
        ("frequency", "amplitude"),
    ),
    "settings in brackets first": (
        "Center (MHz),Span (kHz)\n0.1,2\nFrequency (Hz),R (V),Phase (deg)\n" + rows(F, R, DEGREES),
        ("frequency", "amplitude", "phase"),
    ),
    "a short table of numbers above": (
        "Marker (Hz),Level (dB)\n1,2,3\n4,5,6\n7,8,9\nFrequency (Hz),R (V)\n" + rows(F, R),
        ("frequency", "amplitude"),
    ),
    "a line between names and numbers": (
        "Frequency (Hz);R (V)\nSweep 1 of 1\n" + rows(F, R, between=";"),
        ("frequency", "amplitude"),
    ),
    "units of the axes in settings": (
        "# Instrument,CXA\n# X Axis Units,Hz\n# Y Axis Units,dB\nDATA\n" + rows(F, DB),
        ("frequency", "amplitude"),
    ),
    "units of the axes above names": (
        "X Axis Units,Hz\nY Axis Units,V\nfrequency,amplitude\n" + rows(F, R),
        ("frequency", "amplitude"),
    ),
    "units behind 'in'": (
        "in Sa,Frequency in Hz,Gain in dB,Phase in °,Amplitude in Vpp\n"
        + rows(COUNT, F, DB, DEGREES, np.ones(F.size)),
        ("", "frequency", "amplitude", "phase", ""),
    ),
    "columns called by their units": (
        "GHz,Re.,Im.\n" + rows(F / 1e9, Z.real, Z.imag),
        ("frequency", "re", "im"),
    ),
    "columns called by units, dB and degrees": (
        "MHz;dB;deg\n" + rows(F / 1e6, DB, DEGREES, between=";"),
        ("frequency", "amplitude", "phase"),
    ),
    "conductance and susceptance": (
        '"f (Hz)"\t"G (S)"\t"B (S)"\n' + rows(F, Z.real, Z.imag, between="\t"),
        ("frequency", "re", "im"),
    ),
    "resistance and reactance": (
        "Freq. (Hz),R (ohm),X (ohm)\n" + rows(F, Z.real, Z.imag),
        ("frequency", "re", "im"),
    ),
    "parts of an impedance": (
        "f (Hz),Z' (ohm),Z'' (ohm)\n" + rows(F, Z.real, Z.imag),
        ("frequency", "re", "im"),
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_the_table_below_any_head_is_found(name: str, tmp_path: Path) -> None:
    text, roles = FILES[name]
    path = tmp_path / "sweep.csv"
    path.write_text(text + "\n", "utf-8")
    found = recognised(path)
    assert tuple(column.role for column in found.channels) == tuple(roles)
    assert len(found.places) == F.size
    assert not {"frequency", "phase"} & set(without_unit(found))
    trace = read_trace_of(path, Columns())
    np.testing.assert_allclose(trace.frequency_hz, F, rtol=1e-9)
    seen = Z if np.iscomplexobj(trace.values) else R  # in whichever unit
    np.testing.assert_allclose(trace.values / trace.values[50], seen / seen[50], rtol=1e-6)


def test_lock_in_columns_are_no_impedance(tmp_path: Path) -> None:
    """X, Y, R and theta: X is a real part, and R beside it no resistance."""
    path = tmp_path / "sweep.csv"
    text = "f (Hz),R (V),X (V),Y (V),theta (deg)\n" + rows(F, R, Z.real, Z.imag, DEGREES)
    path.write_text(text, "utf-8")
    found = {column.name: column.role for column in recognised(path).channels}
    assert (found["X"], found["Y"], found["R"]) == ("re", "im", "")


@pytest.mark.parametrize(
    ("text", "row"),
    [
        ("f (Hz),R (V)\n" + rows(F, R).replace("\n", "\nover,load\n", 1), 3),
        ("f (Hz),R (V)\n99000,abc\n" + rows(F[1:], R[1:]), 2),
        ("# remark\nf (Hz),R (V)\n" + rows(F[:50], R[:50]) + "\nx,y\n" + rows(F[50:], R[50:]), 53),
    ],
)
def test_a_row_of_text_among_numbers_is_told_and_not_passed_over(
    text: str, row: int, tmp_path: Path
) -> None:
    path = tmp_path / "sweep.csv"
    path.write_text(text + "\n", "utf-8")
    with pytest.raises(BadInput, match=rf"row {row}\b"):
        ff.line(path)


def test_the_row_of_names_can_be_told(tmp_path: Path) -> None:
    """Names that look like settings above, and settings that look like names below."""
    path = tmp_path / "sweep.csv"
    text = "a,b\nu,v\nf (Hz),R (V)\nfrequency (kHz),level (mV)\n" + rows(F, R)
    path.write_text(text, "utf-8")
    recording = read_recording(path, None, Selection(header_row=3))
    assert [(c.name, c.unit) for c in recording.channels] == [("f", "Hz"), ("R", "V")]
    ended = told("line", path, "--header-row", "3", "--json")
    assert ended.code == 0
    for row in ("2", "400"):
        assert told("line", path, "--header-row", row, "--unit-frequency", "Hz").code in (0, 2)
    assert told("line", path, "--header-row", "400").code == 2


def test_a_drafted_campaign_has_the_row_that_was_told(tmp_path: Path) -> None:
    path = tmp_path / "sweep.csv"
    text = "f (Hz),X (V),Y (V)\nfrequency (kHz),a (mV),b (mV)\n" + rows(F, Z.real, Z.imag)
    path.write_text(text, "utf-8")
    ended = told("init", path, "--header-row", "1", "--out", tmp_path / "o", "--yes")
    assert ended.code == 0, ended.err
    campaign = ff.read_campaign(tmp_path / "o" / "campaign.toml")
    [table] = cast(Any, campaign.measurements["complex_sweep"]).tables
    np.testing.assert_allclose(table.record("").u_hz, F, rtol=1e-9)


def test_elements_of_arrays_are_no_units(tmp_path: Path) -> None:
    """T[1] and T[2], as programs that run FMUs write arrays; gain [1] has the unit 1."""
    path = tmp_path / "t.csv"
    t = np.arange(20.0)
    path.write_text("time,T[1],T[2],gain [1]\n" + rows(t, t, t, t), "utf-8")
    names = [(c.name, c.unit) for c in read_recording(path, None, Selection()).channels]
    assert names == [("time", None), ("T[1]", None), ("T[2]", None), ("gain", "1")]


def test_a_campaign_reads_what_line_reads(tmp_path: Path) -> None:
    path = tmp_path / "sweep.csv"
    path.write_text(FILES["settings in brackets first"][0], "utf-8")
    measured = read_complex(path, None, Selection())
    np.testing.assert_allclose(measured.u_hz, F, rtol=1e-9)


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("Gain,1.5\nRange,2\n\nfrequency (Hz),amplitude (V)", 4),
        ("Instrument,X7\nGain,1.5\nfrequency (Hz),amplitude (V)", 3),
        ("frequency (Hz),amplitude (V)\n# two words", 1),
    ],
)
def test_names_are_those_right_above_the_numbers(tmp_path: Path, head: str, names: int) -> None:
    """Settings with as many cells above them, or a remark of as many words below them, are none."""
    path = tmp_path / "sweep.csv"
    rows = "\n".join(f"{1000 + k},{1.0 + k % 3}" for k in range(9))
    path.write_text(f"{head}\n{rows}\n")
    recording = read_recording(path)
    assert [(c.name, c.unit) for c in recording.channels] == [
        ("frequency", "Hz"),
        ("amplitude", "V"),
    ]
    assert recording.words.endswith(f"names in row {names}")
    assert len(recording.places) == 9


@pytest.mark.parametrize("cell", ["over", "----", ""])
def test_a_first_row_with_a_cell_that_is_no_number_is_not_passed_over(
    tmp_path: Path, cell: str
) -> None:
    path = tmp_path / "sweep.csv"
    rows = "\n".join(f"{1000 + k},{1.0 + k % 3}" for k in range(1, 9))
    path.write_text(f"frequency (Hz),amplitude (V)\n1000,{cell}\n{rows}\n")
    with pytest.raises(BadInput, match=f"row 2, column 'amplitude': found '{cell}'"):
        read_trace(path, None)
