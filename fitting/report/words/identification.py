"""What data determine in lines, as a terminal shows it."""

from __future__ import annotations

from fitting.inference.likelihood.knowledge import Identification
from fitting.report.table import text_lines
from fitting.report.tables.inference import direction_table
from fitting.report.words.inference import knowledge_lines


def identification_lines(found: Identification) -> list[str]:
    """What was found as lines of text.

    Args:
        found: what the data determine.
    """
    marked = found.synthetic and "synthetic" not in found.title.lower()
    kind = "measured data" if found.knowledge.data else "expected data"
    lines = [
        found.title + (" [synthetic]" if marked else ""),
        f"{kind}, set out from {found.at}",
        "",
    ]
    directions = direction_table(found.knowledge)
    if directions is not None:  # what was tried along them is told below
        lines += text_lines(directions.without("what was tried"))
    return [*lines, "", *knowledge_lines(found.knowledge)]
