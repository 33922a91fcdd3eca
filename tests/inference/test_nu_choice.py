"""nu by L-curve and discrepancy principle: curves with known corners, and Tikhonov by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from fitting.fit.likelihood import likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.fit.path import PATH, PathLevel
from fitting.inference.likelihood.identifiability import choose_nu, corner_of, curvatures
from fitting.inference.likelihood.knowledge import NuRow
from fitting.report.screen import phrases
from tests.support import single_line

NUS = [0.1 * 0.1**k for k in range(9)]


def rows_of(misfit: list[float], distance: list[float]) -> list[NuRow]:
    bends = curvatures(misfit, distance)
    return [
        NuRow(
            nu=nu,
            j_fit=a,
            distance=b,
            chi_square=math.nan,
            curvature=bend,
            parameters={},
            derived={},
        )
        for nu, a, b, bend in zip(NUS, misfit, distance, bends, strict=False)
    ]


def test_the_curvature_of_a_circle_is_one_over_its_radius() -> None:
    """Logarithms on a circle of radius 2, passed like an L: down first, then outward."""
    angles = np.linspace(math.pi, 1.5 * math.pi, 9)
    distance = np.exp(5.0 + 2.0 * np.sin(angles))
    misfit = np.exp(5.0 + 2.0 * np.cos(angles))
    # read the other way round: from where distance is small to where misfit is
    bends = curvatures(list(misfit[::-1]), list(distance[::-1]))
    assert math.isnan(bends[0])
    assert math.isnan(bends[-1])
    assert bends[1:-1] == pytest.approx([0.5] * 7, rel=1e-9)


def test_the_corner_is_where_the_curve_turns() -> None:
    """Misfit falls at constant distance down to the fifth nu, then distance grows for nothing."""
    misfit = [16.0, 8.0, 4.0, 2.0, 1.0, 0.99, 0.98, 0.97, 0.96]
    distance = [1.0, 1.01, 1.02, 1.03, 1.04, 2.0, 4.0, 8.0, 16.0]
    assert corner_of(rows_of(misfit, distance)) == pytest.approx(NUS[4])


def test_a_curve_that_goes_nowhere_has_no_corner() -> None:
    assert math.isnan(corner_of(rows_of([1.0, 0.999, 0.998], [2.0, 2.0, 2.0])))
    assert math.isnan(corner_of(rows_of([1.0, 0.999, 0.998], [0.0, 0.0, 0.0])))
    assert math.isnan(corner_of(rows_of([1.0, 0.5], [1.0, 2.0])))


def steps_at(objective: Objective, xs: list[np.ndarray]) -> list[PathLevel]:
    return [
        PathLevel(
            kind=PATH,
            alternative=0,
            level=k,
            nu=NUS[k],
            x=tuple(map(float, x)),
            parameters=(0.0,) * 3,
            j_fit=1.0 / (k + 1),
            j_reg=0.0,
            change=0.0,
            optimality=0.0,
            status="converged",
            message="",
            iterations=0,
            evaluations=0,
            jacobians=0,
            runs=0,
            seconds=0.0,
        )
        for k, x in enumerate(xs)
    ]


def test_the_discrepancy_principle_takes_the_largest_nu_within_the_noise() -> None:
    """Points on the way from the prior to the truth of exact data: chi^2 written out by hand."""
    objective = single_line.line_objective(sigma=0.02, span=4.0)
    truth = np.array([0.0, (single_line.WIDTH_HZ - 9.0) / 5.0, single_line.TOP - 1.0])
    shares = (0.0, 0.5, 0.9, 0.95, 0.99, 1.0)
    steps = steps_at(objective, [share * truth for share in shares])
    sigma = objective.data.sigma
    likelihood = likelihood_of(objective, RowNoise(sigma, np.zeros((sigma.size, 0))))
    choice = choose_nu(likelihood, steps, ())
    exact = single_line.LineResponse(objective.response.tones_hz)  # type: ignore[attr-defined]
    z = exact.peaks(np.array([single_line.ETA_HZ, single_line.WIDTH_HZ, single_line.TOP]))
    squares = []
    for share in shares:
        p = np.array([1000.0, 9.0 - share, 1.0 + share])
        squares.append(float(np.sum(((exact.peaks(p) - z) / 0.02) ** 2)))
    assert [row.chi_square for row in choice.rows] == pytest.approx(squares, rel=1e-6, abs=1e-9)
    assert choice.allowed == pytest.approx(float(chi2.ppf(0.95, sigma.size)))
    first = next(k for k, square in enumerate(squares) if square <= choice.allowed)
    assert 0 < first < len(shares) - 1
    assert choice.discrepancy == pytest.approx(NUS[first])
    assert choice.last == pytest.approx(NUS[5])


def test_a_misfit_beyond_the_noise_chooses_none_and_says_so() -> None:
    objective = single_line.line_objective(sigma=0.02, span=4.0)
    steps = steps_at(objective, [np.zeros(3)] * 4)
    sigma = objective.data.sigma
    choice = choose_nu(
        likelihood_of(objective, RowNoise(sigma, np.zeros((sigma.size, 0)))), steps, ()
    )
    assert math.isnan(choice.discrepancy)
    assert math.isnan(choice.corner)
    least = float(f"{min(row.chi_square for row in choice.rows):.3g}")
    second = phrases("knowledge", "nu", choice)[1]
    assert f" {least:.0f} " in second
    assert f" {choice.allowed:.3g}" in second
