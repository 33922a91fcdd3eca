"""A reconstruction through an FMU: the campaign's FMU found or built, driven, and told of."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

import fitting
from fitting.driving import FmuResponse, plan_campaign
from fitting.errors import BadInput
from fitting.fmu import FmuDescription, FmuWorkers
from fitting.job import Identity, Options
from fitting.labdata import BoundCampaign, FmuChoice
from fitting.reconstruction import Hooks, reconstruct
from fitting.result import Result

FloatArray = npt.NDArray[np.float64]

BUILDER = "build_fmu.py"
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def provide_fmu(choice: FmuChoice, cache: Path) -> Path:
    """Path of the campaign's FMU: the file it names, or the model it names, built into `cache`.

    The build is reproducible and takes a second, so it is made anew every time: what is driven is
    what the sources say.

    Raises:
        BadInput: no builder beside the installed package, or the builder's own complaint.
    """
    if choice.file is not None:
        return choice.file
    builder = Path(fitting.__file__).resolve().parent.parent / BUILDER
    if not builder.is_file():
        raise BadInput(
            f"[fmu] model = {choice.model!r} is built by {builder}, which is not there; wanted a "
            "checkout of the project (pip install -e .), or [fmu] file = an FMU"
        )
    command = [sys.executable, str(builder), "--model", str(choice.model), "--out", str(cache)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    lines = built.stdout.strip().splitlines()
    if built.returncode != 0 or not lines:
        said = built.stderr.strip().splitlines() or ["no message"]
        raise BadInput(f"[fmu] model = {choice.model!r} could not be built: {said[-1]}")
    return Path(lines[-1])


def identify_fmu(description: FmuDescription, command: str) -> Identity:
    """What the result says about the FMU, without the plan."""
    units = {name: v.unit or "" for name, v in description.variables.items()}
    return Identity(
        description.model_name, description.path.name, description.guid, description.sha256,
        command, units,
    )  # fmt: skip


def reconstruct_through(
    workers: FmuWorkers,
    bound: BoundCampaign,
    identity: Identity,
    options: Options,
    hooks: Hooks | None = None,
) -> Result:
    """Reconstruct a bound campaign with running FMU workers; plan and FMU warnings are added.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: the campaign cannot be planned (see `driving.plan_campaign`).
    """
    plan = plan_campaign(bound)
    result = reconstruct(
        bound,
        lambda alternative: FmuResponse(bound, workers, plan, alternative),
        replace(identity, plan=plan.sentences),
        options,
        hooks,
    )
    response = FmuResponse(bound, workers, plan, result.alternative)
    sentences = (*plan.sentences, f"Instances: {workers.reuse_note}.")
    warnings = [*result.warnings, *_condensed(workers.warnings)]
    misfit = response.misfit(_reported(result, bound))
    if misfit > max(100.0 * bound.accuracy, 1e-4):
        warnings.append(
            f"Sampled runs differ from mean and tones by {misfit:.1e} of their amplitude: "
            "a transient that has not settled, harmonics, or a coarse solver."
        )
    provenance = replace(result.provenance, plan=sentences)
    return replace(result, warnings=tuple(warnings), provenance=provenance)


def _condensed(warnings: Sequence[str]) -> list[str]:
    """The FMU's warnings, one for all that differ in their numbers only."""
    kinds: dict[str, list[str]] = {}
    for said in warnings:
        kinds.setdefault(NUMBER.sub("#", said), []).append(said)
    return [
        f"The FMU says: {alike[0]}"
        + (f" (and {len(alike) - 1} more that differ in numbers only)" if len(alike) > 1 else "")
        for alike in kinds.values()
    ]


def _reported(result: Result, bound: BoundCampaign) -> FloatArray:
    """The reported values in the order of the campaign, as the model takes them."""
    return np.array([result.parameters[parameter.name].value for parameter in bound.parameters])
