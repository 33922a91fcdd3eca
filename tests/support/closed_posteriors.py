"""Problems whose posterior is known without any draw: in closed form, or by a sum over a grid.

wells       two minima: a narrow one that is more likely, a broad one that has more of the mass
linear      z = M p, Gaussian noise: mean (M^T S^-1 M)^-1 M^T S^-1 z*, covariance (M^T S^-1 M)^-1
exchange    z = (p1 + p2, (p1 - p2)^2): exchanging p1 and p2 changes nothing but a prior on p1
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fitting as ff
from fitting.campaign.parameters import Parameter
from fitting.fit.problem import Problem as Record
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from tests.support.datasets import answer, dataset


@dataclass(frozen=True)
class Formula:
    """`Response` of a formula, p (k, n) -> z (k, m), and `outputs`; `fails`: it has no value."""

    of: Callable[[FloatArray], FloatArray]
    fails: Callable[[FloatArray], bool] = lambda p: False
    outputs: Callable[[FloatArray], dict[str, float]] = lambda p: {}

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        if any(self.fails(p) for p in ps):
            raise FmuFailure("no value here", {}, Path("formula"))
        return [answer(row, runs=1) for row in self.of(np.array(ps))]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{n: np.array([v]) for n, v in self.outputs(p).items()} for p in ps]


def problem(
    formula: Formula, parameters: Sequence[Parameter], measured: FloatArray, sigmas: FloatArray
) -> ff.Problem:
    """The problem of measured values (m,) with the noise of each."""
    record = Record(parameters=tuple(parameters), data=dataset(measured, sigmas))
    return ff.Problem.answered_by(lambda alternative: formula, record)


def parameter(
    name: str, lower: float, upper: float, start: float, prior: tuple[float, float] | None = None
) -> Parameter:
    """A parameter without unit; `prior` its middle and standard deviation."""
    return Parameter(
        name=name,
        unit="",
        lower=lower,
        upper=upper,
        start=start,
        reference=start if prior is None else prior[0],
        scale=0.1 * (upper - lower),
        prior=None if prior is None else prior[1],
    )


#: Of the linear problem: nearly the same columns, so that its values are correlated.
MATRIX = np.array([[1.0, 2.0, 0.5], [1.0, 2.2, 0.4], [2.0, 1.0, 1.0], [1.0, 1.0, 3.0]])
MEASURED, SIGMAS = np.array([9.1, 9.4, 9.2, 16.8]), np.array([0.1, 0.2, 0.1, 0.3])


def linear(prior: tuple[float, float] | None = None) -> ff.Problem:
    """z = M p in a wide box; `prior` of the first parameter."""
    names = [
        parameter("p1", -100.0, 100.0, 1.0, prior),
        parameter("p2", -100.0, 100.0, 1.0),
        parameter("p3", -100.0, 100.0, 1.0),
    ]
    formula = Formula(lambda p: p @ MATRIX.T, outputs=linear_outputs)
    return problem(formula, names, MEASURED, SIGMAS)


#: The first parameter from which the linear problem's `root` is real: half a sigma below its mean.
ALONG, REAL_FROM = np.array([1.0, 2.0, -1.0]), -0.5


def linear_outputs(p: FloatArray) -> dict[str, float]:
    """A sum of the parameters, and a root that is real in 69 % of the posterior."""
    mean, covariance = linear_moments()
    beyond = (p[0] - mean[0]) / np.sqrt(covariance[0, 0]) - REAL_FROM
    return {
        "sum": float(ALONG @ p),
        "root": float(np.sqrt(beyond)) if beyond >= 0.0 else float("nan"),
    }


def linear_moments(prior: tuple[float, float] | None = None) -> tuple[FloatArray, FloatArray]:
    """Mean (3,) and covariance (3, 3) of the linear problem's posterior."""
    precision = MATRIX.T @ np.diag(SIGMAS**-2) @ MATRIX
    right = MATRIX.T @ (MEASURED / SIGMAS**2)
    if prior is not None:
        precision[0, 0] += prior[1] ** -2
        right[0] += prior[0] / prior[1] ** 2
    covariance = np.linalg.inv(precision)
    return covariance @ right, covariance


def exchanged(p: FloatArray) -> FloatArray:
    """Sum and squared difference of two values, (k, 2)."""
    return np.column_stack([p[:, 0] + p[:, 1], (p[:, 0] - p[:, 1]) ** 2])


SUM, SQUARE, SUM_SIGMA, SQUARE_SIGMA = 10.0, 16.0, 0.2, 1.0
#: Of p1: nearer to 7 than to 3, the other minimum.
PRIOR = (5.3, 1.5)


def exchange() -> ff.Problem:
    """Two values that may be exchanged but for a prior on the first: 7 and 3, or 3 and 7."""
    names = [parameter("p1", 0.0, 20.0, 8.0, PRIOR), parameter("p2", 0.0, 20.0, 2.0)]
    return problem(
        Formula(exchanged), names, np.array([SUM, SQUARE]), np.array([SUM_SIGMA, SQUARE_SIGMA])
    )


def exchange_share() -> float:
    """How likely p1 > p2 is: sums over a grid, spaced a tenth of the least width."""
    p = np.arange(0.005, 20.0, 0.01)
    p1, p2 = (g.ravel() for g in np.meshgrid(p, p, indexing="ij"))
    square = ((p1 + p2 - SUM) / SUM_SIGMA) ** 2
    square += (((p1 - p2) ** 2 - SQUARE) / SQUARE_SIGMA) ** 2 + ((p1 - PRIOR[0]) / PRIOR[1]) ** 2
    weight = np.exp(-0.5 * square)
    return float(np.sum(weight[p1 > p2]) / np.sum(weight))


#: Of the wells: where they are, how wide each is, and by how much ln is less at the broad one.
NARROW, BROAD, NARROW_WIDTH, BROAD_WIDTH, LESS = 4.0, 14.0, 0.1, 1.0, 0.5


def well_residuals(p: FloatArray) -> FloatArray:
    """Of two rows, (k, 2): the second is 1 in all of the broad well."""
    narrow = p[:, 0] < 0.5 * (NARROW + BROAD)
    off = np.where(narrow, (p[:, 0] - NARROW) / NARROW_WIDTH, (p[:, 0] - BROAD) / BROAD_WIDTH)
    return np.column_stack([off, np.where(narrow, 0.0, np.sqrt(2.0 * LESS))])


def wells(start: float) -> ff.Problem:
    """The problem of the wells, looked for from a value."""
    formula = Formula(lambda p: 100.0 + well_residuals(p))
    names = [parameter("p", 0.0, 20.0, start)]
    return problem(formula, names, np.array([100.0, 100.0]), np.array([1.0, 1.0]))


def broad_share() -> float:
    """Masses of two Gaussians: widths times heights."""
    broad = BROAD_WIDTH * np.exp(-LESS)
    return float(broad / (broad + NARROW_WIDTH))
