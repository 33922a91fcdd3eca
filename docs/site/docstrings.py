"""Docstrings in parts: prose, and what each section lists."""

from __future__ import annotations

import inspect
import re

#: Headings of a docstring whose lines are names with what they mean.
SECTIONS = ("Args", "Attributes", "Returns", "Raises")
ITEM = re.compile(r" {4}\*{0,2}(\w+(?:, \w+)*): (.*)")


def parts_of(described: object) -> tuple[str, dict[str, list[tuple[str, str]]]]:
    """The prose of a docstring, and names with texts by section; what is returned has no name.

    Args:
        described: has the docstring, with code in single or double back quotes.
    """
    doc = (inspect.getdoc(described) or "").replace("``", "`")
    prose: list[str] = []
    sections: dict[str, list[tuple[str, str]]] = {}
    section = ""
    for line in doc.splitlines():
        item = ITEM.fullmatch(line)
        if line[:-1] in SECTIONS and line.endswith(":"):
            section = line[:-1]
            sections[section] = []
        elif section and line.startswith("    "):
            items = sections[section]
            if item and section != "Returns":
                items.append((item[1], item[2]))
            else:
                name, text = items.pop() if items else ("", "")
                items.append((name, f"{text} {line.strip()}".strip()))
        else:
            section = section if not line else ""
            prose.append(line)
    return re.sub(r"\n{3,}", "\n\n", "\n".join(prose)).strip(), sections
