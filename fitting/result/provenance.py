"""Where a result comes from: FMU, files, versions, settings; whether files have changed since."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import fitting
from fitting.campaign import BoundCampaign
from fitting.fit.options import Options
from fitting.fit.problem import Problem
from fitting.fmu.description import FmuDescription
from fitting.result.result import Provenance, Result
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.files import read_whole
from fitting.text.records import to_plain

#: What goes on with other data, as a command has it.
ANYWAY = "--changed-data to go on"
#: Digits of a SHA-256 that are shown.
SHOWN = 12


def job_of(problem: Problem, sha256: str, options: Options) -> str:
    """Fingerprint of everything that a finished level depends on.

    Args:
        problem: parameters, measurements and alternatives.
        sha256: of the FMU; empty: there is none.
        options: schedule of ν and misfit.
    """
    content = {
        "files": _files(problem),
        "fmu": sha256,
        "options": to_plain({"schedule": options.schedule, "misfit": options.misfit}),
        "accuracy": problem.accuracy,
        "starts": {parameter.name: parameter.start for parameter in problem.parameters},
        "version": fitting.__version__,
        "versions": {name: version(name) for name in ("numpy", "scipy")},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def provenance_of(
    problem: Problem, description: FmuDescription, command: str, options: Options
) -> Provenance:
    """Where a result of this job comes from, finished now.

    Args:
        problem: parameters, measurements and alternatives.
        description: of the FMU.
        command: command line that made it, for the record.
        options: schedule of ν and misfit.
    """
    schedule = options.schedule
    packages = ("fmpy", "numpy", "scipy")
    versions = {name: version(name) for name in packages}
    versions |= {"fmu-fit": fitting.__version__, "python": platform.python_version()}
    return Provenance(
        fmu_name=description.model_name,
        fmu_file=description.path.name,
        fmu_guid=description.guid,
        fmu_sha256=description.sha256,
        campaign=str(_first(problem).path),
        files=_files(problem),
        versions=versions,
        command=command,
        seed=schedule.seed,
        settings={
            "nu_start": schedule.nu_start,
            "beta": schedule.beta,
            "iterations": schedule.iterations,
            "tolerance": schedule.tolerance,
            "starts": schedule.starts,
            "misfit": options.misfit,
            "estimator": options.estimator,
            "peak_noise": " ".join(dict.fromkeys(t.noise_origin for t in problem.data.tones)),
        },
        plan=(),
        start_values=_start_values(problem),
        fmu_tool=description.generation_tool,
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _start_values(problem: Problem) -> dict[str, Scalar]:
    """Start values of the FMU that all campaigns agree on."""
    first, *others = (bound.setup.start_values for bound in problem.campaigns.values())
    return {n: v for n, v in first.items() if all(other.get(n) == v for other in others)}


def _first(problem: Problem) -> BoundCampaign:
    return next(iter(problem.campaigns.values()))


def _files(problem: Problem) -> dict[str, str]:
    """SHA-256 of every file read, by its path as seen from the first campaign's folder."""
    folder = _first(problem).path.parent
    paths = [path for bound in problem.campaigns.values() for path in (bound.path, *bound.files)]
    return {Path(os.path.relpath(path, folder)).as_posix(): sha256_of(path) for path in paths}


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal; empty where there is none.

    Args:
        path: of the file.
    """
    return hashlib.sha256(read_whole(path)).hexdigest() if path.is_file() else ""


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
