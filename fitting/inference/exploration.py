"""All walks of one optimum: other minima, ends of the ranges, profiles, in few large batches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import search_bounds
from fitting.inference.descent import Local, Optimum, descend, located
from fitting.inference.likelihood import Surface
from fitting.inference.lockstep import Exhausted, Request, Task, together
from fitting.inference.profiles import ROOT_95, STEPS, Quantity, Side, Stop, reach, walk
from fitting.inference.ranges import OutputRange
from fitting.text.arrays import FloatArray

#: Seeded points of the box from which other minima are looked for.
OTHER_STARTS = 12
#: Linearised sigma over the range from which the ends of the range are tried outright.
WORTH_REACHING = 0.05
#: Strides across a range whose ends are both known to fit: they only show what is between.
OPEN_STEPS = 6


@dataclass(frozen=True)
class Found:
    """What was found around one optimum.

    `sides` (downward, upward) and `reached` (points at the low and high end that fit, None where
    none does) by quantity; `pool` are minima from other starts that fit.
    """

    optimum: Optimum
    quantities: tuple[Quantity, ...]
    sides: Mapping[str, tuple[Side, Side]]
    reached: Mapping[str, tuple[Stop | None, Stop | None]]
    pool: tuple[Stop, ...]
    ranges: Mapping[str, OutputRange]

    @property
    def points(self) -> list[Stop]:
        """Every point that any walk came by."""
        points = [p for sides in self.sides.values() for side in sides for p in side.points]
        return points + [s for both in self.reached.values() for s in both if s is not None]


def explore(
    surface: Surface,
    optimum: Optimum,
    ranges: Mapping[str, OutputRange],
    pool: Sequence[Stop],
    only: Sequence[str] = (),
) -> Found:
    """The ends of the ranges, then the profiles; each step one set of batches.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    chosen = tuple(q for q in quantities(optimum, ranges) if not only or q.name in only)
    reached = _reached(surface, optimum, chosen, ranges, pool)
    walks = []
    for quantity in chosen:
        open_ = all(stop is not None for stop in reached[quantity.name])
        steps = OPEN_STEPS if open_ else STEPS
        walks += [walk(optimum, quantity, direction, steps) for direction in (-1.0, 1.0)]
    none = Side((), "cost", math.nan, math.nan)
    sides = [side if side is not None else none for side in together(walks, surface)]
    pairs = {q.name: (sides[2 * k], sides[2 * k + 1]) for k, q in enumerate(chosen)}
    return _with_outputs(surface, Found(optimum, chosen, pairs, reached, tuple(pool), ranges))


def _reached(
    surface: Surface,
    optimum: Optimum,
    chosen: Sequence[Quantity],
    ranges: Mapping[str, OutputRange],
    pool: Sequence[Stop],
) -> dict[str, tuple[Stop | None, Stop | None]]:
    """Points at the ends of the ranges that fit; further beginnings only where the first failed."""
    ends: dict[tuple[str, int], Stop] = {}
    for attempt in range(3):
        tries: list[tuple[str, int, Task[Stop | None]]] = []
        for quantity in chosen:
            if quantity.round or not quantity.sigma > WORTH_REACHING * quantity.width:
                continue
            for which, end in enumerate((quantity.low, quantity.high)):
                begins = _beginnings(optimum, quantity, which, ranges, pool)
                if (quantity.name, which) not in ends and attempt < len(begins):
                    begin, frozen = begins[attempt]
                    task = reach(optimum, quantity, begin, end, frozen)
                    tries.append((quantity.name, which, task))
        ended = _possible(surface, optimum, together([task for _, _, task in tries], surface))
        for (name, which, _), stop in zip(tries, ended, strict=True):
            if stop is not None:
                ends[name, which] = stop
    return {q.name: (ends.get((q.name, 0)), ends.get((q.name, 1))) for q in chosen}


def _with_outputs(surface: Surface, found: Found) -> Found:
    """Every point with its outputs: searches for parameters did not ask for them."""
    bare = [p for sides in found.sides.values() for side in sides for p in side.points]
    bare += [stop for both in found.reached.values() for stop in both if stop is not None]
    bare = [stop for stop in bare if stop.outputs.size == 0]
    if not found.optimum.likelihood.names or not bare:
        return found
    request = Request(tuple(stop.x for stop in bare), rows=False)
    read = {
        id(stop): sample.outputs for stop, sample in zip(bare, surface([request])[0], strict=True)
    }

    def whole(stop: Stop) -> Stop:
        return replace(stop, outputs=read.get(id(stop), stop.outputs))

    sides = {
        name: tuple(replace(side, points=tuple(map(whole, side.points))) for side in both)
        for name, both in found.sides.items()
    }
    reached = {
        name: tuple(None if stop is None else whole(stop) for stop in both)
        for name, both in found.reached.items()
    }
    return replace(
        found,
        sides={name: (low, high) for name, (low, high) in sides.items()},
        reached={name: (low, high) for name, (low, high) in reached.items()},
    )


