"""Equal fits elsewhere: which is reported, and what the others say against an interval."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.campaign.parameters import to_search
from fitting.fit.alternative import Outcome, best_alternative, chi_squares, is_complete
from fitting.fit.noise import RowNoise
from fitting.fit.objective import make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Equivalent
from fitting.inference.statuses import contradicts, equivalent_findings
from fitting.text.estimate import Verdict
from tests.inference.test_identifiability import TRUTH, both_modes
from tests.support import closed_form
from tests.support.whitened import Z95, learnt, parameter, whitened

#: The damping matrix of the truth a quarter turn on.
TURNED = np.array([1.9498 - np.pi / 2, 90.0, 120.0])


def test_of_equal_fits_one_with_every_value_is_reported() -> None:
    """lambda^2 = -sin(2 theta) (eta_-^2 - eta_+^2)/2 is negative a quarter turn on."""
    measured = closed_form.measured_by(both_modes(), noise=0.01, seed=4)
    objectives = [
        make_objective(both_modes(reflection), closed_form.string_parameters(), measured)
        for reflection in (False, True)
    ]

    def best(*places: np.ndarray) -> int:
        xs = [to_search(objectives[0].parameters, p) for p in places]
        pairs = zip(objectives, xs, strict=True)
        values, _ = chi_squares([Outcome(objective=o, x=x) for o, x in pairs])
        assert values[0] == pytest.approx(values[1], rel=1e-6)
        complete = [is_complete(o, x) for o, x in zip(objectives, xs, strict=True)]
        return best_alternative(values, complete)

    # of the reflection: the same matrices with lambda, and a quarter turn on
    there = np.array([1.5 * np.pi - TRUTH[0], 90.0, 120.0])
    part = np.array([np.pi - TRUTH[0], 120.0, 90.0])
    assert best(TURNED, there) == 1
    assert best(TRUTH, part) == best(TURNED, part) == best(TRUTH, there) == 0


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


@pytest.mark.parametrize(("offset", "severity"), [(4.1, "note"), (9.0, "warning")])
def test_an_equal_fit_with_the_same_determined_values_is_a_note(
    offset: float, severity: str
) -> None:
    """A reflection that changes an unconstrained angle alone: nothing to act on."""
    known: Any = SimpleNamespace(
        parameters={
            "theta": SimpleNamespace(likely=0.4, status=Verdict.UNCONSTRAINED, unit="rad"),
            "offset": SimpleNamespace(likely=4.0, status=Verdict.DETERMINED, unit="Hz"),
        },
        scans={"theta": SimpleNamespace(sigma=0.1), "offset": SimpleNamespace(sigma=0.6)},
        knowledge=SimpleNamespace(
            equivalents=[
                Equivalent(
                    parameters={"theta": 2.7, "offset": offset},
                    derived={},
                    delta=1e-7,
                    origin="alternative",
                    where="reflection = true",
                )
            ]
        ),
    )
    [finding] = equivalent_findings(known)
    assert finding.severity == severity
    assert ("offset" in finding.names["values"]) is (severity == "warning")
