"""Proposals that follow a bent posterior: learnt from residuals at places of walks that are lost.

Where data leave directions open, the posterior is a thin sheet that bends through the box, and one
Gaussian about the minimum misses it. Residuals and their derivatives where walkers begin make a
surrogate; walks on it, which take no run of a model, end at places of the sheet that nobody knew;
residuals there make a better one, until the weights of a round's places say that it is the
posterior:

    share = (sum w)^2/(N sum w^2)        w = posterior/surrogate

Walks on it draw from a mixture about places of their own. About a place p, of residuals r and
derivatives A

    min_d |r + A d|^2 + |d|^2/h^2        c = p + d        R^T R = A^T A + 1/h^2

in units of the box: across the sheet as wide as the data say, along it h, as far as it is straight.
h is the longest over which |r + A d|^2/2 is right to two, in the mean of some draws of that width.

Nothing that is learnt changes what is drawn from: it is not changed any more when draws begin.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fitting.inference.posterior.follow import Follow
from fitting.inference.posterior.minima import WHOLE, Target
from fitting.inference.posterior.start import Mixture
from fitting.inference.posterior.surrogate import MOST, Places, Surrogate
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer, NoScale

#: How far a place reaches along the sheet, in units of the box: what is tried.
REACHES = (0.5, 0.3, 0.2, 0.12, 0.07, 0.045, 0.03, 0.02, 0.012, 0.007, 0.004)
#: By how much ln may be another for it than it were on a straight sheet, in the mean of so many
#: draws.
STRAIGHT, BENT = 2.0, 4
#: Proposals by which a mixture is judged.
TRIED = 256
#: Share of draws about the minima that a learnt mixture keeps.
KEPT = 0.1
#: Rounds at most, and the share of the weights that ends them where it is reached in two of them.
ROUNDS, ENOUGH = 12, 0.98
#: Mixtures that are made one from another in a round, and after the last.
MADE, LAST = 2, 8
#: No more parameters than these, and no larger arrays, bytes: with more there is no surrogate.
DIMENSIONS, LARGEST = 12, 200e6
#: Walks on a surrogate, places of each that are looked at, steps between them; parts of a mixture.
WALKS, EACH, BETWEEN, PARTS = 128, 8, 15, 500


def worth(
    mixture: Mixture, log: Callable[[FloatArray], FloatArray], rng: np.random.RandomState
) -> float:
    """Share of independent draws among proposals of a mixture, by their weights; see the module.

    Args:
        mixture: that proposes.
        log: ln of the posterior of points in units of the box.
        rng: of the proposals.
    """
    tried = mixture.draw(TRIED, rng)
    return _share(log(tried) - mixture.log_density(tried))


def learnt(
    target: Target,
    begin: tuple[FloatArray, FloatArray],
    minima: Mixture,
    rng: np.random.RandomState,
    progress: Callable[[str], None],
) -> tuple[Follow | None, tuple[FloatArray, FloatArray]]:
    """Proposals that follow the posterior, and where walkers have come to, with ln of it there.

    Args:
        target: The posterior.
        begin: Places (walkers, n) in units of the box where walkers begin, and ln of it there.
        minima: Mixture about the minima.
        rng: Of the walks.
        progress: Is called with a line.

    Returns:
        None for the proposals where the model has no residuals at any of the places, or more of
        them, or of parameters, than a surrogate is made for.
    """
    places, many = begin[0], len(begin[0])
    known = known_at(target, places)
    if known is None:
        progress("no surrogate: no residuals where walkers begin, or too many for one")
        return None, begin
    before = 0.0
    for k in range(ROUNDS):
        surrogate = Surrogate.through(known, periods_of(target))
        _, ends = walked_on(surrogate, minima, places, rng, MADE)
        log = target.log(target.in_units(ends))
        weights = log - surrogate.log(ends - surrogate.turns(ends))
        share = _share(weights)
        progress(f"learning where it is likely, round {k + 1}: {100.0 * share:.0f} %")
        off = np.abs(weights - np.median(weights))
        if np.any(np.isfinite(log)):
            places = ends[np.isfinite(log)]
        if min(share, before) > ENOUGH:
            break
        before = share
        more = known_at(target, ends[np.argsort(-np.where(np.isfinite(log), off, -1.0))[:many]])
        known = known if more is None else known.beside(more)
    progress("proposals for the draws, from what was learnt")
    follow, _ = walked_on(Surrogate.through(known, periods_of(target)), minima, places, rng, LAST)
    likely = np.isfinite(log)
    if np.sum(likely) < many:
        return follow, begin
    return follow, (ends[likely][:many], log[likely][:many])


def fits(n: int, m: int = 0) -> bool:
    """Whether a surrogate is made: of n parameters, and m residuals where these are known.

    Args:
        n: parameters.
        m: residuals, those of priors among them.
    """
    points = max(PARTS * BENT, MOST // (n + 1))
    return n <= DIMENSIONS and 8.0 * points * m * (n + 1) <= LARGEST


def learning(walkers: int, n: int) -> int:
    """Evaluations of the posterior that `learnt` takes to make a surrogate, at most.

    Args:
        walkers: how many.
        n: parameters.
    """
    rows = walkers * (2 * n + 2)  # one for the scatter of unknown noise
    return rows + ROUNDS * (rows + max(WALKS, walkers))


def _share(log: FloatArray) -> float:
    """Of weights by their ln."""
    if not np.any(np.isfinite(log)):
        return 0.0
    weights = np.exp(log - np.max(log))
    return float(np.sum(weights) ** 2 / (weights.size * np.sum(weights**2)))


def periods_of(target: Target) -> FloatArray:
    """Periods (n,) in units of the box where this holds a whole one, else inf.

    Args:
        target: the posterior.
    """
    _, width = target.box
    parts = [(p.period or math.inf) / w for p, w in zip(target.parameters, width, strict=True)]
    return np.array([part if part * (1.0 - WHOLE) <= 1.0 else math.inf for part in parts])


def known_at(target: Target, places: FloatArray, *, any_size: bool = False) -> Places | None:
    """Residuals at places in units of the box, as far as the model has them.

    Args:
        target: the posterior.
        places: (k, n) in units of the box.
        any_size: whether they may be more than a surrogate is made of; None without, else.
    """
    _, width = target.box
    known: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    if not (any_size or fits(len(width))):
        return None
    for place in places:
        try:
            rows, slopes = target.rows(target.in_units(place))
        except NoAnswer:
            raise
        except (FmuFailure, NoScale):
            continue  # beside a place where the model has no value
        if not (any_size or fits(*slopes.shape[::-1])):
            return None
        known.append((place, rows, slopes * width))
    return Places.of(known) if known else None


def walked_on(
    surrogate: Surrogate, minima: Mixture, begin: FloatArray, rng: np.random.RandomState, made: int
) -> tuple[Follow, FloatArray]:
    """Proposals with a mixture about places of walks on a surrogate, and where these end, (k, n).

    Args:
        surrogate: what is walked on.
        minima: mixture about the minima.
        begin: where walks begin, (k, n) in units of the box.
        rng: of the walks.
        made: mixtures that are made one from another.
    """
    u, places = np.resize(begin, (max(WALKS, len(begin)), begin.shape[1])), begin
    for _ in range(made):
        follow = Follow(surrogate, _mixture(surrogate, places, minima, rng))
        passed = []
        for _ in range(EACH):
            u, _ = follow.proposed(u, rng, BETWEEN)
            passed.append(u)
        places = _chosen(follow, np.unique(np.concatenate(passed), axis=0), rng)
    follow = Follow(surrogate, _mixture(surrogate, places, minima, rng))
    return follow, u[rng.permutation(len(u))]


def _chosen(follow: Follow, places: FloatArray, rng: np.random.RandomState) -> FloatArray:
    """Some of the places: those that the mixture proposes most seldom for what they are worth."""
    folded = places - follow.surrogate.turns(places)
    seldom = follow.surrogate.log(folded) - follow.mixture.log_density(folded)
    order = np.argsort(-seldom)
    others = rng.permutation(order[PARTS // 2 :])[: PARTS - PARTS // 2]
    return np.asarray(folded[np.concatenate([order[: PARTS // 2], others])])


def _mixture(
    surrogate: Surrogate, places: FloatArray, minima: Mixture, rng: np.random.RandomState
) -> Mixture:
    """Parts about places, each as far as the sheet is straight there, and those of the minima."""
    places = places - surrogate.turns(places)
    rows, slopes = surrogate.rows(places), surrogate.slopes(places)
    centres, roots = about(places, rows, slopes, REACHES[-1])
    wanted = np.full(len(places), True)  # whose reach is not known
    for reach in REACHES:
        wide = about(places, rows, slopes, reach)
        straight = wanted & (_bend(surrogate, (places, rows, slopes), wide, rng) < STRAIGHT)
        centres[straight], roots[straight] = wide[0][straight], wide[1][straight]
        wanted &= ~straight
    parts = Mixture(centres, roots, np.full(len(places), 1.0 / len(places)))
    return parts.beside(minima, 1.0 - KEPT)


def about(
    places: FloatArray, rows: FloatArray, slopes: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """c (k, n) and R (k, n, n) of each place; see the module.

    Args:
        places: (k, n) in units of the box.
        rows: residuals there, (k, m).
        slopes: their derivatives, (k, m, n).
        reach: along the sheet, in units of the box.
    """
    k, n = places.shape
    held = np.broadcast_to(np.eye(n) / reach, (k, n, n))
    turned, roots = np.linalg.qr(np.concatenate([slopes, held], axis=1))
    right = np.concatenate([rows, np.zeros((k, n))], axis=1)
    aim = -np.einsum("kmn,km->kn", turned, right)
    return places + np.linalg.solve(roots, aim[..., None])[..., 0], roots


def _bend(
    surrogate: Surrogate,
    known: tuple[FloatArray, FloatArray, FloatArray],
    parts: tuple[FloatArray, FloatArray],
    rng: np.random.RandomState,
) -> FloatArray:
    """By how much ln s is another than from straight residuals, in the mean of draws, (k,)."""
    (places, rows, slopes), (centres, roots) = known, parts
    k, n = places.shape
    z = rng.standard_normal((k, n, BENT))
    u = (centres[..., None] + np.linalg.solve(roots, z)).transpose(0, 2, 1)
    straight = rows[:, None] + (u - places[:, None]) @ slopes.transpose(0, 2, 1)
    found = surrogate.rows(u.reshape(-1, n)).reshape(straight.shape)
    off = 0.5 * (np.sum(found**2, axis=2) - np.sum(straight**2, axis=2))
    return np.asarray(np.mean(np.abs(off), axis=1))
