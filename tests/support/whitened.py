"""Problems told by their whitened rows: chi^2(p) = sum rows(p)^2 is what the test writes down.

Measured are ones with the relative noise SIGMA, the model answers 1 + SIGMA rows(p), so that the
residuals over their noise are the rows, and intervals follow from their closed form.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fitting.campaign.parameters import Parameter, to_search
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Determined
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from tests.support.datasets import answer, dataset

SIGMA = 0.01
#: A 95 % interval in standard deviations, scipy.stats.norm.ppf(0.975).
Z95 = 1.959964


@dataclass(frozen=True)
class WhitenedResponse:
    """`Response` whose rows are those of a function; `outputs` are functions of p, too."""

    rows: Callable[[FloatArray], FloatArray]
    outputs: Mapping[str, Callable[[FloatArray], float]] = field(default_factory=dict)

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(1.0 + SIGMA * self.rows(p)) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{n: np.array([output(p)]) for n, output in self.outputs.items()} for p in ps]


def parameter(name: str, lower: float, upper: float, **others: Any) -> Parameter:
    """A parameter whose start and reference are in its box, at the middle if nothing else is said.

    Its scale is one.
    """
    middle = 0.5 * (lower + upper)
    told = {"unit": "", "start": middle, "reference": others.get("start", middle), "scale": 1.0}
    return Parameter(name=name, lower=lower, upper=upper, **(told | others))


def whitened(
    rows: Callable[[FloatArray], FloatArray],
    *parameters: Parameter,
    known: bool = True,
    **outputs: Callable[[FloatArray], float],
) -> Objective:
    """The objective of some rows; its noise is stated, or `known` to nobody."""
    size = rows(np.array([p.start for p in parameters])).size
    sigmas = np.full(size, SIGMA) if known else None
    response = WhitenedResponse(rows, outputs)
    return make_objective(response, parameters, dataset(np.ones(size), sigmas))


def learnt(objective: Objective, start: Sequence[float] = (), **options: Any) -> Determined:
    """What the data determine, from a start in the parameters' units or from their own."""
    parameters = objective.parameters
    begin = np.array(start if len(start) else [p.start for p in parameters])
    size = objective.data.sigma.size
    noise = RowNoise(np.full(size, SIGMA), np.zeros((size, 0)))
    return determine(objective, to_search(parameters, begin), noise, InferenceOptions(**options))


def evaluator_of(objective: Objective) -> LikelihoodEvaluator:
    """The likelihood of some rows by the noise that is theirs, with every output of the model."""
    size = objective.data.sigma.size
    names = tuple(objective.response.derived_many([np.zeros(len(objective.parameters))])[0])
    own = likelihood_of(objective, RowNoise(np.full(size, SIGMA), np.zeros((size, 0))), names)
    return LikelihoodEvaluator(own)


def in_box(
    rows: Callable[[FloatArray], FloatArray],
    count: int,
    half: float = 10.0,
    **outputs: Any,
) -> LikelihoodEvaluator:
    """The likelihood of rows over parameters x0, x1, ... from -half to half, of scale one."""
    own = (parameter(f"x{i}", -half, half) for i in range(count))
    return evaluator_of(whitened(rows, *own, **outputs))
