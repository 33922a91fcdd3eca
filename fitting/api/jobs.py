"""Whole jobs besides the fit: what data determine, the next measurements, a report."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.api.early import RESULT_FILES
from fitting.api.fitted import Fit, Inference, Valued
from fitting.api.printed import written
from fitting.api.problem import Problem
from fitting.engine.threads import one_thread
from fitting.fit.likelihood import Spent
from fitting.inference.determine import InferenceOptions
from fitting.inference.determine import identify as identify_through
from fitting.inference.likelihood.knowledge import Identification, PartAlone
from fitting.report.shown import shown_fit
from fitting.result.external import with_external
from fitting.result.provenance import require_same_data
from fitting.result.result import Result, write_result
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.choices import FORMATS, INTERACTIVE, PAPER, STYLES
from fitting.text.errors import BadInput
from fitting.text.old_names import renamed


@checked
@one_thread()
def identify(  # noqa: PLR0913 - keywords, of which most have defaults
    problem: Problem,
    at: Valued | Result | None = None,
    *,
    expected: bool = False,
    seed: int = 1,
    budget: int | None = None,
    bootstrap: int = 0,
    settings: Mapping[str, Scalar] | None = None,
    progress: Callable[[Spent], None] | None = None,
) -> Identification:
    """What data determine, before a fit or around one: directions, profiles, statuses.

    Args:
        problem: The problem.
        at: A fit to start from; None: the problem's start and references.
        expected: Data that the model expects there, with their noise, instead of the measured.
        seed: Of further starts and synthetic data, at least 0.
        budget: Runs of the FMU, about; incomplete searches are marked. None: 500,000, or 3,000
            evaluations if that is more.
        bootstrap: Synthetic data sets to refit; 0: none.
        settings: Also what measurements at these settings determine alone, as of `Problem.part`.
        progress: Called before every stage and batch with the stage and its evaluations.

    Returns:
        ``parameters`` and ``derived`` values, ``knowledge``, the start ``at``, and ``part``, the
        result at ``settings``.

    Raises:
        BadInput: the problem cannot be planned, the fit is of another one, or of other data, or
            settings that name no part of the measurements.
        FmuFailure: the FMU failed.
    """
    alone = problem.part(settings) if settings else None  # refused before the long run
    fitted = at.result if isinstance(at, Valued) else at
    if fitted is not None and not expected:  # else no measured value is looked at
        require_same_data(fitted, list(problem.record.campaigns.values()))
    record = problem.record
    provenance: dict[str, str] = {}
    units: dict[str, str] = {}
    if problem.has_fmu:
        description, variables = problem.fmu.description, problem.fmu.variables
        provenance = {"FMU": description.model_name, "FMU sha256": description.sha256}
        units = {name: variables[name].unit or "" for name in record.outputs}
    options = InferenceOptions(
        units=units,
        data=not expected,
        bootstrap=bootstrap,
        seed=seed,
        budget=budget,
        progress=progress or (lambda spent: None),
    )
    start = () if fitted is None else (fitted.fitted_values, fitted.alternative)
    determined = identify_through(record, problem.respond, options, *start)
    part = None
    if settings and alone is not None:
        options = replace(options, data=determined.knowledge.data, bootstrap=0)
        own = identify_through(alone.record, alone.respond, options)
        places, total = (
            sum(len(m.places) for m in each.record.measurements) for each in (alone, problem)
        )
        part = PartAlone(**vars(own), settings=dict(settings), places=places, total=total)
    return Identification(
        **vars(determined),
        title=record.title,
        synthetic=record.synthetic,
        at="the campaign's start and reference values" if fitted is None else "a fit",
        provenance={**provenance, "seed": str(seed)},
        part=part,
    )


@renamed
@checked
def report(
    result: Fit | Inference,
    out: str | Path,
    *,
    external: Sequence[str] = (),
    style: str = "report",
    formats: Sequence[str] = (),
) -> Path:
    """Write result.json, history.csv, values, figures and report.html, as the command does.

    Args:
        result: A fit or inference.
        out: Folder, made where there is none.
        external: Values from elsewhere to test, as "lambda=0.8604 MHz +- 1 kHz".
        style: "paper": figures also as PDF for print, without title, one or two columns wide;
            "interactive": figures can be zoomed, needs Bokeh.
        formats: Further formats of figures next to SVG and CSV: "png", "pdf".

    Returns:
        The path of report.html.

    Raises:
        BadInput: the folder cannot be written, another style or format, one whose library is not
            installed, or a value that the result has not.
    """
    check_style("report", style)
    for name in formats:
        if name not in FORMATS:
            raise BadInput(f"report: formats has {name!r}, wanted some of {', '.join(FORMATS)}")
    record = with_external(result.result, external)

    def write(to: Path) -> Path:
        write_result(record, to)
        return draw_report(result, record, to, style, formats=formats)

    return written(out, "reconstruct", RESULT_FILES, write)


def check_style(what: str, style: str) -> None:
    """Complain of a style that cannot be drawn.

    Args:
        what: is drawn in it.
        style: requested.

    Raises:
        BadInput: another style, or one whose library is not installed.
    """
    if style not in STYLES:
        raise BadInput(f"{what}: style is {style!r}, wanted one of {', '.join(STYLES)}")
    if style == INTERACTIVE and importlib.util.find_spec("bokeh") is None:
        raise BadInput(
            f"{what}: interactive figures need Bokeh: pip install 'fmu-fit[interactive]'"
        )


def draw_report(
    fitted: Valued,
    result: Result,
    out: Path,
    style: str = "report",
    progress: Callable[[int, int], None] = lambda done, of: None,
    formats: Sequence[str] = (),
) -> Path:
    """Figures and report.html of a result; the path of the page.

    Args:
        fitted: A fit, or what was inferred of one.
        result: Its result, with what was added to it.
        out: Folder.
        style: One of STYLES.
        progress: Is given how many figures are drawn, of how many.
        formats: Of further files of each figure, some of FORMATS.
    """
    shown = shown_fit(fitted.source.record)
    # matplotlib takes a second to import: only where something is drawn
    page = importlib.import_module("fitting.report.reconstruction")
    if style != PAPER:
        live = style == INTERACTIVE
        made = page.write_report(result, shown, out, progress, formats=formats, interactive=live)
        return Path(made)
    # for print every figure is drawn in two widths, then for the page
    importlib.import_module("fitting.report.figures.reconstruction").write_paper_figures(
        result, shown, out, lambda done, of: progress(done, of + of // 2)
    )
    last = page.write_report(
        result, shown, out, lambda done, of: progress(2 * of + done, 3 * of), formats=formats
    )
    return Path(last)
