"""Intervals by the profile likelihood, with as few runs as each value needs.

    Dchi^2(c) = min { chi^2(x) : g(x) = c } - min chi^2

for g a parameter or a derived output. Values with Dchi^2 <= 1 and <= 3.84 are the 68 % and 95 %
intervals. Where the residuals give the noise, Dchi^2 is t^2 of Student's distribution, and stands
here as the normal deviate's square of the same probability, so that the thresholds are these.

1. The ends that the covariance predicts are evaluated, all values in one batch. Where chi square
   there, and chi square after the other parameters have followed by the stored slopes, both agree
   with the prediction, no bound is active and no other minimum lies there, that is the interval.
2. Elsewhere both bounds are tried from every known minimum: a value that fits there is not closed.
3. Only then a side is scanned outward from the most likely point, all sides in common batches.
   Every accepted point of every scan is shared: where one that fits lies beyond the end of another
   scan, that scan goes on from there.

Source: D. Venzon and S. Moolgavkar, Applied Statistics 37 (1988) 87; A. Raue et al.,
Bioinformatics 25 (2009) 1923.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.fit.levenberg import Constraint, Descent, Expansion, Goal, expand, minimise
from fitting.fit.likelihood import Exhausted, LikelihoodEvaluator, Request, Sample
from fitting.fit.optimum import Optimum, active_bounds_at
from fitting.fit.twins import Twin
from fitting.inference.likelihood.ends import is_reached, open_side, try_ends
from fitting.inference.likelihood.profile import Key, Quantity, ScanPoint, Scans, Side, quantities
from fitting.inference.likelihood.ranges import OutputRange
from fitting.inference.likelihood.shared import Shared, by_data_or_priors, with_simulation
from fitting.inference.likelihood.verified import verify
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95

#: Steps across half a period, at least.
PER_PERIOD = 5
#: Rounds of all scans, and failed steps of one, at most.
ROUNDS, MISSES = 60, 5
#: sqrt(Dchi^2) of a step that went too far.
FAR = 2.0 * ROOT_95
#: A crossing is known where sqrt(Dchi^2) is this close to its threshold; a step of it across the
#: threshold between points that are close is no crossing; closer points than that are one.
CLOSE, JUMP, SAME_PLACE = 0.02, 0.5, 1e-4
#: Dchi^2 of a point that is inside for certain, and needs not be followed to its minimum.
INSIDE = 0.05
#: From this distance of sqrt(Dchi^2) to the threshold on, points are confirmed by slopes there.
CONFIRMED = 0.3
#: Share of a step that leads nowhere.
NOWHERE = 0.05
#: Share of an interval by which a point that fits lies beyond it; how often scans go on from one.
BEYOND, EXTENSIONS = 0.02, 3


def scanned(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    ranges: Mapping[str, OutputRange],
    minima: Sequence[Sample],
    only: Sequence[str] = (),
    twins: Sequence[Twin] = (),
) -> Scans:
    """The interval of every quantity: linearised and verified, else scanned.

    Args:
        evaluator: of the likelihood of `optimum`; counts what is evaluated.
        optimum: the most likely point.
        ranges: of the outputs without data, by name.
        minima: other points that fit, at which chi square has a minimum.
        only: names of the values that are wanted; all if empty.
        twins: exact symmetries of the likelihood: images of points that fit do, too.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    every = quantities(optimum, ranges)
    wanted = tuple(q for q in every if not only or q.name in only)
    shared = Shared(evaluator, optimum, ranges, [_point(optimum, m) for m in minima], twins)
    sides: dict[Key, Side] = {}
    started = verify(shared, wanted, sides)
    searched = list(wanted)
    if len(sides) < 2 * len(wanted):
        # a valley that one value's scan does not come to lies on the way of another's
        own = {p.name for p in optimum.likelihood.parameters if p.experiments}
        others = [q for q in every if q not in wanted and q.name not in own]
        started |= verify(shared, others, sides)
        searched += others
    open_ = [(q, side) for q in searched for side in (0, 1) if q.key(side) not in sides]
    for q, side in try_ends(shared, open_):
        sides[q.key(side)] = open_side(shared, q, side)
    scans = [
        _SideScan(shared, q, s, started.get(q.key(s))) for q, s in open_ if q.key(s) not in sides
    ]
    _run(shared, scans)
    _extend(shared, searched, sides, scans)
    for scan in scans:
        q, side = scan.quantity, scan.side
        # another scan may have come to the end that this one did not reach
        is_open = not q.is_periodic and is_reached(shared, q, side)
        sides[q.key(side)] = open_side(shared, q, side) if is_open else scan.ended()
    known = {key: replace(side, points=shared.read(side.points)) for key, side in sides.items()}
    return Scans(
        optimum=optimum,
        quantities=wanted,
        sides={q.name: (known[q.key(0)], known[q.key(1)]) for q in searched},
        minima=tuple(shared.minima),
        shared=tuple(shared.fitting()),
        ranges=ranges,
    )


