"""Strongly correlated errors are a finding: of a linear problem, whose correlation is known."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.fit.fit import solve_problem
from fitting.fit.options import Options, Schedule
from fitting.fit.problem import Problem
from fitting.inference.infer import infer
from fitting.text.finding import Kind, of_kind
from tests.support.whitened import parameter, whitened


@pytest.mark.parametrize(("apart", "named"), [(0.2, True), (1.0, False)])
def test_a_pair_is_named_with_its_correlation_where_that_is_strong(
    apart: float, named: bool
) -> None:
    """Columns (1, ..., 1) and 1 + apart t: the correlation of the errors is that of the inverse."""
    t = np.linspace(-1.0, 1.0, 9)
    matrix = np.column_stack([np.ones(9), 1.0 + apart * t]) * 5.0
    noise = np.random.default_rng(3).standard_normal(9)
    objective = whitened(
        lambda p: matrix @ (p - np.array([2.0, 3.0])) - noise,
        parameter("a", 0.0, 10.0, start=2.5),
        parameter("b", 0.0, 10.0, start=2.5),
    )
    problem = Problem(objective.parameters, objective.data)
    options = Options(schedule=Schedule(starts=1, nu_start=1e-6, iterations=2))
    fit = solve_problem(problem, lambda _: objective.response, options)
    found = of_kind(infer(fit, profiles=False).findings, Kind.correlated_values)
    covariance = np.linalg.inv(matrix.T @ matrix)
    rho = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert bool(abs(rho) >= 0.95) is named
    assert [f.names["pair"] for f in found] == ([("a", "b")] if named else [])
    for each in found:
        assert each.numbers["correlation"] == pytest.approx(rho, abs=1e-3)
