"""Rules of FMI that an FMU breaks, and what it does that a fit or another tool may not expect."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from fitting.check.examination import Examination
from fitting.check.inputs import InputEffect
from fitting.check.resets import Resets
from fitting.check.runs import STEPS
from fitting.check.steps import Repeatability
from fitting.extension.fmu import FmuDescription
from fitting.text.notation import listed

#: Shares of an output below which rounding differs, on another machine in another way.
ROUNDING = 1e-12
#: By which differences grow from the first quarter of the time to the last where they drift.
DRIFTS = 2.0
#: Share from which outputs of shorter steps are other ones altogether.
OTHER = 0.3
#: Bytes that a run leaves, from which a thousand runs are felt.
LEAK = 50_000


class Severity(StrEnum):
    """How much it matters."""

    #: No result rests on it: hints for other tools, how names are written.
    COSMETIC = "cosmetic"
    #: It runs; other tools may refuse it, or a value may be meant otherwise than it is taken.
    CAREFUL = "careful"
    #: It does not run.
    FATAL = "fatal"

    @property
    def rank(self) -> int:
        """The grave ones first."""
        return (Severity.FATAL, Severity.CAREFUL, Severity.COSMETIC).index(self)


@dataclass(frozen=True)
class Finding:
    """What is wrong with an FMU; `count` times, the first of them told."""

    severity: Severity
    sentence: str
    count: int = 1


#: What fmpy says of rules that only hints and spelling break.
_COSMETIC = re.compile(
    r"InitialUnknowns|ModelStructure|dependenciesKind|display unit|not a legal variable name|"
    r"illegal (carriage return|line feed|tab) character"
)
#: What differs between complaints of one kind: names and places.
_OWN = re.compile(r"\"[^\"]*\"|'[^']*'|\d+")


def rule_findings(problems: Iterable[str]) -> tuple[Finding, ...]:
    """Broken rules, the grave ones first; complaints that differ in names and lines alone are one.

    Args:
        problems: sentences of fmpy's validation.
    """
    kinds: dict[str, Finding] = {}
    for problem in problems:
        sentence = " ".join(problem.split())
        kind = _OWN.sub("", sentence)
        severity = Severity.COSMETIC if _COSMETIC.search(sentence) else Severity.CAREFUL
        first = kinds.get(kind, Finding(severity, sentence, 0))
        kinds[kind] = Finding(first.severity, first.sentence, first.count + 1)
    return tuple(sorted(kinds.values(), key=lambda f: f.severity.rank))


def trial_findings(description: FmuDescription, examination: Examination) -> tuple[Finding, ...]:
    """What is to be known of an FMU that was tried, as findings.

    Args:
        description: of the FMU.
        examination: all that was tried.
    """
    fatal = (
        [] if examination.failure is None else [Finding(Severity.FATAL, str(examination.failure))]
    )
    sentences = [] if examination.resets is None else _of_resets(examination.resets)
    sentences += (
        [] if examination.repeats is None else _of_repeats(examination.repeats, description)
    )
    for effect in examination.effects:
        what = f"{effect.causality} {effect.name}"
        if effect.acts is False:
            sentences.append(
                f"{what}: moved between steps, it changes no output{_over(examination, effect)}"
            )
        elif effect.acts is None:
            sentences.append(f"{what}: the FMU refuses to have it moved between steps")
    if examination.costs is not None and examination.costs.bytes_per_run > LEAK:
        made = "instance" if examination.costs.anew else "reset"
        sentences.append(
            f"every {made} leaves about {examination.costs.bytes_per_run / 1e3:.0f} kB of memory"
        )
    return (*fatal, *(Finding(Severity.CAREFUL, sentence) for sentence in sentences))


def _over(examination: Examination, effect: InputEffect) -> str:
    resets = examination.resets
    return "" if resets is None else f" over {effect.steps} steps of {resets.step_s:g} s"


def _of_resets(resets: Resets) -> list[str]:
    if "" in resets.kept:
        return ["a reset is called OK and does not bring the FMU back to its start"]
    sentences = []
    if resets.steps < STEPS:
        sentences.append(f"it ends, or fails, before {STEPS} steps of {resets.step_s:g} s")
    if resets.kept:
        names = listed(resets.kept[:6]) + (" and others" if len(resets.kept) > 6 else "")
        sentences.append(
            f"a reset is called OK and leaves a trace of values that were set before it: {names}; "
            "here every run sets them, another tool may not"
        )
    elif not resets.true:
        sentences.append("a reset is called OK and leaves something behind")
    elif resets.fails:
        sentences.append(f"its reset does not work: {resets.fails}")
    return sentences


def _of_repeats(repeats: Repeatability, description: FmuDescription) -> list[str]:
    sentences = []
    own = description.own_steps
    if repeats.again > 0.0:
        sentences.append(
            f"the same run on a new instance gives other outputs, by up to {repeats.again:.1e} of "
            "their largest value"
        )
    sentences += _of_steps(repeats)
    if not math.isnan(repeats.own_step_s):
        declared = own.step_s is not None and abs(own.step_s / repeats.own_step_s - 1.0) < 0.1
        sentences.append(
            f"outputs move only every {own.step_s:g} s, its own step, as it declares"
            if declared
            else f"outputs move only about every {repeats.own_step_s:.3g} s, its own step, "
            "which its description does not declare"
        )
    return sentences


def _of_steps(repeats: Repeatability) -> list[str]:
    """What outputs do in shorter communication steps."""
    step_s = repeats.step_s
    if not math.isnan(repeats.stops_s):
        return [
            f"in steps of {repeats.stops_s:g} s no output moves, in steps of {step_s:g} s they do: "
            "it forgets what is shorter than a step of its own"
        ]
    sentences = []
    if math.isnan(repeats.halves):
        sentences.append(
            f"it refuses steps of {step_s / 2.0:g} s, and takes those of {step_s:g} s: other tools "
            "and plans have to keep to steps that it takes"
        )
    if repeats.floor > OTHER:
        sentences.append(
            f"in shorter communication steps outputs are other ones ({repeats.output} by "
            f"{repeats.floor:.1e} of its largest value), however short they are, as where steps "
            "are counted"
        )
    elif repeats.floor > max(ROUNDING, repeats.again):
        sentences.append(
            f"outputs repeat to {repeats.floor:.1e} of their largest value only "
            f"({repeats.output}), however short the communication step: amplitudes rest on that"
        )
    if not repeats.falls and repeats.late > max(ROUNDING, DRIFTS * repeats.early):
        sentences.append(
            f"what outputs differ by with other steps grows with time, from {repeats.early:.1e} to "
            f"{repeats.late:.1e} over {repeats.steps} steps"
        )
    return sentences
