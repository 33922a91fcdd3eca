"""Demodulated decays of the virtual laboratory, against eigenvalues, and the fit of both kinds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.lab.names import DEMODULATED
from fitting.text.errors import BadInput
from fitting.text.tables import read_table
from tests.support.demodulated import demodulated
from tests.support.linear_traces import string

TWO_PI = 2.0 * np.pi


def exact(told: dict[str, Any]) -> np.ndarray:
    """Phasors in V: the steady answer, by a linear system, then what its end leaves."""
    theta = told["theta_rad"] if told["kind"] == "lock-in" else 0.0
    eta = (told["eta_plus_hz"], told["eta_minus_hz"])
    seen = (np.cos(theta), np.sin(theta))
    a, b, c = string(theta, told["d1_hz"], told["d2_hz"], eta, seen)
    tone = 2j * np.pi * told["drive_hz"]
    state = np.linalg.solve(tone * np.eye(4) - a, told["level"] * b)
    times = np.arange(round(told["length_s"] * told["rate_hz"])) / told["rate_hz"]
    free = demodulated((a, b, c), tuple(state.real), told["drive_hz"], times)
    driven = np.full(round(told["before_s"] * told["rate_hz"]), c @ state)
    return np.asarray(told["gain_v"] * np.concatenate([driven, free]))


@pytest.mark.parametrize("kind", DEMODULATED)
def test_the_closed_form_is_that_of_the_equations(kind: str, tmp_path: Path) -> None:
    made = ff.synthesize_curves(kind, noise=0.0, out=tmp_path)
    told = dict(made.truth["trace"])
    table = read_table(tmp_path / "trace.csv")

    def column(name: str) -> np.ndarray:
        return np.asarray(table.numbers(table.column(name)))

    expected = exact(told)
    scale = float(np.max(np.abs(expected)))
    if kind == "lock-in":
        z = 1e-3 * (column("X") + 1j * column("Y")) - told["offset_v"]
    else:  # dBm into 50 ohm: A^2/100 ohm over 1 mW
        z, expected = np.sqrt(0.1 * 10.0 ** (column("amplitude") / 10.0)), np.abs(expected)
    assert z == pytest.approx(expected, abs=1e-7 * scale)


@pytest.mark.parametrize("kind", DEMODULATED)
def test_the_fit_finds_what_was_put_in(kind: str, swift_fmu: Path, tmp_path: Path) -> None:
    made = ff.synthesize_curves(kind, seed=3, length_s=0.5, rate_hz=200.0, out=tmp_path)
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        fit = ff.fit(ff.Problem.of(tmp_path / "campaign.toml", fmu))
    for name, value in fit.result.parameters.items():
        assert abs(value.value - made.truth["trace"][f"{name}_hz"]) < 4.0 * value.std
    assert len(fit.x) == (4 if kind == "lock-in" else 1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"d1_hz": 0.0}, r"d1_hz: found 0\.0"),
        ({"noise": -1.0}, r"noise: found -1\.0"),
        ({"eta_minus_hz": 900.0}, r"eta_plus_hz: found 1000000\.0, .* eta_minus_hz"),
        ({"length_s": 1e-3}, r"length_s: found 0\.001, .* 64 "),
        ({"points": 9}, r"points: .*'lock-in', .*before_s"),
    ],
)
def test_what_no_string_has_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        ff.synthesize_curves("lock-in", **{"before_s": 0.0, **changes})
