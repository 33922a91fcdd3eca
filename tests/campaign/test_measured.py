"""Records of measurements made of arrays: like those of files, and nonsense is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.campaign import read_campaign
from fitting.campaign.measured import Experiment, Spectrum, SweepData, checked_experiment
from fitting.campaign.noise import Noise
from fitting.text.errors import BadInput
from fitting.text.units import Written, as_written, in_unit, positive_in, written_values

DATA = Path(__file__).parents[2] / "data"
F = np.linspace(100.0, 110.0, 11)
A = 1.0 / (1.0 + (F - 105.0) ** 2)


def test_the_shipped_series_from_its_numbers_alone() -> None:
    """What the files say, typed in as arrays, is the same record but for where it comes from."""
    campaign = read_campaign(DATA / "string_q1" / "campaign.toml")
    first, sweep = campaign.experiments[0], campaign.sweep
    assert sweep is not None
    assert first.spectrum is not None
    made = experiment(
        label="pair1",
        tones_hz=(6940160.0, 6940360.0),
        peaks_v=first.peaks_v,
        sigmas_v=first.sigmas_v,
        written=written_values({"u1": 6940160.0, "u2": 6940360.0}, "here"),
    )
    assert made.lines_hz == first.lines_hz == made.tones_hz
    assert np.array_equal(made.peaks_v, first.peaks_v)
    assert in_unit(made.written["u1"], "Hz") == in_unit(first.written["u1"], "Hz")
    again = SweepData(frequency_hz=sweep.frequency_hz, amplitude_v=sweep.amplitude_v)
    assert again.unit == sweep.unit == "V"
    assert again.source == Path("arrays")
    spectrum = Spectrum(first.spectrum.frequency_hz, first.spectrum.amplitude_v)
    assert spectrum.frequency_hz.size == 501


def test_lists_are_arrays_and_what_is_unknown_is_nan() -> None:
    made = experiment(peaks_v=np.array([3, 4]))
    assert made.peaks_v.dtype == float
    assert np.all(np.isnan(made.sigmas_v))
    assert made.sigmas_v.shape == (2,)
    values: Any = list(range(1, 9))
    assert SweepData(frequency_hz=values, amplitude_v=values).amplitude_v.tolist() == values


def experiment(**changed: Any) -> Experiment:
    usual: dict[str, Any] = {"label": "a", "tones_hz": (1.0, 2.0), "peaks_v": np.array([3.0, 4.0])}
    return checked_experiment(Experiment(**usual | changed))


def sweep(**changed: Any) -> SweepData:
    usual: dict[str, Any] = {"frequency_hz": F, "amplitude_v": A}
    return SweepData(**usual | changed)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"tones_hz": (1.0, 1.0)}, "drive frequencies 1, 1 Hz; wanted positive ones that differ"),
        ({"tones_hz": (-1.0, 1.0)}, "wanted positive ones that differ"),
        ({"tones_hz": (np.inf, 1.0)}, "wanted positive ones that differ"),
        ({"lines_hz": (0.0, 1.0)}, "lines 0, 1 Hz; wanted positive ones"),
        ({"peaks_v": [1.0]}, "peaks: 1 of them, wanted 2"),
        ({"peaks_v": [1.0, np.nan]}, "peaks: number 2 is nan, wanted a finite number"),
        ({"peaks_v": [1.0, 0.0]}, "peaks 1, 0; wanted positive amplitudes"),
        ({"peaks_v": [[1.0, 2.0]]}, r"peaks_v has the shape \(1, 2\), wanted \(n,\)"),
        ({"peaks_v": ["a", "b"]}, "peaks_v: found .* wanted an array of numbers"),
        ({"sigmas_v": [1.0]}, "standard deviations: 1 of them, wanted 2"),
        ({"sigmas_v": [1.0, -1.0]}, "standard deviations 1, -1, noise floor 0; wanted zero or"),
        ({"sigmas_v": [1.0, np.inf]}, "standard deviations: number 2 is inf"),
        ({"floor_v": -1.0}, "noise floor -1; wanted zero or more"),
    ],
)
def test_experiments_that_cannot_be_are_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        experiment(**changed)
    assert str(caught.value).startswith(("experiment 'a': ", "a: "))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"frequency_hz": F[:7], "amplitude_v": A[:7]}, "7 points are too few for a sweep"),
        ({"frequency_hz": F[::-1]}, "wanted frequencies above zero that rise strictly"),
        ({"frequency_hz": F - 100.0}, "wanted frequencies above zero that rise strictly"),
        ({"frequency_hz": np.append(F[:-1], np.nan)}, "frequencies: number 11 is nan"),
        ({"amplitude_v": A[:-1]}, "amplitudes: 10 of them, wanted 11"),
        ({"amplitude_v": -A}, "amplitude -0.03[0-9]* at 100 Hz; wanted a magnitude"),
        ({"amplitude_v": 0.0 * A}, "every amplitude is zero; wanted a resonance"),
        ({"phase_rad": A[:-1]}, "phases: 10 of them, wanted 11"),
        ({"phase_rad": np.nan * A}, "phases: number 1 is nan"),
    ],
)
def test_sweeps_that_cannot_be_are_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        sweep(**changed)


def test_spectra_and_noise_that_cannot_be_are_refused() -> None:
    with pytest.raises(BadInput, match=r"2 points; .* 3"):
        Spectrum(F[:2], A[:2])
    with pytest.raises(BadInput, match=r"x\.csv: amplitudes: 3 .* 4"):
        Spectrum(F[:4], A[:3], source=Path("x.csv"))
    for share in (-0.1, 1.0, np.nan):
        with pytest.raises(BadInput, match="share"):
            Noise(relative=share)
    with pytest.raises(BadInput, match="noise: absolute -1"):
        Noise(absolute_v=-1.0)
    with pytest.raises(BadInput, match=r"outliers 'drop', .*keep, huber"):
        Noise(outliers="drop")
    with pytest.raises(BadInput, match="threshold 0"):
        Noise(threshold=0.0)


def test_values_as_if_they_were_written() -> None:
    assert written_values({"a": 1, "b": "2 kHz"}, "here")["b"] == Written("2 kHz", None, "here: b")
    with pytest.raises(BadInput, match=r"here: a: .*nan"):
        written_values({"a": float("nan")}, "here")
    assert positive_in(as_written("2 kHz", "x"), "Hz") == 2000.0
    for value, words in ((2.0, "2.0 has no unit"), ("-2 Hz", "wanted more than zero")):
        with pytest.raises(BadInput, match=f"x: .*{words}"):
            positive_in(as_written(value, "x"), "Hz")
