"""What result.json and its like hold, from the records that are written."""

from __future__ import annotations

import dataclasses
import enum
import functools
import re
import types
import typing
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from docs.site.docstrings import parts_of
from docs.site.markdown import code, escaped
from fitting.design.result import Design
from fitting.inference.likelihood.knowledge import Identification
from fitting.lines.line import Line
from fitting.lines.noise_spectrum import NoiseLine
from fitting.lines.record import LineNumber
from fitting.lines.ringdown import Ringdown
from fitting.posterior.summary import PosteriorSummary
from fitting.result.result import Result
from fitting.text.arrays import Scalar
from fitting.text.estimate import Estimate, Verdict
from fitting.text.finding import Kind
from fitting.text.schema import words_below_fields

INTRODUCTION = """\
# Files of results

`reconstruct` writes `result.json`, `identify` writes `identify.json`, `design` writes
`design.json`, `posterior` writes `posterior.json`: the
records below, key by key. A number that does not exist is `null`, an infinite one `"inf"`; numbers
keep all their digits. Brackets name the records that keys hold, or the words.
[result.schema.json](result.schema.json) has all of result.json as a JSON Schema,
[Files under `--out`](files.md) lists what else is written, [Findings](findings.md) every kind of
finding, and [What the data determine](../explanation/what-data-determine.md) explains the
verdicts."""
ROOTS: tuple[tuple[str, type[Any]], ...] = (
    ("result.json", Result),
    ("identify.json", Identification),
    ("design.json", Design),
    ("posterior.json", PosteriorSummary),
    ("line.json of a sweep", Line),
    ("line.json of a ringdown", Ringdown),
    ("line.json of a noise spectrum", NoiseLine),
)
OLD_KEYS = """\
## Keys of 0.2.0

`result.json` of 0.2.0 (schema 1) is read. In Python the old names work until 0.4, with a warning
that states the new one, and so do numbers of lines as plain numbers.
A number of a line is an [Estimate](#estimate); its keys that only fits use
are left out: `frequency_hz`, `frequency_std_hz` and `frequency_ci95_hz` are `frequency.value`,
`frequency.std` and `frequency.ci95`, and likewise of every number.

In schema 1 `knowledge.parameters` and `knowledge.derived` repeated the numbers of every value. Now
these are in `parameters` and `derived` alone, and the points of its profile (`values`,
`delta_chi2`, `path`) with `sigma` and `held` in `knowledge.scans`. `bars` and `precision` follow
from `ci68` and `ci95`, `knowledge.findings` are among the `findings`."""
PLAIN = {float: "number", int: "integer", str: "text", bool: "Boolean", Any: "anything"}
PLURAL = {"number": "numbers", "text": "texts", "integer": "integers"}
#: Words of an enumeration that are listed, at most; the schema has those of longer ones.
MOST_WORDS = 13


def page() -> str:
    """The page: the files, then every record that they hold."""
    parts, seen = [INTRODUCTION], set[Any]()
    for name, root in ROOTS:
        parts.append(f"## {name}")
        for record in _with_bases(_records(root)):
            if record not in seen:
                seen.add(record)
                parts += [] if record is root else [f"### {record.__name__}"]
                parts += _described(record)
    parts.append(OLD_KEYS)
    return "\n\n".join(part for part in parts if part)


def _records(record: type[Any]) -> list[type[Any]]:
    """A record and all that it holds, each once and behind the one that it is derived from."""
    met = [record]
    for kind in met:  # which grows
        held = [each for hint in typing.get_type_hints(kind).values() for each in _inside(hint)]
        met += [
            each
            for each in dict.fromkeys(held)
            if isinstance(each, type)
            and dataclasses.is_dataclass(each)
            and each not in (*met, LineNumber)
        ]
    return met


@functools.cache
def _bases() -> set[type[Any]]:
    """Records that several others are derived from; one that is derived alone has its keys."""
    held = {record for _, root in ROOTS for record in _records(root)}
    count = Counter(base for record in held for base in record.__mro__[1:])
    return {
        kind for kind, n in count.items() if n > 1 and getattr(kind, "__dataclass_fields__", None)
    }


