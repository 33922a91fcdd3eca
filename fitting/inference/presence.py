"""Do curves show the model's response at all? In noise alone a fit finds something, and holds it.

Without the response a constant describes a curve, or what is declared beside it. With it the
squares are less by

    gain = sum (flat^2 - left^2)/sigma^2        P(chi^2_k > gain)        the noise is stated
    F    = (gain/k)/(sum left^2/(m - k))        P(F_{k, m-k} > F)        it is that of the rest

k counts what is fitted, scales too. A response is looked for at very many places, at one of which
noise makes it best: so the bar is far below a per cent. Where the response does not pass it, what a
profile says is said of that place alone, and the truth may be at any other.

Source: E. Gross and O. Vitells, Eur. Phys. J. C 70 (2010) 525, for searches at many places.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import fdtrc, gammaincc

from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.measurement import Measurement
from fitting.text.arrays import FloatArray

#: Probability by noise alone below which a response is there.
SURELY = 1e-9


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


def chance(flat: FloatArray, left: FloatArray, sigma: FloatArray, unknowns: int) -> float:
    """Probability with which noise alone lets a response at one place take as much of curves.

    Args:
        flat: rows without the response, shape (m,).
        left: rows that the fit leaves, shape (m,).
        sigma: standard deviations, (m,); 0: not known.
        unknowns: of the response, k. As many as there are rows tell nothing.
    """
    if np.all(sigma > 0.0):
        gain = float(np.sum((flat / sigma) ** 2 - (left / sigma) ** 2))
        return float(gammaincc(0.5 * unknowns, 0.5 * max(gain, 0.0)))
    freedom, rest = flat.size - unknowns, float(left @ left)
    if freedom <= 0 or not rest > 0.0:
        return 0.0
    ratio = max(float(flat @ flat) - rest, 0.0) / unknowns / (rest / freedom)
    return float(fdtrc(unknowns, freedom, ratio))


def _words(fitted: list[Measurement]) -> str:
    """What shows nothing."""
    named = [m.series for m in fitted if m.series]
    return f"the curves of {', '.join(dict.fromkeys(named))}" if named else "the curves"
