"""The public names of the package with their arguments and docstrings."""

from __future__ import annotations

import functools
import inspect
import json
import re
from collections.abc import Iterator
from typing import Any

import fitting
from docs.site.commands import actions_of
from docs.site.docstrings import parts_of
from fitting.lines.record import MeasuredLine
from fitting.measurements.schema import campaign_schema

INTRODUCTION = """\
# Python

Everything that the commands do is in `import fitting as ff`. Nothing else is promised. Wrong input
raises `BadInput`, an FMU that fails `FmuFailure`: `help(ff.fit)` lists when. An argument is
described where it comes first, or by the key of its name in [campaign.toml](campaign.md) or the
option in [Commands](commands.md); `help` describes it everywhere, with its type, and those of
methods and plots. A default that the text names (None, empty) is not listed. Fields of records that
are returned are those of [Files of results](results.md)."""
#: Tables of campaign.toml whose keys mean what arguments of these names mean.
TABLES = {
    "ComplexCurve": "complex_sweep",
    "ControlSweep": "control_sweep",
    "DemodulatedTrace": "demodulated_trace",
    "Limits": "design",
    "Noise": "noise",
    "NoiseSpectrum": "noise_spectrum",
    "Parameter": "parameters",
    "Sweep": "sweep",
    "Tikhonov": "continuation",
    "Tones": "experiments",
    "Trace": "trace",
}
#: Commands whose options mean what arguments of these names mean.
OPTIONS = {
    "Accuracy": "simulate",
    "Columns": "line",
    "EnsembleOptions": "ensemble",
    "Goal": "design",
    "Sampling": "posterior",
    "calibrate": "calibrate",
    "check": "check",
    "cost": "reconstruct",
    "ensemble": "ensemble",
    "fit": "reconstruct",
    "identify": "identify",
    "line": "line",
    "report": "reconstruct",
    "ringdown": "line",
    "tradeoff": "tradeoff",
}
UNIT = re.compile(r"_(s|hz)$")
#: Classes whose properties and methods are listed; `help` has those of the others.
WITH_MEMBERS = ("Problem", "Fmu", "Value", "Fit", "Inference")
#: Returned as the type states it.
FILES = "The files."
#: Words of an argument's description from which it is not repeated.
REPEATED = 4


def page() -> str:
    """The page: every name with its arguments and docstring."""
    parts, described = [INTRODUCTION], dict[tuple[str, str], str]()
    for name in (name for name in fitting.__all__ if not name.startswith("_")):
        parts.append(f"## ff.{name}")
        parts += _described(f"ff.{name}", getattr(fitting, name), described)
    return "\n\n".join(part for part in parts if part)


def _described(name: str, value: Any, described: dict[tuple[str, str], str]) -> Iterator[str]:
    """Docstring, arguments and public members of a class; the functions of a module.

    Args:
        name: as it is called.
        value: has this name.
        described: where an argument with a description was listed first; is added to.
    """
    prose, sections = parts_of(value)
    if inspect.ismodule(value):
        yield re.sub(r"^\w+ {2,}.*\n?", "", prose, flags=re.MULTILINE).replace("\n\n\n", "\n\n")
        yield "\n".join(_call(member, getattr(value, member)) for member in value.__all__)
        return
    yield prose
    if "Args" in sections or not inspect.isclass(value):
        yield _arguments(name, value, dict(sections.get("Args", ())), described)
    if not (inspect.isclass(value) and issubclass(value, MeasuredLine)):  # in Files of results
        yield "\n".join(f"- `{key}`: {text}" for key, text in sections.get("Attributes", ()))
    if not inspect.isclass(value):
        kind = _type(inspect.signature(value).return_annotation)
        text = "".join(f": {text}" for _, text in sections.get("Returns", ()) if text != FILES)
        yield f"Returns `{kind}`{text or '.'}" if kind != "None" else ""
    elif value.__name__ in WITH_MEMBERS:
        yield "With:"
        yield "\n".join(
            _call(member, inner) if callable(inner) else f"- `{member}`: {_sentence(inner)}"
            for member, inner in _members(value)
        )


