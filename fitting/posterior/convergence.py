"""Whether a chain has enough draws: its correlation with itself, its walkers, values it misses.

    tau = 1 + 2 sum_(t=1)^M rho(t),  M the least with M >= 5 tau(M)

    R = sqrt((B/W + N - 1)/N)        B = N var(means of half walkers), W = mean(their variances)

rho is the mean autocorrelation of all walkers about their common mean: walkers that stay where they
began have a long one. R is taken of normal scores of the ranks, z = Phi^-1((r - 3/8)/(S + 1/4)),
and of those of the distances from the median; the larger counts.

Walkers agree as well where all of them miss the same part of a posterior. What is known apart from
them shows it: a value v of a parameter is accepted where the fit's own profile has

    Dchi^2(v) k^2 <= 3.84        k the factor by which the fit widened the noise; draws do not

and at every other minimum that fits as well. A chain is near it where a draw is closer than a tenth
of the width of the profile's interval.

Sources: A. Sokal, "Monte Carlo Methods in Statistical Mechanics" (1989), section 3; A. Vehtari, A.
Gelman, D. Simpson, B. Carpenter, P. Bürkner, Bayesian Analysis 16 (2021) 667.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtri

from fitting.extension.problem import Parameter, Values
from fitting.posterior.minima import Target
from fitting.posterior.periods import value_in_period
from fitting.text.arrays import FloatArray
from fitting.text.estimate import ROOT_95
from fitting.text.finding import Finding, Kind

#: A window of so many correlation times, beyond which there is noise alone.
WINDOW = 5.0
#: Share of the profile's interval within which a draw has to be.
NEAR = 0.1

#: Values of a parameter that a fit accepts, in its unit, and the width of its interval.
Accepted = tuple[Sequence[float], float]


def autocorrelation_time(chain: FloatArray) -> float:
    """Integrated autocorrelation time tau of one quantity in steps, at least 1; see the module.

    Args:
        chain: Values, shape (steps, walkers).
    """
    steps = chain.shape[0]
    centred = chain - np.mean(chain)
    size = 2 ** math.ceil(math.log2(2 * steps))
    spectrum = np.abs(np.fft.rfft(centred, size, axis=0)) ** 2
    correlation = np.mean(np.fft.irfft(spectrum, size, axis=0)[:steps], axis=1)
    if not correlation[0] > 0.0:
        return math.inf  # nothing moved: nothing is known
    times = 2.0 * np.cumsum(correlation / correlation[0]) - 1.0
    enough = np.arange(steps) >= WINDOW * times
    return max(1.0, float(times[np.argmax(enough)] if np.any(enough) else np.max(times)))


def split_rhat(chain: FloatArray) -> float:
    """Rank-normalised split R of one quantity: 1 where walkers agree; see the module.

    Args:
        chain: Values, shape (steps, walkers), 4 steps at least.
    """
    half = chain.shape[0] // 2
    halves = np.hstack([chain[:half], chain[-half:]])
    return max(_rhat(halves), _rhat(np.abs(halves - np.median(halves))))


def _rhat(chains: FloatArray) -> float:
    """R of the normal scores of the ranks; equal values share theirs."""
    _, place, counts = np.unique(chains, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - 0.5 * (counts - 1))[place].reshape(chains.shape)
    scores = ndtri((ranks - 0.375) / (chains.size + 0.25))
    steps = chains.shape[0]
    between = steps * float(np.var(np.mean(scores, axis=0), ddof=1))
    within = float(np.mean(np.var(scores, axis=0, ddof=1)))
    return math.sqrt((between / within + steps - 1.0) / steps) if within else math.inf


def accepted_by(fit: Values, parameters: Sequence[Parameter]) -> dict[str, Accepted]:
    """Values that a fit accepts, by name of the parameter, with the width of its interval.

    Args:
        fit: with its profiles; without them nothing is known.
        parameters: that are drawn.
    """
    knowledge = fit.knowledge
    if knowledge is None:
        return {}
    names = {p.name for p in parameters}
    others = [e.parameters for e in knowledge.equivalents if not e.where]
    accepted: dict[str, Accepted] = {}
    for name, scan in knowledge.scans.items():
        if name not in fit.parameters or name not in names:
            continue
        values = [place[name] for place in others if name in place]
        values += [
            value
            for value, delta in zip(scan.values, scan.delta_chi2, strict=True)
            if delta * knowledge.inflation**2 <= ROOT_95**2
        ]
        low, high = fit.parameters[name].ci95
        if high > low and math.isfinite(high - low):
            accepted[name] = (values, high - low)
    return accepted


def missed_by(
    target: Target, begins: FloatArray, draws: FloatArray, accepted: Mapping[str, Accepted]
) -> Finding | None:
    """The accepted ``value`` that is the farthest from its ``nearest`` draw; None: all are near.

    Args:
        target: the posterior.
        begins: where the period of each parameter that has one begins, (n,), NaN of others.
        draws: (steps, walkers, n) in the parameters' units.
        accepted: by name of the parameter.
    """
    worst, missed = NEAR, None
    for i, (p, begin) in enumerate(zip(target.parameters, begins.tolist(), strict=True)):
        if p.name not in accepted:
            continue
        values, width = accepted[p.name]
        if p.period is not None:
            # of a box that holds no whole period those that a turn leads to
            values = [v for v in values if p.lower + (v - p.lower) % p.period <= p.upper]
            values = [value_in_period(p, begin, v) for v in values]
            width = min(width, p.period)
        ordered = np.sort(draws[..., i], axis=None)
        for value in values:
            k = int(np.searchsorted(ordered, value))
            # the last one is next to the first, on a circle
            neighbours = ordered[[k - 1, k % ordered.size]]
            apart = neighbours - value
            if p.period is not None:
                apart = apart - p.period * np.round(apart / p.period)
            nearest = int(np.argmin(np.abs(apart)))
            off = abs(float(apart[nearest])) / width
            if off > worst:
                worst = off
                missed = Finding(
                    kind=Kind.posterior_incomplete,
                    severity="error",
                    subject=p.name,
                    numbers={"value": value, "nearest": float(neighbours[nearest])},
                )
    return missed