def _point(optimum: Optimum, sample: Sample) -> ScanPoint:
    at = replace(optimum.expansion, sample=sample, age=1)
    return ScanPoint(value=math.nan, delta=optimum.delta(float(sample.rows @ sample.rows)), at=at)


class _SideScan:
    """A scan of one side: its points outward inside the threshold, the first one outside."""

    def __init__(
        self, shared: Shared, quantity: Quantity, side: int, tried: Sequence[Expansion] | None
    ) -> None:
        self.shared, self.quantity, self.side = shared, quantity, side
        self.sign, self.limit = (-1.0, 1.0)[side], (quantity.low, quantity.high)[side]
        self.span = abs(self.limit - quantity.best)
        here = ScanPoint(value=quantity.best, delta=0.0, at=shared.optimum.expansion)
        self.inside: list[ScanPoint] = [here]
        self.outside: ScanPoint | None = None
        self.points: list[ScanPoint] = []
        self.tried = list(tried or ())
        self.origin, self.first95 = quantity.best, math.nan
        self.step = 1.03 * quantity.sigma
        self.misses = self.narrowed = 0
        self.is_retried = self.wants_slopes = False
        self.closed = ""
        self.active: tuple[int, ...] = ()
        self.target, self.begin = math.nan, shared.optimum.expansion

    def extend_from(self, point: ScanPoint) -> None:
        """Scan on from a point that fits beyond the crossing."""
        self.points += [p for p in (*self.inside, self.outside) if p is not None]
        self.inside, self.outside, self.closed = [point], None, ""
        self.origin, self.misses, self.narrowed = point.value, 0, 0
        self.tried = []

    @property
    def last(self) -> ScanPoint:
        """The outermost point inside."""
        return self.inside[-1]

    def aim(self) -> bool:
        """Choose the next target and where its search begins; False where the scan has ended."""
        if self.outside is not None:
            return self._aim_between(self.outside)
        left = abs(self.limit - self.last.value)
        if self.quantity.is_at_end(self.side, self.last.value):
            self.closed = "periodic" if self.quantity.is_periodic else "bound"
            return False
        # where an end fits what is between decides nothing; a period has no end
        step = min(self.step, self.span / PER_PERIOD) if self.quantity.is_periodic else self.step
        step = left if step > 0.8 * left else step
        self.target, self.begin = self.last.value + self.sign * step, self.last.at
        if self.misses % 2:  # from inside it failed: now from the shared point that is the nearest
            fitting = self.shared.fitting()
            near = [
                (abs(self.quantity.of(p.at.sample, self.shared.periods) - self.target), p)
                for p in fitting
            ]
            gap, nearest = min(near, key=lambda each: each[0], default=(math.inf, self.last))
            if gap < step:
                self.begin, self.wants_slopes = nearest.at, True
        if self.tried:  # the covariance's own prediction was evaluated already
            at = self.tried.pop(0)
            value = self.quantity.of(at.sample, self.shared.periods)
            way = self.sign * (value - self.last.value)
            # an output that is bent is elsewhere there
            is_near = NOWHERE * step < way < min(left, 2.0 * step)
            if math.isfinite(at.chi_square) and is_near:
                self.target, self.begin = value, at
        return True

    def _aim_between(self, outside: ScanPoint) -> bool:
        inside = self.last
        gap = abs(outside.value - inside.value)
        if min(ROOT_95 - inside.root, outside.root - ROOT_95) < CLOSE:
            self._cross(inside, outside)
            return False
        if (
            gap <= SAME_PLACE * abs(outside.value - self.quantity.best)
            or self.narrowed > ROUNDS // 3
        ):
            if outside.root - inside.root < JUMP:
                self._cross(inside, outside)
                return False
            if self.is_retried:
                self.closed = "failed"
                return False
            # one of the two has left the valley: once more, by slopes of the point inside
            self.is_retried, self.outside, self.narrowed = True, None, 0
            self.step, self.wants_slopes = gap, True
            return self.aim()
        share = (ROOT_95 - inside.root) / (outside.root - inside.root)
        share = min(max(share, 0.1), 0.9) if self.narrowed < 3 else 0.5
        self.target = inside.value + share * (outside.value - inside.value)
        # the valley that led here goes on from inside; where that fails it may from outside
        self.begin = outside.at if self.misses % 2 else inside.at
        self.narrowed += 1
        return True

    def _cross(self, inside: ScanPoint, outside: ScanPoint) -> None:
        """The data close the side between two points, or bounds of others do."""
        near = inside if ROOT_95 - inside.root < outside.root - ROOT_95 else outside
        besides = [self.quantity.index] if self.quantity.index >= 0 else []
        constraints = self.quantity.constraint(near.value, outside.value - inside.value)
        likelihood = self.shared.optimum.likelihood
        self.active = tuple(
            {*self.active, *active_bounds_at(likelihood, near.at, besides, constraints)}
        )
        self.closed = by_data_or_priors(self.shared, outside)
        if math.isnan(self.first95):
            self.first95 = crossing(inside, outside, ROOT_95)

    def constraint(self) -> Constraint:
        """What holds the quantity at the target."""
        start = self.quantity.of(self.begin.sample, self.shared.periods)
        step = self.target - (start if math.isfinite(start) else self.last.value)
        return self.quantity.constraint(self.target, step or self.target - self.last.value)

    def take(self, end: Descent) -> None:
        """Go on with where a search ended."""
        if end.is_cut:
            self.closed = "budget"
            return
        point = self.shared.point(self.quantity, end.end)
        ahead = self.sign * (point.value - self.last.value)
        wanted = abs(self.target - self.last.value)
        is_there = end.reached and math.isfinite(point.value) and ahead > NOWHERE * wanted
        if self.outside is not None:
            is_there = is_there and ahead < abs(self.outside.value - self.last.value)
        elif point.root > FAR and wanted > SAME_PLACE * self.span:
            is_there = False  # too far, or in another valley
        if not is_there:
            self.misses += 1
            # sqrt(Dchi^2) is straight at best: that of a point too far tells how far is enough
            rise = point.root - self.last.root
            share = (ROOT_95 - self.last.root) / rise if rise > 0.0 else 1.0
            self.step = wanted * min(max(share, 0.02), 0.25)
            self.wants_slopes = True
            if self.misses > MISSES:
                self.closed = "failed"
            return
        self.misses = max(0, self.misses - 1)
        if point.root > ROOT_95:
            self.outside = point
        else:
            self.shared.accept([point])
            self.step = self._next_step(point)
            self.inside.append(point)

    def _next_step(self, point: ScanPoint) -> float:
        """To the next threshold by the slope of sqrt(Dchi^2), which is straight at best."""
        moved, rise = abs(point.value - self.last.value), point.root - self.last.root
        mark = ROOT_68 if point.root < 0.9 * ROOT_68 else ROOT_95
        if not (moved > 0.0 and rise > 0.0):
            return 2.0 * max(moved, self.step)
        return float(
            np.clip((mark + 0.5 * CLOSE - point.root) * moved / rise, 0.2 * moved, 3.0 * moved)
        )

    def ended(self) -> Side:
        """The side as it was found."""
        q = self.quantity
        every = [*self.points, *self.inside, *([self.outside] if self.outside else [])]
        every = sorted(every, key=lambda p: self.sign * p.value)
        is_crossed = self.closed in ("data", "prior") and self.outside is not None
        end95 = (
            crossing(self.last, self.outside, ROOT_95)
            if is_crossed and self.outside
            else self.limit
        )
        end68 = self.limit
        last68 = max(k for k, p in enumerate(every) if p.root < ROOT_68)
        if last68 + 1 < len(every):
            end68 = crossing(every[last68], every[last68 + 1], ROOT_68)
        elif is_crossed:
            end68 = end95
        known = Side(
            points=tuple(every[1:]),
            closed=self.closed or "failed",
            end68=end68,
            end95=end95,
            own95=self.first95,
            active=self.active,
        )
        return with_simulation(q, self.side, known, self.origin) if is_crossed else known


