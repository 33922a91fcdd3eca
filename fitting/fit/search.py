"""Minima of chi square within the bounds: a multistart of bounded least squares.

Points that fill the bounds evenly are evaluated in one batch; from the best of them that are apart
searches start, all side by side. While noise does not explain the least chi square, rounds of as
many further points as there were follow, as far as the budget goes: a valley that takes a
thousandth of the box is met by a thousand points, not by sixty-four. White residuals of one size
are noise, however large: no better minimum makes them smaller. Each of these rounds is followed by
two that look elsewhere: curves over frequency are first compared by where their power is, which
moves lines that do not overlap together; and in boxes of many parameters points along the
edges of the box through the lowest minima are evaluated.

Source: A. Rinnooy Kan and G. Timmer, "Stochastic global optimization methods II: multi level
methods", Mathematical Programming 39 (1987) 57.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds, starts, to_model, to_search
from fitting.fit.levenberg import Goal, expand, minimise
from fitting.fit.likelihood import Likelihood, LikelihoodEvaluator, Request
from fitting.fit.optimum import TOO_LARGE_P, freedom_of
from fitting.measurements.dataset import Dataset
from fitting.signal.misfit import DOUBTFUL, SURE, UNLIKELY, of_one_size
from fitting.signal.residual_tests import white_noise_p
from fitting.signal.student import tail
from fitting.text.arrays import FloatArray, IntArray

#: Points of the first round, a power of two (each further one doubles them), and rounds at most.
POINTS, ROUNDS = 64, 18
#: Searches that start from the best points of a round, and from those along edges.
STARTS, STARTS_ALONG = 8, 12
#: Parameters beyond which each doubles the points that are evaluated in any case, up to so many;
#: and by what the budget is larger there.
FEW, MOST_AT_FIRST, MORE = 3, 512, 6
#: Points along each edge of the box, and minima that the lines go through; each time they are moved
#: on by the golden ratio, so that none is evaluated twice.
ALONG, THROUGH, GOLDEN = 64, 4, 0.618
#: Ways to look between two rounds of points: by shares of the power, and along edges; and when a
#: search by shares is near enough.
_SHARES, _EDGES, NEARER = "shares", "edges", Goal(promise=10.0, confirmed=False)
#: Probability of the least chi square below which a box of many parameters is searched along edges.
BARELY_P = 0.2
#: Difference of chi square that counts, and as a share of the lower one.
WORTH, WORTH_SHARE = 1.0, 1e-2
#: Ends closer than this share of the box are one minimum, if their chi squares are one, too.
SAME = 0.02
#: Bases of Halton's sequence, one for each edge that it fills.
PRIMES = (2, 3, 5)
#: How far a prior reaches from its middle, in standard deviations: beyond, nothing fits as well.
PRIOR_SIGMAS = 3.0


class Box:
    """The bounds as a unit cube: ratios in their logarithm, periodic parameters over one period.

    What the model depends on is searched whether it has a prior or not, as far as that may reach;
    offsets of single experiments that have one stay at their start.
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = parameters
        self.free = np.array([p.is_searched for p in parameters], dtype=bool)
        self.lower, self.upper = search_bounds(parameters)
        self._log = np.array([p.spans_decades for p in parameters], dtype=bool)
        self._periodic = np.zeros(len(parameters), dtype=bool)
        self._low, self._high = np.zeros(len(parameters)), np.zeros(len(parameters))
        for i, p in enumerate(parameters):
            low, high = p.lower, p.upper
            if p.prior_sigma is not None and p.is_searched:
                reach = PRIOR_SIGMAS * p.prior_sigma
                near = max(low, p.reference - reach), min(high, p.reference + reach)
                low, high = near if near[0] < near[1] else (low, high)
            if p.period is not None and high - low >= p.period * (1.0 - 1e-9):
                self._periodic[i], high = True, low + p.period
            self._low[i], self._high[i] = low, high

    def spread(self, number: int, seed: int, skip: int = 0) -> list[FloatArray]:
        """Search vectors that fill the box evenly; a longer list continues a shorter one.

        Sobol's sequence; along a few edges Halton's, which does without importing all of
        scipy.stats, and that takes as long as many a fit.

        Args:
            number: of points, a power of two.
            seed: of scrambling or shift.
            skip: points of the same sequence that were used before.

        Source: I. Sobol, USSR Comput. Math. Math. Phys. 7 (1967) 86; A. Owen's scrambling.
        J. Halton, Numer. Math. 2 (1960) 84; R. Cranley and T. Patterson, SIAM J. Numer. Anal. 13
        (1976) 904.
        """
        count = int(np.count_nonzero(self.free))
        if not count:
            return []
        if count > len(PRIMES):  # there Halton's points missed 2 of 20 crossings that these find
            from scipy.stats.qmc import Sobol

            sequence = Sobol(count, scramble=True, seed=np.random.default_rng(seed))
            if skip:
                sequence.fast_forward(skip)
            return [self.from_cube(u) for u in sequence.random(number)]
        places = np.arange(skip + 1, skip + number + 1)
        shift = np.random.default_rng(seed).random(count)
        cube = np.stack([radical_inverse(places, prime) for prime in PRIMES[:count]], axis=1)
        return [self.from_cube(u) for u in np.mod(cube + shift, 1.0)]

    def from_cube(self, u: FloatArray) -> FloatArray:
        """The search vector at a point of the cube, (n,); what is not searched is at its start.

        Args:
            u: in the unit cube of what is searched.
        """
        p, low, high = starts(self.parameters), self._low[self.free], self._high[self.free]
        x = to_search(self.parameters, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = low * (high / low) ** u
        p[self.free] = np.where(self._log[self.free], ratios, low + u * (high - low))
        x[self.free] = to_search(self.parameters, p)[self.free]
        return np.clip(x, self.lower, self.upper)

    def to_cube(self, x: FloatArray) -> FloatArray:
        """Coordinates of a search vector in the cube, (n,); outside where a period was added.

        Args:
            x: search vector, shape (n,).
        """
        p, low, high = to_model(self.parameters, x), self._low, self._high
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithmic = np.log(np.maximum(p, low) / low) / np.log(high / low)
        return np.asarray(np.where(self._log, logarithmic, (p - low) / (high - low)))

    def apart(self, x: FloatArray, y: FloatArray) -> float:
        """Largest distance of two search vectors along an edge of the cube, modulo periods.

        Args:
            x: search vector, shape (n,).
            y: another, shape (n,).
        """
        gap = np.abs(self.to_cube(x) - self.to_cube(y))
        rest = np.mod(gap, 1.0)
        gap = np.where(self._periodic, np.minimum(rest, 1.0 - rest), gap)
        return float(np.max(gap[self.free], initial=0.0))


def radical_inverse(k: IntArray, base: int) -> FloatArray:
    """The digits of whole numbers in some base, mirrored at the point: sum d_i b^(-i-1), (n,).

    Args:
        k: from 1 on, shape (n,).
        base: of the digits, at least 2.
    """
    result, share = np.zeros(k.size), 1.0
    while np.any(k > 0):
        share /= base
        result += share * (k % base)
        k = k // base
    return result


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Where searches ended: search vector and chi square, and where the first of them started.

    `descents` is the number of searches that ended here.
    """

    x: FloatArray
    start: FloatArray
    chi_square: float
    descents: int = 1


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Search within the bounds in one alternative.

    `screened` points were evaluated and `descents` started in `screens` rounds from the best.
    `explained`: whether noise explains the lowest; `twins`: exact symmetries of the model;
    `refused` points at which the model failed, first with `refusal`.
    """

    screened: int
    screens: int
    descents: int
    explained: bool
    twins: int = 0
    evaluations: int
    fmu_runs: int
    refused: int = 0
    refusal: str = ""


def worth(chi_square: float) -> float:
    """Difference of chi square that counts, about such a value.

    Args:
        chi_square: of the lower of two points.
    """
    return max(WORTH, WORTH_SHARE * chi_square)


def lowest(minima: Sequence[Minimum]) -> list[Minimum]:
    """Minima as low as the lowest.

    Args:
        minima: the lowest first.
    """
    least = min((m.chi_square for m in minima), default=math.inf)
    return [m for m in minima if not m.chi_square > least + worth(least)]


def merit(rows: FloatArray) -> float:
    """Sum ln(1 + row^2): where half of the rows fit is worth more than where none is far off.

    Args:
        rows: whitened, shape (m,).
    """
    return float(np.sum(np.log1p(rows**2)))


def screened(
    evaluator: LikelihoodEvaluator, seed: int, number: int = POINTS, skip: int = 0
) -> list[FloatArray]:
    """Points of the box from which searches start, the most promising first.

    Those with the best rows that have no better one near them, ranked by their `merit`.

    Args:
        evaluator: of the likelihood.
        seed: of the points.
        number: of points, a power of two.
        skip: points of the same sequence that were used before.

    Raises:
        FmuFailure: the model failed at a dozen points and has answered at none.
    """
    box = Box(evaluator.likelihood.parameters)
    points = box.spread(number, seed, skip)
    if not points:
        return []
    [samples] = evaluator([Request(tuple(points), outputs=False)])
    merits = np.array([merit(sample.rows) for sample in samples])
    order = [k for k in np.argsort(merits, kind="stable") if math.isfinite(merits[k])]
    near = 0.5 * len(points) ** (-1.0 / np.count_nonzero(box.free))
    alone: list[int] = []
    for place, k in enumerate(order):
        if len(alone) < STARTS and all(
            box.apart(points[k], points[j]) > near for j in order[:place]
        ):
            alone.append(k)
    return [points[k] for k in [*alone, *(k for k in order if k not in alone)][:STARTS]]


def along_edges(
    evaluator: LikelihoodEvaluator, through: Sequence[FloatArray], offset: float
) -> tuple[list[FloatArray], int]:
    """Minima along lines through points, parallel to the edges of the box, and points evaluated.

    A valley too narrow for a few thousand points that fill the box is wide along some edge of it:
    where two lines of a sweep are exchanged, one parameter alone leads from the wrong minimum to
    the side of the right one.

    Args:
        evaluator: of the likelihood.
        through: search vectors, (n,) each.
        offset: of the points along a line, as a share of their distance.

    Raises:
        FmuFailure: the model failed at a dozen points and has answered at none.
    """
    box, places = Box(evaluator.likelihood.parameters), (np.arange(ALONG) + offset) / ALONG
    lines, owns = [], []
    for cube in (box.to_cube(x)[box.free] for x in through):
        for edge, here in enumerate(cube):
            own = int(np.searchsorted(places, here))
            along = np.repeat(cube[None, :], ALONG + 1, axis=0)
            along[:, edge] = np.insert(places, own, here)
            lines.append(tuple(map(box.from_cube, along)))
            owns.append(own)
    results: list[tuple[float, FloatArray]] = []
    answers = evaluator([Request(line, outputs=False) for line in lines])
    for line, own, samples in zip(lines, owns, answers, strict=True):
        merits = np.array([merit(sample.rows) for sample in samples])
        merits = np.concatenate([[np.inf], np.nan_to_num(merits, nan=np.inf), [np.inf]])
        is_low = (merits[1:-1] < merits[:-2]) & (merits[1:-1] <= merits[2:])
        # the point itself and its neighbours lead back to where it is
        others = [int(k) for k in np.flatnonzero(is_low) if abs(k - own) > 1]
        results += [(merits[k + 1], line[k]) for k in others]
    results.sort(key=lambda each: each[0])
    return [x for _, x in results[:STARTS_ALONG]], sum(map(len, lines))


def search_box(
    evaluator: LikelihoodEvaluator, begins: Sequence[FloatArray], seed: int, budget: int
) -> tuple[tuple[Minimum, ...], SearchResult]:
    """Minima of chi square in the box, apart from each other, the lowest first.

    Args:
        evaluator: of the likelihood, without inflation.
        begins: search vectors that searches start from besides, (n,) each.
        seed: of the points.
        budget: evaluations after which no further points of the box are evaluated.

    Raises:
        FmuFailure: the model failed at a dozen points and has answered at none.
    """
    likelihood, box = evaluator.likelihood, Box(evaluator.likelihood.parameters)
    unknowns = int(np.count_nonzero(box.free))
    is_wide = unknowns > FEW
    enough = min(POINTS * 2 ** max(0, unknowns - FEW), MOST_AT_FIRST)
    budget *= MORE if is_wide else 1
    data = likelihood.objective.data
    has_curves = any(m.rows and m.line_width_hz is not None for m in data.measurements)
    others = [way for way, use in ((_SHARES, has_curves), (_EDGES, is_wide)) if use]
    left: list[str] = []  # ways that remain before the next points of the box
    minima: list[Minimum] = []
    some, tried = list(begins), list(begins)
    rounds, spread, along, descents, p = 0, 0, 0, 0, 0.0
    while True:
        ends = minimise(evaluator, expand(evaluator, some, outputs=False)) if some else []
        # where the model fails no minimum is known
        ended = [e for e in zip(some, ends, strict=True) if math.isfinite(e[1].chi_square)]
        descents += len(ended)
        for start, end in ended:
            if end.chi_square < min((m.chi_square for m in minima), default=math.inf):
                rows = end.end.sample.rows[: likelihood.data_rows]
                freedom = freedom_of(likelihood, end.end)
                p = tail(float(rows @ rows), freedom, data.noise_freedom)
                if _is_correlated(data, rows):
                    p = 0.0
                elif p < TOO_LARGE_P and freedom >= SURE and _is_noise(likelihood, rows):
                    p = 1.0
            x = likelihood.folded(end.end.x)
            minima.append(Minimum(x=x, start=start, chi_square=end.chi_square))
        minima = distinct(box, minima)
        # one wrong minimum in twenty is explained by noise at TOO_LARGE_P, nearly none at BARELY_P
        is_explained = p >= (BARELY_P if is_wide and not along else TOO_LARGE_P)
        is_spent = evaluator.evaluations >= budget
        is_done = (is_spent or spread >= enough) if is_explained else (is_spent and not left)
        if (rounds and is_done) or rounds == ROUNDS or not unknowns:
            break
        way = left.pop(0) if left and minima and not is_explained else ""
        if way == _SHARES:
            with evaluator.of(replace(likelihood, by_shares=True)):
                led = minimise(evaluator, expand(evaluator, tried, outputs=False), goal=NEARER)
            some = [likelihood.folded(end.end.x) for end in led if math.isfinite(end.chi_square)]
        elif way == _EDGES:
            offset = (0.5 + GOLDEN * (rounds // len(others))) % 1.0
            some, number = along_edges(evaluator, [m.x for m in minima[:THROUGH]], offset)
            along += number
        else:
            number = max(POINTS, spread)
            some = screened(evaluator, seed, number, skip=spread)
            spread += number
            tried, left = ([*begins, *some] if not rounds else some), [*others]
        rounds += 1
    return tuple(minima), SearchResult(
        screened=spread + along,
        screens=rounds,
        descents=descents,
        explained=p >= TOO_LARGE_P,
        evaluations=evaluator.evaluations,
        fmu_runs=evaluator.runs,
        refused=evaluator.failures,
        refusal=evaluator.failure,
    )


def _is_correlated(data: Dataset, rows: FloatArray) -> bool:
    """Whether rows (m,) whose noise is estimated from the data show a pattern along a curve.

    Scatter that counts a narrow line for noise is too large for its chi square to be.
    """
    if math.isinf(data.noise_freedom):
        return False
    curves = (rows[at] for m, at in zip(data.measurements, data.slices, strict=True) if m.is_curve)
    return any(white_noise_p(each) < UNLIKELY for each in curves)


def _is_noise(likelihood: Likelihood, rows: FloatArray) -> bool:
    """Whether whitened rows (m,) are noise that is larger than stated: white, and of one size.

    A wrong minimum leaves a pattern along some curve, or a part of the rows far off the rest.
    """
    data, tests, tested = likelihood.objective.data, list[float](), np.zeros(rows.size, dtype=bool)
    residuals = likelihood.residuals(rows)
    for m, at in zip(data.measurements, data.slices, strict=True):
        for curve in m.residual_curves(residuals[at]):
            tests.append(white_noise_p(rows[at][curve.rows]))
            tested[at.start + curve.rows] = True
    is_white = bool(np.all(tested)) and min(tests) * len(tests) >= DOUBTFUL
    return is_white and of_one_size(rows, outliers=False)


def distinct(box: Box, minima: Sequence[Minimum]) -> list[Minimum]:
    """Minima apart from each other, the lowest first; those that are one are counted together.

    Args:
        box: of their parameters.
        minima: in any order.
    """
    kept: list[Minimum] = []
    for minimum in sorted(minima, key=lambda each: each.chi_square):
        for k, other in enumerate(kept):
            is_level = minimum.chi_square - other.chi_square <= worth(other.chi_square)
            if is_level and box.apart(minimum.x, other.x) <= SAME:
                kept[k] = replace(other, descents=other.descents + minimum.descents)
                break
        else:
            kept.append(minimum)
    return kept
