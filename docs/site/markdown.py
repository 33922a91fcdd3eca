"""Tables and cells of Markdown, as GitHub and the site both read them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

CODE = re.compile(r"(`+[^`]+`+)")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; its cells are made fit for one line.

    Args:
        head: of its columns.
        rows: cells.
    """
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("|" + "".join(f" {cell(text)} |" for text in line) for line in lines)


def cell(text: str) -> str:
    """A text on one line, in which bars do not end the cell and brackets are no HTML.

    Args:
        text: with code in back quotes.
    """
    return escaped(" ".join(text.split())).replace("|", r"\|") or "–"


def escaped(text: str) -> str:
    """A text whose angle brackets and stars are plain characters, outside code.

    Args:
        text: with code in back quotes.
    """
    parts = CODE.split(text)
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"<(?=[A-Za-z/!])", "&lt;", parts[i]).replace("*", r"\*")
    return "".join(parts)


def code(text: str) -> str:
    """A text as code; nothing where it is empty.

    Args:
        text: of a line.
    """
    return f"`{text}`" if text else ""
