"""Findings in sentences: a macro of one template for each kind."""

from __future__ import annotations

from collections.abc import Iterable

from fitting.text.finding import Finding
from fitting.text.rendering import blocks


def sentence(finding: Finding) -> str:
    """The sentence of a finding, its first letter capital.

    Args:
        finding: decided where its numbers are.
    """
    block = getattr(blocks("findings"), finding.kind.value)
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


def sentence_lines(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The sentences of findings, in lines.

    Args:
        findings: in their order.
    """
    return tuple(line for each in findings for line in sentence(each).splitlines())


def warning_sentences(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The sentences of errors and warnings, each once.

    Args:
        findings: of a result.
    """
    urgent = (finding for finding in findings if finding.severity != "note")
    return tuple(dict.fromkeys(map(sentence, urgent)))
