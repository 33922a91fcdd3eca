"""Derived outputs as numbers: the mean of each over the experiments, at many search vectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.campaign.parameters import Parameter, in_box, to_model
from fitting.measurements.measurement import Response
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer


def output_means(
    response: Response, parameters: Sequence[Parameter], xs: Sequence[FloatArray]
) -> dict[str, FloatArray]:
    """Means of the derived outputs over the experiments, (k,) each by name, in one batch.

    NaN where an output has no value. Empty without search vectors.

    Args:
        response: the model.
        parameters: what the search vectors stand for.
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
        parameters: what the search vectors stand for.
        xs: k search vectors, shape (n,) each, in the box or beyond it.
        names: of the outputs.

    Raises:
        FmuFailure: the model failed inside the box, or does not answer any more.
    """
    try:
        return output_means(response, parameters, xs)
    except NoAnswer:
        raise
    except FmuFailure:
        if len(xs) == 1:
            if in_box(parameters, xs[0]):
                raise
            return {name: np.array([np.nan]) for name in names}
    half = len(xs) // 2
    first, second = (
        output_means_beyond(response, parameters, part, names) for part in (xs[:half], xs[half:])
    )
    return {name: np.concatenate([first[name], second[name]]) for name in first}


def mean(values: FloatArray) -> float:
    """Mean of the values of one output, shape (experiments,); NaN of none.

    Args:
        values: one per experiment, in the unit of the output.
    """
    return float(np.mean(values)) if values.size else float("nan")
