"""What a misfit does to the values: one rule for the residuals of every kind of measurement.

(a) Residuals that are correlated along the axis of a curve, or of all curves of a measurement one
    after the other (P < CORRELATED), and whose structured part exceeds SHARE of the largest
    amplitude: the model does not describe the data. Below: the values hold with the errors of the
    effective sample size.
(b) Uncorrelated residuals of TESTABLE degrees of freedom or more, P(chi^2) < IMPROBABLE and
    chi^2/freedom > NOTICED: the noise is larger than stated, by sqrt(chi^2/freedom); where a part
    of them alone is so large (`of_one_size`), the model does not describe the data.
    That something is wrong is known then, and less evidence shows what: residuals count as
    correlated where P < UNLIKELY already (`correlated_below`).
    Of few (below SURE) the test of (a) misses what is wrong: there chi^2/freedom > RATIO wants
    residuals that look uncorrelated (P >= DOUBTFUL), else the model does not describe the data.
    Noise is hardly ever stated so wrongly as chi^2/freedom > BEYOND: there both are wanted,
    SURE degrees of freedom and residuals that look uncorrelated.
(c) Fewer degrees of freedom, or no axis: structure cannot be tested. P(chi^2) < IMPROBABLE and
    chi^2/freedom > RATIO: the model does not describe the data; between, as (b).

How often that is wrong, by degrees of freedom: `python -m tests.bench.bench_misfit_rule`.

Whether curves show a response at all (`leaves_noise`): without it a constant describes a curve, or
what is declared next to it. With it the squares are less by

    gain = sum (flat^2 - left^2)/sigma^2        P(chi^2_k > gain)        the noise is stated
    F    = (gain/k)/(sum left^2/(m - k))        P(F_{k, m-k} > F)        it is that of the rest

k counts what is fitted, scales too. A response is looked for at very many places, at one of which
noise makes it best: so the bar is far below a per cent.

Source: E. Gross and O. Vitells, Eur. Phys. J. C 70 (2010) 525, for searches at many places.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.special import bdtrc, fdtrc, gammaincc

from fitting.signal.residual_tests import LAGS, SMALLEST_RESIDUAL, white_noise_p
from fitting.signal.roughness import MEDIAN_OF_NORMAL
from fitting.signal.student import tail
from fitting.text.arrays import FloatArray, IntArray

#: Probability of residuals along an axis, by white noise, below which they are correlated.
CORRELATED = 1e-6
#: Structured part of residuals over the largest amplitude, from which a model fails.
SHARE = 0.05
#: Probability of a chi square below which it is not chance.
IMPROBABLE = 1e-4
#: Chi square over its degrees of freedom from which the noise was stated too small, and from which
#: a model fails whose residuals cannot be tested for structure.
NOTICED, RATIO = 2.0, 4.0
#: Chi square over its degrees of freedom from which it is rather the model that fails: noise stated
#: twenty times too small.
BEYOND = 400.0
#: Degrees of freedom from which structure can be tested.
TESTABLE = 20.0
#: Degrees of freedom from which the test for structure misses little, and its probability below
#: which fewer are in doubt.
SURE, DOUBTFUL = 50.0, 0.05
#: Probability of residuals by white noise below which those of an improbable chi square are
#: correlated, or of more than one size.
UNLIKELY = 1e-3
#: Share of the readings that may be outliers, how many at most, and standard deviations off.
FEW, MOST_OFF, FAR = 0.02, 10, 5.0

#: Probability by noise alone below which a response is there.
SURELY = 1e-9
#: Correlation of neighbours, in its standard deviations, up to which residuals are noise.
WHITE = 3.0


class Misfit(Enum):
    """What residuals are, besides the noise that is stated."""

    #: What the stated noise explains, or nearly.
    NONE = "none"
    #: Correlated, but small against the largest amplitude.
    CORRELATED = "correlated"
    #: Uncorrelated, and larger than the noise.
    UNDERESTIMATED = "underestimated"
    #: The model does not describe the data.
    REFUSED = "refused"

    @property
    def describes(self) -> bool:
        """Whether the model describes the data."""
        return self is not Misfit.REFUSED


@dataclass(frozen=True, kw_only=True)
class Correlation:
    """Residuals of one curve along its axis.

    Args:
        p_value: with which white noise is as correlated.
        share: structured part, root mean square, over the largest amplitude.
        excused: share that rounding, or the simulation's own error, explains.
        below: probability below which they are correlated (`correlated_below`).
    """

    p_value: float = 1.0
    share: float = 0.0
    excused: float = SMALLEST_RESIDUAL
    below: float = CORRELATED

    @property
    def misfit(self) -> Misfit:
        """Rule (a)."""
        if not (self.p_value < self.below and self.share > self.excused):
            return Misfit.NONE
        return Misfit.REFUSED if self.share > SHARE else Misfit.CORRELATED


def correlation(white: FloatArray, shares: FloatArray, *, equal: bool = True) -> Correlation:
    """How residuals are correlated along an axis.

    share^2 = max_k |sum_i s_i s_(i+k)|/n over the lags k = 1..min(10, n/5): what neighbours have in
    common, to which white noise adds nothing.

    Args:
        white: in the order of the axis, over their noise where that is known, shape (n,).
        shares: the same over the largest amplitude of the curve, shape (n,).
        equal: whether the noise has one size.
    """
    count = min(LAGS, shares.size // 5)
    if count < 1:
        return Correlation()
    common = [abs(float(shares[k:] @ shares[:-k])) for k in range(1, count + 1)]
    share = math.sqrt(max(common) / shares.size)
    return Correlation(p_value=white_noise_p(white, equal=equal), share=share)


def misfit_of(
    chi_square: float, freedom: float, p_value: float, correlated_p: float = math.nan
) -> Misfit:
    """Rules (b) and (c), of residuals that are not correlated.

    Args:
        chi_square: by the stated noise.
        freedom: its degrees of freedom.
        p_value: probability of such a chi square or a larger one; NaN: nothing to judge by.
        correlated_p: probability that white noise is as correlated; NaN: there is no axis.
    """
    if not p_value < IMPROBABLE:
        return Misfit.NONE
    ratio = chi_square / freedom
    tested = freedom >= TESTABLE and not math.isnan(correlated_p)
    signs = (freedom >= SURE, correlated_p >= DOUBTFUL)
    white = tested and (all(signs) if ratio > BEYOND else any(signs))
    if ratio > RATIO and not white:
        return Misfit.REFUSED
    return Misfit.UNDERESTIMATED if ratio > NOTICED else Misfit.NONE


def correlated_below(chi_square: float, freedom: float, p_value: float) -> float:
    """Probability of residuals along an axis, by white noise, below which they are correlated.

    Args:
        chi_square: by the stated noise; NaN: none is stated.
        freedom: its degrees of freedom.
        p_value: probability of such a chi square or a larger one.
    """
    is_wrong = p_value < IMPROBABLE and chi_square > NOTICED * freedom
    return UNLIKELY if is_wrong and freedom >= SURE else CORRELATED


def of_one_size(white: FloatArray, *, outliers: bool = True) -> bool:
    """Whether residuals may be noise of one size: a part of them alone does not make up chi square.

    Half of Gaussian residuals are within 0.674 of their root mean square. Where so many more are
    that it is hardly chance (P < UNLIKELY), a part of the data is off and the rest is not.

    Args:
        white: over their noise, shape (m,).
        outliers: whether as many as may be outliers (`far_off`) are left out, two of each reading.
    """
    most = 2 * _most_off(white.size) if outliers else 0
    sizes = np.sort(np.abs(white))[: white.size - most]
    half = MEDIAN_OF_NORMAL * math.sqrt(float(np.mean(sizes**2)))
    inside = int(np.count_nonzero(sizes < half))
    return bool(bdtrc(inside - 1, sizes.size, 0.5) >= UNLIKELY)


def far_off(white: FloatArray, slopes: FloatArray, readings: IntArray) -> tuple[int, ...]:
    """Numbers of single residuals that make up a misfit alone, the farthest first; mostly none.

    As few are left out of a linear fit as do until chi square of the rest is what the noise
    explains, or nearly (`misfit_of`); each is FAR beyond that fit, and their readings are few.

    Args:
        white: over their noise, shape (m,).
        slopes: their derivatives by all that is fitted, shape (m, k).
        readings: number of the reading each is of, shape (m,): peaks of one experiment are one
            reading, as are both parts of a complex value.
    """
    out: list[int] = []
    most = _most_off(white.size)
    while True:
        left = _left_without(white, slopes, out)
        sizes = np.abs(left)
        sizes[out] = 0.0
        out.append(int(np.argmax(sizes)))
        if np.unique(readings[out]).size > most:
            return ()
        left = _left_without(white, slopes, out)
        freedom = white.size - len(out) - slopes.shape[1]
        if freedom < 1 or np.min(np.abs(left[out])) < FAR:
            return ()
        rest = float(left @ left - left[out] @ left[out])
        if not tail(rest, freedom) < IMPROBABLE or rest <= NOTICED * freedom:
            return tuple(out)


def _most_off(residuals: int) -> int:
    """How many readings of so many residuals may be outliers."""
    return min(MOST_OFF, max(1, int(FEW * residuals)))


def _left_without(white: FloatArray, slopes: FloatArray, out: list[int]) -> FloatArray:
    """What a linear fit to all but some residuals leaves of all, (m,)."""
    weights = np.ones(white.size)
    weights[out] = 0.0
    step = scaled_solution(slopes * weights[:, None], white * weights)
    return np.asarray(white - slopes @ step)


def scaled_solution(columns: FloatArray, target: FloatArray) -> FloatArray:
    """x of the least |columns x - target|, (k,), whatever the units of the columns are.

    Args:
        columns: shape (m, k).
        target: shape (m,).
    """
    sizes = np.linalg.norm(columns, axis=0)
    sizes[sizes == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / sizes, target, rcond=1e-9)[0] / sizes)


def excess_share(left: float, before: float, freedom: float) -> float:
    """Share of chi square beyond its degrees of freedom that is left; one where there was none.

    Args:
        left: chi square after a change.
        before: chi square before it.
        freedom: degrees of freedom.
    """
    excess = before - freedom
    return float(np.clip((left - freedom) / excess, 0.0, 1.0)) if excess > 0.0 else 1.0


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
        return tail(float(np.sum((left / sigma) ** 2)), left.size) > IMPROBABLE
    together = abs(float(left[1:] @ left[:-1])) * np.sqrt(left.size)
    white = together <= WHITE * float(left @ left)
    return bool(white) and chance(flat, left, sigma, unknowns) <= SURELY
