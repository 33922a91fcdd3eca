"""Real files of other people: what is known of each of them is found behind the reader.

Most come with the libraries that read them and are read where these are installed; see
tests/campaign/files/README.md for where they are from.
"""

from __future__ import annotations

from pathlib import Path

import nptdms
import numpy as np
import pytest
import skrf

from fitting.campaign.instruments import read_recording, read_trace
from fitting.campaign.instruments.recording import Selection
from fitting.campaign.recognised import recognised
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from tests.support.recognised import is_complex, is_sweep, seeming_selection
from tests.support.written_resonance import found_line

DATA = Path(__file__).parents[2] / "data"
HERE = Path(__file__).parent / "files" / "coupled-rlc-circuits"
TOUCHSTONE = Path(skrf.__file__).parent / "data"
NAMES = sorted(p.name for p in TOUCHSTONE.glob("*.s?p"))
TDMS = sorted((Path(nptdms.__file__).parent / "test" / "data").glob("*.tdms"))
LIGHT_M_PER_S = 299_792_458.0
INCH_M = 0.0254


def by_hand(path: Path) -> tuple[FloatArray, ComplexArray]:
    """Hz and S11 by the format alone: all numbers in a row per frequency, the first pair is S11."""
    ports = int(path.suffix[2])
    rows = [t.partition("!")[0] for t in path.read_text(encoding="latin-1").splitlines()]
    options = next(t for t in rows if t.startswith("#")).lower().split()
    numbers = " ".join(t for t in rows if not t.startswith(("#", "["))).split()
    table = np.array(numbers, dtype=float).reshape(-1, 1 + 2 * ports**2)
    first, second = table[:, 1], table[:, 2]
    values = first + 1j * second if "ri" in options else first * np.exp(1j * np.radians(second))
    return table[:, 0] * (1e9 if "ghz" in options else 1.0), values


@pytest.mark.parametrize("name", NAMES)
def test_touchstone_as_it_is_read_by_hand(name: str) -> None:
    path = TOUCHSTONE / name
    f, values = by_hand(path)
    trace = read_trace(path, None, Selection(amplitude="S11"))
    assert trace.phase is not None
    np.testing.assert_allclose(trace.frequency, f, rtol=1e-14)
    np.testing.assert_allclose(trace.amplitude * np.exp(1j * trace.phase), values, atol=1e-14)
    found = recognised(path)
    assert found.words.startswith(f"Touchstone, {path.suffix[2]} port")
    assert is_complex(found)


def test_there_are_enough_of_them() -> None:
    assert len(NAMES) >= 15
    assert len(TDMS) >= 3


@pytest.mark.parametrize(
    ("name", "parameter", "width_inch", "sign"),
    [
        ("wr2p2,line.s2p", "S21", 0.022, 1.0),
        ("wr2p2,line1.s2p", "S21", 0.022, 1.0),
        ("wr1p5,line.s2p", "S21", 0.015, 1.0),
        ("wr2p2,delayshort.s1p", "S11", 0.022, -1.0),
        ("line.s2p", "S21", 0.100, 1.0),
        ("delay_short.s1p", "S11", 0.100, -1.0),
    ],
)
def test_lines_of_waveguide_have_their_cutoff(
    name: str, parameter: str, width_inch: float, sign: float
) -> None:
    """The phase of a line is -k L with k = 2π/c √(f² - fc²), fc = c/2a of its width a.

    With the file's frequencies in any other unit, or another parameter, it would not be.
    """
    trace = read_trace(TOUCHSTONE / name, None, Selection(amplitude=parameter))
    assert trace.phase is not None
    np.testing.assert_allclose(trace.amplitude, 1.0, atol=1e-9)
    phase = np.unwrap(np.angle(sign * np.exp(1j * trace.phase)))
    cutoff_hz = LIGHT_M_PER_S / (2.0 * width_inch * INCH_M)
    k = 2.0 * np.pi / LIGHT_M_PER_S * np.sqrt(trace.frequency**2 - cutoff_hz**2)
    slope, start = np.polyfit(k, phase, 1)
    assert slope < 0.0
    assert np.max(np.abs(phase - slope * k - start)) < 1e-6
    assert abs(start / (2.0 * np.pi) - round(start / (2.0 * np.pi))) < 1e-6


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("short.s1p", "S11", -1.0),
        ("wr1p5,short.s1p", "S11", -1.0),
        ("wr2p2,short.s1p", "S11", -1.0),
        ("tee.s3p", "S11", -1.0 / 3.0),  # a lossless tee of equal lines: 2/3 - 1 and 2/3
        ("tee.s3p", "S21", 2.0 / 3.0),
        ("tee.s3p", "S23", 2.0 / 3.0),
    ],
)
def test_ideal_parts_have_their_closed_form(name: str, parameter: str, value: float) -> None:
    trace = read_trace(TOUCHSTONE / name, None, Selection(amplitude=parameter))
    assert trace.phase is not None
    np.testing.assert_allclose(trace.amplitude * np.exp(1j * trace.phase), value, atol=1e-11)


