"""The sampler, the one import of ``emcee``: walkers that move by each other and by a mixture.

Some steps propose a point of a mixture about the minima, or an image of the walker under a symmetry
that the model may have; the others are stretches (Goodman and Weare) and differences of walkers
(ter Braak), which need no shape to be known. Each leaves the posterior as it is: whatever mixture
and symmetries are worth, the draws are those of the posterior in the end. A chain is in a file,
whole after every part of it.

Sources: D. Foreman-Mackey, D. Hogg, D. Lang, J. Goodman, PASP 125 (2013) 306; C. ter Braak,
Statistics and Computing 16 (2006) 239.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitting.posterior.mixture import Mixture
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, MissingFile
from fitting.text.files import read_whole
from fitting.text.results_folder import write_whole

#: Shares of steps by the mixture, by images, by stretches, by differences.
MIXED, IMAGE, STRETCHED, DIFFERENCE = 0.4, 0.1, 0.25, 0.25

#: ln of the posterior of points in units of the box, (k, n) -> (k,).
LogPosterior = Callable[[FloatArray], FloatArray]
#: An image of a point, (n,) -> (n,), in the same units.
Image = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class Samples:
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

    def with_more(self, other: Samples) -> Samples:
        """Both, one after the other.

        Args:
            other: what follows.
        """
        share = self.steps * self.accepted + other.steps * other.accepted
        return Samples(
            places=np.concatenate([self.places, other.places]),
            log=np.concatenate([self.log, other.log]),
            accepted=share / (self.steps + other.steps),
        )


class SamplingInterrupted(KeyboardInterrupt):
    """Sampling that was interrupted: the steps that all walkers have taken, and how it continues.

    Args:
        samples: At least one step.
        random: State of its random numbers after them, for `sampled`.
    """

    def __init__(self, samples: Samples, random: FloatArray) -> None:
        super().__init__()
        self.samples, self.random = samples, random


def sampler_library() -> Any:
    """``emcee``.

    Raises:
        BadInput: it is not installed; states how to install it.
    """
    try:
        import emcee
    except ImportError as error:
        raise BadInput(
            f"posterior: draws are made by emcee; to have it: pip install 'fmu-fit[posterior]' "
            f"({error})"
        ) from error
    return emcee


def sampled(
    log_posterior: LogPosterior,
    mixture: Mixture,
    images: Sequence[Image],
    begin: tuple[FloatArray, FloatArray],
    steps: int,
    seed: tuple[int, ...] | FloatArray,
) -> Samples:
    """So many steps of all walkers; the same seed takes the same ones.

    Interrupted and continued from where it was, it takes the same ones, too.

    Args:
        log_posterior: -inf where a point is impossible.
        mixture: About all minima.
        images: Maps of volume one, each its own inverse but for whole periods.
        begin: Places (walkers, n) in units of the box, and ln of the posterior there (walkers,).
        steps: How many.
        seed: Of the draws: of the chain, and of this part of it; or the state of the random numbers
            of samples that were interrupted: whole numbers of 32 bits, then three more.

    Raises:
        BadInput: ``emcee`` is not installed.
        SamplingInterrupted: After a step or more; KeyboardInterrupt before.
    """
    emcee = sampler_library()
    places, log = begin
    walkers, n = places.shape

    def mixed(old: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        new = mixture.draw(len(old), rng)
        return new, mixture.log_density(old) - mixture.log_density(new)

    def imaged(old: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        which = rng.randint(len(images), size=len(old))
        new = np.array([images[k](place) for k, place in zip(which, old, strict=True)])
        return new, np.zeros(len(old))

    moves = [
        (emcee.moves.MHMove(mixed), MIXED),
        (emcee.moves.StretchMove(), STRETCHED),
        (emcee.moves.DEMove(), DIFFERENCE),
    ]
    if images:
        moves.append((emcee.moves.MHMove(imaged), IMAGE))
    sampler = emcee.EnsembleSampler(walkers, n, log_posterior, moves=moves, vectorize=True)
    # the library's wrapper prints a traceback of whatever comes out, an interrupt as well
    sampler.log_prob_fn = log_posterior
    if isinstance(seed, np.ndarray):
        key, (place, has_normal, normal) = seed[:-3].astype(np.uint32), seed[-3:].tolist()
        random: Any = ("MT19937", key, int(place), int(has_normal), normal)
    else:
        generator = np.random.MT19937(np.random.SeedSequence(seed))
        random = tuple(np.random.RandomState(generator).get_state())
    state = emcee.State(places, log_prob=log, random_state=random)
    done, interrupted = 0, False
    try:
        # the library doubts starts in a plane; those here have the width of the posterior in each
        # axis, which may be a millionth of the box
        for _ in sampler.sample(state, iterations=steps, skip_initial_state_check=True):
            random, done = sampler.random_state, done + 1
    except KeyboardInterrupt:
        if done == 0:
            raise
        interrupted = True
    samples = Samples(
        places=np.asarray(sampler.get_chain())[:done],
        log=np.asarray(sampler.get_log_prob())[:done],
        accepted=float(np.mean(sampler.acceptance_fraction)),
    )
    if interrupted:
        raise SamplingInterrupted(samples, np.array([*random[1], *random[2:]], dtype=float))
    return samples


@dataclass(frozen=True)
class Chain:
    """What a file holds: samples, proposals, and `evaluations`, of which `failed` had no value.

    Where its last part was interrupted, that ends at step `until` and continues with the state
    `random`.
    """

    samples: Samples
    mixture: Mixture
    evaluations: int
    failed: int
    until: int | None = None
    random: FloatArray | None = None


def write_chain(path: Path, job: str, chain: Chain) -> None:
    """Replace the file: arrays ``places`` in units of the box, ``log`` and what they belong to.

    Args:
        path: Of the file.
        job: Fingerprint of all that the draws depend on.
        chain: So far.

    Raises:
        BadInput: the file cannot be written.
    """
    content = io.BytesIO()
    interrupted: dict[str, FloatArray] = {}
    if chain.random is not None:
        interrupted = {"cut_steps": np.array(chain.until), "cut_random": chain.random}
    np.savez(
        content,
        allow_pickle=False,
        job=np.array(job),
        places=chain.samples.places,
        log=chain.samples.log,
        accepted=np.array(chain.samples.accepted),
        centres=chain.mixture.centres,
        roots=chain.mixture.roots,
        weights=chain.mixture.weights,
        counts=np.array([chain.evaluations, chain.failed]),
        **interrupted,
    )
    write_whole(path, content.getvalue())


def read_chain(path: Path, job: str) -> Chain | None:
    """The chain of an earlier run of the same job; None where there is no file.

    Args:
        path: Of the file.
        job: Fingerprint of all that the draws depend on.

    Raises:
        BadInput: it is no chain, or that of another job.
    """
    try:
        content = read_whole(path, "a chain")
    except MissingFile:
        return None
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            a = {name: file[name] for name in file}
        chain = Chain(
            Samples(places=a["places"], log=a["log"], accepted=float(a["accepted"])),
            Mixture(a["centres"], a["roots"], a["weights"]),
            evaluations=int(a["counts"][0]),
            failed=int(a["counts"][1]),
            until=int(a["cut_steps"]) if "cut_steps" in a else None,
            random=a.get("cut_random"),
        )
        owner = str(a["job"])
    except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
        raise BadInput(f"{path}: is no chain of draws that can be gone on from") from error
    if owner != job:
        raise BadInput(
            f"{path}: belongs to other data, another FMU, fit, version or settings; wanted the "
            "same as now (leave out --resume to start afresh)"
        )
    return chain
