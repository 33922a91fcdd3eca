"""A chain in a file, whole after every part of it: to go on from, and for other programs."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.inference.posterior.chain import Walk
from fitting.inference.posterior.follow import Follow
from fitting.inference.posterior.start import Mixture
from fitting.inference.posterior.surrogate import Places, Surrogate
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.files import NoFile, read_whole, write_whole

NAMES = ("job", "places", "log", "accepted", "counts", "centres", "roots", "weights")
#: Of a surrogate; none of them where there is none.
FOLLOWED = ("known_places", "known_rows", "known_slopes", "periods", "length")


@dataclass(frozen=True)
class Kept:
    """A walk, its proposals, what it cost: `evaluations`, `failed` of which had no value."""

    walk: Walk
    mixture: Mixture
    follow: Follow | None
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
    arrays = _followed(kept.follow)
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
        **arrays,
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
            found |= {name: file[name] for name in FOLLOWED if name in file.files}
            follow = _follow(found)
    except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
        raise BadInput(f"{path}: is no chain of draws that can be gone on from") from error
    if str(found["job"]) != job:
        raise BadInput(
            f"{path}: belongs to other data, another FMU, fit, version or settings; wanted the "
            "same as now (leave out --resume to start afresh)"
        )
    walk = Walk(places=found["places"], log=found["log"], accepted=float(found["accepted"]))
    evaluations, failed = map(int, found["counts"])
    return Kept(walk, _mixture(found), follow, evaluations, failed)


def _mixture(found: Mapping[str, FloatArray]) -> Mixture:
    return Mixture(found["centres"], found["roots"], found["weights"])


def _followed(follow: Follow | None) -> dict[str, FloatArray]:
    """Arrays of a surrogate; its mixture is that of the walk."""
    if follow is None:
        return {}
    known, surrogate = follow.surrogate.known, follow.surrogate
    arrays = (known.places, known.rows, known.slopes, surrogate.periods, surrogate.length)
    return {name: np.array(array) for name, array in zip(FOLLOWED, arrays, strict=True)}


def _follow(found: Mapping[str, FloatArray]) -> Follow | None:
    if FOLLOWED[0] not in found:
        return None
    places, rows, slopes, periods, length = (found[name] for name in FOLLOWED)
    known = Places(places=places, rows=rows, slopes=slopes)
    return Follow(Surrogate(known=known, periods=periods, length=float(length)), _mixture(found))
