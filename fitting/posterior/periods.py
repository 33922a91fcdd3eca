"""In which period values are given that have one: draws, minima, truth and the fit in the same.

Values that differ by a period are the same system. The period given holds the value that the fit
reports, as the fit gives it. It begins

    in the middle of the widest gap between draws, if that is GAP of the period or wider
    else, as the draws go all round, at a multiple of the period, as a fit gives values
    but where draws are rarest, if at that multiple they are more than OFTEN times as frequent

so that no cut goes through where the draws are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fitting.extension.problem import Parameter, canonical
from fitting.posterior.minima import WHOLE, Target
from fitting.text.arrays import FloatArray

#: Share of a period without a draw from which draws do not go all round.
GAP = 0.125
#: Bins of a period, and how many of them are looked at together.
BINS, TOGETHER = 32, 4
#: How often draws may be at the cut, of how often they are where they are rarest.
OFTEN = 2.0


def period_begins(target: Target, draws: FloatArray, likely: Mapping[str, float]) -> FloatArray:
    """Where the period of each parameter begins, (n,), in its unit; NaN of one without.

    Args:
        target: The posterior.
        draws: (..., n) in the parameters' units.
        likely: What the fit reports, by name.
    """
    values = np.array([likely.get(p.name, math.nan) for p in target.parameters])
    reported = canonical(target.parameters, values)
    begins = np.full(len(values), math.nan)
    for i, p in enumerate(target.parameters):
        if p.period is None:
            continue
        if p.upper - p.lower < p.period * (1.0 - WHOLE):
            # a box that holds no whole period is shown in one piece, whatever is drawn in it
            cut = 0.5 * (p.lower + p.upper - p.period)
        else:
            cut = _cut(np.mod(draws[..., i].ravel() / p.period, 1.0)) * p.period
        within = reported[i] if math.isfinite(reported[i]) else 0.5 * p.period
        begins[i] = cut + p.period * math.floor((within - cut) / p.period)
    return begins


def in_period(target: Target, begins: FloatArray, p: FloatArray) -> FloatArray:
    """Parameters (..., n) with each that has a period in the one given.

    Args:
        target: The posterior.
        begins: of the periods, (n,).
        p: in their units.
    """
    columns = [
        _shifted(q, begin, p[..., i])
        for i, (q, begin) in enumerate(zip(target.parameters, begins.tolist(), strict=True))
    ]
    return np.stack(columns, axis=-1)


def value_in_period(parameter: Parameter, begin: float, value: float) -> float:
    """A value, in the period given where its parameter has one.

    Args:
        parameter: whose it is.
        begin: of its period.
        value: in its unit; nan stays.
    """
    return float(_shifted(parameter, begin, np.array(value)))


def _shifted(parameter: Parameter, begin: float, values: FloatArray) -> FloatArray:
    if parameter.period is None:
        return values
    turns = np.floor((values - begin) / parameter.period)
    return np.asarray(values - parameter.period * turns)


def interval_in_period(
    parameter: Parameter, begin: float, interval: tuple[float, float]
) -> tuple[float, float]:
    """An interval of the fit: the period given where it holds a whole one, else as it is.

    Args:
        parameter: whose it is.
        begin: of its period.
        interval: about the value that the fit reports, which lies in the period given.
    """
    low, high = interval
    if parameter.period is None or not high - low >= parameter.period * (1.0 - WHOLE):
        return interval
    return begin, begin + parameter.period


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
