"""What `fmu-fit identify` prints, and its page: what data determine, before or after a fit."""

from __future__ import annotations

import importlib
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fitting.inference.likelihood.knowledge import Identification
from fitting.report.page import write_page
from fitting.report.screen import phrase, printed_lines
from fitting.report.summary import EXPRESSED, Summary, design_command, warnings_of, with_values
from fitting.report.table import table
from fitting.text.estimate import Verdict


def identification_lines(
    result: Identification, files: Sequence[Path] = (), *, verbose: bool = False
) -> list[str]:
    """What `fmu-fit identify` prints: values with intervals, what is unconstrained, what is next.

    Args:
        result: what the data determine.
        files: identify.json, the report if there is one.
        verbose: whether directions, all intervals and their sentences are printed.
    """
    knowledge = result.knowledge
    # the outputs that the campaign asks for come first
    every = {n: v for n, v in {**result.derived, **result.parameters}.items() if n in result.scans}
    summary = Summary(
        title=result.title,
        status=phrase("identification", "status", result),
        synthetic=result.synthetic and "synthetic" not in result.title.lower(),
        warnings=warnings_of(
            (f for f in result.findings if f.severity != "note" and f.kind not in EXPRESSED), every
        ),
    )
    summary, left = with_values(summary, every)
    open_ = [name for name, value in left.items() if value.status is not Verdict.BOUNDED]
    words = shlex.split(result.provenance.get("command", ""))
    if open_ and words[:2] == ["fmu-fit", "identify"] and knowledge.adequacy.gives_values:
        at = result.at if "--at" in words else ""
        command = design_command(words[2:3], at, open_[0])
        summary = replace(
            summary, advice=phrase("next", "determine", open_[0], False), command=command
        )
    return printed_lines(
        "identification",
        "screen",
        result,
        summary,
        verbose,
        table("directions", knowledge=knowledge, tried=False) if knowledge.directions else None,
        None if result.part is None else table("part", whole=result, part=result.part),
        files,
    )


def write_report(result: Identification, out_dir: Path) -> Path:
    """Draw the figures (`out_dir`/figures), write `report.html` and return its path.

    Args:
        result: what the data determine.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    # matplotlib takes a second to import: only where something is drawn
    look = importlib.import_module("fitting.report.figures.style")
    drawn = importlib.import_module("fitting.report.figures.inference")
    order = (drawn.PROFILES, drawn.TOGETHER, drawn.OUTPUTS, drawn.NU)  # their numbers
    with look.style():
        figures = [
            look.save(
                planned.drawing(1 + order.index(planned.name)), out_dir / "figures", for_page=True
            )
            for planned in drawn.knowledge_figures(result, result.title, synthetic=result.synthetic)
        ]
    statuses = [value.status for value in result.profiled.values()]
    return write_page(
        out_dir,
        "identification.html.j2",
        title=result.title,
        kind="what the data determine",
        status="Identified",
        message=phrase("knowledge", "left", result),
        mark="" if all(status is Verdict.DETERMINED for status in statuses) else "bad",
        synthetic=result.synthetic,
        figures=figures,
        flat=drawn.undrawn_sentence(result, figures),
        known=result,
        part=result.part,
        origin={**result.provenance, "start point": result.at},
    )
