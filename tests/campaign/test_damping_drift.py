"""Damping that changes over a series, as a law of the experiment; data and errors in closed form.

q'' + 2 pi d q' + (2 pi eta)^2 q = cos 2 pi u t, d = d0 (1 + growth m), m from 0 to 1 over the
series, eta moving as well. A change is asserted where growth is more than three standard errors
from zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.parameters import Parameter
from fitting.fit.noise import noise_of
from fitting.fit.objective import evaluate_many, make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from tests.support.datasets import answer, dataset

ETA_HZ, MOVED_HZ, WIDTH_HZ, GROWTH = 1000.0, 4.0, 12.5, 0.2
NOISE, ASSERTED = 0.01, 3.0
#: Eight states of the series, three tones in each.
M: FloatArray = np.repeat(np.linspace(0.0, 1.0, 8), 3)
TONES_HZ: FloatArray = ETA_HZ + MOVED_HZ * M + np.tile([-6.0, 0.0, 5.0], 8)

CAMPAIGN = """
title = "A mode whose damping changes"
synthetic = true

[fmu]
file = "{fmu}"
start = {{ periodic_start = true, theta = 0.0, d2 = 10.0, eta_minus = 2000.0, A2 = 0.0 }}

[observe]
output = "q1_hybrid"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1"]
amplitudes = ["A1"]

[experiments]
file = "peaks.csv"
amplitude = "m peak"
peaks = ["peak"]

[noise]
relative = 0.01

[laws]
eta_plus = "e0 + e1*m"
d1 = "d0*(1 + growth*m)"
"""
PARAMETERS = """
[[parameters]]
name = "{name}"
unit = "{unit}"
lower = {lower}
upper = {upper}
start = {start}
"""
BOUNDS = {
    "e0": ("Hz", 980.0, 1020.0, 1001.0),
    "e1": ("Hz", -20.0, 20.0, 0.0),
    "d0": ("Hz", 1.0, 100.0, 15.0),
    "growth": ("1", -0.9, 5.0, 0.0),
}


def amplitude(eta_hz: FloatArray, width_hz: FloatArray) -> FloatArray:
    stiff = (2 * np.pi) ** 2 * (eta_hz - TONES_HZ) * (eta_hz + TONES_HZ)
    return np.asarray(1.0 / np.hypot(stiff, (2 * np.pi) ** 2 * TONES_HZ * width_hz))


def peaks(e0: float, e1: float, d0: float, growth: float) -> FloatArray:
    return amplitude(e0 + e1 * M, d0 * (1.0 + growth * M))


@dataclass(frozen=True)
class Closed:
    """The campaign's model without the FMU; parameters in the order of BOUNDS."""

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(peaks(*p.tolist()), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]


def errors_from_zero(growth: float, seed: int) -> float:
    """Growth over its standard error in a laboratory."""
    exact = peaks(ETA_HZ, MOVED_HZ, WIDTH_HZ, growth)
    noise = NOISE * exact
    data = exact + noise * np.random.default_rng(seed).standard_normal(exact.size)
    made = [
        Parameter(
            name=name,
            unit=unit,
            lower=low,
            upper=high,
            start=start,
            reference=start,
            scale=(high - low) / 2,
        )
        for name, (unit, low, high, start) in BOUNDS.items()
    ]
    objective = make_objective(Closed(), tuple(made), dataset(data, noise))
    [point] = evaluate_many(objective, [np.zeros(4)])
    options = InferenceOptions(directions=False)
    found = determine(objective, point.x, noise_of(objective, point), options)
    value = found.parameters["growth"]
    return abs(value.value / value.std)


@pytest.mark.parametrize("count", [4, pytest.param(100, marks=pytest.mark.nightly)])
def test_a_change_of_damping_is_found_and_none_is_asserted_without_it(count: int) -> None:
    with_it = [errors_from_zero(GROWTH, seed) for seed in range(count)]
    assert np.count_nonzero(np.array(with_it) > ASSERTED) >= 0.95 * count
    without = [errors_from_zero(0.0, seed) for seed in range(count)]
    assert np.count_nonzero(np.array(without) > ASSERTED) <= 0.02 * count


def test_a_law_of_the_experiment_is_the_change(swift_fmu: Path, tmp_path: Path) -> None:
    """Through the FMU: a law that names a column of the series which is no variable of it."""
    data = peaks(ETA_HZ, MOVED_HZ, WIDTH_HZ, GROWTH)
    data = data * (1.0 + NOISE * np.random.default_rng(1).standard_normal(data.size))
    rows = (
        f"{k},{u!r},{m!r},{a!r}"
        for k, (u, m, a) in enumerate(
            zip(TONES_HZ.tolist(), M.tolist(), data.tolist(), strict=True)
        )
    )
    (tmp_path / "peaks.csv").write_text("experiment,u1 (Hz),m (1),peak (m)\n" + "\n".join(rows))
    tables = (
        PARAMETERS.format(name=name, unit=unit, lower=low, upper=high, start=start)
        for name, (unit, low, high, start) in BOUNDS.items()
    )
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN.format(fmu=swift_fmu.as_posix()) + "".join(tables))
    fit = ff.fit(ff.Problem.of(ff.read_campaign(path)), starts=1)
    # Cramer-Rao from the closed form
    truth = np.array([ETA_HZ, MOVED_HZ, WIDTH_HZ, GROWTH])
    steps = 1e-5 * np.eye(4)
    slopes = np.stack(
        [(np.log(peaks(*(truth + s))) - np.log(peaks(*(truth - s)))) / 2e-5 for s in steps]
    )
    least = NOISE * np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    for k, name in enumerate(BOUNDS):
        assert abs(fit[name].value - truth[k]) < 4.0 * least[k], name
        assert fit[name].std == pytest.approx(least[k], rel=0.3), name
    assert fit["growth"].value > ASSERTED * fit["growth"].std
