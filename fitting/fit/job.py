"""What a reconstruction is asked to do, and the papers that go with it: identity, provenance."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

import fitting
from fitting.campaign import BoundCampaign
from fitting.campaign.noise import maximum_sigma, sweep_sigmas
from fitting.fit.continuation import Schedule
from fitting.fit.interior_point import SolveSettings
from fitting.fit.noise import peak_sigmas
from fitting.fit.objective import Measured
from fitting.fit.result import Provenance
from fitting.measurements.measured import join_measured
from fitting.text.records import to_plain


@dataclass(frozen=True)
class Identity:
    """What the result says about the FMU and how it was asked; `units` name -> unit."""

    name: str = ""
    file: str = ""
    guid: str = ""
    sha256: str = ""
    command: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    plan: tuple[str, ...] = ()


@dataclass(frozen=True)
class Options:
    """Schedule of nu and settings of each solve."""

    schedule: Schedule = field(default_factory=Schedule)
    solve: SolveSettings = field(default_factory=SolveSettings)


def options_of(bound: BoundCampaign, *, quick: bool = False) -> Options:
    """The campaign's own settings; `quick` takes its own start alone and looser tolerances."""
    chosen = bound.continuation
    schedule = Schedule(
        chosen.nu_start,
        chosen.beta,
        chosen.iterations,
        chosen.tolerance,
        chosen.starts,
        chosen.seed,
    )
    solve = SolveSettings(misfit=chosen.misfit)
    if quick:
        schedule = replace(schedule, starts=1)
        solve = replace(solve, absolute=1e-5, relative=1e-3, iterations=30, restarts=0)
    return Options(schedule, solve)


def measured_of(bound: BoundCampaign) -> Measured:
    """Peaks and sweep of a campaign as the objective wants them."""
    if bound.members:
        return join_measured([measured_of(member) for member in bound.members])
    peaks = [e.peaks_v for e in bound.experiments]
    sweep, noise = bound.sweep, bound.noise
    return Measured(
        peaks_v=np.concatenate(peaks) if peaks else np.empty(0),
        sigmas_v=peak_sigmas(bound)[0],
        sweep_v=sweep.amplitude_v if sweep is not None else np.empty(0),
        scale=sweep.scale if sweep is not None else "none",
        fit_sweep=sweep is not None and sweep.use == "fit",
        weigh=noise.declared
        or noise.outliers != "keep"
        or any(p.prior_sigma is not None for p in bound.parameters),
        outliers=noise.outliers,
        sweep_sigmas_v=sweep_sigmas(sweep.frequency_hz, sweep.amplitude_v, noise)
        if sweep is not None
        else np.empty(0),
        sweep_known=noise.declared,
        maximum_sigma=maximum_sigma(sweep.frequency_hz, sweep.amplitude_v, noise)
        if sweep is not None
        else 0.0,
    )


def job_of(bound: BoundCampaign, identity: Identity, options: Options) -> str:
    """Fingerprint of everything that a finished level depends on."""
    content = {
        "files": _files(bound),
        "fmu": identity.sha256,
        "options": to_plain(options),
        "accuracy": bound.setup.accuracy,
        "version": fitting.__version__,
        "versions": {name: version(name) for name in ("numpy", "scipy")},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def provenance_of(bound: BoundCampaign, identity: Identity, options: Options) -> Provenance:
    """Where a result of this job comes from, finished now."""
    schedule, solve = options.schedule, options.solve
    packages = ("fmpy", "numpy", "scipy")
    versions = {name: version(name) for name in packages}
    versions |= {"fmu-fit": fitting.__version__, "python": platform.python_version()}
    return Provenance(
        fmu_name=identity.name,
        fmu_file=identity.file,
        fmu_guid=identity.guid,
        fmu_sha256=identity.sha256,
        campaign=str(bound.path),
        files=_files(bound),
        versions=versions,
        command=identity.command,
        seed=schedule.seed,
        settings={
            "nu_start": schedule.nu_start,
            "beta": schedule.beta,
            "iterations": schedule.levels,
            "tolerance": schedule.tolerance,
            "starts": schedule.starts,
            "misfit": solve.misfit,
            "peak_noise": peak_sigmas(bound)[1],
            "optimality_absolute": solve.absolute,
            "optimality_relative": solve.relative,
        },
        plan=identity.plan,
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _files(bound: BoundCampaign) -> dict[str, str]:
    """SHA-256 of every file read, by its path as seen from the campaign's folder."""
    folder = bound.path.parent
    return {
        Path(os.path.relpath(path, folder)).as_posix(): _sha256(path)
        for path in (bound.path, *bound.files)
    }


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
