"""In which period values are told that have one: draws, minima, truth and the fit in the same.

Values that differ by a period are the same system. The told period holds the value that the fit
reports, as the fit tells it. It begins

    in the middle of the widest gap between draws, if that is GAP of the period or wider
    else, as the draws go all round, at a multiple of the period, as a fit tells values
    but where draws are rarest, if at that multiple they are more than OFTEN times as frequent

so that no cut goes through where the draws are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fitting.campaign.parameters import Parameter, canonical
from fitting.inference.posterior.minima import WHOLE, Target
from fitting.text.arrays import FloatArray

#: Share of a period without a draw from which draws do not go all round.
GAP = 0.125
#: Bins of a period, and how many of them are looked at together.
BINS, TOGETHER = 32, 4
#: How often draws may be at the cut, of how often they are where they are rarest.
OFTEN = 2.0


def begins_of(target: Target, draws: FloatArray, likely: Mapping[str, float]) -> FloatArray:
    """Where the told period of each parameter begins, (n,), in its unit; NaN of one without.

    Args:
        target: The posterior.
        draws: (..., n) in the parameters' units.
        likely: What the fit reports, by name.
    """
    values = np.array([likely.get(p.name, math.nan) for p in target.parameters])
    reported = canonical(target.parameters, values)
    return np.array(
        [
            math.nan if p.period is None else _begin(p, p.period, draws[..., i], reported[i])
            for i, p in enumerate(target.parameters)
        ]
    )


def told(target: Target, begins: FloatArray, p: FloatArray) -> FloatArray:
    """Parameters (..., n) with each that has a period in the told one.

    Args:
        target: The posterior.
        begins: of the told periods, (n,).
        p: in their units.
    """
    columns = [
        _turned(q, begin, p[..., i])
        for i, (q, begin) in enumerate(zip(target.parameters, begins.tolist(), strict=True))
    ]
    return np.stack(columns, axis=-1)


def told_value(parameter: Parameter, begin: float, value: float) -> float:
    """A value, in the told period where its parameter has one.

    Args:
        parameter: whose it is.
        begin: of its told period.
        value: in its unit; nan stays.
    """
    return float(_turned(parameter, begin, np.array(value)))


def _turned(parameter: Parameter, begin: float, values: FloatArray) -> FloatArray:
    if parameter.period is None:
        return values
    turns = np.floor((values - begin) / parameter.period)
    return np.asarray(values - parameter.period * turns)


def told_interval(
    parameter: Parameter, begin: float, interval: tuple[float, float]
) -> tuple[float, float]:
    """An interval of the fit: the told period where it holds a whole one, else as it is.

    Args:
        parameter: whose it is.
        begin: of its told period.
        interval: about the value that the fit reports, which lies in the told period.
    """
    low, high = interval
    if parameter.period is None or not high - low >= parameter.period * (1.0 - WHOLE):
        return interval
    return begin, begin + parameter.period


def _begin(parameter: Parameter, period: float, draws: FloatArray, reported: float) -> float:
    """Where the told period begins: by the draws, and a multiple off so that it holds a value."""
    if parameter.upper - parameter.lower < period * (1.0 - WHOLE):
        # a box that holds no whole period is told in one piece, whatever is drawn in it
        cut = 0.5 * (parameter.lower + parameter.upper - period)
    else:
        cut = _cut(np.mod(draws.ravel() / period, 1.0)) * period
    within = reported if math.isfinite(reported) else 0.5 * period
    return cut + period * math.floor((within - cut) / period)


def _cut(shares: FloatArray) -> float:
    """Where a circle of length one is cut, by draws (k,) on it."""
    ordered = np.sort(shares)
    gaps = np.diff(ordered, append=ordered[0] + 1.0)
    widest = int(np.argmax(gaps))
    if gaps[widest] >= GAP:
        return float(ordered[widest] + 0.5 * gaps[widest])
    counts, _ = np.histogram(shares, BINS, (0.0, 1.0))
    # about the lower end of each bin
    about = np.sum([np.roll(counts, TOGETHER // 2 - k) for k in range(TOGETHER)], axis=0)
    rarest = int(np.argmin(about))
    return 0.0 if about[0] <= OFTEN * about[rarest] else rarest / BINS
