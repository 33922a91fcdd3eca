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

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import drift_square
from fitting.fit.levenberg import (
    UNCONSTRAINED,
    Constraint,
    Descent,
    Expansion,
    Goal,
    expand,
    minimise,
)
from fitting.fit.likelihood import Exhausted, LikelihoodEvaluator, Request, Sample
from fitting.fit.optimum import Optimum, active_bounds_at
from fitting.fit.twins import Twin
from fitting.inference.likelihood.profile import (
    OutputRange,
    Quantity,
    ScanPoint,
    Scans,
    Side,
    data_covariance,
    quantities,
)
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.estimate import ROOT_95

#: Disagreement of chi square, or of an output, with its linearised prediction that is none.
AGREES = 0.05
#: Share of the increase that the other parameters may gain by the stored slopes, which see no more
#: than a part of what they gain in a valley that bends.
FOLLOWED = 0.005
#: Share of an increase of chi square by priors of what drifts from which they close an interval.
BY_PRIORS = 0.5
#: Steps over which an output is held to the end of its range.
STEPS = 10
#: Dchi^2 at which a bound is known to fit without being followed to its minimum.
ENOUGH = 0.5
#: Known points from which an end of a range is tried, at most; linearised sigmas to it beyond
#: which it is tried once.
ATTEMPTS, WORTH = 4, 10.0
#: Known points that are evaluated at an end for each attempt.
CANDIDATES = 6
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


