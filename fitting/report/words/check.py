"""What a doctor found of an FMU, in lines."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from fitting.campaign.check import Check, Suits
from fitting.fmu import FmuDescription, FmuVariable
from fitting.fmu.findings import Finding, Severity
from fitting.fmu.trial.costs import Costs
from fitting.fmu.trial.findings import ROUNDING
from fitting.fmu.trial.inputs import InputEffect
from fitting.fmu.trial.resets import Resets
from fitting.fmu.trial.steps import SHIFT, Repeatability, Trial
from fitting.text.choices import INTERFACES
from fitting.text.controls import spelled_out
from fitting.text.notation import how_many, listed

#: Those that the binary which pythonfmu packs into an FMU looks for on the machine.
PYTHONS = "3.8 to 3.13"
#: Names of FMI of several words.
CAUSALITIES = {
    "calculatedParameter": "calculated parameter",
    "structuralParameter": "structural parameter",
    "local": "local variable",
    "independent": "independent variable",
}
#: Below it, what a run leaves is a page of memory here or there.
LEAST_BYTES = 1000.0
SHOWN = ("parameter", "input", "output", "calculatedParameter")


def description_lines(description: FmuDescription) -> list[str]:
    """What an FMU says of itself: where it runs, who made it, its variables.

    Args:
        description: of the FMU.
    """
    counts = Counter(v.causality for v in description.variables.values())
    seen = {v.name for v in description.seen}
    shown = [v for v in description.variables.values() if v.causality in SHOWN or v.name in seen]
    width = max((len(spelled_out(v.name)) for v in shown), default=0)
    lines = [
        f"{description.path}: {description.model_name}, FMI {description.fmi_version}, "
        f"{', '.join(description.platforms)}",
        f"guid {description.guid}, sha256 {description.sha256}",
        f"made by {description.generation_tool or 'a tool that does not tell'}",
        *_interface(description),
        *_needs(description),
        *_step(description),
        listed(_counted(n, causality) for causality, n in sorted(counts.items())),
        "",
        *(_row(v, width) for v in shown),
        "",
    ]
    return [spelled_out(line) for line in lines]


def _counted(count: int, causality: str) -> str:
    """Variables of a kind: "4 outputs", "1 input"."""
    words = CAUSALITIES.get(causality, causality)
    return f"{count} {words}{'' if count == 1 else 's'}"


def check_lines(found: Check) -> list[str]:
    """What a doctor found, but for what is wrong with the FMU in one sentence.

    Args:
        found: of the FMU.
    """
    lines = [finding_words(f) for f in found.findings if f.severity is not Severity.FATAL]
    if found.suits is not None:
        lines.append(suits_line(found.suits))
    lines += examination_lines(found)
    lines += [] if found.examination.costs is None else [costs_line(found.examination.costs)]
    lines += [f"the FMU warns: {warning}" for warning in found.warnings]
    return [spelled_out(line) for line in lines]


def examination_lines(found: Check) -> list[str]:
    """What came of what was tried on the running FMU, but for what it costs.

    Args:
        found: of the FMU.
    """
    tried = found.examination
    lines = [] if tried.trial is None else [_trial(tried.trial, found.description)]
    lines += [] if tried.repeats is None else _repeats(tried.repeats)
    lines += [] if tried.resets is None else _resets(tried.resets)
    return [*lines, *_effects(tried.effects)]


def suits_line(suits: Suits) -> str:
    """What a campaign would do with the FMU.

    Args:
        suits: that it suits.
    """
    return (
        f"{suits.campaign}: suits this FMU; {how_many(suits.parameters, 'parameter')} to fit, "
        f"{how_many(suits.experiments, 'experiment')}, output {suits.output}"
    )


def described(description: FmuDescription) -> dict[str, str]:
    """What an FMU says of itself, by what it says.

    Args:
        description: of the FMU.
    """
    d = description
    return {
        "file": str(d.path),
        "FMI": d.fmi_version,
        "platforms": ", ".join(d.platforms),
        "guid": d.guid,
        "sha256": d.sha256,
        "made by": d.generation_tool or "a tool that does not tell",
        "further": "; ".join((*_interface(d), *_needs(d), *_step(d))) or "nothing",
    }


def finding_words(finding: Finding) -> str:
    """A finding as a line.

    Args:
        finding: of the FMU.
    """
    more = f" ({finding.count - 1} more of this kind)" if finding.count > 1 else ""
    return f"{finding.severity}: {finding.sentence}{more}"


def _repeats(repeats: Repeatability) -> list[str]:
    """How far outputs rest on the communication step, and on the time of the start."""
    of = f"over {repeats.steps} steps of {repeats.step_s:g} s"
    if not math.isnan(repeats.stops_s):
        lines = [f"half the step: no output moves in steps of {repeats.stops_s:g} s"]
    elif math.isnan(repeats.halves):
        lines = [f"half the step: the FMU refuses steps of {repeats.step_s / 2.0:g} s"]
    elif repeats.halves <= ROUNDING:
        lines = [f"half the step: the outputs are the same to {ROUNDING:g} {of}"]
    else:
        falls = f", and fall with the step (order {repeats.order:.1f})" if repeats.falls else ""
        lines = [
            f"half the step: outputs differ by up to {repeats.halves:.1e} of their largest value "
            f"{of} ({repeats.output}){falls}"
        ]
    if repeats.again == 0.0:
        lines.append("repeated on a new instance: the same bit for bit")
    if repeats.later > ROUNDING and not repeats.by_time:
        lines.append(
            f"the same run, begun at {SHIFT * repeats.step_s:.2g} s instead of at 0 s: outputs "
            f"differ by up to {repeats.later:.1e} of their largest value; no fault: something "
            "inside it, as a drive, goes by the time, and runs that are compared begin at one time"
        )
    return lines


def _effects(effects: Sequence[InputEffect]) -> list[str]:
    """What inputs and tunable parameters do that are moved between steps."""
    acting = [e.name for e in effects if e.acts and not e.at_once]
    at_once = [e.name for e in effects if e.at_once]
    lines = [] if not acting else [f"moved between steps, outputs change: {listed(acting)}"]
    if at_once:
        lines.append(f"seen by an output without a step (direct feed-through): {listed(at_once)}")
    return lines


def costs_line(costs: Costs) -> str:
    """What a step and a start cost on this machine.

    Args:
        costs: measured.
    """
    made = "a new instance" if costs.anew else "a reset"
    line = (
        f"here a step takes about {_seconds(costs.step_s)} of processor time, the start of a run "
        f"with {made} about {_seconds(costs.start_s)}"
    )
    if math.isnan(costs.bytes_per_run):
        return line
    if costs.bytes_per_run < LEAST_BYTES:
        return f"{line}, and leaves less than {LEAST_BYTES / 1e3:g} kB of memory"
    return f"{line}, and leaves about {costs.bytes_per_run / 1e3:.0f} kB of memory"


def _seconds(time_s: float) -> str:
    """A measured time to one digit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if time_s >= size:
            return f"{float(f'{time_s / size:.1g}'):g} {unit}"
    return "1 µs"


