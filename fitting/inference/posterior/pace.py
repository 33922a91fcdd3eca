"""How long a surrogate takes, beside the model: timed on one of the same size.

Residuals of it are straight, r(u) = r(c) + A (u - c) about the best minimum c: how long a walk
takes depends on the sizes alone.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from fitting.inference.posterior.chain import FOLLOWED
from fitting.inference.posterior.follow import WALKED
from fitting.inference.posterior.learnt import (
    LAST,
    MADE,
    ROUNDS,
    fits,
    periods_of,
    walked_on,
)
from fitting.inference.posterior.minima import Target
from fitting.inference.posterior.start import Mixture
from fitting.inference.posterior.surrogate import MOST, Places, Surrogate
from fitting.text.arrays import FloatArray

#: Steps of a walk that are timed.
TIMED = 10


@dataclass(frozen=True)
class Pace:
    """Seconds of a surrogate without runs of the model: `learning_s` at most, `step_s` of a step.

    A step is one of all walkers, in the mean of those that follow the surrogate and the others.
    """

    learning_s: float
    step_s: float


def pace_of(target: Target, minima: Mixture, walkers: int) -> Pace:
    """Seconds that a surrogate takes; 0 where the posterior is too large for one.

    Args:
        target: The posterior.
        minima: Mixture about the minima, the most likely first.
        walkers: How many.

    Raises:
        FmuFailure: the FMU failed at the most likely minimum.
    """
    n = minima.centres.shape[1]
    if not fits(n):
        return Pace(0.0, 0.0)
    rng = np.random.RandomState(1)
    known = _stand_in(target, minima.centres[0], walkers * (1 + ROUNDS), rng)
    if not fits(n, known.rows.shape[1]):
        return Pace(0.0, 0.0)
    begin, times = minima.spread(walkers, rng), [time.perf_counter()]
    surrogate = Surrogate.through(known, periods_of(target))
    times.append(time.perf_counter())
    follow, _ = walked_on(surrogate, minima, begin, rng, 1)
    times.append(time.perf_counter())
    follow.proposed(begin, rng, TIMED)
    times.append(time.perf_counter())
    through, walk, some = np.diff(times)
    return Pace(
        learning_s=float((ROUNDS + 1) * through + (ROUNDS * MADE + LAST) * walk),
        step_s=float(FOLLOWED * WALKED / TIMED * some),
    )


def _stand_in(
    target: Target, centre: FloatArray, places: int, rng: np.random.RandomState
) -> Places:
    """So many places, as far as a surrogate takes them, with straight residuals."""
    n = centre.size
    _, width = target.box
    rows, slopes = target.rows(target.in_units(centre))
    u = rng.random_sample((min(places, MOST // (n + 1)), n))
    turned = slopes * width
    return Places(
        places=u,
        rows=rows + (u - centre) @ turned.T,
        slopes=np.repeat(turned[None], len(u), axis=0),
    )
