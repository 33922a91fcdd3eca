"""The names of the package, from its front door; their docstrings are put in by the site."""

from __future__ import annotations

import inspect

import fitting
from docs.site.markdown import table

INTRODUCTION = """\
# Python

Everything that the commands do is behind `import fitting as ff`. Nothing else is promised. The
site (`mkdocs serve -f docs/site/mkdocs.yml`) and `help(ff.fit)` show arguments with their shapes
and units, and what is raised."""


def page() -> str:
    """The page: a table of all names, then each with its signature and docstring."""
    names = [name for name in fitting.__all__ if not name.startswith("_")]
    rows = [(f"[`ff.{name}`](#ff{name.lower()})", _summary(name)) for name in names]
    parts = [INTRODUCTION, table(("name", "is"), rows)]
    for name in names:
        parts += [f"## ff.{name}", f"::: {_home(name)}"]
    return "\n\n".join(parts)


def _home(name: str) -> str:
    """Where it is defined: some functions have the names of rooms, which the site would show."""
    found = getattr(fitting, name)
    return found.__name__ if inspect.ismodule(found) else f"{found.__module__}.{found.__name__}"


def _summary(name: str) -> str:
    return (inspect.getdoc(getattr(fitting, name)) or "").partition("\n\n")[0]
