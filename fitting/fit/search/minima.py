"""Minima of chi square over the whole box: points screened in one batch, the best let down.

Of points that fill the box evenly those are let down that lie lowest and apart from lower ones
(multi-level single linkage), all side by side. While noise does not explain the least chi square,
as many further points of the same sequence are screened as there were, as far as the budget goes:
a valley that takes a thousandth of the box is seen by a thousand points, not by sixty-four. Boxes
of many parameters are screened by more points from the first on. Where noise hardly explains the
least chi square, every edge of the box is gone along through the lowest minima; where it does not
explain it, differential evolution searches the box, and finer scans go through what is lowest then.
Where all descents came to one minimum evolution is not repeated, and not begun where that is rarely
noise, but may be: right minima are that by noise more often than such a box hides a lower one.
Evolution comes first where the ground is rough: a lowest minimum that one descent alone came to,
with another little above it, tells that the descents have not seen all there are.

Source: A. Rinnooy Kan and G. Timmer, "Stochastic global optimization methods II: multi level
methods", Mathematical Programming 39 (1987) 57; C. Boender and A. Rinnooy Kan, "Bayesian stopping
rules for multistart global optimization methods", Mathematical Programming 37 (1987) 59.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fitting.fit.few_places import of_few_places, own_gain
from fitting.fit.levenberg import Descent, expand, minimise
from fitting.fit.likelihood import Likelihood, LikelihoodEvaluator, Request
from fitting.fit.optimum import TOO_LARGE_P, freedom_of, inflation_of
from fitting.fit.search.box import Box
from fitting.fit.search.evolution import evolved, merit
from fitting.fit.search.scans import scanned
from fitting.text.arrays import FloatArray

#: Points of the first screen, a power of two; each further one doubles what was screened.
SCREENED = 64
#: Descents from the best points of a screen; screens at most, 4,096 points in all.
DESCENTS, SCREENS = 8, 7
#: Points along each edge of a first scan and of finer ones; minima that scans go through, and
#: descents from what they find.
SCAN, FINER_SCAN, THROUGH, SCAN_DESCENTS = 64, 256, 4, 12
#: Evolutions and finer scans at most, where there are more parameters than that.
EVOLUTIONS, FINER_SCANS = 2, 3
#: Probability of the least chi square below which scans look for a lower one: one wrong minimum in
#: twenty is explained by noise at TOO_LARGE_P, nearly none is at the middle of what noise leaves.
BARELY_P = 0.2
#: The same below which evolution searches a box whose descents all came to one minimum.
RARELY_P = 1e-3
#: The probability that no chi square above nought has: the search goes on whatever noise explains.
NEVER_EXPLAINED_P = 1.0
#: Parameters beyond which each doubles what is screened in any case, up to so many points.
FEW, MOST_AT_FIRST = 3, 512
#: Chi square above the least below which another minimum makes the ground rough.
ROUGH = 10.0
#: Decrease of chi square that counts as something lower, and as a share of it.
WORTH, WORTH_SHARE = 1.0, 1e-2
#: Chi square of a minimum by few places, in units of the least, from which nothing goes on.
HIGHER = 2.0
#: Probability of the least chi square of few places below which all are searched instead.
HARDLY_P = 1e-6
#: Ends closer than this share of the box are one minimum, if their chi squares are one, too.
SAME = 0.02


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Where descents ended: search vector and chi square, where the first of them had begun.

    `reached` where no step promises a decrease; `descents` ended here.
    """

    x: FloatArray
    begun: FloatArray
    chi_square: float
    reached: bool
    descents: int = 1


@dataclass(frozen=True, kw_only=True)
class Search:
    """What a search of the box found: `minima` apart from each other, the lowest first.

    `screened` points in `screens` rounds of all kinds, `descents` from the best of them;
    `explained` whether noise explains the least chi square; `mirrored` where all of it was taken
    over from an alternative that this one mirrors.
    """

    minima: tuple[Minimum, ...]
    screened: int
    screens: int
    descents: int
    explained: bool
    evaluations: int
    runs: int
    mirrored: bool = False

    def apart_by_height(self) -> tuple[list[Minimum], list[Minimum]]:
        """Minima as low as the lowest, and the higher ones."""
        if not self.minima:
            return [], []
        least = self.minima[0].chi_square
        low = [m for m in self.minima if not m.chi_square > least + worth(least)]
        return low, list(self.minima[len(low) :])


def worth(chi_square: float) -> float:
    """Difference of chi square that counts, about such a value.

    Args:
        chi_square: of the lower of two points.
    """
    return max(WORTH, WORTH_SHARE * chi_square)


