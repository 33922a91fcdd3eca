"""Rules of FMI that an FMU breaks, and what it does that a fit or another tool may not expect."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

from fitting.check.examination import Examination
from fitting.check.runs import ROUNDING, STEPS
from fitting.extension.fmu import USUAL_ACCURACY, FmuDescription
from fitting.text.finding import Kind, warning
from fitting.text.rendering import blocks, sentence

#: Share of rounding; growth of differences from the first quarter of the time to the last where
#: they drift; share from which outputs of shorter steps are other ones, and up to which no
#: amplitude rests on how well they repeat; bytes of a run that a thousand feel. Names that a
#: sentence on the screen lists; the page has all.
MOST_LISTED = 10
LIMITS = {
    "most": MOST_LISTED,
    "rounding": ROUNDING,
    "drifts": 2.0,
    "other": 0.3,
    "exact": USUAL_ACCURACY,
    "leak": 50_000,
    "steps": STEPS,
}


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
    """What is wrong with an FMU; `count` times, with the first of them.

    `kind` is that of a fit's findings where those have the like.
    """

    severity: Severity
    sentence: str
    count: int = 1
    kind: Kind | None = None


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
    failure = examination.failure
    failed: dict[str, Finding] = {}  # probes that fail alike are one, as broken rules are
    for probe in examination.failed:
        sentence_ = f"{probe.what}: {probe.message}"
        first = failed.get(_OWN.sub("", probe.message), Finding(Severity.CAREFUL, sentence_, 0))
        failed[_OWN.sub("", probe.message)] = replace(first, count=first.count + 1)
    fatal = () if failure is None else (Finding(Severity.FATAL, str(failure)),)
    repeats = examination.repeats
    late = [
        warning(Kind.output_late, name, None, step_s=tried.step_s)
        for tried in ([] if repeats is None else [repeats])
        for name in tried.late_outputs
    ]
    text = blocks("check/text")
    cautions = str(text.cautions(examination, description, LIMITS)).splitlines()
    notes = str(text.notes(examination, LIMITS)).splitlines()
    return (
        *fatal,
        *failed.values(),
        *(Finding(Severity.CAREFUL, sentence(each), kind=each.kind) for each in late),
        *(Finding(Severity.CAREFUL, line.strip()) for line in cautions if line.strip()),
        *(Finding(Severity.COSMETIC, line.strip()) for line in notes if line.strip()),
    )
