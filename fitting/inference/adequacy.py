"""Does the model describe the data at all? By the residuals at the most likely point.

    chi^2 = r^T V^-1 r        freedom = m - s - tr(W C W^T)

over rows of declared or measured noise, s the unknowns that are solved for inside them; where
noise is estimated from the residuals themselves, chi square tests nothing. What follows from chi
square and from how residuals are correlated along an axis is one rule for every kind of measurement
(`fitting.signal.misfit`): rows of curves whose residuals are correlated are judged by that alone,
the rest by chi square.

With few degrees of freedom noise alone reaches several times them, but a probability of 1e-4 only
once in ten thousand fits (`fitting.signal.chi_square`: noise that was estimated apart from the fit
leaves larger ones). What the simulation may be off by (`fitting.fit.noise`) excuses what it can
explain: it is in the intervals then, and no fault of the model.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincc

from fitting.fit.covariance import RowCovariance
from fitting.fit.fit import Status
from fitting.fit.optimum import Optimum
from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy, Ending
from fitting.inference.likelihood.profile import data_covariance
from fitting.measurements.dataset import Dataset, own_scale
from fitting.signal.chi_square import tail
from fitting.signal.misfit import (
    Correlation,
    Misfit,
    correlated_below,
    correlation,
    misfit_of,
    of_one_size,
)
from fitting.signal.presence import SURELY, chance
from fitting.signal.residual_tests import STRUCTURED, Structure, innovations
from fitting.text.arrays import BoolArray, FloatArray, IntArray

#: Parts of a curve whose residuals are compared in size where their noise is not stated.
PARTS = 4
#: Chi square by stated noise below which residuals of a curve test nothing, however correlated: no
#: move of parameters gains more, and within one standard error (Dchi^2 = 1) all fit alike.
RESOLVED = 1.0
#: Share of the rows of a measurement that a fit may take away where they are tested for structure.
MOST_TAKEN = 0.25


class _Along(NamedTuple):
    """Residuals of a curve in the order of its axis, or of all curves of a measurement in turn.

    `name` of the curve; of all of them, that of the measurement. `rows` (n,) are the numbers of the
    rows, `white` residuals over their noise, `share` of a residual over the largest amplitude.
    """

    name: str
    rows: IntArray
    white: FloatArray
    share: FloatArray


def adequacy_of(
    optimum: Optimum,
    structure: Structure | None = None,
    closer: Adequacy | None = None,
    scale_off: float = math.nan,
) -> Adequacy:
    """Chi square of the rows of known noise at the most likely point, and the rule's decision.

    Args:
        optimum: the most likely point and its likelihood.
        structure: of the residuals of curves, by which their noise was widened: that excuses no
            model, the noise is known.
        closer: the model against lines of another form that leave far less.
        scale_off: factor by which the scale of peaks may be off, where that is beyond their noise:
            errors about one point are not enough for it; else NaN.
    """
    likelihood, m = optimum.likelihood, optimum.likelihood.data_rows
    data, noise = likelihood.objective.data, likelihood.noise
    rows = likelihood.residuals(optimum.expansion.sample.rows[:m])
    matrix = likelihood.residuals(optimum.expansion.matrix[:m])
    covariance = data_covariance(optimum, stated=True)
    slopes = noise.whitened(matrix)
    taken = np.sum((slopes @ covariance) * slopes, axis=1)

    def stated(wider: RowCovariance) -> RowCovariance:
        """The noise as it is stated, not as it was widened."""
        sigma = wider.sigma.copy()
        sigma[data.curve_rows] /= 1.0 if structure is None else structure.widening
        return replace(wider, sigma=sigma)

    def judgement(wider: RowCovariance, kept: BoolArray, least_p: float = math.nan) -> Adequacy:
        """Of some rows: unknowns solved inside count for measurements with rows among them."""
        pairs = zip(data.measurements, data.slices, strict=True)
        return chi_square_test(
            stated(wider).restricted(kept).whitened(rows[kept]),
            wider.restricted(kept).whitened(matrix[kept]),
            covariance,
            sum(m.solved_inside + own_scale(m) for m, at in pairs if np.any(kept[at])),
            data.noise_freedom,
            correlated_p=least_p,
        )

    known = data.sigma > 0.0
    every = judgement(noise, known)
    below = correlated_below(every.chi_square, every.freedom, every.p_value)
    correlated, least_p, along = _along_curves(optimum, rows, stated(noise), taken, below)
    rest = judgement(noise, known & ~correlated, least_p)
    describes = rest.describes
    if not describes and likelihood.bounded.columns:
        loosened = noise.loosened(likelihood.bounded)
        describes = judgement(loosened, known & ~correlated, least_p).describes
    result = replace(
        every,
        describes=describes and along.describes,
        noise_factor=rest.noise_factor if describes else 1.0,
        is_uneven=rest.is_uneven and not describes,
        correlated_p=along.correlated_p,
        share=along.share,
        curve=along.curve,
    )
    if closer is not None and (result.describes or result.is_correlated):
        return closer  # it names what the correlated residuals are
    if result.describes and scale_off > 1.0:
        return replace(result, describes=False, scale_off=scale_off)
    return result


def _along_curves(
    optimum: Optimum,
    rows: FloatArray,
    stated: RowCovariance,
    taken: FloatArray,
    below: float,
) -> tuple[BoolArray, float, Adequacy]:
    """Which rows (m,) are on curves with correlated residuals; least p of others; worst curve.

    The curve that is correlated worst is a record without chi square. Probabilities are of that
    many curves, NaN without any.

    Args:
        optimum: the most likely point and its likelihood.
        rows: residuals there, shape (m,).
        stated: their noise.
        taken: share of each that the fit takes away, shape (m,): where that is much, residuals of
            a right model are correlated.
        below: probability by white noise below which they are correlated.
    """
    data, bounded = optimum.likelihood.objective.data, optimum.likelihood.bounded
    off = bounded.largest if bounded.own.size else np.zeros(rows.size)
    asked: list[_Along] = []
    for m, at in zip(data.measurements, data.slices, strict=True):
        if m.solved_inside + np.sum(taken[at]) >= MOST_TAKEN * m.rows:
            continue
        each = []
        for curve in m.residual_curves(rows[at]):
            mine = np.asarray(at.start + curve.rows)
            name = "/".join(filter(None, (m.series, curve.name)))
            # what rows share, as the error of a scale, is no structure
            white = stated.restricted(mine).whitened(rows[mine] - curve.centre)
            each.append(_Along(name, mine, white, curve.share))
        asked += each
        # what every sweep of a map has too weakly to be seen alone; peaks have no common axis
        if len(each) > 1 and m.is_curve:
            columns = zip(*(curve[1:] for curve in each), strict=True)
            asked.append(_Along(m.series, *map(np.concatenate, columns)))
    correlated = np.zeros(rows.size, dtype=bool)
    worst, name, highest, others = Correlation(), "", -1.0, [1.0]
    for along in asked:
        mine = along.rows
        known = bool(np.all(data.sigma[mine] > 0.0))
        left = along.white * stated.sigma[mine]
        test = Correlation()
        if not known or float(along.white @ along.white) >= RESOLVED:
            test = correlation(along.white, left * along.share, equal=known or _is_equal(left))
        excused = float(np.sqrt(np.mean((off[mine] * along.share) ** 2)))
        test = replace(
            test,
            p_value=min(1.0, test.p_value * len(asked)),
            excused=max(test.excused, excused),
            below=below,
        )
        if test.misfit is not Misfit.NONE:
            correlated[mine] = True
        else:
            others.append(test.p_value)
        rank = 1.0 - test.p_value if test.misfit.describes else 2.0 + test.share
        if rank > highest:
            worst, name, highest = test, along.name, rank
    summary = Adequacy(
        chi_square=math.nan,
        freedom=0.0,
        p_value=math.nan,
        describes=worst.misfit.describes,
        correlated_p=worst.p_value if asked else math.nan,
        share=worst.share if asked else math.nan,
        curve=name,
    )
    return correlated, min(others) if asked else math.nan, summary


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


def chi_square_test(
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
    square = float(white @ white) if white.size else math.nan
    freedom = float(white.size - solved - np.sum((slopes @ covariance) * slopes))
    if not white.size or freedom < 0.5:  # as many unknowns as rows: nothing is tested
        return Adequacy(chi_square=square, freedom=0.0, p_value=np.nan, describes=True)
    p_value = tail(square, freedom, noise_freedom)
    misfit = misfit_of(square, freedom, p_value, correlated_p)
    uneven = misfit is Misfit.UNDERESTIMATED and not of_one_size(white)
    misfit = Misfit.REFUSED if uneven else misfit
    return Adequacy(
        chi_square=square,
        freedom=freedom,
        p_value=p_value,
        describes=misfit.describes,
        is_uneven=uneven,
        noise_factor=math.sqrt(square / freedom) if misfit is Misfit.UNDERESTIMATED else 1.0,
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
    """That nothing of the response exceeds the noise of the curves; None where it does.

    Peaks of tones are a response: where any are fitted nothing is tested.

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
        no_line=True,
        series=tuple(dict.fromkeys(m.series for m in fitted if m.series)),
    )