def search_box(
    evaluator: LikelihoodEvaluator, begins: Sequence[FloatArray], seed: int, budget: int
) -> Search:
    """Look for the lowest minima of chi square in the box.

    Of measurements at many places few are looked at first (`fitting.fit.few_places`):
    what is a minimum of all of them is about one of those, where noise explains both. Descents are
    then those by all, from what is not far above the lowest. Where noise rarely explains the lowest
    of all, but may, the few are searched as thoroughly as all would be: a part of the cost.

    Args:
        evaluator: of the likelihood, without inflation.
        begins: search vectors that are let down besides, (n,) each.
        seed: of the points that are screened.
        budget: evaluations after which no further screen is begun.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    few = of_few_places(evaluator.likelihood)
    if few is None:
        return _searched(evaluator, begins, seed, budget)
    with evaluator.of(few.likelihood):
        scouted = _searched(evaluator, begins, seed, budget, SCOUTING)
    if not scouted.explained:
        return _searched(evaluator, begins, seed, budget)
    ended = _let_down(evaluator, [*begins, *_promising(evaluator.likelihood, scouted)])
    if not _is_explained(evaluator.likelihood, ended):
        if not _is_explained(evaluator.likelihood, ended, RARELY_P):
            return _searched(evaluator, begins, seed, budget)
        lowest = min(ended, key=lambda each: each[1].chi_square)[1].end.x
        with evaluator.of(few.likelihood):
            scouted = _searched(evaluator, [lowest], seed, budget, THOROUGHLY)
        ended += _let_down(evaluator, _promising(evaluator.likelihood, scouted))
    return replace(
        scouted,
        minima=_apart(Box(evaluator.likelihood.parameters), evaluator.likelihood, ended),
        descents=len(ended),
        explained=_is_explained(evaluator.likelihood, ended),
        evaluations=evaluator.evaluations,
        runs=evaluator.runs,
    )


def _promising(likelihood: Likelihood, scouted: Search) -> list[FloatArray]:
    """Minima by few places that are not far above the lowest of them."""
    enough = HIGHER * scouted.minima[0].chi_square + own_gain(likelihood)
    return [minimum.x for minimum in scouted.minima if minimum.chi_square <= enough]


@dataclass(frozen=True)
class _Effort:
    """How thoroughly rows are searched.

    `bar` is the probability of the least chi square from which noise explains it, `least_p` the
    one below which every round looks further, whatever its own is; without `rounds` nothing follows
    the screens.
    """

    bar: float = TOO_LARGE_P
    least_p: float = 0.0
    rounds: bool = True


#: By rows that tell whether noise explains them; by few of others, which go on from it and tell
#: that: where it hardly explains these no more is spent on them; by few for all, which it rarely
#: explains.
USUAL, SCOUTING, THOROUGHLY = _Effort(), _Effort(HARDLY_P, rounds=False), _Effort(least_p=1.0)


def _searched(
    evaluator: LikelihoodEvaluator,
    begins: Sequence[FloatArray],
    seed: int,
    budget: int,
    effort: _Effort = USUAL,
) -> Search:
    """A search by all rows that the evaluator has."""
    box = Box(evaluator.likelihood.parameters)
    ended = _let_down(evaluator, begins)
    unknowns = int(np.count_nonzero(box.free))
    enough = min(SCREENED * 2 ** max(0, unknowns - FEW), MOST_AT_FIRST)
    bar = max(effort.bar, effort.least_p)
    screens, taken = 0, 0
    while screens < SCREENS and unknowns:
        number = max(SCREENED, taken)
        ended += _let_down(evaluator, screened(evaluator, seed, number, skip=taken))
        screens, taken = screens + 1, taken + number
        done = not effort.rounds or _is_explained(evaluator.likelihood, ended, bar)
        if evaluator.evaluations >= budget or (done and taken >= enough):
            break
    many = unknowns > FEW and effort.rounds
    for least_p, look in _further_rounds(evaluator, box, ended, seed) if many else ():
        if _is_explained(evaluator.likelihood, ended, max(least_p, effort.least_p)):
            break
        points, looked_at = look()
        ended += _let_down(evaluator, points)
        screens, taken = screens + 1, taken + looked_at
    return Search(
        minima=_apart(box, evaluator.likelihood, ended),
        screened=taken,
        screens=screens,
        descents=len(ended),
        explained=_is_explained(evaluator.likelihood, ended, effort.bar),
        evaluations=evaluator.evaluations,
        runs=evaluator.runs,
    )


def _further_rounds(
    evaluator: LikelihoodEvaluator,
    box: Box,
    ended: Sequence[tuple[FloatArray, Descent]],
    seed: int,
) -> Iterator[tuple[float, Callable[[], tuple[list[FloatArray], int]]]]:
    """Rounds behind the screens, and the probability of the least chi square that ends them.

    Each answers with what is worth to descend from and how many points were looked at; scans go
    through the minima that all descents before them have found (`ended` grows). A finer scan that
    found nothing lower is the last: the next one would see the same points.
    """

    def least() -> float:
        return min((descent.chi_square for _, descent in ended), default=math.inf)

    def scan(number: int) -> tuple[list[FloatArray], int]:
        lowest = _apart(box, evaluator.likelihood, ended)[:THROUGH]
        through = [minimum.x for minimum in lowest]
        return scanned(evaluator, box, through, number=number, wanted=SCAN_DESCENTS)

    def is_alone() -> bool:
        return len(_apart(box, evaluator.likelihood, ended)) == 1

    if _is_rough(_apart(box, evaluator.likelihood, ended)):
        yield NEVER_EXPLAINED_P, partial(evolved, evaluator, box, seed + EVOLUTIONS, DESCENTS)
    yield BARELY_P, partial(scan, SCAN)
    for turn in range(EVOLUTIONS):
        alone = is_alone()
        if turn and alone:
            break
        least_p = RARELY_P if alone else TOO_LARGE_P
        yield least_p, partial(evolved, evaluator, box, seed + turn, DESCENTS)
    for _ in range(FINER_SCANS):
        before = least()
        yield TOO_LARGE_P, partial(scan, FINER_SCAN)
        if not least() < before - worth(before):
            return


def _is_rough(minima: Sequence[Minimum]) -> bool:
    """Whether descents found the lowest of several minima that are nearly as low only once."""
    if not minima or minima[0].descents > 1:
        return False
    least = minima[0].chi_square
    return any(worth(least) < minimum.chi_square - least < ROUGH for minimum in minima)


def _let_down(
    evaluator: LikelihoodEvaluator, begins: Sequence[FloatArray]
) -> list[tuple[FloatArray, Descent]]:
    """Descents side by side: where each began and ended; without those where the model failed."""
    if not begins:
        return []
    ends = minimise(evaluator, expand(evaluator, begins, outputs=False))
    return [(x, end) for x, end in zip(begins, ends, strict=True) if math.isfinite(end.chi_square)]


def screened(
    evaluator: LikelihoodEvaluator, seed: int, number: int = SCREENED, skip: int = 0
) -> list[FloatArray]:
    """Points of the box from which it is worth to descend, the most promising first, at most 8.

    Those with the best rows that have no better one near them, ranked by sum ln(1 + row^2): a point
    where half of the rows fit is worth more than one where none is far off.

    Args:
        evaluator: of the likelihood.
        seed: of the points that are screened.
        number: of points, a power of two.
        skip: points of the same sequence that were used before.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    box = Box(evaluator.likelihood.parameters)
    points = box.spread(number, seed, skip)
    if not points:
        return []
    samples = evaluator([Request(tuple(points), outputs=False)])[0]
    merits = np.array([merit(s.rows) for s in samples])
    order = [k for k in np.argsort(merits, kind="stable") if math.isfinite(merits[k])]
    near = 0.5 * len(points) ** (-1.0 / max(1, int(np.count_nonzero(box.free))))
    alone: list[int] = []
    for place, k in enumerate(order):
        if all(box.apart(points[k], points[j]) > near for j in order[:place]):
            alone.append(k)
        if len(alone) == DESCENTS:
            break
    rest = [k for k in order if k not in alone]
    return [points[k] for k in (alone + rest)[:DESCENTS]]


