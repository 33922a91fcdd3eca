"""A chain that agrees with itself is not converged where it misses what the fit itself accepts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

import fitting as ff
from fitting.posterior import summary
from fitting.posterior.chain import Minimum, Target
from fitting.text.arrays import FloatArray
from tests.support import closed_posteriors as closed
from tests.support.closed_posteriors import Formula, parameter, problem


def fitted(made: ff.Problem) -> ff.Fit:
    return ff.fit(made, ff.Tikhonov(levels=4, misfit="squares"), starts=1)


@pytest.fixture
def one_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Walkers begin at the narrow well alone, and nothing leads to the other one."""

    every = Target.minima

    def first(target: Target, known: Sequence[tuple[str, FloatArray]]) -> list[Minimum]:
        return [m for m in every(target, known) if abs(m.centre[0] - closed.NARROW) < 1.0]

    monkeypatch.setattr(Target, "minima", first)


@pytest.mark.usefixtures("one_minimum")
def test_a_chain_in_one_of_two_minima_is_not_converged() -> None:
    """All walkers agree about the narrow well; the broad one has 0.86 of the mass."""
    made = closed.wells(start=13.0)
    at = ff.profile(fitted(made))
    found = ff.posterior(made, at, ff.Sampling(steps=300))
    assert found.values["p"].rhat < 1.01
    assert found.status == "not converged"
    assert math.isnan(found["p"].value)
    [finding] = found.summary.findings
    assert (finding.kind, finding.severity) == ("posterior_incomplete", "error")
    assert finding.subject == "p"
    assert abs(finding.numbers["value"] - closed.BROAD) < 3.0
    assert abs(finding.numbers["nearest"] - closed.NARROW) < 1.0


def test_draws_of_both_minima_are_converged_beside_the_same_profiles() -> None:
    made = closed.wells(start=13.0)
    found = ff.posterior(made, ff.profile(fitted(made)), ff.Sampling(walkers=12))
    assert found.status == "converged"
    assert found.summary.findings == ()


def test_a_bent_posterior_beside_no_profiles_is_not_converged() -> None:
    """Of a ring whose angle is open: nothing shows what its draws miss."""
    formula = Formula(lambda p: (p**2).sum(axis=1, keepdims=True))
    names = [parameter("p1", -2.0, 2.0, 1.0), parameter("p2", -2.0, 2.0, 0.1)]
    made = problem(formula, names, np.array([1.0]), np.array([0.05]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(summary, "LONG_ENOUGH", 0.0)
        patch.setattr(summary, "AGREE", math.inf)
        found = ff.posterior(made, fitted(made), ff.Sampling(steps=200, walkers=8))
    assert found.status == "not converged"
    assert [finding.kind for finding in found.summary.findings] == ["posterior_unchecked"]
