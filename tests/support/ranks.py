"""Simulation-based calibration: ranks of the truth among draws of its posterior.

Where truths are drawn from the prior, data from the model at the truth and draws from the posterior
of these data, the rank of the truth among L independent draws is uniform on 0 ... L.

    X^2 = sum_b (n_b - e)^2/e,  e = N/B        P = Q((B - 1)/2, X^2/2)

Source: S. Talts, M. Betancourt, D. Simpson, A. Vehtari, A. Gelman, arXiv:1804.06788 (2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.signal.student import tail
from fitting.text.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Uniformity:
    """Ranks of one value: counts in `bins`, chi square of these and its `p_value`.

    `fraction_mean` is the mean of rank/draws: 1/2 without bias; `fraction_std` their standard
    deviation: 0.289 where posteriors are as wide as they should be, less where they are too wide.
    """

    name: str
    bins: tuple[int, ...]
    chi_square: float
    p_value: float
    fraction_mean: float
    fraction_std: float


def rank_of(truth: float, draws: FloatArray) -> int:
    """How many draws are below the truth.

    Args:
        truth: In the unit of the draws.
        draws: Independent ones, (L,).
    """
    return int(np.sum(draws < truth))


def uniformity(name: str, ranks: Sequence[int], draws: int, bins: int) -> Uniformity:
    """Whether ranks are uniform on 0 ... L; see the module.

    Args:
        name: Of the value.
        ranks: One for each laboratory.
        draws: L, how many there are of each.
        bins: Into how many the ranks are counted; L + 1 should be a multiple of it.
    """
    found = np.asarray(ranks)
    counts = np.bincount(found * bins // (draws + 1), minlength=bins)
    expected = found.size / bins
    chi_square = float(np.sum((counts - expected) ** 2) / expected)
    fractions = (found + 0.5) / (draws + 1.0)
    return Uniformity(
        name=name,
        bins=tuple(map(int, counts)),
        chi_square=chi_square,
        p_value=tail(chi_square, bins - 1),
        fraction_mean=float(np.mean(fractions)),
        fraction_std=float(np.std(fractions)),
    )
