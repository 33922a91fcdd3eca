"""A mixture that follows a bent posterior: about places of a first walk.

Where data leave directions open, the posterior is a thin sheet that bends through the box, and one
Gaussian about the minimum misses it. About a place p of a first walk, residuals r and derivatives A

    min_d |r + A d|^2 + |d|^2/s^2        c = p + d        R^T R = A^T A + 1/s^2

in units of the box: across the sheet as wide as the data say, along it s, as far as it is straight.
s is the one whose mixture needs the fewest proposals for a draw, by the weights p/q of some:

    share = (sum w)^2/(N sum w^2)        w = posterior/q

Nothing that is learnt changes what is drawn from: the first walk is left out, and the mixture is
not changed after it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from fitting.inference.posterior.minima import Target
from fitting.inference.posterior.start import Mixture
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer, NoScale

#: How far a place reaches along the sheet, in units of the box: what is tried.
REACHES = (0.3, 0.1, 0.03, 0.01)
#: Proposals by which a mixture is judged.
TRIED = 256
#: Share of draws about the minima that a learnt mixture keeps.
KEPT = 0.1


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
    found = log(tried) - mixture.log_density(tried)
    if not np.any(np.isfinite(found)):
        return 0.0
    weights = np.exp(found - np.max(found))
    return float(np.sum(weights) ** 2 / (TRIED * np.sum(weights**2)))


def learnt(
    target: Target,
    places: Iterable[FloatArray],
    minima: Mixture,
    log: Callable[[FloatArray], FloatArray],
    rng: np.random.RandomState,
) -> Mixture:
    """The best mixture about places of a walk, with that of the minima as a part.

    Args:
        target: The posterior.
        places: (n,) each, in units of the box.
        minima: Their mixture.
        log: ln of the posterior of points in units of the box.
        rng: Of proposals that are tried.
    """
    _, width = target.box
    known = []
    for place in places:
        try:
            rows, slopes = target.rows(target.in_units(place))
        except NoAnswer:
            raise
        except (FmuFailure, NoScale):
            continue  # beside a place where the model has no value
        known.append((place, rows, slopes * width))
    if not known:
        return minima
    made = [_about(known, reach).beside(minima, 1.0 - KEPT) for reach in REACHES]
    return max([minima, *made], key=lambda one: worth(one, log, rng))


def _about(known: list[tuple[FloatArray, FloatArray, FloatArray]], reach: float) -> Mixture:
    n = known[0][0].size
    held = np.eye(n) / reach
    centres, roots = [], []
    for place, rows, slopes in known:
        turned, root = np.linalg.qr(np.vstack([slopes, held]))
        step = -np.linalg.solve(root, turned.T @ np.concatenate([rows, np.zeros(n)]))
        centres.append(place + step)
        roots.append(root)
    return Mixture(np.array(centres), np.array(roots), np.full(len(known), 1.0 / len(known)))
