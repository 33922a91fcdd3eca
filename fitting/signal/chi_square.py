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

from scipy.special import chdtri, fdtrc, fdtri, gammaincc


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
