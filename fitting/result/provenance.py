"""Where a result comes from: the FMU, the files, the versions, the settings."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import fitting
from fitting.campaign import BoundCampaign
from fitting.fit.options import Options
from fitting.fit.problem import Problem
from fitting.result.result import Provenance
from fitting.text.arrays import Scalar
from fitting.text.files import read_whole
from fitting.text.records import to_plain


@dataclass(frozen=True, kw_only=True)
class Identity:
    """What the result states about the FMU and how it was asked; `units` name -> unit."""

    name: str = ""
    file: str = ""
    guid: str = ""
    sha256: str = ""
    command: str = ""
    units: Mapping[str, str] = field(default_factory=dict)


def job_of(problem: Problem, identity: Identity, options: Options) -> str:
    """Fingerprint of everything that a finished level depends on.

    Args:
        problem: parameters, measurements and alternatives.
        identity: of the FMU and of this program.
        options: schedule of ν and misfit.
    """
    content = {
        "files": _files(problem),
        "fmu": identity.sha256,
        "options": to_plain({"schedule": options.schedule, "misfit": options.misfit}),
        "accuracy": problem.accuracy,
        "starts": {parameter.name: parameter.start for parameter in problem.parameters},
        "version": fitting.__version__,
        "versions": {name: version(name) for name in ("numpy", "scipy")},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def provenance_of(problem: Problem, identity: Identity, options: Options) -> Provenance:
    """Where a result of this job comes from, finished now.

    Args:
        problem: parameters, measurements and alternatives.
        identity: of the FMU and of this program.
        options: schedule of ν and misfit.
    """
    schedule = options.schedule
    packages = ("fmpy", "numpy", "scipy")
    versions = {name: version(name) for name in packages}
    versions |= {"fmu-fit": fitting.__version__, "python": platform.python_version()}
    return Provenance(
        fmu_name=identity.name,
        fmu_file=identity.file,
        fmu_guid=identity.guid,
        fmu_sha256=identity.sha256,
        campaign=str(_first(problem).path),
        files=_files(problem),
        versions=versions,
        command=identity.command,
        seed=schedule.seed,
        settings={
            "nu_start": schedule.nu_start,
            "beta": schedule.beta,
            "iterations": schedule.levels,
            "tolerance": schedule.tolerance,
            "starts": schedule.starts,
            "misfit": options.misfit,
            "estimator": options.estimator,
            "peak_noise": " ".join(dict.fromkeys(t.noise_origin for t in problem.data.tones)),
        },
        plan=(),
        start_values=_start_values(problem),
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