def crossing(inside: ScanPoint, outside: ScanPoint, root: float) -> float:
    """Where sqrt(Dchi^2) has a value between two points, by the straight line."""
    rise = outside.root - inside.root
    share = (root - inside.root) / rise if rise > 0.0 else 1.0
    return inside.value + share * (outside.value - inside.value)


def _run(shared: Shared, scans: Sequence[_SideScan]) -> None:
    """Rounds in which every scan goes one point on, in common batches.

    Searches go on by updated slopes; near and beyond the threshold a minimum is confirmed by
    slopes that are taken there.
    """
    for _ in range(ROUNDS):
        for scan in scans:
            q = scan.quantity
            if not (scan.closed or q.is_periodic or scan.outside) and is_reached(
                shared, q, scan.side
            ):
                scan.closed = "bound"
        active = [scan for scan in scans if not scan.closed and scan.aim()]
        if not active:
            return
        fresh = [scan for scan in active if scan.wants_slopes]
        _predict(shared, [scan for scan in active if not scan.wants_slopes])
        try:
            slopes = expand(shared.evaluator, [scan.begin.x for scan in fresh]) if fresh else []
        except Exhausted:
            for scan in active:
                scan.closed = "budget"
            return
        for scan, at in zip(fresh, slopes, strict=True):
            scan.begin, scan.wants_slopes = at, False
        constraints = [scan.constraint() for scan in active]
        goal = Goal(
            enough=shared.optimum.least + INSIDE,
            wanted=shared.optimum.least + reach(FAR, shared.optimum.noise_freedom) ** 2,
            confirmed=False,
        )
        ends = minimise(shared.evaluator, [scan.begin for scan in active], constraints, goal)
        near = [
            k
            for k, (scan, end) in enumerate(zip(active, ends, strict=True))
            if not end.is_cut
            and (end.end.age or not end.reached)
            and ROOT_95 - CONFIRMED <= shared.point(scan.quantity, end.end).root <= FAR
        ]
        if near:
            confirmed = minimise(
                shared.evaluator, [ends[k].end for k in near], [constraints[k] for k in near]
            )
            for k, end in zip(near, confirmed, strict=True):
                ends[k] = end
        for scan, end in zip(active, ends, strict=True):
            scan.take(end)


