"""What a doctor found of an FMU, in lines."""

from __future__ import annotations

from collections import Counter

from fitting.campaign.check import Check
from fitting.fmu import FmuDescription, FmuVariable
from fitting.fmu.findings import Finding, Severity
from fitting.fmu.trial import HalvedStep, Resets, Trial
from fitting.text.notation import listed

#: Those that the binary which pythonfmu packs into an FMU looks for on the machine.
PYTHONS = "3.8 to 3.13"
#: Names of FMI of several words.
CAUSALITIES = {
    "calculatedParameter": "calculated parameter",
    "structuralParameter": "structural parameter",
    "local": "local variable",
    "independent": "independent variable",
}
#: Share of an output below which rounding differs, on another machine in another way.
ROUNDING = 1e-12
SHOWN = ("parameter", "input", "output", "calculatedParameter")


def description_lines(description: FmuDescription) -> list[str]:
    """What an FMU says of itself: where it runs, who made it, its variables.

    Args:
        description: of the FMU.
    """
    counts = Counter(v.causality for v in description.variables.values())
    seen = {v.name for v in description.seen}
    shown = [v for v in description.variables.values() if v.causality in SHOWN or v.name in seen]
    width = max((len(v.name) for v in shown), default=0)
    return [
        f"{description.path}: {description.model_name}, FMI {description.fmi_version}, "
        f"{', '.join(description.platforms)}",
        f"guid {description.guid}, sha256 {description.sha256}",
        f"made by {description.generation_tool or 'a tool that does not tell'}",
        *_needs(description),
        *_step(description),
        listed(_counted(n, causality) for causality, n in sorted(counts.items())),
        "",
        *(_row(v, width) for v in shown),
        "",
    ]


def _counted(count: int, causality: str) -> str:
    """Variables of a kind: "4 outputs", "1 input"."""
    words = CAUSALITIES.get(causality, causality)
    return f"{count} {words}{'' if count == 1 else 's'}"


def check_lines(found: Check) -> list[str]:
    """What a doctor found, but for what is wrong with the FMU in one sentence.

    Args:
        found: of the FMU.
    """
    lines = [_finding(f) for f in found.findings if f.severity is not Severity.FATAL]
    if found.suits is not None:
        suits = found.suits
        lines.append(
            f"{suits.campaign}: suits this FMU; {suits.parameters} parameters to fit, "
            f"{suits.experiments} experiments, output {suits.output}"
        )
    if found.trial is not None:
        lines.append(_trial(found.trial, found.description))
    if found.halved is not None:
        lines.append(_halved(found.halved))
    if found.resets is not None:
        lines += _resets(found.resets)
    return [*lines, *(f"the FMU warns: {warning}" for warning in found.warnings)]


def _finding(finding: Finding) -> str:
    more = f" ({finding.count - 1} more of this kind)" if finding.count > 1 else ""
    return f"{finding.severity}: {finding.sentence}{more}"


def _halved(halved: HalvedStep) -> str:
    """How far outputs rest on the communication step."""
    of = f"over {halved.steps} steps of {halved.step_s:g} s"
    if halved.share <= ROUNDING:
        return f"half the step: the outputs are the same to {ROUNDING:g} {of}"
    return (
        f"half the step: outputs differ by up to {halved.share:.1e} of their largest value {of} "
        f"({halved.output})"
    )


def _resets(resets: Resets) -> list[str]:
    lines = [f"reset: {resets.reuse}"]
    if resets.idle:
        over = f"over {resets.steps} steps of {resets.step_s:g} s"
        lines.append(f"a change by 0.1 % changed no output {over}: {listed(resets.idle)}")
    if resets.unvaried:
        lines.append(f"not varied, because the FMU refuses: {', '.join(resets.unvaried)}")
    return lines


def _trial(trial: Trial, description: FmuDescription) -> str:
    outputs = any(v.causality == "output" for v in description.seen)
    what = "outputs" if outputs else "local variables (it has no output)"
    line = f"trial run: one step of {trial.step_s:g} s, {len(trial.numbers)} {what} are numbers"
    return line + (f"; not a number: {', '.join(trial.blank)}" if trial.blank else "")


def _needs(description: FmuDescription) -> list[str]:
    """What the flags of the FMU ask of a host."""
    lines = []
    if description.needs_execution_tool:
        python = "pythonfmu" in description.generation_tool.lower()
        what = f", here a libpython of Python {PYTHONS}" if python else ""
        lines.append(f"needsExecutionTool: needs further software on the machine{what}")
    if description.one_instance_per_process:
        lines.append("canBeInstantiatedOnlyOncePerProcess: one instance in a process")
    return lines


def _step(description: FmuDescription) -> list[str]:
    """The step that the FMU was made for."""
    step_s = description.step_s
    return [] if step_s is None else [f"made for steps of {step_s:g} s"]


def _row(v: FmuVariable, width: int) -> str:
    start = "" if v.start is None else f" = {v.start}"
    limits = [] if v.min is None else [f"from {v.min:g}"]
    limits += [] if v.max is None else [f"to {v.max:g}"]
    unit = "" if v.unit is None else f" {v.unit}"
    text = f"{v.name:{width}}  {v.causality}, {v.variability}, {v.kind}{start}{unit}"
    return " ".join([text, *limits])
