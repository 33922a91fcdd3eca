"""Measured numbers that are none, and such that are beyond all computing in their unit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.measured import SweepData
from tests.support.in_process import told
from tests.support.lines import mode, write_csv

F_HZ = np.linspace(990.0, 1010.0, 41)
LINE = mode(F_HZ, 1e3, 4.0)
AMPLITUDES = np.asarray(abs(LINE), dtype=float)
T_S = np.arange(400) / 1e3
#: What takes an axis and values.
TAKERS: dict[str, tuple[Callable[..., Any], np.ndarray, np.ndarray]] = {
    "amplitudes": (ff.line, F_HZ, AMPLITUDES),
    "phasors": (ff.line, F_HZ, LINE),
    "density": (ff.noise_line, F_HZ, abs(LINE) ** 2),
    "decay": (ff.ringdown, T_S, np.exp(-9.0 * T_S) * np.cos(600.0 * T_S)),
    "sweep": (lambda f, a: SweepData(frequency_hz=f, amplitude_v=a), F_HZ, AMPLITUDES),
}


@pytest.mark.parametrize("factor", [1e-320, 1e-163, 1e163, 1e300])
@pytest.mark.parametrize(
    ("taker", "which"),
    [
        (taker, which)
        for taker in TAKERS
        for which in ("axis", "values")
        # amplitudes of a campaign are in units of their largest: tests/fit/test_extremes.py
        if (taker, which) != ("sweep", "values")
    ],
)
def test_numbers_whose_squares_are_none_are_refused(taker: str, factor: float, which: str) -> None:
    take, axis, values = TAKERS[taker]
    scaled = (axis * factor, values) if which == "axis" else (axis, values * factor)
    with pytest.raises(ff.BadInput, match=r"wanted 1e-70 to 1e\+70"):
        take(*scaled)


@pytest.mark.parametrize("factor", [1e-60, 1e60])
@pytest.mark.parametrize("taker", ["amplitudes", "phasors"])
def test_small_and_large_units_have_the_same_line(taker: str, factor: float) -> None:
    take, axis, values = TAKERS[taker]
    plain, scaled = take(axis, values), take(axis, values * factor)
    assert scaled.width.value == pytest.approx(plain.width.value, rel=1e-6)
    assert scaled.amplitude.value == pytest.approx(factor * plain.amplitude.value, rel=1e-6)


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize(
    "wrong", [["a", "b"], [[1.0], [1.0, 2.0]], [None, 1.0], {"a": 1}, object(), [10**400, 1]]
)
def test_what_is_no_array_of_numbers_is_refused(taker: str, wrong: object) -> None:
    take, axis, values = TAKERS[taker]
    for given in ((wrong, values), (axis, wrong)):
        with pytest.raises(ff.BadInput):
            take(*given)


def test_the_command_says_so_of_a_file(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "s.csv", "frequency (Hz),amplitude (V)", F_HZ, 1e-163 * AMPLITUDES)
    ended = told("line", path)
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1)
    assert str(path) in ended.err
