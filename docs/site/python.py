"""The public names of the package with their signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import fitting
from docs.site.markdown import table

INTRODUCTION = """\
# Python

Everything that the commands do is in `import fitting as ff`. Nothing else is promised.
`help(ff.fit)` and `fmu-fit help python` print the same."""
#: Headings of a docstring whose lines are names with what they mean.
SECTIONS = ("Args:", "Attributes:", "Returns:", "Raises:")
#: Classes whose properties and methods are listed; `help` has those of the others.
WITH_MEMBERS = ("Problem", "Fmu", "Value", "Fit", "Inference")


def page() -> str:
    """The page: a table of all names, then each with its signature and docstring."""
    names = [name for name in fitting.__all__ if not name.startswith("_")]
    rows = [(f"[`ff.{name}`](#{_anchor(name)})", _summary(name)) for name in names]
    parts = [INTRODUCTION, table(("name", "is"), rows)]
    for name in names:
        parts += [f'<a id="{_anchor(name)}"></a>', f"## ff.{name}"]
        parts += _described(f"ff.{name}", getattr(fitting, name))
    return "\n\n".join(parts)


def _anchor(name: str) -> str:
    """Classes and functions of one name differ in capitals alone, which anchors may not."""
    return f"{'class' if name[0].isupper() else 'function'}-{name.lower()}"


def _summary(name: str) -> str:
    return (inspect.getdoc(getattr(fitting, name)) or "").partition("\n\n")[0]


def _described(name: str, found: Any) -> Iterator[str]:
    """Signature, docstring and public members of a class; the functions of a module."""
    if inspect.ismodule(found):
        yield _text(inspect.getdoc(found) or "")
        for member in found.__all__:
            yield f"### {name}.{member}"
            yield from _described(f"{name}.{member}", getattr(found, member))
        return
    is_exception = inspect.isclass(found) and issubclass(found, Exception)
    if not is_exception:
        yield f"```python\n{name}{_signature(found)}\n```"
    yield _text(inspect.getdoc(found) or "")
    if not inspect.isclass(found) or found.__name__ not in WITH_MEMBERS:
        return
    members = _members(found)
    properties = [(n, inspect.getdoc(v) or "") for n, v in members if not callable(v)]
    if properties:
        rows = ((f"`{n}`", doc.partition("\n\n")[0].replace("``", "`")) for n, doc in properties)
        yield table(("attribute", "is"), rows)
    for member, value in members[len(properties) :]:
        yield f"### {name}.{member}"
        yield from _described(f"{name}.{member}", value)


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


def _signature(found: Any) -> str:
    """The signature as it is written, types without their modules."""
    try:
        signature = inspect.signature(found)
    except ValueError:
        return ""
    text = re.sub(r"(: |-> )'([^']*)'", r"\1\2", str(signature))
    text = re.sub(r"<factory>|<class \S+>|<function .*? at \w+>", "...", text)
    text = re.sub(r"\b(?:[a-z_]+\.)+([A-Za-z]\w*)", r"\1", text)
    text = text.removesuffix(" -> None").replace("(self, ", "(").replace("(self)", "()")
    if len(text) <= 80:
        return text
    inside, arrow, returns = text.rpartition(") -> ")
    if not arrow:
        inside, returns = text.removesuffix(")"), ""
    arguments = re.split(r", (?![^\[(]*[\])])", inside.removeprefix("("))
    lines = "".join(f"    {argument},\n" for argument in arguments)
    return f"(\n{lines})" + (f" -> {returns}" if returns else "")


def _text(doc: str) -> str:
    """A docstring as a page has it: sections as lists, formulas as they are indented."""
    made: list[str] = []
    section = False
    for line in doc.splitlines():
        row = re.fullmatch(r"(\w+) {2,}(.+)", line)
        item = re.match(r"    (\*{0,2}\w+(?:, \w+)*): (.*)", line)
        if line in SECTIONS:
            section = True
            made += [f"**{line.removesuffix(':')}**", ""]
        elif section and item:
            made.append(f"- `{item[1].lstrip('*')}`: {item[2].replace('``', '`')}")
        elif section and line.startswith("    "):
            made.append(f"  {line.strip()}".replace("``", "`"))
        elif row:
            made.append(f"- `{row[1]}`: {row[2]}")
        else:
            section = section and not line.strip()
            made.append(line.replace("``", "`"))
    return "\n".join(made).strip()
