"""A chain in a file, whole after every part of it: to go on from, and for other programs."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.inference.posterior.chain import Walk
from fitting.inference.posterior.start import Mixture
from fitting.text.errors import BadInput
from fitting.text.files import NoFile, read_whole, write_whole

NAMES = ("job", "places", "log", "accepted", "counts", "bent", "centres", "roots", "weights")


@dataclass(frozen=True)
class Kept:
    """A walk, its proposals, what it cost: `evaluations`, `failed` of which had no value.

    `bent` where a mixture about the minima alone would seldom have hit the posterior.
    """

    walk: Walk
    mixture: Mixture
    bent: bool
    evaluations: int
    failed: int


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
            found = {name: file[name] for name in NAMES}
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
    return Kept(walk, mixture, bool(found["bent"]), evaluations, failed)
