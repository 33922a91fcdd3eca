"""Ways of parameters to the ends of their room, the rest following as well as it can.

What fits at the end of such a way may lie far from the most likely point, behind valleys that no
profile goes through.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.likelihood.descent import AT_LIMIT, Optimum
from fitting.fit.likelihood.few_places import FewPlaces, of_few_places, own_gain
from fitting.fit.likelihood.likelihood import Likelihood, LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Request, Task, run_in_lockstep
from fitting.inference.likelihood.profiles import ProfilePoint, Quantity, fit_at_end
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95

#: Turns of an angle to either side, in periods.
TURNS = (3e-4, 6e-4, 1e-3, 1.5e-3, 2e-3, 3e-3, 6e-3, 1e-2)
#: Strides of a parameter to the end of its room, each from where the last one ended: valleys are
#: curved.
STRIDES = 4


def walked_to_ends(
    evaluator: LikelihoodEvaluator,
    wide: Optimum,
    parameters: Sequence[Quantity],
    fitting: Sequence[ProfilePoint],
) -> list[list[ProfilePoint]]:
    """Points on the ways of every parameter to the ends of its room, those that fit.

    Ends that none of them reached are tried once more, from the ends that were: what a parameter
    does may come to its end only where another one is at a limit, as the damping of a mode does
    that is not coupled there.

    Args:
        evaluator: of the likelihood of `wide`; counts what is evaluated.
        wide: the optimum with the room.
        parameters: that are brought to the ends of it.
        fitting: points in hand that fit.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    at = wide.expansion
    here = ProfilePoint(value=math.nan, delta=0.0, x=at.x, outputs=at.sample.outputs)
    known = [here, *fitting]
    first = _gone(evaluator, wide, _from_nearest(parameters, wide, known))
    known += [p for walk in first for p in walk if p.delta <= ROOT_95**2]
    return first + _gone(evaluator, wide, _from_limits(parameters, wide, known))


