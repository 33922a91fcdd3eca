"""Derived outputs as numbers: the mean of each over the experiments, at many search vectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.campaign.parameters import Parameter, in_box, to_model
from fitting.fit.objective import answered_apart
from fitting.measurements.measurement import Response
from fitting.text.arrays import FloatArray


def output_means(
    response: Response, parameters: Sequence[Parameter], xs: Sequence[FloatArray]
) -> dict[str, FloatArray]:
    """Means of the derived outputs over the experiments, (k,) each by name, in one batch.

    NaN where an output has no value. Empty without search vectors.

    Args:
        response: the model.
        parameters: of the search vectors.
        xs: k search vectors, shape (n,) each.

    Raises:
        FmuFailure: the model failed at one of them.
    """
    if not xs:
        return {}
    answers = response.derived_many([to_model(parameters, x) for x in xs])
    return {name: np.array([mean(answer[name]) for answer in answers]) for name in answers[0]}


def output_means_beyond(
    response: Response,
    parameters: Sequence[Parameter],
    xs: Sequence[FloatArray],
    names: Sequence[str],
) -> dict[str, FloatArray]:
    """The same, and NaN, too, where the model failed outside the box of the campaign.

    Args:
        response: the model.
        parameters: of the search vectors.
        xs: k search vectors, shape (n,) each, in the box or beyond it.
        names: of the outputs.

    Raises:
        FmuFailure: the model failed inside the box, or does not answer any more.
    """

    def read(some: Sequence[FloatArray]) -> list[FloatArray]:
        means = output_means(response, parameters, some)
        return list(np.stack([means[name] for name in names], axis=1))

    def failed(x: FloatArray, failure: Exception) -> FloatArray:
        if in_box(parameters, x):
            raise failure
        return np.full(len(names), np.nan)

    table = answered_apart(read, xs, failed) if xs and names else []
    return {name: np.array([row[k] for row in table]) for k, name in enumerate(names)}


def runs_of_outputs(response: Response) -> int:
    """Runs in which a response has read derived outputs so far; 0 where it counts none.

    Args:
        response: the model.
    """
    return int(getattr(response, "output_runs", 0))


def mean(values: FloatArray) -> float:
    """Mean of the values of one output, shape (experiments,); NaN of none.

    Args:
        values: one per experiment, in the unit of the output.
    """
    return float(np.mean(values)) if values.size else float("nan")
