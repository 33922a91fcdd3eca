"""Equal fits elsewhere: which is reported, and what the others say against an interval."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign.parameters import to_search
from fitting.fit.alternative import Outcome
from fitting.fit.choice import chosen
from fitting.fit.noise import RowNoise
from fitting.fit.objective import make_objective
from fitting.fit.solver.continuation import Chain, ContinuationStep
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.equivalent_fits import contradicts
from fitting.inference.likelihood.knowledge import Equivalent
from fitting.text.estimate import Verdict
from tests.inference.test_identifiability import TRUTH, both_modes
from tests.support import closed_form
from tests.support.whitened import Z95, learnt, parameter, whitened

#: The damping matrix of the truth a quarter turn on.
TURNED = np.array([1.9498 - np.pi / 2, 90.0, 120.0])


def step(p: np.ndarray, j: float) -> ContinuationStep:
    return ContinuationStep(
        alternative=0,
        start=0,
        level=0,
        nu=1e-9,
        x=tuple(p),
        parameters=tuple(p),
        j_fit=j,
        j_reg=0.0,
        change=0.0,
        optimality=0.0,
        status="optimal",
        message="",
        iterations=1,
        evaluations=1,
        jacobians=1,
        runs=1,
        seconds=0.0,
    )


def outcome(*ends: tuple[np.ndarray, float]) -> Outcome:
    return Outcome(
        tuple(
            Chain(start=k, begun=tuple(p), steps=(replace(step(p, j), start=k),))
            for k, (p, j) in enumerate(ends)
        )
    )


def test_of_equal_fits_one_with_every_value_is_reported() -> None:
    """lambda^2 = -sin(2 theta) (eta_-^2 - eta_+^2)/2 is negative a quarter turn on."""
    measured = closed_form.measured_by(both_modes(), noise=0.01, seed=4)
    objectives = [
        make_objective(both_modes(reflection), closed_form.string_parameters(), measured)
        for reflection in (False, True)
    ]
    whole, part = outcome((TRUTH, 0.1)), outcome((TURNED, 0.1))
    assert chosen(objectives, [part, whole])[1] == 1
    assert chosen(objectives, [whole, part])[1] == 0
    assert chosen(objectives, [part, part])[1] == 0
    found, best = chosen(objectives, [part, outcome((TURNED, 0.1), (TRUTH, 0.1))])
    assert best == 1
    assert found[1].best is not None
    assert found[1].best.start == 1
    # a better fit is reported all the same
    assert chosen(objectives, [outcome((TURNED, 0.05)), whole])[1] == 0


def test_an_alternative_that_fits_as_well_exchanges_values(tmp_path: Path) -> None:
    """T diag(d) T^T of the truth is that of the reflection at pi - theta; (d2, d1) at its turn."""
    response = both_modes()
    measured = closed_form.measured_by(response, noise=0.01, seed=4)
    objective = make_objective(response, closed_form.string_parameters(), measured)
    same = closed_form.damping(TRUTH[0], 120.0, 90.0, False)
    there = np.array([1.5 * np.pi - TRUTH[0], 90.0, 120.0])
    assert closed_form.damping(there[0], 90.0, 120.0, True) == pytest.approx(same)
    outputs = both_modes(reflection=True).derived_many([there])[0]
    twin = Equivalent(
        parameters=dict(zip(("theta", "d1", "d2"), map(float, there), strict=True)),
        derived={name: float(np.mean(v)) for name, v in outputs.items()},
        delta=0.0,
        origin="alternative",
        where="reflection = true",
    )
    sigma = measured.sigma
    x = to_search(objective.parameters, TRUTH)
    noise = RowNoise(sigma, np.zeros((sigma.size, 1)))
    determined = determine(
        objective, x, noise, InferenceOptions(units={"lambda": "Hz"}, alternatives=(twin,))
    )
    for name in ("theta", "d1", "d2"):
        profile = determined.parameters[name]
        assert profile.status is Verdict.SEVERAL, name
        assert "exchange" in profile.reason
    assert "120 Hz" in determined.parameters["d2"].reason
    assert "reflection = true" in determined.parameters["d2"].reason
    for name in ("lambda", "D11"):  # the same at both
        assert determined.derived[name].status == "determined", name


@pytest.mark.parametrize(
    ("value", "period", "outside"),
    [
        (1.8977 - 2.0 * np.pi, np.pi, False),  # two periods off
        (1.8977 + 5.0 * np.pi, np.pi, False),
        (1.8977 + 0.5 * np.pi, np.pi, True),
        (1.8977 - 2.0 * np.pi, None, True),
    ],
)
def test_whole_periods_apart_is_the_same_value(
    value: float, period: float | None, outside: bool
) -> None:
    assert contradicts(value, (1.85, 1.95), period) is outside


def test_another_fit_beyond_the_only_end_leaves_no_bound() -> None:
    """1/p measured as 1/4 +- 1/4: p is at least 1.35, unless something of p = 1 fits as well."""

    def rows(p: np.ndarray) -> np.ndarray:
        return np.full(3, (1.0 / float(p[0]) - 0.25) / 0.25 / np.sqrt(3.0))

    own = whitened(rows, parameter("p", 0.01, 1000.0, start=4.0))
    [alone] = learnt(own).parameters.values()
    assert alone.status == "bounded below"
    assert alone.ci95[0] == pytest.approx(1.0 / (0.25 + 0.25 * Z95), rel=1e-3)
    twin = Equivalent(
        parameters={"p": 0.5},
        derived={},
        delta=0.0,
        origin="alternative",
        where="mirrored = true",
    )
    [both] = learnt(own, alternatives=(twin,)).parameters.values()
    assert both.status == "not known"
    assert both.ci95 == (0.01, 1000.0)
    assert "0.5 " in both.reason
    assert "mirrored = true" in both.reason
    inside = replace(twin, parameters={"p": 30.0})
    assert learnt(own, alternatives=(inside,)).parameters["p"].status == "bounded below"
