"""Other people's samplers take the posterior of a problem as it is.

One line, sampled densely over a wide span with equal noise: its width has the standard deviation of
`bounds_of`, in closed form.
"""

from __future__ import annotations

import math

import emcee
import numpy as np
import numpy.typing as npt
import pints
import pytest

import fitting as ff
from fitting.fit.problem import Problem as Record
from tests.support import closed_posteriors as closed
from tests.support.single_line import (
    ETA_HZ,
    TOP,
    WIDTH_HZ,
    LineResponse,
    bounds_of,
    line_objective,
)

SIGMA, SPAN, PER_WIDTH = 0.02, 30.0, 2
TRUTH = np.array([ETA_HZ, WIDTH_HZ, TOP])


@pytest.fixture(scope="module")
def problem() -> ff.Problem:
    objective = line_objective(sigma=SIGMA, seed=1, span=SPAN, per_width=PER_WIDTH)
    response = objective.response
    assert isinstance(response, LineResponse)
    record = Record(parameters=objective.parameters, data=objective.data)
    return ff.Problem.answered_by(lambda alternative: response, record)


def bound_hz() -> float:
    return bounds_of(SIGMA, PER_WIDTH)["w"]


def least_squares(problem: ff.Problem) -> npt.NDArray[np.float64]:
    """Gauss and Newton's solution with the noise of the problem, from the truth."""
    sigma = problem.record.data.sigma[:, None]
    p = TRUTH
    for _ in range(6):
        p = (
            p
            - np.linalg.lstsq(
                problem.jac(p) / sigma, problem.residuals(p) / sigma[:, 0], rcond=None
            )[0]
        )
    return p


def test_the_logarithms_are_those_of_gauss(problem: ff.Problem) -> None:
    p = TRUTH + np.array([0.1, 0.2, 0.01])
    rows, sigma = problem.residuals(p), problem.record.data.sigma
    by_hand = sum(
        -0.5 * (r / s) ** 2 - math.log(s) - 0.5 * math.log(2.0 * math.pi)
        for r, s in zip(rows, sigma, strict=True)
    )
    assert float(problem.logl(p)) == pytest.approx(by_hand, rel=1e-12)
    lower, upper = problem.bounds
    prior = -float(np.sum(np.log(upper - lower)))
    assert float(problem.logp(p)) == pytest.approx(by_hand + prior, rel=1e-12)


def test_unknown_noise_is_integrated_out() -> None:
    """A sum over ln sigma of Gaussian rows: the prior 1/sigma, by the trapezoidal rule."""
    rng = np.random.default_rng(3)
    matrix = rng.standard_normal((9, 2))
    names = [closed.parameter(name, -10.0, 10.0, 1.0) for name in ("p1", "p2")]
    measured = 20.0 + matrix @ [1.0, 2.0] + 0.2 * rng.standard_normal(9)
    formula = closed.Formula(lambda p: 20.0 + p @ matrix.T)
    made = closed.problem(formula, names, measured, np.zeros(9))
    p = np.array([1.1, 1.9])
    rows, grid = made.residuals(p), np.linspace(math.log(SIGMA) - 4.0, math.log(SIGMA) + 4.0, 4001)
    logs = [
        -0.5 * float(rows @ rows) * math.exp(-2.0 * u)
        - rows.size * (u + 0.5 * math.log(2.0 * math.pi))
        for u in grid
    ]
    by_hand = max(logs) + math.log(np.trapezoid(np.exp(np.array(logs) - max(logs)), grid))
    assert float(made.logl(p)) == pytest.approx(by_hand, rel=1e-9)
    # the slopes of the logarithm are those of its rows
    best = p - np.linalg.lstsq(made.jac(p), made.residuals(p), rcond=None)[0]
    wider = made.widened(3.0, best)
    for each in (made, wider):
        white, slopes = each.white_rows(p)
        seen = [(each.logl(p + h) - each.logl(p - h)) / 2e-4 for h in 1e-4 * np.eye(2)]
        assert -(white @ slopes) == pytest.approx(np.array(seen), rel=1e-4)
    # and errors about the best place are as much wider
    plain, wide = (each.white_rows(best)[1] for each in (made, wider))
    assert plain == pytest.approx(3.0 * wide, rel=1e-9)
    with pytest.raises(ff.BadInput, match="at least 1"):
        made.widened(0.5, best)


