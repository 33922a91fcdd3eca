"""The report of an identification: what data determine, before or after a fit."""

from __future__ import annotations

from pathlib import Path

from fitting.inference.likelihood.knowledge import Identification
from fitting.report.figures import inference as profile_figures
from fitting.report.figures.inference import NU, OUTPUTS, PROFILES, TOGETHER
from fitting.report.figures.style import save, style
from fitting.report.page import write_page
from fitting.report.screen import phrase
from fitting.text.estimate import Verdict

#: Numbers of the figures, each that of its kind.
ORDER = (PROFILES, TOGETHER, OUTPUTS, NU)


def write_report(result: Identification, out_dir: Path) -> Path:
    """Draw the figures (`out_dir`/figures), write `report.html` and return its path.

    Args:
        result: what the data determine.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    with style():
        figures = [
            save(planned.drawing(1 + ORDER.index(planned.name)), out_dir / "figures", for_page=True)
            for planned in profile_figures.knowledge_figures(
                result, result.title, synthetic=result.synthetic
            )
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
        flat=profile_figures.undrawn_sentence(result, figures),
        known=result,
        part=result.part,
        origin={**result.provenance, "start point": result.at},
    )