def _resets(resets: Resets) -> list[str]:
    lines = [f"reset: {resets.reuse}"]
    if resets.idle:
        over = f"over {resets.idle_steps} steps of {resets.step_s:g} s"
        lines.append(f"a change by 0.1 % changed no output {over}: {listed(resets.idle)}")
    if resets.unvaried:
        lines.append(f"not varied, because the FMU refuses: {', '.join(resets.unvaried)}")
    return lines


def _trial(trial: Trial, description: FmuDescription) -> str:
    outputs = any(v.causality == "output" for v in description.seen)
    count = len(trial.numbers)
    what = _counted(count, "output" if outputs else "local")
    said = "is a number" if count == 1 else "are numbers"
    where = "" if outputs else " (it has no output)"
    line = f"trial run: one step of {trial.step_s:g} s, {what}{where} {said}"
    return line + (f"; not a number: {', '.join(trial.blank)}" if trial.blank else "")


def _interface(description: FmuDescription) -> list[str]:
    """By which interface it is run, where that is not the only one, or not the usual one."""
    if description.offers == INTERFACES[:1]:
        return []
    others = [name for name in description.offers if name != description.interface]
    lines = [f"run by {description.interface}"]
    if description.exchange is not None:
        lines[0] += ": its equations are integrated here"
    lines[0] += f"; it offers {others[0]}, too (--interface {others[0]})" if others else ""
    return lines


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
    own = description.own_steps
    lines = []
    if own.internal_s is not None:
        lines.append(f"steps of its own of {own.internal_s:g} s: others are to be whole multiples")
    elif own.usual_s is not None:
        lines.append(f"made for steps of {own.usual_s:g} s")
    if not own.of_any_length:
        lines.append("says that it takes communication steps of one length only")
    return lines


def _row(v: FmuVariable, width: int) -> str:
    start = "" if v.start is None else f" = {v.start}"
    limits = [] if v.min is None else [f"from {v.min:g}"]
    limits += [] if v.max is None else [f"to {v.max:g}"]
    unit = "" if v.unit is None else f" {v.unit}"
    text = f"{spelled_out(v.name):{width}}  {v.causality}, {v.variability}, {v.kind}{start}{unit}"
    return " ".join([text, *limits])