def _predict(shared: Shared, scans: Sequence[_SideScan]) -> None:
    """Searches begin where the last two points of their scans lead to, if that is not far off."""
    likelihood = shared.optimum.likelihood
    led: list[tuple[_SideScan, FloatArray]] = []
    for scan in scans:
        if scan.begin is scan.last.at and len(scan.inside) > 1:
            one, other = scan.inside[-2:]
            share = (scan.target - other.value) / (other.value - one.value)
            x = np.clip(other.x + share * (other.x - one.x), likelihood.lower, likelihood.upper)
            led.append((scan, x))
    if not led:
        return
    try:
        requests = [Request((x,), outputs=scan.quantity.output >= 0) for scan, x in led]
        answers = shared.evaluator(requests)
    except Exhausted:
        return
    for (scan, _), [sample] in zip(led, answers, strict=True):
        square = float(sample.rows @ sample.rows)
        if math.isfinite(square) and shared.optimum.delta(square) < FAR**2:
            scan.begin = replace(scan.begin, sample=sample, age=scan.begin.age + 1)


def _extend(
    shared: Shared, wanted: Sequence[Quantity], sides: dict[Key, Side], scans: list[_SideScan]
) -> None:
    """Scans go on from the farthest point in hand that fits and lies beyond where they ended."""
    for _ in range(EXTENSIONS):
        fitting = shared.fitting()
        going: list[_SideScan] = []
        for q in wanted:
            for side, sign in ((0, -1.0), (1, 1.0)):
                scan = next((w for w in scans if w.quantity is q and w.side == side), None)
                known = sides.get(q.key(side)) if scan is None else scan.ended()
                if known is None or known.closed in ("bound", "periodic"):
                    continue
                is_crossed = known.closed in ("data", "prior")
                end = known.end95 if is_crossed or scan is None else scan.last.value
                margin = BEYOND * abs(end - q.best) + 1e-9 * q.width
                beyond = [(sign * (q.of(p.at.sample, shared.periods) - end), p) for p in fitting]
                beyond = [(gap, p) for gap, p in beyond if gap > margin]
                if not beyond:
                    continue
                point = max(beyond, key=lambda each: each[0])[1]
                if scan is None:
                    scan = _SideScan(shared, q, side, None)
                    scan.first95 = known.own95
                    scan.points += list(known.points)
                    scans.append(scan)
                    del sides[q.key(side)]
                scan.extend_from(replace(point, value=q.of(point.at.sample, shared.periods)))
                going.append(scan)
        if not going:
            return
        try:
            started = expand(shared.evaluator, [scan.last.x for scan in going])
        except Exhausted:
            for scan in going:
                scan.closed = "budget"
            return
        for scan, at in zip(going, started, strict=True):
            scan.inside[-1] = replace(scan.last, at=at)
        _run(shared, going)
