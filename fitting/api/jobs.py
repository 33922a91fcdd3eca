"""Whole jobs besides the fit: what data determine, the next measurements, a report."""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path

from fitting.api.choices import INTERACTIVE, PAPER, STYLES
from fitting.api.fitted import Fit, Valued
from fitting.api.problem import Problem
from fitting.api.written import RESULT_FILES
from fitting.engine.local import LocalProcesses
from fitting.engine.threads import one_thread
from fitting.inference.identification import IdentificationOptions
from fitting.inference.identification import identify as identify_through
from fitting.inference.likelihood.knowledge import Determined, Identification, PartAlone
from fitting.report.artists import Artists, Begun
from fitting.report.shown import shown_fit
from fitting.result.external import with_external
from fitting.result.result import Result, write_result
from fitting.result.same_data import require_same_data
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder
from fitting.text.scratch import Scratch

__all__ = [
    "DrawnBeside",
    "IdentificationOptions",
    "check_style",
    "draw_report",
    "drawn_beside",
    "identified",
    "identify",
    "report",
    "with_part",
]

#: Processes that draw: ten figures are soon drawn.
MOST_ARTISTS = 2


@checked
def identify(
    problem: Problem,
    at: Valued | Result | None = None,
    *,
    expected: bool = False,
    seed: int = 1,
    budget: int | None = None,
    bootstrap: int = 0,
) -> Identification:
    """What data determine, before any fit or around one: directions, profiles, verdicts.

    Args:
        problem: What is looked for, and from what.
        at: A fit to set out from; None: the problem's start and reference values.
        expected: Not the measured data, but those that the model expects there, with their noise.
        seed: Of further starts and of synthetic data sets, at least 0.
        budget: Runs of the FMU, about, at most; values whose search they cut say so. None: 500,000,
            or 3,000 evaluations where that is more.
        bootstrap: Synthetic data sets that are fitted anew; 0: none.

    Returns:
        ``parameters`` and ``derived`` hold the values, ``knowledge`` what was found besides,
        ``at`` says where it set out from. What a part of the measurements says alone:
        ``identify(problem.part({"depth": 0.0}))``.

    Raises:
        BadInput: the problem cannot be planned, or the fit is of another one, or of other data.
        FmuFailure: the FMU failed.
    """
    asked = IdentificationOptions(expected=expected, bootstrap=bootstrap, seed=seed, budget=budget)
    return identified(problem, at, asked)


@one_thread()
def identified(
    problem: Problem, at: Valued | Result | None, asked: IdentificationOptions
) -> Identification:
    """As `identify`, told how far it is.

    Args:
        problem: What is looked for, and from what.
        at: A fit to set out from; None: the problem's start and reference values.
        asked: Limits, and who is told.

    Raises:
        BadInput: the problem cannot be planned, or the fit is of another one, or of other data.
        FmuFailure: the FMU failed.
    """
    check_problem("identify", problem)
    fitted = at.result if isinstance(at, Valued) else at
    if fitted is not None and not asked.expected:  # else no measured value is looked at
        require_same_data(fitted, list(problem.record.campaigns.values()))
    if fitted is not None:
        asked = replace(asked, values=fitted.fitted_values, alternative=fitted.alternative)
    record = problem.record
    provenance: dict[str, str] = {}
    units: dict[str, str] = {}
    if problem.has_fmu:
        description = problem.fmu.description
        units = {name: description.variables[name].unit or "" for name in record.outputs}
        provenance = {"FMU": description.model_name, "FMU sha256": description.sha256}
    found = identify_through(record, problem.respond, units, asked)
    provenance["seed"] = str(asked.seed)
    return Identification(
        **vars(found),
        title=record.title,
        synthetic=record.synthetic,
        at="the campaign's start and reference values" if fitted is None else "a fit",
        provenance=provenance,
    )


def with_part(
    problem: Problem,
    found: Identification,
    settings: Mapping[str, Scalar],
    asked: IdentificationOptions,
) -> Identification:
    """The same with what was measured at some settings, and what that determines alone.

    Args:
        problem: What was identified.
        found: What all its measurements determine.
        settings: Values that places have, by name, as `Problem.part` takes them.
        asked: Limits, and who is told.

    Raises:
        BadInput: settings that name no part of the measurements.
        FmuFailure: the FMU failed.
    """
    alone = problem.part(settings)
    own = identified(alone, None, replace(asked, expected=not found.knowledge.data, bootstrap=0))
    places, total = len(_places(alone)), len(_places(problem))
    shared = {each.name: getattr(own, each.name) for each in fields(Determined)}
    part = PartAlone(**shared, settings=dict(settings), places=places, total=total)
    return replace(found, part=part)