def _is_explained(
    likelihood: Likelihood,
    ended: Sequence[tuple[FloatArray, Descent]],
    least_p: float = TOO_LARGE_P,
) -> bool:
    """Whether noise explains the lowest end of all descents, not less often than `least_p`."""
    if not ended:
        return False
    end = min((d for _, d in ended), key=lambda each: each.chi_square).end
    m = likelihood.data_rows
    rows = end.sample.rows[:m]
    free = freedom_of(likelihood, end)
    noise_dof = likelihood.objective.data.noise_freedom
    return inflation_of(float(rows @ rows), free, least_p, noise_dof) == 1.0


def _apart(
    box: Box, likelihood: Likelihood, ended: Sequence[tuple[FloatArray, Descent]]
) -> tuple[Minimum, ...]:
    """Ends of descents as minima, those that are one counted together."""
    kept: list[Minimum] = []
    for begun, descent in sorted(ended, key=lambda each: each[1].chi_square):
        x, square = likelihood.folded(descent.end.x), descent.chi_square
        for k, other in enumerate(kept):
            level = square - other.chi_square <= worth(other.chi_square)
            if level and box.apart(x, other.x) <= SAME:
                kept[k] = replace(other, descents=other.descents + 1)
                break
        else:
            kept.append(Minimum(x=x, begun=begun, chi_square=square, reached=descent.reached))
    return tuple(kept)
