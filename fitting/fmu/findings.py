"""Rules of FMI that an FMU breaks, by how much that matters, each kind told once."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


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
