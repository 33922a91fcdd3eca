"""The one Jinja environment of all text that is printed, and of all pages.

Templates of this package (`text/templates`) are those of records below the report: findings, and
decisions of a plan. Every other folder of templates may import them. Findings become sentences
here: a macro of one template for each kind.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitting.text import notation
from fitting.text.finding import Finding
from fitting.text.once import made_once
from fitting.text.streams import spelled_out

if TYPE_CHECKING:
    from jinja2 import Environment, FileSystemBytecodeCache

TEMPLATES = Path(__file__).parent / "templates"
#: Templates of an optional package are named by their path in it: "posterior/text.txt.j2".
PACKAGE = Path(__file__).parents[1]
#: Numbers without a prefix from which a power of ten is printed.
MANY = 1e5
#: Share of the upper end of a range below which its lower end is printed as zero.
NOTHING = 1e-6
#: Times up to so many seconds are printed in a unit of so many.
TIMES = ((120.0, "s", 1.0), (7200.0, "min", 60.0), (math.inf, "h", 3600.0))
#: Functions of `fitting.text.notation` that every template knows by their names.
FUNCTIONS = (
    notation.as_known,
    notation.bound,
    notation.freedom_words,
    notation.hertz,
    notation.how_many,
    notation.in_its_unit,
    notation.joint_prefix,
    notation.listed,
    notation.number,
    notation.percent,
    notation.prefixed,
    notation.probability,
    notation.quantity,
    notation.scalar_words,
    notation.settings_words,
    notation.sign,
    notation.signed_number,
    notation.span,
    notation.unit_text,
    notation.with_error,
    notation.with_unit,
)


def environment(*folders: Path, escaped: bool = False) -> Environment:
    """Templates of some folders and of this package: nothing may be left undefined.

    Args:
        folders: that are searched before those of this package.
        escaped: whether all text is escaped for HTML; not for a terminal.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # most commands print little

    made = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES, PACKAGE]),
        autoescape=escaped,  # noqa: S701 - a terminal renders no HTML
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        bytecode_cache=_compiled(escaped=escaped),
    )
    made.tests["finite"] = math.isfinite
    made.filters["spelled_out"] = spelled_out
    made.globals.update({function.__name__: function for function in FUNCTIONS})
    for function in (duration, limit_words, range_words, sized, two_digits, with_prefix):
        made.globals[function.__name__] = function
    return made


def _compiled(*, escaped: bool) -> FileSystemBytecodeCache | None:
    """Compiled templates beside compiled modules, where Python keeps those.

    Whether text is escaped is part of the code, and no part of jinja's key.
    """
    from jinja2 import FileSystemBytecodeCache

    folder = Path(__file__).parent / "__pycache__"
    if sys.dont_write_bytecode or not os.access(folder, os.W_OK):
        return None
    kind = "html" if escaped else "text"
    return FileSystemBytecodeCache(str(folder), f"templates-{kind}-%s.cache")


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


def sized(value: float, unit: str, digits: int) -> str:
    """A number in its unit, without an error: "5.2 Hz".

    Args:
        value: in the unit.
        unit: of the value; empty or "1": none.
        digits: significant ones.
    """
    return f"{notation.number(value, digits)} {notation.unit_text(unit)}".rstrip()


def with_prefix(value: float, unit: str, digits: int = 3, *, signed: bool = False) -> str:
    """A number under the prefix that suits it, or a power of ten times its unit: "66 ms".

    Args:
        value: in the unit.
        unit: of the value; empty or "1": none.
        digits: significant ones.
        signed: whether a positive one has its sign, as a shift: "+32 kHz".
    """
    factor, shown = (1.0, "") if unit == "1" else notation.prefixed(abs(value), unit)
    times = "× " if shown.startswith("10") else ""
    text = notation.signed_number if signed else notation.number
    return f"{text(value / factor, digits)} {times}{shown}".rstrip()


def range_words(low: float, high: float, unit: str) -> str:
    """An interval with one unit, or one for each end where they are far apart: "1 Hz–1 kHz".

    Args:
        low: lower end.
        high: upper end.
        unit: of both.
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value"
    if 0.0 < low < NOTHING * high:
        low = 0.0
    factor, shown = notation.prefixed(max(abs(low), abs(high)), unit)
    if high - low < 1e-3 * factor or not notation.unit_text(unit):
        factor, shown = 1.0, notation.unit_text(unit)
    if 0.0 < low < 1e-2 * high and shown:
        return f"{limit_words(low, unit, up=False)}–{limit_words(high, unit, up=True)}"
    ends = ((low / factor, False), (high / factor, True))
    # of many digits three are enough: 7.03e+06
    lower, upper = (notation.bound(x, 3, up=up) if abs(x) < MANY else f"{x:.3g}" for x, up in ends)
    between = " to " if low < 0.0 else "–"
    return f"{lower}{between}{upper} {shown}".rstrip()


def limit_words(value: float, unit: str, *, up: bool = True) -> str:
    """A bound of three digits, with a prefix that suits it.

    Args:
        value: in the unit.
        unit: of the value.
        up: whether it is an upper one, which is rounded up.
    """
    factor, shown = notation.prefixed(abs(float(f"{value:.3g}")), unit)
    return f"{notation.bound(value / factor, 3, up=up)} {shown}".strip()


def duration(seconds: tuple[float, float]) -> str:
    """A range of times in the unit that suits it: "2 to 3 min".

    Args:
        seconds: least and most, s.
    """
    low, high = seconds
    unit, size = next((unit, size) for limit, unit, size in TIMES if high < limit)
    return f"{two_digits(low / size)} to {two_digits(high / size)} {unit}"


def two_digits(value: float) -> str:
    """A count of two significant digits, without an exponent: "1,200".

    Args:
        value: at least zero.
    """
    if value <= 0.0:
        return "0"
    place = 1 - math.floor(math.log10(value))
    return f"{round(value, place):,.{max(0, place)}f}"


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
