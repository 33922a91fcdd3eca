"""How improbable a chi square is, of noise that is known or was estimated besides.

    P(chi^2 or more) = Q(f/2, chi^2/2)              noise is known
                     = P(F(f, nu) >= chi^2/f)       noise is estimated from nu degrees of freedom

A sum whose parts are weighed by variances of several estimates, of f_k rows and nu_k degrees of
freedom each, is taken to have f^2/nu = sum f_k^2/nu_k.

Source: G. Snedecor, Calculation and Interpretation of Analysis of Variance (1934);
F. Satterthwaite, Biometrics Bulletin 2 (1946) 110.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from scipy.special import chdtri, fdtrc, fdtri, gammaincc, ndtri


def tail(square: float, freedom: float, noise_freedom: float = math.inf) -> float:
    """Probability with which noise leaves such a chi square, or a larger one.

    Args:
        square: chi square.
        freedom: degrees of freedom that it has, positive.
        noise_freedom: those of the estimate of the noise; infinite: it is known.
    """
    if math.isinf(noise_freedom):
        return float(gammaincc(0.5 * freedom, 0.5 * square))
    return float(fdtrc(freedom, noise_freedom, square / freedom))


def largest(probability: float, freedom: float, noise_freedom: float = math.inf) -> float:
    """Chi square up to which noise stays with a probability.

    Args:
        probability: of that or less.
        freedom: degrees of freedom that it has, positive.
        noise_freedom: those of the estimate of the noise; infinite: it is known.
    """
    if math.isinf(noise_freedom):
        return float(chdtri(freedom, 1.0 - probability))
    return freedom * float(fdtri(freedom, noise_freedom, probability))


def joined_freedom(parts: Iterable[tuple[int, float]]) -> float:
    """Degrees of freedom of the noise of a sum over several parts.

    Args:
        parts: rows of each, and degrees of freedom of its noise; infinite: it is known.
    """
    rows, doubt = 0, 0.0
    for count, freedom in parts:
        rows, doubt = rows + count, doubt + count**2 / freedom
    return rows**2 / doubt if doubt > 0.0 else math.inf


def as_sigmas(square: float, p_value: float) -> float:
    """A chi square as standard deviations of a normal distribution, by its probability.

    Args:
        square: chi square, of which this is the root where the probability is too small for digits.
        p_value: of such a one or a larger.
    """
    return float(-ndtri(0.5 * p_value)) if p_value > 0.0 else math.sqrt(square)
