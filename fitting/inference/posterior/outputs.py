"""What draws say of derived outputs: the model's values at draws that are nearly independent."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fitting.fit.outputs import answered_apart, mean
from fitting.inference.posterior.summary import NONE, PosteriorOutput, numbers_of
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate

#: Draws that are read in one batch.
BATCH = 500

#: Derived outputs at parameters (n,), each in its own unit, for many of them.
Read = Callable[[Sequence[FloatArray]], Sequence[Mapping[str, FloatArray]]]


def read_outputs(read: Read, draws: FloatArray, names: Sequence[str]) -> dict[str, FloatArray]:
    """Outputs at every draw, (k,), the mean over experiments; NaN where the model has no value.

    Args:
        read: The model.
        draws: Parameters, shape (k, n), each in its own unit.
        names: Of the outputs.

    Raises:
        NoAnswer: the model does not answer any more.
    """

    def asked(ps: Sequence[FloatArray]) -> list[dict[str, float]]:
        return [{name: mean(answer[name]) for name in names} for answer in read(ps)]

    def failed(p: FloatArray, failure: Exception) -> dict[str, float]:
        return dict.fromkeys(names, math.nan)

    rows: list[dict[str, float]] = []
    for begin in range(0, len(draws), BATCH):
        rows += answered_apart(asked, list(draws[begin : begin + BATCH]), failed)
    return {name: np.array([row[name] for row in rows]) for name in names}


def outputs_of(
    table: Mapping[str, FloatArray],
    beside: Mapping[str, FittedEstimate],
    truth: Mapping[str, float],
) -> dict[str, PosteriorOutput]:
    """Every derived output by name.

    Args:
        table: Its values at the draws, (k,).
        beside: What the fit says of it.
        truth: What is true, by name, where it is known.
    """
    return {
        name: _output(values, beside[name], truth.get(name, math.nan))
        for name, values in table.items()
    }


def _output(values: FloatArray, fit: FittedEstimate, truth: float) -> PosteriorOutput:
    there = values[np.isfinite(values)]
    return PosteriorOutput(
        name=fit.name,
        unit=fit.unit,
        status=fit.status,
        **numbers_of(there),
        draws=int(there.size),
        missing=1.0 - there.size / values.size if values.size else math.nan,
        most_likely=fit.most_likely,
        profile95=fit.ci95 if all(map(math.isfinite, fit.ci95)) else NONE,
        truth=truth,
    )
