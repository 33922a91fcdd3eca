"""A mixture that follows a bent posterior: about places of a first walk.

Where data leave directions open, the posterior is a thin sheet that bends through the box, and one
Gaussian about the minimum misses it. About a place p, of residuals r and derivatives A

    min_d |r + A d|^2 + |d|^2/h^2        c = p + d        R^T R = A^T A + 1/h^2

in units of the box: across the sheet as wide as the data allow, along it h. All places have the
same h: that whose mixture needs the fewest proposals for a draw (`mixture.worth`). The first walk
is left out of the draws, and the mixture is not changed after it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fitting.posterior.chain import Walk
from fitting.posterior.minima import Target
from fitting.posterior.mixture import TRIED, Mixture, worth
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer, NoScale

#: First walks from which is learnt; places of every walker, and steps between them.
LEARNING, PLACES, EVERY = 2, 8, 12
#: How far a place reaches along the sheet, in units of the box: what is tried.
REACHES = (0.3, 0.1, 0.03, 0.01)
#: Share of draws about the minima that a learnt mixture keeps.
KEPT = 0.1


def about_walk(
    target: Target,
    walk: Walk,
    minima: Mixture,
    log: Callable[[FloatArray], FloatArray],
    rng: np.random.RandomState,
) -> Mixture:
    """The best mixture about late places of a walk, with that of the minima as a part.

    Args:
        target: the posterior.
        walk: that is left out of the draws.
        minima: their mixture.
        log: ln of the posterior of points in units of the box.
        rng: of proposals that are tried.
    """
    late = walk.places[-1 : walk.steps // 2 : -EVERY][:PLACES]
    _, width = target.box
    known: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for place in late.reshape(-1, late.shape[-1]):
        try:
            rows, slopes = target.rows(target.in_units(place))
        except NoAnswer:
            raise
        except (FmuFailure, NoScale):
            continue  # next to a place where the model has no value
        known.append((place, rows, slopes * width))
    if not known:
        return minima
    places, residuals, derivatives = (np.array(part) for part in zip(*known, strict=True))
    k, n = places.shape
    right = np.concatenate([residuals, np.zeros((k, n))], axis=1)
    mixtures = [minima]
    for reach in REACHES:
        regular = np.broadcast_to(np.eye(n) / reach, (k, n, n))
        q, roots = np.linalg.qr(np.concatenate([derivatives, regular], axis=1))
        steps = np.linalg.solve(roots, -np.einsum("kmn,km->kn", q, right)[..., None])[..., 0]
        here = Mixture(places + steps, roots, np.full(k, 1.0 / k))
        mixtures.append(here.beside(minima, 1.0 - KEPT))
    return max(mixtures, key=lambda mixture: worth(mixture, log, rng))


def evaluations(walkers: int, n: int, steps: int) -> int:
    """Evaluations of the posterior that first walks and what is learnt of them take, at most.

    Args:
        walkers: how many.
        n: parameters.
        steps: of a first walk.
    """
    # one more of each place for the scatter of unknown noise
    each = walkers * steps + walkers * PLACES * (2 * n + 2) + (1 + len(REACHES)) * TRIED
    return LEARNING * each