def scan_profiles(
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
    wanted = [q for q in every if not only or q.name in only]
    shared = Shared(evaluator, optimum, minima, twins)
    sides = [_SideScan(shared, q, side) for q in wanted for side in (0, 1)]
    _verify(shared, sides)
    if any(side.result is None for side in sides):
        # a valley that one value's scan does not come to lies on the way of another's
        own = {p.name for p in optimum.likelihood.parameters if p.experiments}
        others = [q for q in every if q not in wanted and q.name not in own]
        more = [_SideScan(shared, q, side) for q in others for side in (0, 1)]
        _verify(shared, more)
        sides += more
    # parameters first: where one ends, an output that follows from it may end as well
    for outputs in (False, True):
        _try_ends(
            shared,
            [s for s in sides if s.result is None and (s.quantity.index < 0) is outputs],
            ranges,
        )
    _scan(shared, [s for s in sides if s.result is None])
    _extend(shared, sides)
    known = []
    for side in sides:
        end = side.end()
        known.append(replace(end, points=tuple(shared.read(end.points))))
    names = [side.quantity.name for side in sides[::2]]
    return Scans(
        optimum=optimum,
        quantities=tuple(wanted),
        sides=dict(zip(names, zip(known[::2], known[1::2], strict=True), strict=True)),
        minima=tuple(shared.minima),
        shared=tuple(shared.fitting()),
        ranges=ranges,
    )


class Shared:
    """What all scans of one optimum share: the evaluator, known minima, every point that fits."""

    def __init__(
        self,
        evaluator: LikelihoodEvaluator,
        optimum: Optimum,
        minima: Sequence[Sample],
        twins: Sequence[Twin],
    ) -> None:
        self.evaluator, self.optimum, self.twins = evaluator, optimum, twins
        self.minima: list[ScanPoint] = []
        for sample in minima:
            at = replace(optimum.expansion, sample=sample, age=1)
            delta = optimum.delta(float(sample.rows @ sample.rows))
            if delta <= ROOT_95**2:
                self.minima.append(ScanPoint(value=math.nan, delta=delta, at=at))
        self.minima = self.read(self.minima)
        self.accepted = list(self.minima)

    def point(self, quantity: Quantity, at: Expansion) -> ScanPoint:
        """A point of the profile of a quantity; chi square without the row that holds it."""
        square = float(at.sample.rows @ at.sample.rows)
        delta = self.optimum.delta(square, quantity.freedom)
        return ScanPoint(value=quantity.of(at.sample), delta=delta, at=at)

    def read(self, points: Sequence[ScanPoint]) -> list[ScanPoint]:
        """The points with their outputs, as far as the budget allows."""
        bare = [p for p in points if not p.outputs.size]
        if not self.optimum.likelihood.names or not bare:
            return list(points)
        try:
            [read] = self.evaluator([Request(tuple(p.x for p in bare), rows=False)])
        except Exhausted:
            return list(points)
        known, there = [], iter(read)
        for point in points:
            if not point.outputs.size:
                sample = replace(point.at.sample, outputs=next(there).outputs)
                point = replace(point, at=replace(point.at, sample=sample))
            known.append(point)
        return known

    def fitting(self) -> list[ScanPoint]:
        """Every accepted point, with outputs; without those that lack one that the optimum has.

        A fit at parameters for which the model has no such output is no fit of that model.
        """
        exists = np.isfinite(self.optimum.expansion.sample.outputs)
        self.accepted = [
            p
            for p in self.read(self.accepted)
            if p.outputs.size == exists.size and np.all(np.isfinite(p.outputs[exists]))
        ]
        return self.accepted

    def accept(self, points: Sequence[ScanPoint]) -> None:
        """Share points inside the 95 % threshold, and their images by the model's symmetries."""
        for point in points:
            if not point.delta <= ROOT_95**2:
                continue
            self.accepted.append(point)
            for twin in self.twins:
                image = twin.of(self.optimum.likelihood.parameters, point.x)
                if image is not None:
                    sample = Sample(image, point.at.sample.rows, np.empty(0))
                    unknown = np.empty((0, 0))  # slopes
                    bare = Expansion(sample, unknown, unknown, age=1)
                    self.accepted.append(replace(point, at=bare))


class _SideScan:
    """One side of a profile: `result` once it is known, and the state of the scan until then.

    `inside` are its points outward inside the threshold, `outside` the first one outside; `points`
    those of earlier stretches. `tried` are the ends that the covariance predicts, nearest first,
    `attempted` known points from which the end of the range was tried.
    """

    def __init__(self, shared: Shared, quantity: Quantity, side: int) -> None:
        self.shared, self.quantity, self.side = shared, quantity, side
        self.sign, self.limit = (-1.0, 1.0)[side], (quantity.low, quantity.high)[side]
        self.span = abs(self.limit - quantity.best)
        here = ScanPoint(value=quantity.best, delta=0.0, at=shared.optimum.expansion)
        self.result: Side | None = None
        self.tried: list[Expansion] = []
        self.attempted: set[bytes] = set()
        self.inside: list[ScanPoint] = [here]
        self.outside: ScanPoint | None = None
        self.points: list[ScanPoint] = []
        self.origin, self.first95 = quantity.best, math.nan
        self.step = 1.03 * quantity.sigma
        self.misses = self.narrowed = 0
        self.is_retried = self.wants_slopes = False
        self.closed = ""
        self.active: tuple[int, ...] = ()
        self.target, self.begin = math.nan, shared.optimum.expansion

    @property
    def last(self) -> ScanPoint:
        """The outermost point inside."""
        return self.inside[-1]

    def is_reached(self) -> bool:
        """Whether a known point that fits is at the end of the range; a period has no end."""
        q = self.quantity
        known = [] if q.is_periodic else self.shared.fitting()
        return any(q.is_at_end(self.side, q.of(p.at.sample)) for p in known)

    def open_side(self) -> Side:
        """The side where its bound fits: its points are those that are shared."""
        q, known = self.quantity, self.shared.fitting()
        values, mine = q.values(known), list[ScanPoint]()
        for k in np.argsort(self.sign * values, kind="stable"):
            if self.sign * (values[k] - q.best) > 0.0:
                mine.append(replace(known[k], value=float(values[k])))
        return Side(
            points=tuple(mine),
            closed="bound",
            end68=self.limit,
            end95=self.limit,
            own95=math.nan,
        )

    def closed_by(self, beyond: ScanPoint) -> str:
        """What excludes a point: data, or priors of what drifts, which do not concern the sample.

        Priors that hold what differs between experiments are stated for lack of anything better, of
        offsets that may be correlated.
        """
        optimum = self.shared.optimum
        least = drift_square(optimum.likelihood.parameters, optimum.expansion.x)
        more = drift_square(optimum.likelihood.parameters, beyond.x) - least
        return "prior" if more > BY_PRIORS * beyond.delta else "data"

    def with_simulation(self, known: Side) -> Side:
        """A side, longer by what the simulation may be off by; never beyond the range.

        Where it may move the estimate by `reach` sigma, the true value lies where sqrt(Dchi^2) is
        below its threshold plus that: sides are longer in that ratio, each by its own.
        """
        q, ends = self.quantity, []
        for end, root in ((known.end68, ROOT_68), (known.end95, ROOT_95)):
            far = end + q.reach / reach(root, q.freedom) * (end - self.origin)
            ends.append(max(far, self.limit) if self.side == 0 else min(far, self.limit))
        if ends[1] == self.limit and q.reach and known.closed == "data":
            known = replace(known, closed="bound")
        return replace(known, end68=ends[0], end95=ends[1])

    # --- a step of the scan ---

    def aim(self) -> bool:
        """Choose the next target and where its search begins; False where the scan has ended."""
        if self.outside is not None:
            return self._aim_between(self.outside)
        q, left = self.quantity, abs(self.limit - self.last.value)
        if q.is_at_end(self.side, self.last.value):
            self.closed = "periodic" if q.is_periodic else "bound"
            return False
        # where an end fits what is between decides nothing; a period has no end
        step = min(self.step, self.span / PER_PERIOD) if q.is_periodic else self.step
        step = left if step > 0.8 * left else step
        self.target, self.begin = self.last.value + self.sign * step, self.last.at
        if self.misses % 2:  # from inside it failed: now from the shared point that is the nearest
            fitting = self.shared.fitting()
            gaps = np.abs(q.values(fitting) - self.target)
            if np.any(gaps < step):
                self.begin, self.wants_slopes = fitting[int(np.argmin(gaps))].at, True
        if self.tried:  # the covariance's own prediction was evaluated already
            at = self.tried.pop(0)
            value = q.of(at.sample)
            way = self.sign * (value - self.last.value)
            # an output that is bent is elsewhere there
            if math.isfinite(at.chi_square) and NOWHERE * step < way < min(left, 2.0 * step):
                self.target, self.begin = value, at
        return True

    def _aim_between(self, outside: ScanPoint) -> bool:
        """The same between the outermost point inside and one outside; ends where they cross."""
        inside, gap = self.last, abs(outside.value - self.last.value)
        is_known = min(ROOT_95 - inside.root, outside.root - ROOT_95) < CLOSE
        is_narrow = gap <= SAME_PLACE * abs(outside.value - self.quantity.best)
        if not is_known and (is_narrow or self.narrowed > ROUNDS // 3):
            is_known = outside.root - inside.root < JUMP
            if not is_known and self.is_retried:
                self.closed = "failed"
                return False
            if not is_known:
                # one of the two has left the valley: once more, by slopes of the point inside
                self.is_retried, self.outside, self.narrowed = True, None, 0
                self.step, self.wants_slopes = gap, True
                return self.aim()
        if is_known:  # the data close the side between the two, or bounds of others do
            near = inside if ROOT_95 - inside.root < outside.root - ROOT_95 else outside
            besides = [self.quantity.index] if self.quantity.index >= 0 else []
            constraints = self.quantity.constraint(near.value, outside.value - inside.value)
            likelihood = self.shared.optimum.likelihood
            bounds = active_bounds_at(likelihood, near.at, besides, constraints)
            self.active = tuple({*self.active, *bounds})
            self.closed = self.closed_by(outside)
            if math.isnan(self.first95):
                self.first95 = crossing(inside, outside, ROOT_95)
            return False
        share = (ROOT_95 - inside.root) / (outside.root - inside.root)
        share = min(max(share, 0.1), 0.9) if self.narrowed < 3 else 0.5
        self.target = inside.value + share * (outside.value - inside.value)
        # the valley that led here goes on from inside; where that fails it may from outside
        self.begin = outside.at if self.misses % 2 else inside.at
        self.narrowed += 1
        return True

    def constraint(self) -> Constraint:
        """What holds the quantity at the target."""
        start = self.quantity.of(self.begin.sample)
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
        rise = point.root - self.last.root
        is_there = end.reached and math.isfinite(point.value) and ahead > NOWHERE * wanted
        if self.outside is not None:
            is_there = is_there and ahead < abs(self.outside.value - self.last.value)
        elif point.root > FAR and wanted > SAME_PLACE * self.span:
            is_there = False  # too far, or in another valley
        if not is_there:
            # sqrt(Dchi^2) is straight at best: that of a point too far tells how far is enough
            share = (ROOT_95 - self.last.root) / rise if rise > 0.0 else 1.0
            self.step = wanted * min(max(share, 0.02), 0.25)
            self.misses, self.wants_slopes = self.misses + 1, True
            if self.misses > MISSES:
                self.closed = "failed"
            return
        self.misses = max(0, self.misses - 1)
        if point.root > ROOT_95:
            self.outside = point
            return
        self.shared.accept([point])
        # to the next threshold by the slope of sqrt(Dchi^2), which is straight at best
        moved = abs(point.value - self.last.value)
        mark = ROOT_68 if point.root < 0.9 * ROOT_68 else ROOT_95
        if moved > 0.0 and rise > 0.0:
            step = (mark + 0.5 * CLOSE - point.root) * moved / rise
            self.step = float(np.clip(step, 0.2 * moved, 3.0 * moved))
        else:
            self.step = 2.0 * max(moved, self.step)
        self.inside.append(point)

    def end(self) -> Side:
        """The side as it is known; another scan may have come to the end that this one did not."""
        return self.result or (self.open_side() if self.is_reached() else self.ended())

    def ended(self) -> Side:
        """The side as its scan has it."""
        is_crossed = self.closed in ("data", "prior") and self.outside is not None
        every = [*self.points, *self.inside, *([self.outside] if self.outside else [])]
        every = sorted(every, key=lambda p: self.sign * p.value)
        end68 = end95 = self.limit
        if is_crossed and self.outside is not None:
            end68 = end95 = crossing(self.last, self.outside, ROOT_95)
        last68 = max(k for k, p in enumerate(every) if p.root < ROOT_68)
        if last68 + 1 < len(every):
            end68 = crossing(every[last68], every[last68 + 1], ROOT_68)
        known = Side(
            points=tuple(every[1:]),
            closed=self.closed or "failed",
            end68=end68,
            end95=end95,
            own95=self.first95,
            active=self.active,
        )
        return self.with_simulation(known) if is_crossed else known


def crossing(inside: ScanPoint, outside: ScanPoint, root: float) -> float:
    """Where sqrt(Dchi^2) has a value between two points, by the straight line."""
    rise = outside.root - inside.root
    share = (root - inside.root) / rise if rise > 0.0 else 1.0
    return inside.value + share * (outside.value - inside.value)


# --- linearised ends, verified --------------------------------------------------------------------


def _verify(shared: Shared, sides: Sequence[_SideScan]) -> None:
    """Intervals from the covariance where chi square confirms them: one run at each predicted end.

    All values in one batch. x + z C g/sigma is where the linearised problem has its least chi
    square at that value.
    """
    here, likelihood = shared.optimum.expansion, shared.optimum.likelihood
    covariance = data_covariance(shared.optimum)
    places: list[tuple[_SideScan, float, FloatArray]] = []
    for side in sides:
        q = side.quantity
        if np.all(np.isfinite(q.slope)) and q.sigma > 0.0:
            along = covariance @ q.slope / q.sigma
            for root in (ROOT_68, ROOT_95):
                x = here.x + side.sign * reach(root, q.freedom) * along
                places.append((side, root, np.clip(x, likelihood.lower, likelihood.upper)))
    try:
        requests = [Request((x,), outputs=s.quantity.output >= 0) for s, _, x in places]
        answers = shared.evaluator(requests) if requests else []
    except Exhausted:
        return
    agreeing: dict[int, list[bool]] = {}
    for (side, root, _), [sample] in zip(places, answers, strict=True):
        at = Expansion(sample, here.matrix, here.outward, age=1)
        side.tried.append(at)
        agreeing.setdefault(id(side), []).append(_agrees(side, root, at))
    for side in sides:
        q, agree = side.quantity, agreeing.get(id(side), [])
        points = [shared.point(q, at) for at in side.tried]
        # a scan accepts what its search has followed; these, what stored slopes have followed
        shared.accept(list(itertools.compress(points, agree)))
        if not agree or not all(agree):
            continue
        # no known point of the side may fit better than the linearised profile has it there
        if not any(
            side.sign * (q.of(p.at.sample) - q.best) / q.sigma - reach(p.root, q.freedom)
            > 2.0 * AGREES * ROOT_95
            for p in shared.fitting()
        ):
            # the ends are where sqrt(Dchi^2), straight through the points, has its thresholds
            near, far = points
            end68 = q.best + (near.value - q.best) * ROOT_68 / near.root
            end95 = q.best + (far.value - q.best) * ROOT_95 / far.root
            known = Side(
                points=tuple(points),
                closed=side.closed_by(far),
                end68=end68,
                end95=end95,
                own95=end95,
                is_verified=True,
            )
            side.result = side.with_simulation(known)


def _agrees(side: _SideScan, root: float, at: Expansion) -> bool:
    """Whether chi square at a predicted end is as foreseen, also after the others have followed.

    Both are upper bounds of the profile: the second one is that of the stored slopes, which see a
    valley that bends away from the predicted end.
    """
    q, optimum = side.quantity, side.shared.optimum
    here, rows = optimum.expansion, at.sample.rows
    foreseen = reach(root, q.freedom) ** 2
    increase = float(rows @ rows) - optimum.least
    step = side.sign * reach(root, q.freedom) * q.sigma
    value = q.of(at.sample)
    if not (
        abs(increase / foreseen - 1.0) <= AGREES
        and abs(value - q.best - step) <= AGREES * abs(step)
    ):
        return False
    scale = optimum.likelihood.widths
    normal = q.slope * scale / np.linalg.norm(q.slope * scale)
    scaled = here.matrix * scale
    tangent = scaled - np.outer(scaled @ normal, normal)
    # directions that the data hardly see are not followed: nothing moves along them
    left, singular, _ = np.linalg.svd(tangent, full_matrices=False)
    followed = singular**2 / (singular**2 + 1.0)
    gain = float(np.sum(followed * (left.T @ rows) ** 2))
    gain -= float(np.sum(followed * (left.T @ here.sample.rows) ** 2))
    if gain > FOLLOWED * foreseen:
        return False
    besides = [q.index] if q.index >= 0 else []
    constraints = q.constraint(value, step) if q.output >= 0 else UNCONSTRAINED
    return not active_bounds_at(optimum.likelihood, at, besides, constraints)


# --- ends of ranges -------------------------------------------------------------------------------


def _try_ends(
    shared: Shared, open_: Sequence[_SideScan], ranges: Mapping[str, OutputRange]
) -> None:
    """Sides whose bound fits: tried from known points, that one first which fits best there.

    What was reached is shared at once: where a parameter ends may lie next to where another does.
    Half a period away nothing is decided by a fit alone: such parameters are scanned. Of an output,
    in turn the known point with the nearest value leads there, and a known point at which what the
    output depends on is put, and held, where it has its extreme.
    """
    rest, reached = [s for s in open_ if not s.quantity.is_periodic], list[_SideScan]()
    # what an output depends on and no prior holds: that is best where the data have it, (n,)
    has_prior = shared.optimum.likelihood.inverse_prior_sigma > 0.0
    movable = {name: np.flatnonzero(each.depends & ~has_prior) for name, each in ranges.items()}
    for attempt in range(ATTEMPTS + 1):
        left, near = list[_SideScan](), list[_SideScan]()
        for side in rest:
            (reached if side.is_reached() else left).append(side)
        for side in left:
            if not attempt or side.span < WORTH * side.quantity.sigma:
                near.append(side)
        rest = left
        if not near or attempt == ATTEMPTS:
            break
        is_projected = bool(attempt % 2)
        try:
            begins = _begins(shared, near, ranges, movable, is_projected=is_projected)
            if not begins:
                continue
            places = expand(shared.evaluator, [x for _, x in begins])
        except Exhausted:
            break
        constraints = []
        for side, _ in begins:
            q, step = side.quantity, (side.limit - side.quantity.best) / STEPS
            if q.output >= 0 and is_projected:
                frozen = tuple(map(int, movable[q.name]))
                constraints.append(Constraint(target=side.limit, frozen=frozen))
            else:
                constraints.append(q.constraint(side.limit, step))
        least = shared.optimum.least
        most = max(reach(ROOT_95, side.quantity.freedom) ** 2 for side, _ in begins)
        goal = Goal(enough=least + ENOUGH, wanted=least + most, confirmed=False)
        ends = minimise(shared.evaluator, places, constraints, goal)
        pairs = zip(begins, ends, strict=True)
        shared.accept([shared.point(side.quantity, end.end) for (side, _), end in pairs])
    for side in reached:
        side.result = side.open_side()


def _begins(
    shared: Shared,
    sides: Sequence[_SideScan],
    ranges: Mapping[str, OutputRange],
    movable: Mapping[str, IntArray],
    *,
    is_projected: bool,
) -> list[tuple[_SideScan, FloatArray]]:
    """Where searches for fits at the ends begin, one for each side: the best of known points there.

    Raises:
        Exhausted: the budget does not allow to evaluate them.
    """
    fitting = shared.fitting()
    known = [shared.optimum.expansion.x, *(p.x for p in fitting)]
    begins: list[tuple[_SideScan, FloatArray]] = []
    places: list[tuple[_SideScan, FloatArray]] = []
    for side in sides:
        q = side.quantity
        if q.index < 0 and not is_projected:
            values = np.append(q.best, q.values(fitting))
            for k in np.argsort(np.abs(values - side.limit), kind="stable"):
                if known[k].tobytes() not in side.attempted:
                    begins.append((side, known[k]))
                    break
            continue
        if q.index >= 0:
            axes, end = np.array([q.index]), np.full(known[0].size, side.limit)
        else:
            range_ = ranges[q.name]
            axes, end = movable[q.name], (range_.x_low, range_.x_high)[side.side]
        if np.all(np.isfinite(end[axes])):
            new: dict[bytes, FloatArray] = {}
            for x in known:
                moved = x.copy()
                moved[axes] = end[axes]
                if moved.tobytes() not in side.attempted and len(new) < CANDIDATES:
                    new[moved.tobytes()] = moved
            places += [(side, x) for x in new.values()]
    best: dict[int, tuple[float, _SideScan, FloatArray]] = {}
    if places:
        answers = shared.evaluator([Request((x,), outputs=False) for _, x in places])
        for (side, x), [sample] in zip(places, answers, strict=True):
            square = float(sample.rows @ sample.rows)
            if square < best.get(id(side), (math.inf,))[0]:  # not where the model failed
                best[id(side)] = square, side, x
    begins += [(side, x) for _, side, x in best.values()]
    for side, x in begins:
        side.attempted.add(x.tobytes())
    return begins


# --- scans ----------------------------------------------------------------------------------------


def _scan(shared: Shared, scans: Sequence[_SideScan]) -> None:
    """Rounds in which every scan goes one point on, in common batches.

    Searches go on by updated slopes; near and beyond the threshold a minimum is confirmed by
    slopes that are taken there.
    """
    least = shared.optimum.least
    far = reach(FAR, shared.optimum.noise_freedom) ** 2
    goal = Goal(enough=least + INSIDE, wanted=least + far, confirmed=False)
    for _ in range(ROUNDS):
        for scan in scans:
            if not (scan.closed or scan.outside) and scan.is_reached():
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
        ends = minimise(shared.evaluator, [scan.begin for scan in active], constraints, goal)
        near = []
        for k, (scan, end) in enumerate(zip(active, ends, strict=True)):
            root = shared.point(scan.quantity, end.end).root
            is_sure = end.reached and not end.end.age
            if not (end.is_cut or is_sure) and ROOT_95 - CONFIRMED <= root <= FAR:
                near.append(k)
        if near:
            begins = [ends[k].end for k in near]
            confirmed = minimise(shared.evaluator, begins, [constraints[k] for k in near])
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
    try:
        requests = [Request((x,), outputs=scan.quantity.output >= 0) for scan, x in led]
        answers = shared.evaluator(requests) if led else []
    except Exhausted:
        return
    for (scan, _), [sample] in zip(led, answers, strict=True):
        square = float(sample.rows @ sample.rows)
        if math.isfinite(square) and shared.optimum.delta(square) < FAR**2:
            scan.begin = replace(scan.begin, sample=sample, age=scan.begin.age + 1)


def _extend(shared: Shared, sides: Sequence[_SideScan]) -> None:
    """Scans go on from the farthest point in hand that fits and lies beyond where they ended."""
    for _ in range(EXTENSIONS):
        # where a side ends is known to CLOSE: its point on the threshold fits as well as any
        ends = [s.outside for s in sides if s.outside is not None]
        fitting = [*shared.fitting(), *shared.read([p for p in ends if p.root - ROOT_95 < CLOSE])]
        going = list[_SideScan]()
        for scan in sides:
            q = scan.quantity
            known = scan.result or scan.ended()
            if known.closed in ("bound", "periodic"):
                continue
            is_end = scan.result is not None or known.closed in ("data", "prior")
            end = known.end95 if is_end else scan.last.value
            margin = BEYOND * abs(end - q.best) + 1e-9 * (q.high - q.low)
            gaps = scan.sign * (q.values(fitting) - end)
            if not np.any(gaps > margin):
                continue
            if scan.result is not None:  # it was closed without a scan
                scan.first95, scan.result = known.own95, None
                scan.points += list(known.points)
            point = fitting[int(np.nanargmax(gaps))]
            scan.points += [p for p in (*scan.inside, scan.outside) if p is not None]
            scan.inside, scan.outside = [replace(point, value=q.of(point.at.sample))], None
            scan.origin, scan.misses, scan.narrowed = scan.last.value, 0, 0
            scan.tried, scan.closed = [], ""
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
        _scan(shared, going)