def _possible(
    surface: Surface, optimum: Optimum, stops: Sequence[Stop | None]
) -> list[Stop | None]:
    """Those points at which every output exists that exists at the optimum, with their outputs.

    A fit at parameters for which the model has no such output is no fit of that model.
    """
    there = [stop for stop in stops if stop is not None]
    if not optimum.likelihood.names or not there:
        return list(stops)
    kept: dict[int, Stop] = {}
    exists = np.isfinite(optimum.local.sample.outputs)
    request = Request(tuple(stop.x for stop in there), rows=False)
    for stop, sample in zip(there, surface([request])[0], strict=True):
        outputs = stop.outputs if stop.outputs.size else sample.outputs
        if np.all(np.isfinite(outputs[exists])):
            kept[id(stop)] = replace(stop, outputs=outputs)
    return [None if stop is None else kept.get(id(stop)) for stop in stops]


def quantities(optimum: Optimum, ranges: Mapping[str, OutputRange]) -> tuple[Quantity, ...]:
    """Every parameter, and every output that has a value at the optimum and a range."""
    likelihood, local = optimum.likelihood, optimum.local
    lower, upper = search_bounds(likelihood.parameters)
    covariance = data_covariance(optimum)
    made = []
    for i, parameter in enumerate(likelihood.parameters):
        best, low, high = float(local.x[i]), float(lower[i]), float(upper[i])
        goes_round = bool(np.isfinite(likelihood.periods[i]))
        if goes_round:
            half = 0.5 * float(likelihood.periods[i])
            low, high = best - half, best + half
        sigma = math.sqrt(covariance[i, i])
        made.append(Quantity(parameter.name, i, -1, best, sigma, low, high, goes_round))
    for k, name in enumerate(likelihood.names):
        best, slope = float(local.sample.outputs[k]), local.outward[k]
        known = math.isfinite(best) and bool(np.all(np.isfinite(slope)))
        if not known or not ranges[name].high > ranges[name].low:
            continue
        sigma = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
        low, high = min(ranges[name].low, best), max(ranges[name].high, best)
        made.append(Quantity(name, -1, k, best, max(sigma, 1e-12 * (high - low)), low, high))
    return tuple(made)


def data_covariance(optimum: Optimum) -> FloatArray:
    """(J^T J + P)^-1 with the box as a uniform prior, (n, n): linearised, never infinite."""
    likelihood = optimum.likelihood
    root = likelihood.widths / math.sqrt(12.0)
    _, singular, rows = np.linalg.svd(optimum.local.matrix * root, full_matrices=False)
    directions = rows.T * root[:, np.newaxis]
    rest = np.diag(root**2) - directions @ directions.T  # nothing where m >= n
    return np.asarray((directions / (1.0 + singular**2)) @ directions.T + rest)


def other_minima(
    surface: Surface, optimum: Optimum, seed: int, number: int = OTHER_STARTS
) -> tuple[Stop, ...]:
    """Minima from seeded starts of the box that fit as well, (Dchi^2 below the 95 % threshold)."""
    likelihood = optimum.likelihood
    lower, upper = search_bounds(likelihood.parameters)
    generator = np.random.default_rng(seed)
    held = likelihood.tension > 0.0  # what has a prior of its own is looked for near the best
    starts = [
        np.where(held, optimum.local.x, generator.uniform(lower, upper)) for _ in range(number)
    ]

    def search(x: FloatArray) -> Task[Local | None]:
        try:
            here = yield from located(likelihood, x, False)
            if not math.isfinite(here.chi_square):
                return None
            ended = yield from descend(likelihood, here)
            return None if ended is None else (yield from located(likelihood, ended.x))
        except Exhausted:
            return None

    stops = []
    for local in together([search(x) for x in starts], surface):
        if local is not None:
            delta = local.chi_square - optimum.least
            if delta <= ROOT_95**2:
                stops.append(Stop(math.nan, delta, local.x, local.sample.outputs))
    return tuple(stops)


def _beginnings(
    optimum: Optimum,
    quantity: Quantity,
    which: int,
    ranges: Mapping[str, OutputRange],
    pool: Sequence[Stop],
) -> list[tuple[FloatArray, tuple[int, ...]]]:
    """Where to begin a search for a fit at an end of a range, and which axes it keeps."""
    end = (quantity.low, quantity.high)[which]
    if quantity.index >= 0:
        exists = np.isfinite(optimum.local.sample.outputs)
        possible = [stop for stop in pool if np.all(np.isfinite(stop.outputs[exists]))]
        nearest = sorted(possible, key=lambda stop: abs(stop.x[quantity.index] - end))[:2]
        begins = [optimum.local.x.copy(), *(stop.x.copy() for stop in nearest)]
        for begin in begins:
            begin[quantity.index] = end
        return [(begin, ()) for begin in begins]
    range_ = ranges[quantity.name]
    there = (range_.x_low, range_.x_high)[which]
    if not np.all(np.isfinite(there)):
        return []
    # what the output does not depend on is best where the data have it
    mixed = np.where(range_.depends, there, optimum.local.x)
    return [(mixed, tuple(map(int, np.flatnonzero(range_.depends)))), (there, ()), (mixed, ())]
