"""Whether a chain has enough draws: its correlation with itself, and whether its walkers agree.

    tau = 1 + 2 sum_(t=1)^M rho(t),  M the least with M >= 5 tau(M)

    R = sqrt((B/W + N - 1)/N)        B = N var(means of half walkers), W = mean(their variances)

rho is the mean autocorrelation of all walkers about their common mean: walkers that stay where they
began have a long one. R is taken of normal scores of the ranks, z = Phi^-1((r - 3/8)/(S + 1/4)),
and of those of the distances from the median; the larger counts.

Sources: A. Sokal, "Monte Carlo Methods in Statistical Mechanics" (1989), section 3; A. Vehtari, A.
Gelman, D. Simpson, B. Carpenter, P. Bürkner, Bayesian Analysis 16 (2021) 667.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtri

from fitting.text.arrays import FloatArray

#: A window of so many correlation times, beyond which there is noise alone.
WINDOW = 5.0


def autocorrelation_time(chain: FloatArray) -> float:
    """Integrated autocorrelation time tau of one quantity in steps, at least 1; see the module.

    Args:
        chain: Values, shape (steps, walkers).
    """
    steps = chain.shape[0]
    centred = chain - np.mean(chain)
    size = 2 ** math.ceil(math.log2(2 * steps))
    spectrum = np.abs(np.fft.rfft(centred, size, axis=0)) ** 2
    found = np.mean(np.fft.irfft(spectrum, size, axis=0)[:steps], axis=1)
    if not found[0] > 0.0:
        return math.inf  # nothing moved: nothing is known
    times = 2.0 * np.cumsum(found / found[0]) - 1.0
    enough = np.arange(steps) >= WINDOW * times
    return max(1.0, float(times[np.argmax(enough)] if np.any(enough) else np.max(times)))


def split_rhat(chain: FloatArray) -> float:
    """Rank-normalised split R of one quantity: 1 where walkers agree; see the module.

    Args:
        chain: Values, shape (steps, walkers), 4 steps at least.
    """
    half = chain.shape[0] // 2
    halves = np.hstack([chain[:half], chain[-half:]])
    folded = np.abs(halves - np.median(halves))
    return max(_rhat(_scores(halves)), _rhat(_scores(folded)))


def _scores(chains: FloatArray) -> FloatArray:
    """Normal scores of the ranks, equal values sharing theirs."""
    _, place, counts = np.unique(chains, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    ranks = (ends - 0.5 * (counts - 1))[place].reshape(chains.shape)
    return np.asarray(ndtri((ranks - 0.375) / (chains.size + 0.25)))


def _rhat(chains: FloatArray) -> float:
    steps = chains.shape[0]
    between = steps * float(np.var(np.mean(chains, axis=0), ddof=1))
    within = float(np.mean(np.var(chains, axis=0, ddof=1)))
    if within == 0.0:
        return math.inf
    return math.sqrt((between / within + steps - 1.0) / steps)
