"""What `fmu-fit reconstruct --verbose` prints after the first screen."""

from __future__ import annotations

from fitting.report.screen import screen
from fitting.report.table import table
from fitting.result.result import Result
from fitting.text.rendering import blocks


def detail_lines(result: Result) -> list[str]:
    """How the fit ended, the table of values, every finding, and its cost.

    Args:
        result: of a reconstruction.
    """
    return screen(
        "details",
        r=result,
        table=table("intervals", result=result, ends=False),
        plan="" if result.plan is None else str(blocks("plan").line(result.plan)),
    )
