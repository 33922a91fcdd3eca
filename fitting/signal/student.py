"""How far an interval goes whose noise is known from a few residuals alone: Student's t.

    t = (estimate - truth)/standard error

with the noise estimated from nu degrees of freedom lies within t as often as a normal deviate
within z where F_t(t; nu) = Phi(z). An infinite nu is noise that is known.

Source: Student, Biometrika 6 (1908) 1; F. Satterthwaite, Biometrics Bulletin 2 (1946) 110, for a
variance of which only a part is estimated.
"""

from __future__ import annotations

import math

from scipy.special import ndtr, ndtri, stdtr, stdtrit

from fitting.text.estimate import ROOT_95

#: Normal deviate within which 68 % lie.
ROOT_68 = 1.0
#: Tails below which the inverse of the normal distribution rounds to infinity.
SMALLEST_TAIL = 1e-290


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
    tail = float(stdtr(freedom, -math.sqrt(square)))
    if tail > SMALLEST_TAIL:
        return float(ndtri(tail)) ** 2
    share = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    return share**2 * freedom * math.log1p(square / freedom)


def freedom_of_share(freedom: float, share: float) -> float:
    """Degrees of freedom of a variance of which a share is estimated, the rest known.

    Args:
        freedom: of the estimated share.
        share: of the variance, from 0 to 1.
    """
    return freedom / share**2 if share > 0.0 and freedom < share**2 * 1e12 else math.inf
