"""Do curves show a response at all? In noise alone a fit finds something, and holds it.

Without the response a constant describes a curve, or what is declared next to it. With it the
squares are less by

    gain = sum (flat^2 - left^2)/sigma^2        P(chi^2_k > gain)        the noise is stated
    F    = (gain/k)/(sum left^2/(m - k))        P(F_{k, m-k} > F)        it is that of the rest

k counts what is fitted, scales too. A response is looked for at very many places, at one of which
noise makes it best: so the bar is far below a per cent.

Source: E. Gross and O. Vitells, Eur. Phys. J. C 70 (2010) 525, for searches at many places.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc, gammaincc

from fitting.signal.chi_square import tail
from fitting.text.arrays import FloatArray

#: Probability by noise alone below which a response is there.
SURELY = 1e-9
#: Probability of a chi square below which noise that is known does not explain it.
RARELY = 1e-4
#: Correlation of neighbours, in its standard deviations, up to which residuals are noise.
WHITE = 3.0


def chance(flat: FloatArray, left: FloatArray, sigma: FloatArray, unknowns: int) -> float:
    """Probability with which noise alone lets a response at one place take as much of curves.

    Args:
        flat: rows without the response, shape (m,).
        left: rows that the fit leaves, shape (m,).
        sigma: standard deviations, (m,); 0: not known.
        unknowns: of the response, k. As many as there are rows determine nothing.
    """
    if np.all(sigma > 0.0):
        gain = float(np.sum((flat / sigma) ** 2 - (left / sigma) ** 2))
        return float(gammaincc(0.5 * unknowns, 0.5 * max(gain, 0.0)))
    freedom, rest = flat.size - unknowns, float(left @ left)
    if freedom <= 0 or not rest > 0.0:
        return 0.0
    ratio = max(float(flat @ flat) - rest, 0.0) / unknowns / (rest / freedom)
    return float(fdtrc(unknowns, freedom, ratio))


def leaves_noise(flat: FloatArray, left: FloatArray, sigma: FloatArray, unknowns: int) -> bool:
    """Whether a fit leaves noise alone, however much of the variance that is.

    What is left is no more than the noise that is stated. Where none is, the response is surely
    there, and neighbours among the residuals are independent.

    Args:
        flat: rows without the response, shape (m,).
        left: rows that the fit leaves, shape (m,).
        sigma: standard deviations, (m,); 0: not known.
        unknowns: of the response, k.
    """
    if not left.size:
        return False
    if np.all(sigma > 0.0):
        return tail(float(np.sum((left / sigma) ** 2)), left.size) > RARELY
    together = abs(float(left[1:] @ left[:-1])) * np.sqrt(left.size)
    white = together <= WHITE * float(left @ left)
    return bool(white) and chance(flat, left, sigma, unknowns) <= SURELY
