"""The FMU of the campaigns that a command is given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.api.fmu import Fmu
from fitting.api.problem import one_fmu
from fitting.campaign import Campaign
from fitting.cli.options import default_workers
from fitting.fmu.models import provide_fmu


def fmu_for(campaigns: Sequence[Campaign], out: Path, workers: int | None) -> Fmu:
    """The FMU that campaigns name; a model of this project is built into a folder of the results.

    Raises:
        BadInput: they name different ones, or one that is not there.
    """
    named = one_fmu(campaigns)
    path = provide_fmu(named, out / "fmu")
    return Fmu(path, workers or default_workers(), named.timeout_s)
