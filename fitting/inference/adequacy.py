"""Does the model describe the data at all? By the residuals at the most likely point.

    chi^2 = r^T V^-1 r        freedom = m - s - tr(W C W^T)

over rows of declared or measured noise, s the unknowns that are solved for inside them; where
noise is taken from the scatter of the residuals themselves, chi square says nothing. What follows
from chi square and from how residuals are correlated along an axis is one rule for every kind of
measurement (`fitting.signal.misfit`): rows of curves whose residuals are correlated are judged by
that alone, the rest by chi square.

With few degrees of freedom noise alone reaches several times them, but a probability of 1e-4 only
once in ten thousand fits (`fitting.signal.chi_square`: noise that was estimated beside the fit
leaves larger ones). What the simulation may be off by (`fitting.fit.noise`) excuses what it can
explain: it is in the intervals then, and no fault of the model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincc

from fitting.fit.covariance import RowCovariance
from fitting.fit.likelihood.descent import Optimum
from fitting.fit.solution import Solution
from fitting.inference.likelihood.exploration import data_covariance
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.dataset import Dataset, own_scale
from fitting.measurements.measurement import Measurement
from fitting.signal.chi_square import tail
from fitting.signal.misfit import Correlation, Misfit, correlation, misfit_of, of_one_size
from fitting.signal.presence import SURELY, chance
from fitting.signal.residual_tests import STRUCTURED, Structure, innovations
from fitting.text.arrays import BoolArray, FloatArray

#: Parts of a curve whose residuals are compared in size where nobody states their noise.
PARTS = 4
#: Chi square by stated noise below which residuals of a curve tell nothing, however correlated: no
#: move of parameters gains more, and within one standard error (Dchi^2 = 1) all fit alike.
RESOLVED = 1.0
#: Share of the rows of a measurement that a fit may take away where they are tested for structure.
MOST_TAKEN = 0.25


def adequacy_of(
    optimum: Optimum,
    structure: Structure | None = None,
    closer: Adequacy | None = None,
    scale_off: float = math.nan,
) -> Adequacy:
    """Chi square of the rows of known noise at the most likely point, and whether it will do.

    Args:
        optimum: the most likely point and its likelihood.
        structure: of the residuals of curves, by which their noise was taken wider: that excuses
            no model, the noise is known.
        closer: what another form of a line says of a sweep whose residuals tell its noise, where it
            leaves far less.
        scale_off: factor by which the scale of peaks may be off, where that is beyond their noise:
            what they tell with it is not judged by errors about one point; else NaN.
    """
    widening = 1.0 if structure is None else structure.widening
    found = _of_known_noise(optimum, widening)
    if closer is not None and (found.describes or found.is_correlated):
        return closer  # says what the residuals that are correlated show
    if found.describes and scale_off > 1.0:
        return replace(found, describes=False, scale_off=scale_off)
    return found


@dataclass(frozen=True)
class _Along:
    """The curve whose residuals are correlated worst, and which rows (m,) are on such curves.

    `least_p` is the least probability of those that are not correlated; NaN without any curve.
    """

    worst: Correlation
    name: str
    correlated: BoolArray
    least_p: float


def _of_known_noise(optimum: Optimum, widening: float) -> Adequacy:
    likelihood, m = optimum.likelihood, optimum.likelihood.data_rows
    data = likelihood.objective.data
    here = optimum.expansion
    rows = likelihood.residuals(here.sample.rows[:m])
    matrix = likelihood.residuals(here.matrix[:m])
    covariance = data_covariance(optimum, stated=True)
    noise = likelihood.noise
    slopes = noise.whitened(matrix)
    taken = np.sum((slopes @ covariance) * slopes, axis=1)
    along = _along(optimum, rows, _stated(noise, data, widening), taken)
    known = data.sigma > 0.0

    def by(wider: RowCovariance, kept: BoolArray) -> Adequacy:
        white = _stated(wider, data, widening).restricted(kept).whitened(rows[kept])
        slopes = wider.restricted(kept).whitened(matrix[kept])
        # unknowns that measurements are solved for inside, of those with rows kept
        pairs = zip(data.measurements, data.slices, strict=True)
        solved = sum(m.solved_inside + own_scale(m) for m, at in pairs if np.any(kept[at]))
        return judged(
            white, slopes, covariance, solved, data.noise_freedom, correlated_p=along.least_p
        )

    rest = known & ~along.correlated
    found = by(noise, known)
    of_rest = by(noise, rest) if np.any(along.correlated) else found
    describes = of_rest.describes
    if not describes and likelihood.bounded.columns:
        describes = by(noise.loosened(likelihood.bounded), rest).describes
    return replace(
        found,
        describes=describes and along.worst.misfit.describes,
        noise_factor=of_rest.noise_factor if describes else 1.0,
        is_uneven=of_rest.is_uneven and not describes,
        correlated_p=math.nan if math.isnan(along.least_p) else along.worst.p_value,
        share=math.nan if math.isnan(along.least_p) else along.worst.share,
        curve=along.name,
    )


def _stated(noise: RowCovariance, data: Dataset, widening: float) -> RowCovariance:
    """The noise as it is stated: that of curves was taken wider."""
    sigma = noise.sigma.copy()
    sigma[data.curve_rows] /= widening
    return replace(noise, sigma=sigma)


def _along(optimum: Optimum, rows: FloatArray, stated: RowCovariance, taken: FloatArray) -> _Along:
    """How residuals are correlated along every axis; probabilities are of that many curves.

    Args:
        optimum: the most likely point and its likelihood.
        rows: residuals there, shape (m,).
        stated: their noise.
        taken: share of each that the fit takes away, shape (m,): where that is much, residuals of
            a right model are correlated.
    """
    data, bounded = optimum.likelihood.objective.data, optimum.likelihood.bounded
    off = bounded.largest if bounded.own.size else np.zeros(rows.size)
    curves = [
        (m, at, curve)
        for m, at in zip(data.measurements, data.slices, strict=True)
        for curve in m.residual_curves(rows[at])
        if m.solved_inside + np.sum(taken[at]) < MOST_TAKEN * m.rows
    ]
    marked = np.zeros(rows.size, dtype=bool)
    worst, name, least = Correlation(), "", -1.0
    doubts: list[float] = []
    for m, at, curve in curves:
        mine = at.start + curve.rows
        known = bool(np.all(data.sigma[mine] > 0.0))
        # what rows share, as the error of a scale, is no structure
        white = stated.restricted(mine).whitened(rows[mine] - curve.centre)
        left = white * stated.sigma[mine]
        if known and float(white @ white) < RESOLVED:
            found = Correlation()
        else:
            found = correlation(white, left * curve.share, equal=known or _is_equal(left))
        excused = float(np.sqrt(np.mean((off[mine] * curve.share) ** 2)))
        found = replace(
            found,
            p_value=min(1.0, found.p_value * len(curves)),
            excused=max(found.excused, excused),
        )
        if found.misfit is not Misfit.NONE:
            marked[mine] = True
        else:
            doubts.append(found.p_value)
        rank = 2.0 + found.share if not found.misfit.describes else 1.0 - found.p_value
        if rank > least:
            worst, name, least = found, "/".join(filter(None, (m.series, curve.name))), rank
    return _Along(worst, name, marked, min(doubts, default=1.0 if curves else math.nan))


def _is_equal(left: FloatArray) -> bool:
    """Whether residuals of unknown noise are of one size, as far as they are no pattern."""
    _, news = innovations(left)
    ranks = np.argsort(np.argsort(np.abs(news))) + 1.0
    parts = np.array_split(ranks, PARTS)
    if min(part.size for part in parts) < 2 or not np.any(news):
        return True
    # Kruskal and Wallis, J. Am. Stat. Assoc. 47 (1952) 583: chi square of PARTS - 1
    mean, size = 0.5 * (ranks.size + 1.0), ranks.size * (ranks.size + 1.0)
    square = 12.0 / size * sum(part.size * (float(np.mean(part)) - mean) ** 2 for part in parts)
    return bool(gammaincc(0.5 * (PARTS - 1), 0.5 * square) >= STRUCTURED)


def judged(
    white: FloatArray,
    slopes: FloatArray,
    covariance: FloatArray,
    solved: int = 0,
    noise_freedom: float = np.inf,
    *,
    correlated_p: float = math.nan,
) -> Adequacy:
    """Whether residuals are what their noise explains.

    Args:
        white: residuals of known noise, of unit variance by it, shape (m,).
        slopes: their derivatives in x, by the noise that `covariance` is of, shape (m, n).
        covariance: of x, shape (n, n), from all data.
        solved: number of unknowns that the rows are solved for inside.
        noise_freedom: degrees of freedom of the noise where it is estimated, else infinite.
        correlated_p: probability that white noise is as correlated; NaN: there is no axis.
    """
    if not white.size:
        return Adequacy(chi_square=np.nan, freedom=0.0, p_value=np.nan, describes=True)
    square = float(white @ white)
    freedom = float(white.size - solved - np.sum((slopes @ covariance) * slopes))
    if freedom < 0.5:  # as many unknowns as rows: nothing is left to judge by
        return Adequacy(chi_square=square, freedom=0.0, p_value=np.nan, describes=True)
    p_value = tail(square, freedom, noise_freedom)
    found = misfit_of(square, freedom, p_value, correlated_p)
    uneven = found is Misfit.UNDERESTIMATED and not of_one_size(white)
    found = Misfit.REFUSED if uneven else found
    return Adequacy(
        chi_square=square,
        freedom=freedom,
        p_value=p_value,
        describes=found.describes,
        is_uneven=uneven,
        noise_factor=math.sqrt(square / freedom) if found is Misfit.UNDERESTIMATED else 1.0,
    )


def is_redundant(optimum: Optimum) -> bool:
    """Whether there are more data than unknowns: else every model fits, and none is tested.

    A Gaussian prior of a parameter counts as one more datum.

    Args:
        optimum: the most likely point and its likelihood.
    """
    likelihood = optimum.likelihood
    priors = np.count_nonzero(likelihood.inverse_prior_sigma)
    rows = likelihood.data_rows - likelihood.objective.data.solved_inside
    return bool(rows + priors > len(likelihood.parameters))


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
