"""What an amplitude column means: sqrt(2) of rms, the power of dBm into its load, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.amplitudes import Amplitude, declared_amplitude, to_peak
from fitting.text.errors import BadInput

ROWS = ["row 2", "row 3"]


def test_each_kind_gives_peak_amplitudes() -> None:
    two = np.array([3.0, 0.0])
    assert to_peak(two, "mV", Amplitude("peak", "V"), "f", ROWS) == pytest.approx([3e-3, 0.0])
    assert to_peak(two, "mV", Amplitude("rms", "V"), "f", ROWS)[0] == pytest.approx(3e-3 * 2**0.5)
    # 0 dBm into 50 Ω is 0.3162 V peak (0.2236 V rms), 10 dB more is sqrt(10) times as much
    dbm = to_peak(np.array([0.0, 10.0]), "dBm", Amplitude("dBm", "V", 50.0), "f", ROWS)
    assert dbm == pytest.approx([0.1 * 10**0.5, 1.0])
    db = to_peak(np.array([20.0, -6.0]), "dB", Amplitude("dB", "1"), "f", ROWS)
    assert db == pytest.approx([10.0, 0.5011872336], rel=1e-9)
    assert to_peak(np.zeros(2), "V", Amplitude("rms", "V"), "f", ROWS).tolist() == [0.0, 0.0]


def test_declarations() -> None:
    assert declared_amplitude("dBm", 75.0, "here") == Amplitude("dBm", "V", 75.0)
    assert declared_amplitude("dB", None, "here") == Amplitude("dB", "1")
    assert declared_amplitude("V rms", None, "here") == Amplitude("rms", "V")


@pytest.mark.parametrize(
    ("text", "impedance", "words"),
    [
        ("dBm", None, "is a power"),
        ("V peak", 50.0, 'with "dBm" only'),
        ("V", None, 'wanted "V peak"'),
        ("V peak peak", None, 'wanted "V peak"'),
        ("V top", None, 'wanted "V peak"'),
        ("florin peak", None, "florin"),
    ],
)
def test_what_is_no_declaration_is_refused(text: str, impedance: float | None, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        declared_amplitude(text, impedance, "here")


@pytest.mark.parametrize(
    ("values", "unit", "amplitude", "words"),
    [
        ((1.0, 2.0), "dBm", Amplitude("peak", "V"), "is in dBm, but the campaign declares V peak"),
        ((1.0, 2.0), "V", Amplitude("dB", "1"), "is in V, but the campaign declares dB$"),
        ((1.0, -2.0), "V", Amplitude("peak", "V"), "row 3, column 'amplitude': negative .* -2 V"),
        ((1.0, 1e-320), "V", Amplitude("peak", "V"), None),
        ((1e-320, 0.0), "V", Amplitude("peak", "V"), "beyond the range of numbers"),
        ((1e308, 0.0), "V", Amplitude("rms", "uV"), "beyond the range of numbers"),
        ((7000.0, 0.0), "dBm", Amplitude("dBm", "V", 50.0), "beyond the range of numbers"),
        ((7000.0, 0.0), "dB", Amplitude("dB", "1"), "beyond the range of numbers"),
    ],
)
def test_amplitudes_that_cannot_be_meant(
    values: tuple[float, float], unit: str, amplitude: Amplitude, words: str | None
) -> None:
    if words is None:  # the largest one counts
        assert to_peak(np.array(values), unit, amplitude, "f", ROWS)[0] == values[0]
        return
    with pytest.raises(BadInput, match=words):
        to_peak(np.array(values), unit, amplitude, "f", ROWS)
