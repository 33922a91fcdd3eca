"""Whether a fit is of the data that a campaign holds now: by the SHA-256 of every file it read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.campaign import BoundCampaign
from fitting.result.provenance import sha256_of
from fitting.result.result import Result
from fitting.text.errors import BadInput

#: What goes on all the same, as a command has it.
ANYWAY = "--changed-data to go on"
#: Digits of a SHA-256 that are shown.
SHOWN = 12


def require_same_data(
    result: Result, campaigns: Sequence[BoundCampaign], *, whole: bool = False
) -> None:
    """Refuse a fit that read other data than the campaigns hold: what it knows is not of theirs.

    A file is the same wherever it lies, and campaign files themselves may change: only what was
    measured counts. A result of arrays, or `of_any_data`, names no files: it is compared with none.

    Args:
        result: of a fit.
        campaigns: as they are now.
        whole: whether the campaigns have to hold every file that the fit read, too.

    Raises:
        BadInput: one line for each file that is another one, was not read by the fit, or is gone.
    """
    known = result.provenance.files
    if not known or not campaigns:
        return
    complaints = list(_changed(known, campaigns))
    if whole and not complaints:
        complaints = list(_left_out(known, campaigns))
    if complaints:
        raise BadInput(*complaints)


def of_any_data(result: Result) -> Result:
    """The result without the names of the files that its fit read.

    Args:
        result: of a fit.
    """
    return replace(result, provenance=replace(result.provenance, files={}))


def _changed(known: Mapping[str, str], campaigns: Sequence[BoundCampaign]) -> Iterator[str]:
    """Of files that the campaigns hold."""
    digests = set(known.values())
    for path, name in _data_files(campaigns):
        result = sha256_of(path)
        if result not in digests and name in known:
            yield (
                f"{path}: changed since the fit: found SHA-256 {result[:SHOWN]}, required "
                f"{known[name][:SHOWN]}; fit again, or {ANYWAY}"
            )
        elif result not in digests:
            yield f"{path}: is not among the files of the fit; fit again, or {ANYWAY}"


def _left_out(known: Mapping[str, str], campaigns: Sequence[BoundCampaign]) -> Iterator[str]:
    """Of files that the fit read and the campaigns do not hold."""
    kept = {sha256_of(path) for path, _ in _data_files(campaigns)}
    for name, digest in known.items():
        if digest not in kept and not name.endswith(".toml"):
            yield (
                f"{name}: the fit read it, and {campaigns[0].path} does not; fit again, or {ANYWAY}"
            )


def _data_files(campaigns: Sequence[BoundCampaign]) -> list[tuple[Path, str]]:
    """What was measured, each file once, with its path as seen from the first campaign's folder."""
    folder = campaigns[0].path.parent
    paths = dict.fromkeys(p for bound in campaigns for p in bound.files if p != bound.path)
    return [(path, Path(os.path.relpath(path, folder)).as_posix()) for path in paths]
