"""The sampler, the one door to ``emcee``: walkers that move by each other and by a mixture.

Half of the steps propose a point of a mixture that does not change; the others are stretches
(Goodman and Weare) and differences of walkers (ter Braak), which need no shape to be known. Each
leaves the posterior as it is: whatever the mixture is worth, the draws are those of the posterior
in the end.

Sources: D. Foreman-Mackey, D. Hogg, D. Lang, J. Goodman, PASP 125 (2013) 306; C. ter Braak,
Statistics and Computing 16 (2006) 239.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.inference.posterior.start import Mixture
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Shares of steps by the mixture, by stretches, by differences.
MIXED, STRETCHED, DIFFERENCE = 0.5, 0.25, 0.25

#: ln of the posterior of points in units of the box, (k, n) -> (k,).
LogPosterior = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class Walk:
    """Steps of all walkers: `places` (steps, walkers, n) in units of the box.

    `log` (steps, walkers) is ln of the posterior there, `accepted` the share of proposals that were
    taken.
    """

    places: FloatArray
    log: FloatArray
    accepted: float

    @property
    def steps(self) -> int:
        """How many steps."""
        return int(self.places.shape[0])

    def with_more(self, other: Walk) -> Walk:
        """Both, one after the other.

        Args:
            other: what follows.
        """
        share = self.steps * self.accepted + other.steps * other.accepted
        return Walk(
            places=np.concatenate([self.places, other.places]),
            log=np.concatenate([self.log, other.log]),
            accepted=share / (self.steps + other.steps),
        )


class WalkInterrupted(KeyboardInterrupt):
    """A walk that was asked to end: the steps that all walkers have taken, and how it goes on.

    Args:
        walk: At least one step.
        random: State of its random numbers after them, for `walked`.
    """

    def __init__(self, walk: Walk, random: FloatArray) -> None:
        super().__init__()
        self.walk, self.random = walk, random


def sampler_library() -> Any:
    """``emcee``.

    Raises:
        BadInput: it is not installed; says how it is.
    """
    try:
        import emcee
    except ImportError as error:
        raise BadInput(
            f"posterior: draws are made by emcee; to have it: pip install 'fmu-fit[posterior]' "
            f"({error})"
        ) from error
    return emcee


def walked(
    log_posterior: LogPosterior,
    mixture: Mixture,
    begin: tuple[FloatArray, FloatArray],
    steps: int,
    seed: tuple[int, ...] | FloatArray,
) -> Walk:
    """So many steps of all walkers; the same seed takes the same ones.

    Interrupted and gone on with from where it was, it takes the same ones, too.

    Args:
        log_posterior: -inf where a point is impossible.
        mixture: Of all minima, or learnt.
        begin: Places (walkers, n) in units of the box, and ln of the posterior there (walkers,).
        steps: How many.
        seed: Of the draws: of the chain, and of this part of it; or the state of the random numbers
            of a walk that was interrupted.

    Raises:
        BadInput: ``emcee`` is not installed.
        WalkInterrupted: Asked to end, after a step or more; KeyboardInterrupt before.
    """
    emcee = sampler_library()
    places, log = begin
    walkers, n = places.shape

    def mixed(old: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        new = mixture.draw(len(old), rng)
        return new, mixture.log_density(old) - mixture.log_density(new)

    moves = [
        (emcee.moves.MHMove(mixed), MIXED),
        (emcee.moves.StretchMove(), STRETCHED),
        (emcee.moves.DEMove(), DIFFERENCE),
    ]
    sampler = emcee.EnsembleSampler(walkers, n, log_posterior, moves=moves, vectorize=True)
    # the library's wrapper prints a traceback of whatever comes out, an interrupt as well
    sampler.log_prob_fn = log_posterior
    state = emcee.State(places, log_prob=log, random_state=_random_state(seed))
    done, random = 0, np.empty(0)
    try:
        # the library doubts starts in a plane; those here have the width of the posterior in each
        # axis, which may be a millionth of the box
        for _ in sampler.sample(state, iterations=steps, skip_initial_state_check=True):
            random, done = _as_numbers(sampler.random_state), done + 1
    except KeyboardInterrupt:
        if done == 0:
            raise
        raise WalkInterrupted(_walk_of(sampler, done), random) from None
    return _walk_of(sampler, done)


def _walk_of(sampler: Any, steps: int) -> Walk:
    """The steps that all walkers have taken."""
    return Walk(
        places=np.asarray(sampler.get_chain())[:steps],
        log=np.asarray(sampler.get_log_prob())[:steps],
        accepted=float(np.mean(sampler.acceptance_fraction)),
    )


def _random_state(seed: tuple[int, ...] | FloatArray) -> tuple[Any, ...]:
    """State of random numbers that begin with a seed, or go on."""
    if isinstance(seed, np.ndarray):
        key, (place, has_normal, normal) = seed[:-3].astype(np.uint32), seed[-3:].tolist()
        return ("MT19937", key, int(place), int(has_normal), normal)
    state = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(seed))).get_state()
    return tuple(state)


def _as_numbers(state: tuple[Any, ...]) -> FloatArray:
    """The same state as an array, exactly: whole numbers of 32 bits and one normal number."""
    return np.array([*state[1], *state[2:]], dtype=float)
