"""A chain in a file, whole after every part of it: to go on from, and for other programs."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.inference.posterior.chain import Walk
from fitting.inference.posterior.start import Mixture
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.files import NoFile, read_whole, write_whole

#: Where a part of the chain was interrupted, else not there.
CUT = ("cut_steps", "cut_random")
NAMES = ("job", "places", "log", "accepted", "counts", "bent", "centres", "roots", "weights")


@dataclass(frozen=True)
class Cut:
    """A part of a chain that was interrupted: `steps` of the chain at its end, `random` numbers."""

    steps: int
    random: FloatArray


@dataclass(frozen=True)
class Kept:
    """A walk, its proposals, what it cost: `evaluations`, `failed` of which had no value.

    `bent` where a mixture about the minima alone would seldom have hit the posterior; `cut` where
    its last part was interrupted.
    """

    walk: Walk
    mixture: Mixture
    bent: bool
    evaluations: int
    failed: int
    cut: Cut | None = None


def keep(path: Path, job: str, kept: Kept) -> None:
    """Replace the file: arrays ``places`` in units of the box, ``log`` and what they belong to.

    Args:
        path: Of the file.
        job: Fingerprint of all that the draws depend on.
        kept: The walk so far.

    Raises:
        BadInput: the file cannot be written.
    """
    content = io.BytesIO()
    cut = kept.cut
    begun = {} if cut is None else dict(zip(CUT, (np.array(cut.steps), cut.random), strict=True))
    np.savez(
        content,
        allow_pickle=False,
        job=np.array(job),
        places=kept.walk.places,
        log=kept.walk.log,
        accepted=np.array(kept.walk.accepted),
        centres=kept.mixture.centres,
        roots=kept.mixture.roots,
        weights=kept.mixture.weights,
        counts=np.array([kept.evaluations, kept.failed]),
        bent=np.array(kept.bent),
        **begun,
    )
    write_whole(path, content.getvalue())


def kept_in(path: Path, job: str) -> Kept | None:
    """What an earlier run of the same job left; None where it left no file.

    Args:
        path: Of the file.
        job: Fingerprint of all that the draws depend on.

    Raises:
        BadInput: it is no chain, or that of another job.
    """
    try:
        content = read_whole(path, "a chain")
    except NoFile:
        return None
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            found = {name: file[name] for name in (*NAMES, *(n for n in CUT if n in file))}
    except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
        raise BadInput(f"{path}: is no chain of draws that can be gone on from") from error
    if str(found["job"]) != job:
        raise BadInput(
            f"{path}: belongs to other data, another FMU, fit, version or settings; wanted the "
            "same as now (leave out --resume to start afresh)"
        )
    walk = Walk(places=found["places"], log=found["log"], accepted=float(found["accepted"]))
    evaluations, failed = map(int, found["counts"])
    mixture = Mixture(found["centres"], found["roots"], found["weights"])
    cut = Cut(int(found[CUT[0]]), found[CUT[1]]) if all(name in found for name in CUT) else None
    return Kept(walk, mixture, bool(found["bent"]), evaluations, failed, cut)