def _inside(kind: Any) -> Iterator[Any]:
    yield kind
    for inner in typing.get_args(kind):
        yield from _inside(inner)


def _base(record: type[Any]) -> type[Any] | None:
    """The nearest of these that a record is derived from."""
    return next((base for base in record.__mro__[1:] if base in _bases()), None)


def _with_bases(records: list[type[Any]]) -> Iterator[type[Any]]:
    """Records, and behind each the ones that it is derived from."""
    for record in records:
        kind: type[Any] | None = record
        while kind is not None:
            yield kind
            kind = _base(kind)


def _own(record: type[Any]) -> list[dataclasses.Field[Any]]:
    """The fields of a record that the one that it is derived from has not, or of another kind."""
    base = _base(record)
    inherited = {} if base is None else typing.get_type_hints(base)
    hints = typing.get_type_hints(record)
    fields = dataclasses.fields(record)
    return [each for each in fields if inherited.get(each.name) != hints[each.name]]


def _described(record: type[Any]) -> Iterator[str]:
    """What a record is, its keys with a meaning a line each, then the others by kind."""
    prose, sections = parts_of(record)
    # a dataclass without a docstring has one that depends on the version of Python
    yield "" if prose.startswith(f"{record.__name__}(") else escaped(prose)
    listed = [*sections.get("Args", ()), *sections.get("Attributes", ())]
    words = words_below_fields(record) | {
        name: text for names, text in listed for name in names.split(", ")
    }
    hints = typing.get_type_hints(record)
    base = _base(record)
    lines = [f"Keys of {_word(base)}, and:"] if base else []
    by_kind = dict[str, list[str]]()
    for field in _own(record):
        kind = _word(hints[field.name])
        kind = kind if re.search(r'\]\(|"', kind) else ""  # of plain values the names are enough
        if text := words.get(field.name):
            lines.append(f"- `{field.name}`{_in_brackets(kind)}: {escaped(text)}")
        elif f"`{field.name}`" not in prose or "](#" in kind:
            by_kind.setdefault(kind, []).append(code(field.name))
    if lines[1:] or not base:
        yield "\n".join(lines).replace("and:\n", "and:\n\n")
    rest = "; ".join(f"{', '.join(names)}{_in_brackets(kind)}" for kind, names in by_kind.items())
    if base and not lines[1:]:
        yield f"Keys of {_word(base)}{', and ' * bool(rest)}{rest}."
    elif rest:
        yield f"{'Also' if lines or '`' in prose else 'Keys:'} {rest}."


def _in_brackets(kind: str) -> str:
    return f" ({kind})" if kind else ""


def _word(kind: Any) -> str:
    """A type in words, with links to records."""
    if kind in PLAIN:
        return PLAIN[kind]
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if kind == Scalar:
        return "plain value"
    if origin in (typing.Union, types.UnionType):
        words = [_word(each) for each in inner if each is not type(None)]
        return " or ".join(dict.fromkeys([*words, *(["`null`"] if type(None) in inner else [])]))
    if origin is tuple:
        word = _word(inner[0])
        if inner[-1] is Ellipsis:
            return f"list of {PLURAL.get(word, word)}"
        return f"two {PLURAL.get(word, f'of {word}')}"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        word = _word(inner[1])
        return f"{PLURAL.get(word, word)} by name"
    if kind is Kind:
        return "a kind of [findings](findings.md)"
    if isinstance(kind, type) and issubclass(kind, Verdict):
        return "a verdict"
    names = list(inner) if origin is typing.Literal else []
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        names = [member.value for member in kind]
    if names:
        return (
            ", ".join(code(f'"{name}"') for name in names) if len(names) <= MOST_WORDS else "a word"
        )
    if kind is LineNumber:
        return _word(Estimate)
    if dataclasses.is_dataclass(kind):
        name = typing.cast(type[Any], kind).__name__
        return f"[{name}](#{name.lower()})"
    return code(getattr(kind, "__name__", str(kind)))