def _sentence(value: Any) -> str:
    return " ".join(parts_of(value)[0].partition("\n\n")[0].split())


def _call(name: str, value: Any) -> str:
    """A function in a line: the names of its arguments, and what it does."""
    names = [key for key in inspect.signature(value).parameters if key != "self"]
    return f"- `{name}({', '.join(names)})`: {_sentence(value)}"


def _members(kind: type) -> list[tuple[str, Any]]:
    """Documented members of a class, properties first; each once."""
    members = []
    for name in dict.fromkeys(n for base in kind.__mro__ for n in vars(base)):
        base = next(base for base in kind.__mro__ if name in vars(base))
        value = inspect.getattr_static(kind, name)
        if not (isinstance(value, property) or type(value).__name__ == "cached_property"):
            value = getattr(kind, name)
        first = next(
            public for public in WITH_MEMBERS if issubclass(getattr(fitting, public), base)
        )
        public = base.__module__.startswith("fitting.api") and not name.startswith("_")
        shown = callable(value) or hasattr(value, "__get__")
        if public and shown and first == kind.__name__ and inspect.getdoc(value):
            members.append((name, value))
    return sorted(members, key=lambda each: callable(each[1]))


def _arguments(
    name: str, value: Any, texts: dict[str, str], described: dict[tuple[str, str], str]
) -> str:
    """A line for each argument; optional ones that were described before are on the last."""
    table, command = (by.get(name.removeprefix("ff."), "") for by in (TABLES, OPTIONS))
    keys = _keys().get(table, ())
    options = {
        option.removeprefix("--").replace("-", "_")
        for action in (actions_of(command) if command else ())
        for option in action.option_strings
    }
    lines = list[str]()
    before = dict[str, list[str]]()
    for key, parameter in inspect.signature(value).parameters.items():
        if key == "self":
            continue
        text = texts.get(key, "")
        first = described.setdefault((key, text), f"`{name}`")
        if key in keys:
            first = f"[`{table}`](campaign.md#{table})"
        elif UNIT.sub("", key) in options:
            first = f"[`{command}`](commands.md#{command})"
        is_repeated = first != f"`{name}`" and len(text.split()) >= REPEATED
        if is_repeated and parameter.default is parameter.empty:
            lines.append(_argument(parameter, f"as of {first}."))
        elif is_repeated:
            before.setdefault(first, []).append(f"`{key}`")
        else:
            if parameter.kind is parameter.KEYWORD_ONLY and "By keyword:" not in lines:
                lines += ["", "By keyword:", ""]
            lines.append(_argument(parameter, text))
    also = "; ".join(f"as of {first}: {', '.join(keys)}" for first, keys in before.items())
    return "\n".join([*lines, "", f"Also {also}." if also else ""]).strip()


@functools.cache
def _keys() -> dict[str, frozenset[str]]:
    """The keys of each table of campaign.toml."""
    tables = json.loads(campaign_schema())["properties"]
    inner = {name: table.get("items", table) for name, table in tables.items()}
    return {name: frozenset(table.get("properties", ())) for name, table in inner.items()}


def _argument(parameter: inspect.Parameter, text: str) -> str:
    """An argument with its public type, a default that the text does not name, and the text."""
    usual, kind = parameter.default, _type(parameter.annotation).removesuffix(" | None")
    is_public = any(word in fitting.__all__ for word in re.findall(r"[A-Z]\w+", kind))
    is_made = usual is parameter.empty or re.match(r"<factory>|<class |<function ", repr(usual))
    is_named = usual is None or (usual in ("", ()) and re.search("(empty|none): ", text))
    shown = "" if is_made or is_named else f" = {usual!r}"
    return f"- `{parameter.name}{f': {kind}' if is_public else ''}{shown}`: {text}"


def _type(annotation: Any) -> str:
    """A type as it is written, without modules."""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    return re.sub(r"\b(?:[a-z_]+\.)+([A-Za-z]\w*)", r"\1", text)
