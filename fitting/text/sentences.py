"""Findings in sentences: a block of one template for each kind, and the filters that it uses."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fitting.text import notation
from fitting.text.finding import Finding
from fitting.text.once import made_once

TEMPLATES = Path(__file__).parent / "templates"


def sentence(finding: Finding) -> str:
    """The sentence of a finding, its first letter capital.

    Args:
        finding: decided where its numbers are.
    """
    block = getattr(_blocks(), finding.kind.value)
    text = str(block(finding.subject, finding.numbers, finding.names)).strip()
    first = text.split(" ", 1)[0].rstrip(":,")
    named = {
        finding.subject,
        *finding.numbers,
        *(n for all_ in finding.names.values() for n in all_),
    }
    # the name of a parameter or a file is spelled as it is, and so is the text of others
    kept = first in named or "text" in finding.names or not first.isalpha()
    return text if kept else f"{text[0].upper()}{text[1:]}"


def warning_sentences(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The sentences of errors and warnings, each once.

    Args:
        findings: of a result.
    """
    urgent = (finding for finding in findings if finding.severity != "note")
    return tuple(dict.fromkeys(map(sentence, urgent)))


def sized(value: float, unit: str, digits: int) -> str:
    """A number in its unit, without an error: "5.2 Hz".

    Args:
        value: in the unit.
        unit: of the value; empty or "1": none.
        digits: significant ones.
    """
    return f"{notation.number(value, digits)} {notation.unit_text(unit)}".rstrip()


@made_once
def _blocks() -> Any:
    """The template's blocks by kind. Imported late: most commands print no finding."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined)  # noqa: S701 - plain text
    environment.tests["finite"] = math.isfinite
    for function in (
        notation.freedom_words,
        notation.hertz,
        notation.listed,
        notation.number,
        notation.probability,
        notation.signed_number,
        notation.span,
        notation.with_error,
        sized,
    ):
        environment.globals[function.__name__] = function
    return environment.get_template("findings.txt.j2").module
