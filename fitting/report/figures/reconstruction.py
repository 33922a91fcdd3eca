"""The figures of a reconstruction: which belong to a campaign, their numbers, drawn and saved.

Numbers are the same on the page and before the names of files. They follow the order of the page
and depend on the campaign alone, not on how its fit went: what a fit may or may not have to show
keeps its number, so that a figure has one number in every fit.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fitting.measurements.figure import Figure
from fitting.report.figures.fit import CONVERGENCE, DERIVED, draw_convergence, draw_derived, varying
from fitting.report.figures.inference import NU, OUTPUTS, PROFILES, TOGETHER, knowledge_figures
from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.style import Planned, lay_out, save, style
from fitting.report.figures.tones import (
    DRIVE,
    IMPROVEMENT,
    OVER_FREQUENCY,
    PER_EXPERIMENT,
    draw_drive,
    draw_improvement,
    draw_over_frequency,
    draw_per_experiment,
)
from fitting.report.screen import phrase
from fitting.report.shown import ShownCampaign, shares_of
from fitting.result.result import Result
from fitting.text.results_folder import write_whole

FOLDER = "figures"
SPECTRA, PHASES, RESPONSE = "spectra", "phases", "frequency_response"
#: Before and after figures that no list names: those of other kinds of measurements.
FIRST = (PROFILES, TOGETHER, OUTPUTS, DRIVE, SPECTRA, PHASES, RESPONSE)
LAST = (OVER_FREQUENCY, IMPROVEMENT, PER_EXPERIMENT, CONVERGENCE, NU, DERIVED)
#: Of several figures of measurements these show least at once: any other goes first.
SELDOM_LEADING = (SPECTRA, PHASES)
#: What draws figures that no measurement describes, and no inference.
DRAWS: dict[str, Callable[[Result, ShownCampaign], Figure]] = {
    DRIVE: draw_drive,
    OVER_FREQUENCY: draw_over_frequency,
    IMPROVEMENT: draw_improvement,
    PER_EXPERIMENT: draw_per_experiment,
    CONVERGENCE: draw_convergence,
    DERIVED: draw_derived,
}
#: Figures over frequency: of campaigns that were fitted together every one has its own.
ALONG_FREQUENCY = (DRIVE, OVER_FREQUENCY, IMPROVEMENT)
#: Widths of figures for print, of one and of two columns, inches.
ONE_COLUMN, TWO_COLUMNS = 3.4, 7.0


def write_figures(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
    *,
    formats: Sequence[str] = (),
    interactive: bool = False,
) -> list[Figure]:
    """Draw every figure that the campaign has data for, as SVG and CSV.

    The same result gives the same bytes.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go, in its folder "figures".
        progress: called with the number of figures that are drawn, and of all.
        formats: of further files of each figure, "png" and "pdf".
        interactive: whether figures can be zoomed and read off, which needs Bokeh.

    Raises:
        BadInput: the folder cannot be written.
    """
    written = []
    planned = planned_figures(result, data)
    with style():
        for done, (number, figure) in enumerate(planned.items()):
            progress(done, len(planned))
            drawn = figure.drawing(int(number), len(number))
            saved = save(
                drawn, out_dir / FOLDER, formats=formats, for_page=True, interactive=interactive
            )
            written.append(saved)
    progress(len(planned), len(planned))
    return written


def write_paper_figures(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Path]:
    """The same figures as PDF for print, in the widths of one column and of two, without titles.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        progress: called with the number of figures that are drawn, and of all.

    Raises:
        BadInput: the folder cannot be written.
    """
    written: list[Path] = []
    planned = planned_figures(result, data)
    for k, width in enumerate((ONE_COLUMN, TWO_COLUMNS)):
        with style(paper_width=width):
            drawn = [figure.drawing(int(n), len(n)) for n, figure in planned.items()]
            progress(k * len(drawn), 2 * len(drawn))
            written += save_pdf(drawn, out_dir / FOLDER, width)
    return written


def save_pdf(figures: Sequence[Figure], folder: Path, width: float) -> list[Path]:
    """Write drawings of a width as PDF, whole or not at all; the same drawing, the same bytes.

    Args:
        figures: drawn in the style of that width.
        folder: where the files go.
        width: of all of them, inch; figures with panels side by side need two columns.

    Raises:
        BadInput: the folder cannot be written.
    """
    written = []
    for figure in figures:
        specs = [axes.get_subplotspec() for axes in figure.drawn.axes]
        if width < TWO_COLUMNS and any(spec and spec.get_gridspec().ncols > 1 for spec in specs):
            continue
        path = folder / f"{figure.stem}_{width:g}in.pdf"
        lay_out(figure.drawn)
        words = {"Title": figure.title, "Subject": figure.caption, "CreationDate": None}
        image = io.BytesIO()
        figure.drawn.savefig(image, format="pdf", metadata=words)
        write_whole(path, image.getvalue())
        written.append(path)
    return written


def planned_figures(result: Result, data: ShownCampaign) -> dict[str, Planned]:
    """Every figure that the campaign has data for, in order and by number, yet to be drawn.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    order = [DRIVE, OVER_FREQUENCY, IMPROVEMENT] if result.peaks else []
    order += [CONVERGENCE] if result.history else []
    order += [DERIVED] if result.peaks and varying(result) else []
    order += [PER_EXPERIMENT] if result.peaks else []
    parts = shares_of(result, data)
    planned = []
    for name in order:
        # campaigns may be far apart on that axis
        own = parts if name in ALONG_FREQUENCY and parts else [("", result, data)]
        for series, share, member in own:
            draw = partial(DRAWS[name], share, member)
            planned.append(Planned(name=name, draw=draw, series=series))
    planned += [Planned(name=f.name, draw=partial(draw_measurement, f, data)) for f in data.figures]
    if result.knowledge is not None:
        planned += knowledge_figures(result, data.title, synthetic=data.synthetic)
    # captions name numbers of the model, as the distance of its lines
    adequacy = result.ending.adequacy
    if adequacy is not None and not adequacy.gives_values:
        remark = phrase("figures", "withdrawn", adequacy)
        planned = [replace(each, remark=remark) for each in planned]
    return numbered(planned, result, [figure.name for figure in data.figures])