#: It holds the same signal three times, at three rates.
SEVERAL = "Digital_Input.tdms"


def test_of_several_recordings_of_labview_one_has_to_be_named() -> None:
    [path] = [path for path in TDMS if path.name == SEVERAL]
    with pytest.raises(BadInput, match=r"3 recordings.*20000 points.*400 points.*8 points"):
        recognised(path)


@pytest.mark.parametrize(
    "path", [path for path in TDMS if path.name != SEVERAL], ids=lambda path: path.name
)
def test_recordings_of_labview_are_called_so(path: Path) -> None:
    found = recognised(path)
    assert found.words.startswith("TDMS, ")
    assert found.role("time") is not None
    with pytest.raises(BadInput, match="column '"):
        read_trace(path, None)


def test_the_cantilever_is_where_its_microscope_says() -> None:
    """The header tells f_res = 30281.5211 Hz and Q = 1161."""
    found = recognised(DATA / "afm_sensor" / "afm_sensor_sweep.dat")
    # its frequency is no column of the file: what was added is printed
    assert "Frequency = Center Frequency + Frequency Shift" in found.words
    trace = read_trace(found.path, None, seeming_selection(found))
    assert trace.phase is not None
    values = (trace.amplitude * np.exp(-1j * np.radians(trace.phase))).astype(complex)
    f, width = found_line(trace.frequency, values)
    assert f == pytest.approx(float(trace.notes["f_res (Hz)"]), abs=2.0)
    assert f / width == pytest.approx(float(trace.notes["Q"]), rel=0.08)


@pytest.mark.parametrize("row", [0, 25])
def test_an_oscilloscope_shows_the_frequency_of_its_source(row: int) -> None:
    """The table of the same laboratory tells the frequency of every wave form."""
    table = np.loadtxt(DATA / "coupled_rlc" / "c1_response.csv", delimiter=",", skiprows=1)
    path = HERE / f"c1_waveform_{row:02d}.csv"
    found = recognised(path)
    assert not is_sweep(found)
    assert found.role("time") is not None
    recording = read_recording(path, None, Selection())
    time_s, source_v = (recording.numbers(c) for c in recording.channels[:2])

    def rest(hertz: float) -> float:
        angle = 2.0 * np.pi * hertz * time_s
        tones = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])
        return float(np.linalg.lstsq(tones, source_v, rcond=None)[1][0])

    near = table[row, 0] * np.linspace(0.99, 1.01, 401)
    assert near[np.argmin([rest(f) for f in near])] == pytest.approx(table[row, 0], rel=1e-4)


def test_the_response_of_two_circuits_is_recognised() -> None:
    """Of two columns of amplitudes the one that responds is taken, not the source's."""
    found = recognised(DATA / "coupled_rlc" / "c1_response.csv")
    assert seeming_selection(found).amplitude == "amplitude over C1"
    trace = read_trace(found.path, None, seeming_selection(found))
    peak_hz = trace.frequency[np.argmax(trace.amplitude)]
    assert peak_hz == pytest.approx(503.29, rel=0.15)  # 1/(2π√(LC)) of 1 H and 0.1 µF