def ending_of(
    status: Status,
    adequacy: Adequacy | None,
    *,
    inflation: float,
    structure: Structure | None,
    data: Dataset,
    residuals: FloatArray | None = None,
) -> Ending:
    """How a fit ended.

    Args:
        status: of the fit itself, or that its model does not describe the data.
        adequacy: chi square of the rows of known noise, None where it was not tested.
        inflation: of all errors, for residuals beyond the noise.
        structure: of the residuals of curves, None without any.
        data: all measurements.
        residuals: rows of all of them, (m,); None: they are not compared with the curves.
    """
    if status not in (Status.CONVERGED, Status.MISFIT):
        return Ending(kind="not_converged")
    kind: str = "described"
    if status is Status.MISFIT:
        kind = "no_line" if adequacy is not None and adequacy.no_line else "not_described"
    fitted = [(m, k) for m, k in zip(data.measurements, data.slices, strict=True) if m.rows]
    shares = [
        share
        for m, rows in fitted
        if residuals is not None and m.is_curve
        if math.isfinite(share := m.share_left(residuals[rows]))
    ]
    return Ending(
        kind=kind,  # type: ignore[arg-type]
        adequacy=adequacy,
        inflation=inflation,
        structure=structure,
        noise="estimated" if any(m.estimates_noise for m in data.measurements) else "stated",
        share=max(shares, default=math.nan),
        is_part=len(shares) < len(fitted),
    )