def _places(problem: Problem) -> list[str]:
    return [label for m in problem.record.measurements for label, _ in m.places]


def check_problem(verb: str, problem: object) -> None:
    """Complain of what is no problem.

    Args:
        verb: What was called.
        problem: What it was given.

    Raises:
        BadInput: it is something else.
    """
    if not isinstance(problem, Problem):
        raise BadInput(f"{verb}: found a {type(problem).__name__}, wanted a Problem")


def report(
    found: Valued, out: str | Path, *, external: Sequence[str] = (), style: str = "report"
) -> Path:
    """Write what the command line writes: result.json, history.csv, values, figures, report.html.

    Args:
        found: A fit, or what was inferred of one.
        out: Folder, made where there is none.
        external: Values from elsewhere to test, as "lambda=0.8604 MHz +- 1 kHz".
        style: "paper" writes the figures as PDF for print, too: no title, one column or two wide;
            "interactive": figures of the page can be zoomed and read off, which needs Bokeh.

    Returns:
        The path of report.html.

    Raises:
        BadInput: the folder cannot be written, another style, one whose library is not installed,
            or a value that the result has not.
    """
    check_style("report", style)
    if not isinstance(found, Valued):
        raise BadInput(f"report: found a {type(found).__name__}, wanted a Fit or an Inference")
    result = with_external(found.result, external)
    with results_folder(Path(out), "reconstruct", RESULT_FILES):
        write_result(result, Path(out))
        page = draw_report(found, result, Path(out), style)
        remove_earlier(Path(out), RESULT_FILES)
        return page


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
    found: Valued,
    result: Result,
    out: Path,
    style: str = "report",
    progress: Callable[[int, int], None] = lambda done, of: None,
    drawing: DrawnBeside | None = None,
) -> Path:
    """Figures and report.html of a result; the path of the page.

    Args:
        found: A fit, or what was inferred of one.
        result: Its result, with what was added to it.
        out: Folder.
        style: One of STYLES.
        progress: Is told how many figures are drawn, of how many.
        drawing: Processes that draw beside this one; None: this one draws.
    """
    shown = shown_fit(found.source.record)
    if drawing is not None and style == STYLES[0]:
        with suppress(BrokenExecutor):  # somebody ended them: this one draws
            return drawing.artists.report(result, shown, out, drawing.begun)
    # matplotlib takes a second to import: only where something is drawn
    page = importlib.import_module("fitting.report.reconstruction")
    if style != PAPER:
        live = style == INTERACTIVE
        return Path(page.write_report(result, shown, out, progress, interactive=live))
    # for print every figure is drawn in two widths, then for the page
    importlib.import_module("fitting.report.figures.reconstruction").write_paper_figures(
        result, shown, out, lambda done, of: progress(done, of + of // 2)
    )
    last = page.write_report(result, shown, out, lambda done, of: progress(2 * of + done, 3 * of))
    return Path(last)


@dataclass
class DrawnBeside:
    """Processes that draw a report while this one works, and what they have begun."""

    artists: Artists
    begun: Begun | None = None

    def begin(self, fit: Fit) -> None:
        """Draw what is settled of a fit, while its values are inferred.

        Args:
            fit: A solved problem.
        """
        with suppress(BrokenExecutor):  # who draws the report sees that
            self.begun = self.artists.begin(fit.result, shown_fit(fit.record))


@contextmanager
def drawn_beside(wanted: bool) -> Iterator[DrawnBeside | None]:
    """Processes that draw a report, loading while others work; None on one processor.

    Args:
        wanted: Whether there will be a report.
    """
    count = min(MOST_ARTISTS, os.cpu_count() or 1)
    if not wanted or count < 2:
        yield None
        return
    with Scratch() as folder:
        executor = LocalProcesses(count)
        try:
            artists = Artists(executor, count, folder)
            artists.get_ready()
            yield DrawnBeside(artists)
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