def test_a_stack_of_parameters_is_a_stack_of_answers(problem: ff.Problem) -> None:
    ps = TRUTH + np.arange(6.0).reshape(2, 3, 1) * [0.1, 0.01, 0.01]
    rows, slopes = problem.residuals(ps), problem.jac(ps)
    assert rows.shape == (2, 3, problem.record.data.sigma.size)
    assert slopes.shape == (*rows.shape, 3)
    assert problem.logp(ps).shape == (2, 3)
    for k in np.ndindex(2, 3):
        assert np.array_equal(rows[k], problem.residuals(ps[k]))
        assert np.array_equal(slopes[k], problem.jac(ps[k]))
    assert np.allclose(problem.from_search(problem.to_search(ps)), ps, rtol=1e-14)


def test_the_jacobian_is_that_of_the_line_in_its_units(problem: ff.Problem) -> None:
    # relative rows r = z/z* - 1, and dz/dA = z/A: no finite difference
    slopes = problem.jac(TRUTH)[:, 2]
    assert slopes == pytest.approx((problem.residuals(TRUTH) + 1.0) / TOP, rel=1e-6)


def test_outside_of_the_box_nothing_is_likely(problem: ff.Problem) -> None:
    found = problem.logp(np.array([TRUTH, [ETA_HZ, 1e3, TOP], [np.nan, 8.0, 2.0]]))
    assert np.isfinite(found[0])
    assert np.all(found[1:] == -np.inf)


def test_a_gaussian_prior_stands_in_the_posterior() -> None:
    objective = line_objective(sigma=SIGMA, span=SPAN, per_width=PER_WIDTH, prior_hz=0.5)
    record = Record(parameters=objective.parameters, data=objective.data)
    made = ff.Problem.answered_by(lambda alternative: objective.response, record)
    widths = [40.0 - 1.0, 10.0 - 0.1]  # of the other two boxes; the truth is one sigma off
    prior = -0.5 - math.log(0.5 * math.sqrt(2.0 * math.pi)) - sum(map(math.log, widths))
    assert float(made.logp(TRUTH) - made.logl(TRUTH)) == pytest.approx(prior, rel=1e-9)


def test_emcee_finds_the_width_and_its_error(problem: ff.Problem) -> None:
    rng = np.random.default_rng(2)
    centre, steps, walkers = least_squares(problem), 1500, 24
    sampler = emcee.EnsembleSampler(walkers, 3, problem.logp, vectorize=True)
    sampler._random.seed(3)
    scatter = np.array([bounds_of(SIGMA, PER_WIDTH)[name] for name in ("eta", "w", "A")])
    sampler.run_mcmc(centre + scatter * rng.standard_normal((walkers, 3)), steps)
    chain = sampler.get_chain(discard=300, flat=True)[:, 1]
    independent = chain.size / float(sampler.get_autocorr_time(quiet=True)[1])
    assert independent > 300.0
    error = bound_hz()
    assert abs(chain.mean() - centre[1]) < 4.0 * error / math.sqrt(independent) + 0.1 * error
    # a standard deviation is known to 1/sqrt(2 n); the bound is that of an endless span
    assert chain.std() / error == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * independent) + 0.05)
    assert abs(chain.mean() - WIDTH_HZ) < 4.0 * error


class Posterior(pints.LogPDF):  # type: ignore[misc]  # pints has no types
    """A posterior as pints wants it."""

    def __init__(self, problem: ff.Problem) -> None:
        self.problem = problem

    def __call__(self, p: npt.NDArray[np.float64]) -> float:
        return float(self.problem.logp(p))

    def n_parameters(self) -> int:
        return len(self.problem.names)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # inside pints
def test_pints_climbs_to_the_least_squares(problem: ff.Problem) -> None:
    np.random.seed(4)
    begin = TRUTH * [1.0005, 1.1, 0.9]
    search = pints.OptimisationController(
        Posterior(problem), begin, sigma0=[0.5, 0.5, 0.1], method=pints.NelderMead
    )
    search.set_log_to_screen(False)
    search.set_max_iterations(400)
    found, value = search.run()
    best = least_squares(problem)
    assert value == pytest.approx(float(problem.logp(best)), abs=1e-3)
    assert abs(found[1] - best[1]) < 0.05 * bound_hz()
