"""Problems whose residual rows are a function that the test writes down: r(x), x the search vector.

Measured are ones, the model answers 1 + r(x); parameters have scale one and reference zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.objective import Evaluator, Objective
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from tests.support.datasets import answer, dataset

Rows = Callable[[FloatArray], FloatArray]
#: Half a central difference: exact for rows up to the second degree but for rounding.
STEP = 1e-4


@dataclass(frozen=True)
class RowsResponse:
    """`Response` whose rows are those of a function; one run each."""

    rows: Rows

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(1.0 + self.rows(p), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]


def rows_objective(
    rows: Rows, lower: Sequence[float], upper: Sequence[float], *, step: float = STEP
) -> Objective:
    """The objective of some rows in a box."""
    parameters = tuple(
        Parameter(
            name=f"x{i}",
            unit="1",
            lower=low,
            upper=high,
            start=min(max(0.0, low), high),
            reference=0.0,
            scale=1.0,
        )
        for i, (low, high) in enumerate(zip(lower, upper, strict=True))
    )
    size = rows(np.array([p.start for p in parameters])).size
    return Objective(
        response=RowsResponse(rows),
        parameters=parameters,
        data=dataset(np.ones(size)),
        steps=np.full(len(parameters), step),
    )


def rows_evaluator(
    rows: Rows, lower: Sequence[float], upper: Sequence[float], *, step: float = STEP
) -> Evaluator:
    """The same as a solver sees it."""
    return Evaluator(rows_objective(rows, lower, upper, step=step))


def bent_at(x: float) -> float:
    """A row with a kink at zero, whose central difference says that it falls where it rises."""
    return 1.0 + max(x, -3.0 * x)
