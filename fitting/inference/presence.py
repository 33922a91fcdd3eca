"""Curves that do not show the model's response: nothing that a fit finds there is said.

Where the response does not stand out of the noise (`fitting.signal.presence`), what a profile says
is said of one place alone, and the truth may be at any other.
"""

from __future__ import annotations

import math

import numpy as np

from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.measurement import Measurement
from fitting.signal.presence import SURELY, chance


def unseen(solution: Solution) -> Adequacy | None:
    """That nothing of the response stands out of the noise of the curves; None where it does.

    Peaks of tones are a response: where any are fitted nothing is asked.

    Args:
        solution: the end of a fit.
    """
    data, residuals = solution.objective.data, solution.final.residuals
    fitted = [m for m in data.measurements if m.rows]
    flat = [m.rows_without_response for m in fitted]
    if not fitted or not all(rows.size for rows in flat):
        return None
    free = sum(p.prior_sigma is None for p in solution.parameters)
    if chance(np.concatenate(flat), residuals, data.sigma, free + data.solved_inside) <= SURELY:
        return None
    return Adequacy(
        chi_square=math.nan,
        freedom=0.0,
        p_value=math.nan,
        describes=False,
        absent=_words(fitted),
    )


def _words(fitted: list[Measurement]) -> str:
    """What shows nothing."""
    named = [m.series for m in fitted if m.series]
    return f"the curves of {', '.join(dict.fromkeys(named))}" if named else "the curves"
