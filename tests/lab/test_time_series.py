"""Time series of the virtual laboratory: a string let go, and under a chirp, against expm."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.lab.names import TIME_SERIES
from fitting.lab.time_series import LET_GO
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.tables import read_table
from tests.support.linear_traces import held_response, string


def exact(told: dict[str, Any], u: FloatArray) -> FloatArray:
    """The string by the matrix exponential, from the steady state under a tone, or from rest."""
    theta, d, eta = told["theta_rad"], (told["d1_hz"], told["d2_hz"]), told["eta_plus_hz"]
    seen = (np.cos(theta), np.sin(theta))
    a, b, c = string(theta, *d, (eta, told["eta_minus_hz"]), seen)
    if told["kind"] == "chirp":
        y = held_response((a, b, c), u, 1.0 / told["rate_hz"])
        return np.asarray(told["gain_v"] * y + told["offset_v"])
    before = round(told["before_s"] * told["rate_hz"])
    turning = 2j * np.pi * told["drive_hz"]
    state = told["level"] * np.linalg.solve(turning * np.eye(4) - a, b)
    driven = ((c @ state) * np.exp(turning * np.arange(-before, 0) / told["rate_hz"])).real
    free = held_response((a, b, c), u[before:], 1.0 / told["rate_hz"], start=tuple(state.real))
    return np.asarray(told["gain_v"] * np.concatenate([driven, free]) + told["offset_v"])


@pytest.mark.parametrize("kind", TIME_SERIES)
def test_the_closed_form_is_the_matrix_exponential(kind: str, tmp_path: Path) -> None:
    made = ff.synthesize_curves(kind, noise=0.0, out=tmp_path)
    told = made.truth["trace"]
    table = read_table(tmp_path / "trace.csv")
    t, y = (table.numbers(table.column(name)) for name in ("time", "string"))
    u = np.zeros(t.size)
    if kind == "chirp":
        u = table.numbers(table.column("source"))
        past = 1e-3 * t
        cycles = told["start_hz"] * past + (told["stop_hz"] - told["start_hz"]) * past**2 / (
            1.8 * told["length_s"]
        )
        inside = past < 0.9 * told["length_s"]
        assert u == pytest.approx(np.where(inside, told["level"] * np.sin(2 * np.pi * cycles), 0.0))
    expected = exact(dict(told), u)
    assert 1e-3 * y == pytest.approx(expected, abs=1e-9 * float(np.ptp(expected)))


@pytest.mark.parametrize("kind", TIME_SERIES)
def test_the_fit_finds_what_was_put_in(kind: str, swift_fmu: Path, tmp_path: Path) -> None:
    """Frequencies, widths, and of the driven trace the angle."""
    made = ff.synthesize_curves(kind, seed=3, length_s=0.1, out=tmp_path)
    problem = ff.Problem.of(tmp_path / "campaign.toml", ff.Fmu(swift_fmu, workers=1))
    fit = ff.fit(problem, starts=1)
    for name, value in fit.result.parameters.items():
        true = made.truth["trace"][f"{name}_{'rad' if name == 'theta' else 'hz'}"]
        assert abs(value.value - true) < 4.0 * value.std
    assert len(fit.x) == (5 if kind == "chirp" else 4)


def test_noise_comes_from_the_seed() -> None:
    one, same, other = (
        ff.synthesize_curves("ringdown", seed=s).files["trace.csv"] for s in (1, 1, 2)
    )
    assert one == same != other
    assert re.match("# synthetic .* seed 1\n", str(one))
    clean = LET_GO.values()
    rows = [row.split(",") for row in str(one).splitlines()[3:]]
    left = np.array([1e-3 * float(y) for _, y in rows]) - clean
    sigma = 0.01 * float(np.max(np.abs(clean - np.mean(clean))))
    assert np.std(left) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"d1_hz": 0.0}, r"d1_hz: found 0\.0"),
        ({"noise": -1.0}, r"noise: found -1\.0"),
        ({"eta_minus_hz": 900.0}, r"eta_plus_hz: found 1000\.0, .* eta_minus_hz"),
        ({"length_s": 1e-3}, r"length_s: found 0\.001, .* 64 "),
        ({"points": 9}, r"points: .*'ringdown', .*before_s"),
    ],
)
def test_what_no_string_has_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        ff.synthesize_curves("ringdown", **changes)


def test_the_command_writes_a_ringdown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["synthesize", "--series", "ringdown", "--seed", "5", "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "seed 5" in told
    assert "ringdown" in told
    assert {"campaign.toml", "trace.csv", "truth.toml"} < {p.name for p in tmp_path.iterdir()}
