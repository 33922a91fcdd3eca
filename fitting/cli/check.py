"""``fmu-fit check``: will an FMU load, validate, run, survive a reset, and suit a campaign."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from fitting.campaign import bind, read_campaign
from fitting.cli.options import positive_time
from fitting.cli.progress import status_line
from fitting.fmu import FmuDescription, FmuVariable, FmuWorkers, Run, validation_problems
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

NAME = "check"
EXAMPLE = "fmu-fit check build/CoupledOscillator.fmu --campaign data/string_q1/campaign.toml"

#: Those that the binary which pythonfmu packs into an FMU looks for on the machine.
PYTHONS = "3.8 to 3.13"
VARIED = 1e-3  # of a value, to see whether a reset instance still gives what a new one gives


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument("fmu", type=Path, metavar="FMU", help="the file (FMI 2.0 or 3.0)")
    parser.add_argument("--campaign", type=Path, metavar="CAMPAIGN.toml", help="also: does it suit")
    parser.add_argument(
        "--step",
        type=positive_time("--step"),
        default=1e-3,
        metavar="TIME",
        help='length of the trial step, as "1 ms" (0.001 s)',
    )
    parser.add_argument(
        "--timeout",
        type=positive_time("--timeout"),
        default=60.0,
        metavar="TIME",
        help="longest run (60 s)",
    )


def run(args: argparse.Namespace) -> int:
    """Check and tell; returns 0.

    Raises:
        BadInput: the FMU cannot be read, breaks the rules of FMI, or does not suit the campaign.
        FmuFailure: the trial run failed.
    """
    with FmuWorkers(args.fmu, timeout_s=args.timeout, timeout_name="--timeout") as workers:
        print(*_facts(workers.description), sep="\n")
        problems = validation_problems(args.fmu)
        for problem in problems:
            print(f"problem: {' '.join(problem.split())}")
        campaign_values = _suits(args.campaign, workers.description)
        for what, look in (("trial run", _trial), ("reset", _resets)):
            with status_line(NAME) as tell:
                tell(what)
                lines = look(workers, args.step, campaign_values)
            print(*lines, sep="\n")
    for warning in workers.warnings:
        print(f"the FMU warns: {warning}")
    if problems:
        raise BadInput(f"{args.fmu}: runs, but breaks {len(problems)} rules of FMI (see above)")
    return 0


def _facts(description: FmuDescription) -> list[str]:
    counts = Counter(v.causality for v in description.variables.values())
    lines = [
        f"{description.path}: {description.model_name}, FMI {description.fmi_version}, "
        f"{', '.join(description.platforms)}",
        f"guid {description.guid}, sha256 {description.sha256}",
        f"made by {description.generation_tool or 'a tool that does not tell'}",
        *_needs(description),
        ", ".join(f"{n} {causality}" for causality, n in sorted(counts.items())),
        "",
    ]
    shown = [
        v
        for v in description.variables.values()
        if v.causality in ("parameter", "input", "output", "calculatedParameter")
    ]
    width = max((len(v.name) for v in shown), default=0)
    lines += [_row(v, width) for v in shown]
    return [*lines, ""]


def _needs(description: FmuDescription) -> list[str]:
    """What the flags of the FMU ask of a host, in words."""
    lines = []
    if description.needs_execution_tool:
        python = "pythonfmu" in description.generation_tool.lower()
        what = f", here a libpython of Python {PYTHONS}" if python else ""
        lines.append(f"needsExecutionTool: needs further software on the machine{what}")
    if description.one_instance_per_process:
        lines.append("canBeInstantiatedOnlyOncePerProcess: one instance in a process")
    return lines


def _row(v: FmuVariable, width: int) -> str:
    start = "" if v.start is None else f" = {v.start}"
    limits = [] if v.min is None else [f"from {v.min:g}"]
    limits += [] if v.max is None else [f"to {v.max:g}"]
    unit = "" if v.unit is None else f" {v.unit}"
    text = f"{v.name:{width}}  {v.causality}, {v.variability}, {v.kind}{start}{unit}"
    return " ".join([text, *limits])


def _suits(campaign: Path | None, description: FmuDescription) -> Mapping[str, Scalar]:
    """Start values of the campaign, which fits the FMU; none without a campaign."""
    if campaign is None:
        return {}
    bound = bind(read_campaign(campaign), description.variables)
    print(
        f"{campaign}: suits this FMU; {len(bound.parameters)} parameters to fit, "
        f"{len(bound.experiments)} experiments, output {bound.setup.output}"
    )
    return dict(bound.setup.start_values)


def _trial(workers: FmuWorkers, step: float, values: Mapping[str, Scalar]) -> list[str]:
    """One step; which outputs are numbers."""
    run = _trial_run(workers.description, step, values)
    [result] = workers.run([run])
    blank = [
        name
        for name, value in zip(run.outputs, result[-1], strict=True)
        if not math.isfinite(value)
    ]
    line = f"trial run: one step of {step:g} s, {len(run.outputs) - len(blank)} outputs are numbers"
    return [line + (f"; not a number: {', '.join(blank)}" if blank else "")]


def _resets(workers: FmuWorkers, step: float, values: Mapping[str, Scalar]) -> list[str]:
    """Whether a reset instance gives what a new one gives, also with every parameter varied."""
    run = _trial_run(workers.description, step, values)
    unvaried = []
    for variable in workers.description.variables.values():
        other = _varied(variable, values.get(variable.name, variable.start))
        if other is None:
            continue
        changed = {**run.start_values, variable.name: other}
        try:
            workers.run([run, _trial_run(workers.description, step, changed)])
        except NoAnswer:
            raise
        except FmuFailure:
            unvaried.append(variable.name)  # the trial run itself went well: it is this value
    lines = [f"reset: {workers.reuse_note}"]
    if unvaried:
        lines.append(f"not varied, because the FMU refuses: {', '.join(unvaried)}")
    return lines


def _varied(variable: FmuVariable, value: Scalar | None) -> float | None:
    """Another value of a Real parameter, inside its limits."""
    if variable.kind != "Real" or value is None or not variable.can_be_started:
        return None
    number = float(value)
    other = number * (1.0 + VARIED) if number else VARIED
    if variable.max is not None and other > variable.max:
        other = number * (1.0 - VARIED) if number else -VARIED
    return other if variable.min is None or other >= variable.min else None


def _trial_run(description: FmuDescription, step: float, values: Mapping[str, Scalar]) -> Run:
    outputs = tuple(
        v.name
        for v in description.variables.values()
        if v.causality == "output" and v.kind in ("Real", "Integer", "Boolean")
    )
    if not outputs:
        raise BadInput(f"{description.path}: has no output that is a number, wanted one at least")
    starts = {
        v.name: v.start
        for v in description.variables.values()
        if v.can_be_started and v.kind == "Real" and v.start is not None
    }
    return Run(
        start_values={**starts, **values},
        settle_s=0.0,
        sample_step_s=step,
        samples=2,
        outputs=outputs,
        allow_nan=True,
    )
