"""Twins of a fit: when they take part in an interval, and fits that profiles come by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.campaign.parameters import to_search
from fitting.fit.fit import Status, fit_from, solve_problem
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Evaluator, make_objective
from fitting.fit.options import Options, Schedule
from fitting.fit.path import own_start
from fitting.fit.problem import Problem
from fitting.fit.twins import find_twins
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Determined
from fitting.text.estimate import Verdict
from tests.inference.test_identifiability import both_modes
from tests.support import closed_form
from tests.support.crossing import laboratory


def learn(theta: float, seed: int) -> Determined:
    truth = (theta, 120.0, 90.0)
    measured = closed_form.measured_by(both_modes(), truth, noise=0.01, seed=seed)
    objective = make_objective(both_modes(), closed_form.string_parameters(), measured)
    return determine(
        objective,
        to_search(objective.parameters, np.array(truth)),
        RowNoise(measured.sigma, np.zeros((measured.sigma.size, 1))),
        InferenceOptions(
            units={"lambda": "Hz"}, twins=find_twins(Evaluator(objective), seed=1), minima=()
        ),
    )


def test_a_twin_without_a_coupling_takes_no_part_where_the_data_hold_the_coupling() -> None:
    """lambda^2 = -sin(2 theta) (eta_-^2 - eta_+^2)/2 of the twin is that of the fit, negative."""
    determined = learn(1.9498, seed=4)
    assert determined.derived["lambda"].status is Verdict.DETERMINED
    assert {determined.parameters[name].status for name in ("theta", "d1", "d2")} == {
        Verdict.DETERMINED
    }
    [twin] = [e for e in determined.knowledge.equivalents if e.origin == "start"]
    assert twin.parameters["d1"] == pytest.approx(determined.parameters["d2"].likely, rel=1e-3)
    assert np.isnan(twin.derived["lambda"])
    assert not twin.possible


def test_a_twin_takes_part_where_its_coupling_exists_within_the_errors() -> None:
    """Near lambda = 0 the point estimate alone must not tell d1 from d2."""
    determined = learn(np.pi / 2 + 1e-3, seed=4)
    [twin] = [e for e in determined.knowledge.equivalents if e.origin == "start"]
    assert twin.possible
    for name in ("theta", "d1", "d2"):
        assert determined.parameters[name].status is Verdict.SEVERAL, name


def test_a_fit_is_reported_where_others_come_by_a_lower_minimum() -> None:
    """Both lines are started on one side, thousands of chi square too high: no fit ends there."""
    lab = laboratory(1, starts=(5.0, 5.0))
    problem = Problem(lab.parameters, lab.data)
    fit = solve_problem(problem, lambda chosen: lab.response, Options(schedule=Schedule(starts=1)))
    assert lab.chi_square(fit.x) < lab.chi_square(lab.truth) + 5.0
    start = own_start(lab.parameters)
    assert fit_from(fit, start) is fit
    assert fit_from(fit, fit.outcome.x + 1e-9) is fit
    [outcome] = fit.outcomes
    stopped = replace(fit, outcomes=(replace(outcome, x=start),))
    again = fit_from(stopped, outcome.x)
    assert again.x == pytest.approx(fit.x)
    assert again.status is Status.CONVERGED
    assert again.cost.evaluations >= fit.cost.evaluations