def turned(
    evaluator: LikelihoodEvaluator,
    wide: Optimum,
    parameters: Sequence[Quantity],
    fitting: Sequence[ProfilePoint],
) -> list[ProfilePoint]:
    """Points that fit beside those at the ends of rooms, an angle turned a little.

    Where modes stand apart no output changes with their angle to first order, and no search along
    slopes leaves that place; where one is damped without end, a little of it is much to an output.

    Args:
        evaluator: of the likelihood of `wide`; counts what is evaluated.
        wide: the optimum with the room.
        parameters: that have been brought to the ends of it.
        fitting: points in hand that fit.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    begins = _at_limits(parameters, wide, fitting)
    likelihood = wide.likelihood
    xs = []
    for i, parameter in enumerate(likelihood.parameters):
        period = _period(parameter)
        if not period:
            continue
        step = np.zeros(wide.expansion.x.size)
        step[i] = period / parameter.scale
        xs += [begin + way * turn * step for begin in begins for turn in TURNS for way in (-1, 1)]
    xs = [x for x in xs if np.all((likelihood.lower <= x) & (x <= likelihood.upper))]
    if not xs:
        return []

    def looked_at() -> Task[list[ProfilePoint]]:
        samples = yield Request(tuple(xs))
        return [
            ProfilePoint(value=math.nan, delta=delta, x=sample.x, outputs=sample.outputs)
            for sample in samples
            if (delta := wide.delta(float(sample.rows @ sample.rows))) <= ROOT_95**2
        ]

    return run_in_lockstep([looked_at()], evaluator)[0] or []


def _period(parameter: Parameter) -> float:
    """Period of an angle, half a turn where none is told, in its unit; 0 of what is no angle."""
    return parameter.period or (math.pi if parameter.is_angle else 0.0)


@dataclass(frozen=True)
class _Way:
    """A parameter that is brought to an end of its room, in x, and where that begins, (n,)."""

    quantity: Quantity
    begin: FloatArray
    end: float

    def walk(self, wide: Optimum, loose: float = 0.0) -> Task[list[ProfilePoint]]:
        return _walk(wide, self.quantity, self.begin, self.end, loose)


def _gone(
    evaluator: LikelihoodEvaluator, wide: Optimum, ways: Sequence[_Way]
) -> list[list[ProfilePoint]]:
    """Points on the ways, those that fit; where a few places exclude all of one it is not gone."""
    few = of_few_places(wide.likelihood) if ways and _is_noise_alone(wide.likelihood) else None
    if few is not None:
        seen, loose = _seen_by(wide, few), own_gain(wide.likelihood)
        with evaluator.of(few.likelihood):
            found = run_in_lockstep([way.walk(seen, loose) for way in ways], evaluator)
        # None: more evaluations are not allowed, and nothing is known
        ways = [w for w, points in zip(ways, found, strict=True) if points is None or points]
    return [points or [] for points in run_in_lockstep([w.walk(wide) for w in ways], evaluator)]


def _is_noise_alone(likelihood: Likelihood) -> bool:
    """Whether nothing but noise that is known stands between data and model."""
    return likelihood.inflation == 1.0 and not np.any(likelihood.scatter)


def _seen_by(wide: Optimum, few: FewPlaces) -> Optimum:
    """The optimum as a few places see it: their chi square, at the same point."""
    at = wide.expansion
    sample = replace(at.sample, rows=at.sample.rows[few.kept], outputs=np.empty(0))
    seen = replace(at, sample=sample, matrix=at.matrix[few.kept], outward=at.outward[:0])
    return replace(wide, likelihood=few.likelihood, expansion=seen)


def _ends(parameters: Sequence[Quantity], wide: Optimum) -> list[tuple[Quantity, float]]:
    """Parameters and either end of their room, in x."""
    limits = wide.likelihood.lower, wide.likelihood.upper
    return [(q, float(limit[q.index])) for q in parameters for limit in limits]


def _open_ends(
    parameters: Sequence[Quantity], wide: Optimum, known: Sequence[ProfilePoint]
) -> list[tuple[Quantity, float]]:
    """Those at which none of the points in hand is."""
    return [
        (quantity, end)
        for quantity, end in _ends(parameters, wide)
        if not any(_is_at(wide, point, quantity, end) for point in known)
    ]


def _is_at(wide: Optimum, point: ProfilePoint, quantity: Quantity, end: float) -> bool:
    i = quantity.index
    return abs(float(point.x[i]) - end) <= AT_LIMIT * float(wide.likelihood.widths[i])


def _from_nearest(
    parameters: Sequence[Quantity], wide: Optimum, known: Sequence[ProfilePoint]
) -> list[_Way]:
    """A way to every open end, from the nearest point in hand."""
    ways = []
    for quantity, end in _open_ends(parameters, wide, known):
        i = quantity.index
        nearest = min(known, key=lambda p: abs(float(p.x[i]) - end))
        ways.append(_Way(quantity, nearest.x, end))
    return ways


def _from_limits(
    parameters: Sequence[Quantity], wide: Optimum, known: Sequence[ProfilePoint]
) -> list[_Way]:
    """Ways to every open end, from the best point in hand at each limit of any parameter."""
    begins = _at_limits(parameters, wide, known)
    return [
        _Way(quantity, begin, end)
        for quantity, end in _open_ends(parameters, wide, known)
        for begin in begins
    ]


def _at_limits(
    parameters: Sequence[Quantity], wide: Optimum, known: Sequence[ProfilePoint]
) -> list[FloatArray]:
    """The best point in hand at each limit of any parameter, in x."""
    best = []
    for other, limit in _ends(parameters, wide):
        there = [p for p in known if _is_at(wide, p, other, limit)]
        if there:
            best.append(min(there, key=lambda p: p.delta))
    return list({id(point): point.x for point in best}.values())


def _walk(
    wide: Optimum, quantity: Quantity, begin: FloatArray, end: float, loose: float
) -> Task[list[ProfilePoint]]:
    """Points on the way of a parameter to an end, the last of them there, as far as it comes.

    Where a stride leads nowhere the end itself is tried from the last point that fits.
    """
    parameter = wide.likelihood.parameters[quantity.index]
    first, last = (
        parameter.reference + parameter.scale * x for x in (float(begin[quantity.index]), end)
    )
    spaced = np.geomspace if first > 0.0 and last > 0.0 else np.linspace
    way = np.asarray(spaced(first, last, STRIDES + 1))
    found: list[ProfilePoint] = []
    *targets, last = map(float, (way[1:] - parameter.reference) / parameter.scale)
    for target in targets:
        point = yield from value_at(wide, quantity, target, begin, loose)
        if point is None:
            break
        found.append(point)
        begin = point.x
    point = yield from value_at(wide, quantity, last, begin, loose)
    return found if point is None else [*found, point]


def value_at(
    optimum: Optimum, quantity: Quantity, target: float, begin: FloatArray, loose: float = 0.0
) -> Task[ProfilePoint | None]:
    """The least chi square with a quantity at a value, None if that is excluded for good.

    Args:
        optimum: what chi square is counted from.
        quantity: what is held.
        target: where, in x or in the output's unit.
        begin: search vector where the search begins, shape (n,).
        loose: chi square more by which it has to be excluded.
    """
    at = begin.copy()
    if quantity.index >= 0:
        at[quantity.index] = target
    return fit_at_end(optimum, quantity, at, target, loose=loose)
