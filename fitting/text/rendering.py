"""The one Jinja environment of all text that is printed, and of all pages.

Templates of this package (`text/templates`) are those of records below the report: findings, and
decisions of a plan. Every other folder of templates may import them. Findings become sentences
here: a macro of one template for each kind.
"""

from __future__ import annotations

import inspect
import math
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitting.text import notation
from fitting.text.errors import spelled_out
from fitting.text.finding import Finding
from fitting.text.once import made_once

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
#: Templates of an optional package are named by their path in it: "posterior/text.txt.j2".
PACKAGE = Path(__file__).parents[1]


def environment(*folders: Path, escaped: bool = False) -> Environment:
    """Templates of some folders and of this package: nothing may be left undefined.

    Args:
        folders: that are searched before those of this package.
        escaped: whether all text is escaped for HTML; not for a terminal.
    """
    # most commands print little
    from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined

    # compiled templates lie next to compiled modules, where Python keeps those; whether text is
    # escaped is part of the code, and no part of jinja's key
    compiled, cache = Path(__file__).parent / "__pycache__", None
    if not sys.dont_write_bytecode and os.access(compiled, os.W_OK):
        kind = "html" if escaped else "text"
        cache = FileSystemBytecodeCache(str(compiled), f"templates-{kind}-%s.cache")
    made = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES, PACKAGE]),
        autoescape=escaped,  # noqa: S701 - a terminal renders no HTML
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        bytecode_cache=cache,
    )
    made.tests["finite"] = math.isfinite
    made.filters["spelled_out"] = spelled_out
    # what writes names and numbers, every template knows by its name
    made.globals.update(inspect.getmembers(notation, inspect.isfunction))
    return made


@made_once
def blocks(template: str) -> Any:
    """The macros of a template of this package, compiled once.

    Args:
        template: its name without ".txt.j2".
    """
    return environment().get_template(f"{template}.txt.j2").module


def phrase(template: str, macro: str, *records: Any) -> str:
    """What a macro of a template of this package prints, in one line.

    Args:
        template: its name without ".txt.j2".
        macro: its name.
        *records: that it prints.
    """
    return str(getattr(blocks(template), macro)(*records)).strip()


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
    return tuple(dict.fromkeys(sentence(each) for each in findings if each.severity != "note"))
