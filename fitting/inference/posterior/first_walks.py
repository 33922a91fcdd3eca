"""A mixture that follows a bent posterior: about places of a first walk.

Residuals and derivatives at places of a first walk make parts of a mixture (`learnt.about`), all of
one reach: that whose mixture needs the fewest proposals for a draw (`learnt.worth`). The first walk
is left out of the draws, and the mixture is not changed after it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fitting.inference.posterior.chain import Walk
from fitting.inference.posterior.learnt import KEPT, TRIED, Places, about, known_at, worth
from fitting.inference.posterior.minima import Target
from fitting.inference.posterior.start import Mixture
from fitting.text.arrays import FloatArray

#: First walks from which is learnt; places of every walker, and steps between them.
LEARNING, PLACES, EVERY = 2, 8, 12
#: How far a place reaches along the sheet, in units of the box: what is tried.
REACHES = (0.3, 0.1, 0.03, 0.01)


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
    known = known_at(target, late.reshape(-1, late.shape[-1]))
    if known is None:
        return minima
    made = [_of_reach(known, reach).beside(minima, 1.0 - KEPT) for reach in REACHES]
    return max([minima, *made], key=lambda one: worth(one, log, rng))


def _of_reach(known: Places, reach: float) -> Mixture:
    centres, roots = about(known, reach)
    return Mixture(centres, roots, np.full(len(centres), 1.0 / len(centres)))


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
