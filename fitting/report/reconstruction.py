"""The report of a reconstruction: its page and the files next to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fitting.fit.fit import Status
from fitting.measurements.figure import Figure
from fitting.report.figures.inference import undrawn_sentence
from fitting.report.figures.reconstruction import FIRST, LAST, write_figures
from fitting.report.page import render, write_page
from fitting.report.published import write_values
from fitting.report.screen import phrase
from fitting.report.shown import ShownCampaign
from fitting.report.summary import summary_of
from fitting.result.result import Result
from fitting.simulate.budget import PlanRecord
from fitting.simulate.words import decision_in_words
from fitting.text.notation import scalar_words, signs_words

TEMPLATE = "reconstruction.html.j2"
#: What errors and intervals are, once for all of them.
CONVENTION = "± is 1σ, + and − those of each side; intervals are 95 % confidence intervals."


def write_report(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
    *,
    formats: Sequence[str] = (),
    interactive: bool = False,
) -> Path:
    """Draw the figures (`out_dir`/figures), write `report.html`, `values.csv` and `values.tex`.

    Returns the path of the page. The same result gives the same bytes.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        progress: called with the number of figures that are drawn, and of all.
        formats: of further files of each figure, "png" and "pdf".
        interactive: whether figures can be zoomed and read off, which needs Bokeh.

    Raises:
        BadInput: the folder cannot be written.
    """
    figures = write_figures(
        result, data, out_dir, progress, formats=formats, interactive=interactive
    )
    write_values(result, out_dir)
    return write_page(out_dir, TEMPLATE, **_content(result, data, figures))


def page_of(result: Result, data: ShownCampaign, figures: Sequence[Figure]) -> str:
    """The page as HTML text.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        figures: saved for the page.
    """
    return render(TEMPLATE, **_content(result, data, figures))


def _content(result: Result, data: ShownCampaign, figures: Sequence[Figure]) -> dict[str, Any]:
    """What the template is fed with."""
    summary = summary_of(result)
    lead = next((figure for figure in figures if figure.number == 1), None)
    rest = [figure for figure in figures if figure is not lead]
    converged, ground, message = (
        result.status == Status.CONVERGED,
        phrase("status", "ground", result.ending),
        result.message,
    )
    if converged or ground:
        first = ground[:1].upper() if ground[:1].isascii() else ground[:1]
        message = f"{first}{ground[1:]}." if ground else ""
    timed = "fit" if result.knowledge is None else "fit, profiles"
    spent = phrase("result", "spent", result)
    return {
        "title": result.title,
        "kind": "reconstruction",
        "status": summary.status,
        "message": message,
        "mark": "bad" if not converged else "" if result.ending.is_whole else "doubt",
        "synthetic": result.synthetic,
        "warnings": summary.warnings,
        "notes": [CONVENTION, *filter(None, [signs_words([*result.parameters, *result.derived])])],
        "lead": lead,
        "figures": rest,
        "published": True,
        "summary": summary,
        "result": result,
        "data": data,
        "known": result,
        "flat": undrawn_sentence(result, figures),
        # what other kinds of measurements show
        "measured": list(dict.fromkeys(f.name for f in rest if f.name not in {*FIRST, *LAST})),
        "plan_remarks": [*remarks(result.plan, result.provenance.plan), *data.notes],
        "campaign": {
            **data.settings,
            "cost": f"{spent} for {timed} and the plan, whose runs are not counted",
        },
        "continuation": {n: scalar_words(v) for n, v in result.provenance.settings.items()},
    }


def remarks(plan: PlanRecord | None, sentences: tuple[str, ...]) -> tuple[str, ...]:
    """Sentences of a plan that its table does not hold.

    Args:
        plan: settings, settling and windows, with what they promise.
        sentences: as they are shown.
    """
    if plan is None:
        return sentences
    rows = {decision_in_words(decision).lower() for decision in plan.decisions}
    return tuple(
        text
        for text in sentences
        if text.lower().removesuffix(".") not in rows and not text.startswith("In all: ")
    )
