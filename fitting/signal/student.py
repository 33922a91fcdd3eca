"""How improbable a chi square is, and how far an interval goes: noise known, or estimated.

    P(chi^2 or more) = Q(f/2, chi^2/2)              noise is known
                     = P(F(f, nu) >= chi^2/f)       noise is estimated from nu degrees of freedom

A sum whose parts are weighed by variances of several estimates, of f_k rows and nu_k degrees of
freedom each, is taken to have f^2/nu = sum f_k^2/nu_k.

    t = (estimate - truth)/standard error

with the noise estimated from nu degrees of freedom lies within t as often as a normal deviate
within z where F_t(t; nu) = Phi(z). An infinite nu is noise that is known.

Source: Student, Biometrika 6 (1908) 1; G. Snedecor, Calculation and Interpretation of Analysis of
Variance (1934); F. Satterthwaite, Biometrics Bulletin 2 (1946) 110, for a variance of which only a
part is estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from scipy.special import chdtri, fdtrc, fdtri, gammaincc, ndtr, ndtri, stdtr, stdtrit

from fitting.text.estimate import ROOT_95

#: Normal deviate within which 68 % lie.
ROOT_68 = 1.0
#: Tails below which the inverse of the normal distribution rounds to infinity.
SMALLEST_TAIL = 1e-290


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


def reach(root: float, freedom: float) -> float:
    """Standard errors within which Student's t lies as often as a normal deviate within `root`.

    Args:
        root: of the normal distribution, positive.
        freedom: degrees of freedom of the noise; infinite: it is known.
    """
    return root if math.isinf(freedom) else float(stdtrit(freedom, ndtr(root)))


def widening95(freedom: float) -> float:
    """Half of a 95 % interval over that of noise that is known.

    Args:
        freedom: degrees of freedom of the noise; infinite: it is known.
    """
    return reach(ROOT_95, freedom) / ROOT_95


def ratio95(freedom: float) -> float:
    """Half of a 95 % interval over half of the 68 % one.

    Args:
        freedom: degrees of freedom of the noise; infinite: it is known.
    """
    return reach(ROOT_95, freedom) / reach(ROOT_68, freedom)


def normal_square(square: float, freedom: float) -> float:
    """The z^2 that is as improbable as t^2 = `square`: what is held against 1 and 3.84.

    Numbers below zero stay what they are.

    Args:
        square: increase of chi square, its noise taken from the residuals.
        freedom: degrees of freedom of the noise; infinite: it is known.

    Source: for the far tails D. Wallace, Ann. Math. Stat. 30 (1959) 1124.
    """
    if math.isinf(freedom) or not 0.0 < square < math.inf:
        return square
    beyond = float(stdtr(freedom, -math.sqrt(square)))
    if beyond > SMALLEST_TAIL:
        return float(ndtri(beyond)) ** 2
    share = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    return share**2 * freedom * math.log1p(square / freedom)


def freedom_of_share(freedom: float, share: float) -> float:
    """Degrees of freedom of a variance of which a share is estimated, the rest known.

    Args:
        freedom: of the estimated share.
        share: of the variance, from 0 to 1.
    """
    return freedom / share**2 if share > 0.0 and freedom < share**2 * 1e12 else math.inf
