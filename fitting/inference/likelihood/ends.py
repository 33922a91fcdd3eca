"""Ends of ranges that fit: tried from every known point before anything is scanned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.fit.levenberg import Constraint, Expansion, Goal, expand, minimise
from fitting.fit.likelihood import Exhausted, Request
from fitting.inference.likelihood.profile import Key, Quantity, ScanPoint, Side
from fitting.inference.likelihood.shared import Shared
from fitting.signal.student import reach
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.error_bars import ROOT_95

#: Steps over which an output is held to the end of its range.
STEPS = 10
#: Dchi^2 at which a bound is known to fit without being followed to its minimum.
ENOUGH = 0.5
#: Known points from which an end of a range is tried, at most; linearised sigmas to it beyond
#: which it is tried once.
ATTEMPTS, WORTH = 4, 10.0
#: Known points that are looked at for each.
CANDIDATES = 6


def try_ends(shared: Shared, open_: Sequence[tuple[Quantity, int]]) -> list[tuple[Quantity, int]]:
    """Sides whose bound fits: tried from known points, that one first which fits best there.

    What was reached is shared at once: where a parameter ends may lie next to where another does.
    Half a period away nothing is decided by a fit alone: such parameters are scanned.
    """
    rest = [(q, side) for q, side in open_ if not q.is_periodic]
    reached: list[tuple[Quantity, int]] = []
    attempted: set[tuple[Key, bytes]] = set()
    for attempt in range(ATTEMPTS + 1):
        there = {q.key(side) for q, side in rest if is_reached(shared, q, side)}
        reached += [(q, side) for q, side in rest if q.key(side) in there]
        rest = [(q, side) for q, side in rest if q.key(side) not in there]
        again = [
            (q, side)
            for q, side in rest
            if not attempt or abs((q.low, q.high)[side] - q.best) < WORTH * q.sigma
        ]
        if not again or attempt == ATTEMPTS:
            break
        try:
            begins = _begins(shared, again, attempted, projected=bool(attempt % 2))
            if not begins:
                continue
            places = expand(shared.evaluator, [x for _, _, x in begins])
        except Exhausted:
            break
        shared.accept(_reached(shared, begins, places, frozen=bool(attempt % 2)))
    return reached


def _begins(
    shared: Shared,
    sides: Sequence[tuple[Quantity, int]],
    attempted: set[tuple[Key, bytes]],
    *,
    projected: bool,
) -> list[tuple[Quantity, int, FloatArray]]:
    """Where searches for fits at the ends begin, one for each side: the best of known points there.

    A parameter is put to its end. Of an output what it depends on goes where it has its extreme, if
    it is to be `brought`; else the known point is taken whose value is the nearest.
    """
    here = shared.optimum.expansion
    fitting = shared.fitting()
    known = [here.x, *(p.x for p in fitting)]
    places: list[tuple[Quantity, int, FloatArray]] = []
    begins: list[tuple[Quantity, int, FloatArray]] = []
    for q, side in sides:
        limit = (q.low, q.high)[side]
        if q.index < 0 and not projected:
            values = [q.best, *(q.of(p.at.sample, shared.periods) for p in fitting)]
            order = np.argsort(np.abs(np.array(values) - limit), kind="stable")
            new = [known[k] for k in order if (q.key(side), known[k].tobytes()) not in attempted]
            begins += [(q, side, x) for x in new[:1]]
            continue
        if q.index >= 0:
            moved, end = np.arange(here.x.size) == q.index, np.full(here.x.size, limit)
        else:
            range_ = shared.ranges[q.name]
            moved = _movable(shared, q)
            end = np.asarray((range_.x_low, range_.x_high)[side])
        if np.all(np.isfinite(end[moved])):
            mine = {x.tobytes(): x for x in (np.where(moved, end, x) for x in known)}
            new = [x for key, x in mine.items() if (q.key(side), key) not in attempted]
            places += [(q, side, x) for x in new[:CANDIDATES]]
    best: dict[Key, tuple[float, FloatArray]] = {}
    if places:
        answers = shared.evaluator([Request((x,), outputs=False) for _, _, x in places])
        for (q, side, x), [sample] in zip(places, answers, strict=True):
            square = float(sample.rows @ sample.rows)
            square = square if math.isfinite(square) else math.inf
            if square < best.get(q.key(side), (math.inf, x))[0]:
                best[q.key(side)] = square, x
    for q, side in sides:
        if q.key(side) in best:
            begins.append((q, side, best[q.key(side)][1]))
    attempted |= {(q.key(side), x.tobytes()) for q, side, x in begins}
    return begins


def _movable(shared: Shared, q: Quantity) -> BoolArray:
    """What an output depends on and no prior holds: that is best where the data have it, (n,)."""
    constraints = shared.optimum.likelihood.inverse_prior_sigma > 0.0
    return np.asarray(shared.ranges[q.name].depends & ~constraints)


def is_reached(shared: Shared, q: Quantity, side: int) -> bool:
    """Whether a known point that fits is at the end of a range."""
    return any(q.is_at_end(side, q.of(p.at.sample, shared.periods)) for p in shared.fitting())


def _reached(
    shared: Shared,
    begins: Sequence[tuple[Quantity, int, FloatArray]],
    places: Sequence[Expansion],
    *,
    frozen: bool,
) -> list[ScanPoint]:
    """Points at the ends of ranges that fit, searched for from some places.

    With `frozen` what an output depends on stays where it was brought.
    """
    constraints = []
    for q, side, _ in begins:
        limit = (q.low, q.high)[side]
        if q.output >= 0 and frozen:
            moved = _movable(shared, q)
            constraints.append(
                Constraint(target=limit, frozen=tuple(map(int, np.flatnonzero(moved))))
            )
        else:
            constraints.append(q.constraint(limit, (limit - q.best) / STEPS))
    goal = Goal(
        enough=shared.optimum.least + ENOUGH,
        wanted=shared.optimum.least + max(reach(ROOT_95, q.freedom) ** 2 for q, _, _ in begins),
        confirmed=False,
    )
    ends = minimise(shared.evaluator, places, constraints, goal)
    return [shared.point(q, end.end) for (q, _, _), end in zip(begins, ends, strict=True)]


def open_side(shared: Shared, q: Quantity, side: int) -> Side:
    """A side whose bound fits: its points are those that are shared."""
    limit, sign = (q.low, q.high)[side], (-1.0, 1.0)[side]
    known = [replace(p, value=q.of(p.at.sample, shared.periods)) for p in shared.fitting()]
    mine = sorted(
        (p for p in known if sign * (p.value - q.best) > 0.0), key=lambda p: sign * p.value
    )
    closed = "periodic" if q.is_periodic else "bound"
    return Side(points=tuple(mine), closed=closed, end68=limit, end95=limit, own95=math.nan)
