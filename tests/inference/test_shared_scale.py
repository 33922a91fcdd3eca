"""What peaks share through the scale of their sweep weighs alike, however far off rows were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.kinds import KINDS

pytestmark = pytest.mark.usefixtures("swift_models")


def test_the_least_chi_square_is_that_of_one_common_factor(tmp_path: Path) -> None:
    """r^T V^-1 r with V = diag(sigma^2) + s^2 1 1^T, dense; Algorithm 2 ends 41,000 above it.

    A scale that is off by 3 % makes the error of the scale so much smaller, its square 7 %.
    """
    laboratory = KINDS["readings"](40031)
    record = ff.Problem.of(laboratory.write(tmp_path), ff.Fmu("CoupledOscillator")).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    found = ff.profile(ff.fit(problem, starts=1), ["d2"])
    knowledge = found.inferred.knowledge
    assert knowledge is not None
    best = np.array([knowledge.most_likely[name] for name in problem.names])
    rows, sigma = problem.residuals(best), record.data.sigma
    [shared] = record.data.scale_sigmas
    covariance = np.diag(sigma**2) + shared**2 * np.ones((rows.size, rows.size))
    square = float(rows @ np.linalg.solve(covariance, rows))
    assert knowledge.chi_square == pytest.approx(square, rel=0.1)
    low, high = found.inferred.parameters["d2"].ci95
    assert low < laboratory.values["d2"] < high
