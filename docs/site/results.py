"""What result.json and its like hold, from the records that are written."""

from __future__ import annotations

import dataclasses
import enum
import inspect
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from docs.site.markdown import code, escaped, table
from fitting.design.result import Design, Ways
from fitting.inference.likelihood.knowledge import Identification
from fitting.lines import record as line_record
from fitting.lines.line import Line
from fitting.lines.noise_spectrum import NoiseLine
from fitting.lines.ringdown import Ringdown
from fitting.posterior.summary import PosteriorSummary
from fitting.result.result import Result
from fitting.text import old_names
from fitting.text.arrays import Scalar
from fitting.text.estimate import Verdict
from fitting.text.schema import words_below_fields

INTRODUCTION = """\
# Files of results

`reconstruct` writes `result.json`, `identify` writes `identify.json`, `design` writes
`design.json`, or `ways.json` where kinds are compared, `posterior` writes `posterior.json`: the
records below, key by key. A number that does not exist is `null`, an infinite one `"inf"`; numbers
keep all their digits. [Files under `--out`](files.md) lists what else is written,
[Findings](findings.md) every kind of finding, and
[What the data determine](../explanation/what-data-determine.md) explains the verdicts."""
ROOTS: tuple[tuple[str, type[Any]], ...] = (
    ("result.json", Result),
    ("identify.json", Identification),
    ("design.json", Design),
    ("ways.json", Ways),
    ("posterior.json", PosteriorSummary),
    ("line.json of a sweep", Line),
    ("line.json of a ringdown", Ringdown),
    ("line.json of a noise spectrum", NoiseLine),
)
#: Sections of old keys: of which records, and where each is.
RENAMED: tuple[tuple[str, Mapping[str, str]], ...] = (
    ("values", old_names.RENAMED),
    ("lines (`line.json`, `line --json`, `line` of result.json)", line_record.RENAMED),
)
OLD_KEYS = """\
## Keys of 0.2.0

`result.json` of 0.2.0 (schema 1) is read. In Python the old names work until 0.4, with a warning;
`q`, `amplitude`, `power`, `rms` and qualities of a dip work as numbers until then, with a warning.
A number of a line is a value with `value`, `std`, `ci95` and `unit`; its keys that only fits use
are left out.

In schema 1 `knowledge.parameters` and `knowledge.derived` repeated the numbers of every value. Now
these are in `parameters` and `derived` alone, and the points of its profile (`values`,
`delta_chi2`, `path`) with `sigma` and `held` in `knowledge.scans`. `bars` and `precision` follow
from `ci68` and `ci95`, `knowledge.findings` are among the `findings`."""
PLAIN = {float: "number", int: "whole number", str: "text", bool: "true or false", Any: "anything"}


def page() -> str:
    """The page: the files, then every record that they hold."""
    parts, seen = [INTRODUCTION], set[Any]()
    for name, root in ROOTS:
        parts.append(f"## {name}")
        for record in _records(root):
            if record in seen:
                continue
            seen.add(record)
            if record is not root:
                parts.append(f"### {_anchor(record)}")
            parts += [_told(record), _fields(record)]
    parts.append(OLD_KEYS)
    for name, renamed in RENAMED:
        rows = [(code(old), code(new)) for old, new in renamed.items()]
        parts += [f"Of {name}:", table(("0.2.0", "now"), rows)]
    return "\n\n".join(parts)


def _records(record: type[Any]) -> Iterator[type[Any]]:
    """A record and all that it holds, each once, in the order in which they are met."""
    met, waiting = {record: None}, [record]
    while waiting:
        hints = typing.get_type_hints(waiting.pop(0))
        for field_kind in hints.values():
            for kind in _inside(field_kind):
                if dataclasses.is_dataclass(kind) and kind not in met:
                    met[typing.cast(type[Any], kind)] = None
                    waiting.append(typing.cast(type[Any], kind))
    return iter(met)


def _inside(kind: Any) -> Iterator[Any]:
    yield kind
    for inner in typing.get_args(kind):
        yield from _inside(inner)


def _anchor(record: type[Any]) -> str:
    return record.__name__


def _told(record: type[Any]) -> str:
    told = inspect.getdoc(record) or ""
    # a dataclass without a docstring has one that depends on the version of Python
    return "" if told.startswith(f"{record.__name__}(") else escaped(told)


def _fields(record: type[Any]) -> str:
    hints = typing.get_type_hints(record)
    words = words_below_fields(record)
    names = [field.name for field in dataclasses.fields(record)]
    if not any(name in words for name in names):
        return table(("key", "holds"), ((code(name), _word(hints[name])) for name in names))
    rows = ((code(name), _word(hints[name]), words.get(name, "")) for name in names)
    return table(("key", "holds", "meaning"), rows)


def _word(kind: Any) -> str:
    """A type in words, with links to records."""
    if kind in PLAIN:
        return PLAIN[kind]
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if kind == Scalar:
        return "a plain value"
    if origin in (typing.Union, types.UnionType):
        words = [_word(each) for each in inner if each is not type(None)]
        return " or ".join(dict.fromkeys([*words, *(["`null`"] if type(None) in inner else [])]))
    if origin is tuple:
        if inner[-1] is Ellipsis:
            return f"list of {_plural(inner[0])}"
        return f"[{', '.join(map(_word, inner))}]"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"object: name to {_word(inner[1])}"
    if origin is typing.Literal:
        return ", ".join(code(f'"{word}"') for word in inner)
    if isinstance(kind, type) and issubclass(kind, Verdict):
        return "a verdict"
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return ", ".join(code(f'"{member.value}"') for member in kind)
    if dataclasses.is_dataclass(kind):
        name = _anchor(typing.cast(type[Any], kind))
        return f"[{name}](#{name.lower()})"
    return code(getattr(kind, "__name__", str(kind)))


def _plural(kind: Any) -> str:
    word = _word(kind)
    return {"number": "numbers", "text": "texts", "whole number": "whole numbers"}.get(word, word)