def numbered(
    planned: Sequence[Planned], result: Result, shown: Sequence[str]
) -> dict[str, Planned]:
    """The figures of a reconstruction in the order of the page, by their numbers.

    Args:
        planned: all figures that there is something for.
        result: of a reconstruction.
        shown: names of the figures of its measurements, of which one leads: it shows data, fit and
            residual at once.
    """
    leading = [figure for figure in planned if figure.name in shown]
    leading.sort(key=lambda figure: figure.name in SELDOM_LEADING)
    leading += [figure for figure in planned if figure.name == PER_EXPERIMENT]
    ordered = [figure for figure in planned if figure not in leading[:1]]
    ordered.sort(key=lambda figure: _place(figure.name))
    # figures that a fit of this campaign may have, and another may not
    reserved = {PROFILES, CONVERGENCE, NU}
    reserved |= {TOGETHER} if len(result.parameters) > 1 else set()
    reserved |= {OUTPUTS} if result.parameters and result.derived else set()
    missing = sorted(reserved - {figure.name for figure in planned}, key=_place)
    digits = len(str(len(planned) + len(missing)))
    made = {f"{1:0{digits}d}": figure for figure in leading[:1]}
    number = len(made)
    for figure in ordered:
        while missing and _place(missing[0]) < _place(figure.name):
            missing.pop(0)
            number += 1
        number += 1
        made[f"{number:0{digits}d}"] = figure
    return made


def _place(name: str) -> int:
    if name in LAST:
        return len(FIRST) + 1 + LAST.index(name)
    return FIRST.index(name) if name in FIRST else len(FIRST)
