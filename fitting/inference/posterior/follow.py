"""Proposals that follow a surrogate: a walk on it, whose end the posterior takes or leaves.

    u -> v by steps of Metropolis and Hastings that leave s as it is, each reversible
    v is taken with min(1, p(v) s(u)/(p(u) s(v)))

whatever s is worth, this leaves p as it is; where s is p but for a factor, every v is taken. The
steps are those of a mixture that does not change: half of them to a draw of it, q(v), from anywhere
to anywhere; half about u, as its part there is wide,

    q(v|u) = sum_k P(k|u) N(v; u, (R_k^T R_k)^-1 h^2)        P(k|u) = w_k t_5(u; c_k, R_k)/q(u)

Source: J. A. Christen, C. Fox, Journal of Computational and Graphical Statistics 14 (2005) 795.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.inference.posterior.start import Mixture, log_sum
from fitting.inference.posterior.surrogate import Surrogate
from fitting.text.arrays import BoolArray, FloatArray, IntArray

#: Steps on the surrogate of each proposal.
WALKED = 250
#: Share of them that are drawn from the mixture, whatever the place.
ANYWHERE = 0.5
#: Width of a step about a place, in those of the mixture there: 2.4/sqrt(n) of a Gaussian.
NEAR = 2.4


@dataclass(frozen=True)
class Follow:
    """Proposals of a walk on a surrogate, with steps of a mixture."""

    surrogate: Surrogate
    mixture: Mixture

    def proposed(
        self, old: FloatArray, rng: np.random.RandomState, steps: int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Where walks end, (k, n), and ln s(u)/s(v), (k,), as `emcee` wants it of a proposal.

        Args:
            old: where they begin, (k, n), in units of the box.
            rng: of the steps.
            steps: of each walk; None: `WALKED`.
        """
        turns = self.surrogate.turns(old)
        u = old - turns
        begun = self.surrogate.log(u)
        log, parts = begun.copy(), self.mixture.log_parts(u)
        for _ in range(steps or WALKED):
            anywhere = rng.random_sample(len(u)) < ANYWHERE
            v, there, ratio = self._step(u, parts, anywhere, rng)
            new = self.surrogate.log(v)
            taken = np.log(rng.random_sample(len(u))) < new - log + ratio
            u[taken], log[taken], parts[:, taken] = v[taken], new[taken], there[:, taken]
        return u + turns, begun - log

    def _step(
        self, u: FloatArray, parts: FloatArray, anywhere: BoolArray, rng: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """v, the mixture's parts there, and ln q(u|v)/q(v|u)."""
        width = NEAR / np.sqrt(u.shape[1])
        whose = _chosen(parts, rng)
        v = self.mixture.draw(len(u), rng)
        beside = u + width * self.mixture.steps(whose, rng)
        v[~anywhere] = beside[~anywhere]
        there = self.mixture.log_parts(v)
        shift = self.mixture.log_steps((v - u) / width)
        ratio = np.where(
            anywhere,
            log_sum(parts) - log_sum(there),
            _about(there, shift) - _about(parts, shift),
        )
        return v, there, ratio


def _about(parts: FloatArray, shift: FloatArray) -> FloatArray:
    """ln of a step's density about a place: the parts there choose its width."""
    return np.asarray(log_sum(parts + shift) - log_sum(parts))


def _chosen(parts: FloatArray, rng: np.random.RandomState) -> IntArray:
    """The number of a part for each place, by their shares there, (k,)."""
    sums = np.cumsum(np.exp(parts - np.max(parts, axis=0)), axis=0)
    return np.asarray(np.sum(sums < sums[-1] * rng.random_sample(parts.shape[1]), axis=0))
