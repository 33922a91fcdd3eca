"""Mixtures about places of a bent posterior, and what a mixture is worth as a proposal.

Where data leave directions open, the posterior is a thin sheet that bends through the box, and one
Gaussian about the minimum misses it. About a place p, of residuals r and derivatives A

    min_d |r + A d|^2 + |d|^2/h^2        c = p + d        R^T R = A^T A + 1/h^2

in units of the box: across the sheet as wide as the data say, along it h. A mixture is worth the
share of independent draws among its proposals

    share = (sum w)^2/(N sum w^2)        w = posterior/mixture
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitting.inference.posterior.minima import Target
from fitting.inference.posterior.start import Mixture
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer, NoScale

#: Proposals by which a mixture is judged.
TRIED = 256
#: Share of draws about the minima that a learnt mixture keeps.
KEPT = 0.1


@dataclass(frozen=True, kw_only=True)
class Places:
    """What is known: `places` (k, n) in units of the box, `rows` (k, m), `slopes` (k, m, n)."""

    places: FloatArray
    rows: FloatArray
    slopes: FloatArray


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
    logs = log(tried) - mixture.log_density(tried)
    if not np.any(np.isfinite(logs)):
        return 0.0
    weights = np.exp(logs - np.max(logs))
    return float(np.sum(weights) ** 2 / (weights.size * np.sum(weights**2)))


def known_at(target: Target, places: FloatArray) -> Places | None:
    """Residuals at places in units of the box, as far as the model has them; None of none.

    Args:
        target: the posterior.
        places: (k, n) in units of the box.
    """
    _, width = target.box
    known: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for place in places:
        try:
            rows, slopes = target.rows(target.in_units(place))
        except NoAnswer:
            raise
        except (FmuFailure, NoScale):
            continue  # beside a place where the model has no value
        known.append((place, rows, slopes * width))
    if not known:
        return None
    there, rows, slopes = (np.array(part) for part in zip(*known, strict=True))
    return Places(places=there, rows=rows, slopes=slopes)


def about(known: Places, reach: float) -> tuple[FloatArray, FloatArray]:
    """c (k, n) and R (k, n, n) of each place; see the module.

    Args:
        known: places with their residuals and derivatives.
        reach: along the sheet, in units of the box.
    """
    k, n = known.places.shape
    held = np.broadcast_to(np.eye(n) / reach, (k, n, n))
    turned, roots = np.linalg.qr(np.concatenate([known.slopes, held], axis=1))
    right = np.concatenate([known.rows, np.zeros((k, n))], axis=1)
    aim = -np.einsum("kmn,km->kn", turned, right)
    return known.places + np.linalg.solve(roots, aim[..., None])[..., 0], roots
