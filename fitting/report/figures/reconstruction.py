"""The figures of a reconstruction: which belong to a campaign, drawn and saved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fitting.report.figures.file import FigureFile
from fitting.report.figures.fit import draw_convergence, draw_derived, varying
from fitting.report.figures.inference import knowledge_figures
from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.numbers import (
    CONVERGENCE,
    DERIVED,
    DRIVE,
    IMPROVEMENT,
    OVER_FREQUENCY,
    PER_EXPERIMENT,
    SPECTRA,
    numbered,
)
from fitting.report.figures.paper import ONE_COLUMN, TWO_COLUMNS, save_pdf
from fitting.report.figures.style import Drawing, Planned, save, style
from fitting.report.figures.tones import (
    draw_drive,
    draw_improvement,
    draw_over_frequency,
    draw_per_experiment,
)
from fitting.report.shown import ShownCampaign, shares_of
from fitting.result.result import Compared, Result

FOLDER = "figures"
#: Names of the figures of any reconstruction.
NAMES: dict[Callable[[Result, ShownCampaign], Drawing], str] = {
    draw_drive: DRIVE,
    draw_over_frequency: OVER_FREQUENCY,
    draw_improvement: IMPROVEMENT,
    draw_convergence: CONVERGENCE,
    draw_derived: DERIVED,
    draw_per_experiment: PER_EXPERIMENT,
}
#: Figures of peaks beside those of the model: no inference changes them.
OF_PEAKS: tuple[Callable[[Compared, ShownCampaign], Drawing], ...] = (
    draw_drive,
    draw_over_frequency,
    draw_improvement,
    draw_per_experiment,
)
#: Figures that take longest: of several that draw, whoever began one last would be waited for.
LONGEST = (CONVERGENCE, SPECTRA, DRIVE)
#: Figures over frequency: of campaigns that were fitted together every one has its own.
ALONG_FREQUENCY = (draw_drive, draw_over_frequency, draw_improvement)


def write_figures(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[FigureFile]:
    """Draw every figure that the campaign has data for, as SVG, PNG and CSV in `out_dir`/figures.

    The same result gives the same bytes.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        progress: is told how many are drawn, of how many.

    Raises:
        BadInput: the folder cannot be written.
    """
    written = []
    planned = planned_figures(result, data)
    for done, figure in enumerate(planned):
        progress(done, len(planned))
        written.append(write_figure(figure, out_dir))
    progress(len(planned), len(planned))
    return written


def write_figure(planned: Planned, out_dir: Path) -> FigureFile:
    """Draw one of these figures; the same bytes, whatever was drawn before.

    Args:
        planned: what is drawn.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    with style():
        return save(planned.drawing(), out_dir / FOLDER, for_page=True)


def write_paper_figures(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Path]:
    """The same figures as PDF for print, in the widths of one column and of two.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        progress: is told how many are drawn, of how many.

    Raises:
        BadInput: the folder cannot be written.
    """
    written: list[Path] = []
    widths = (ONE_COLUMN, TWO_COLUMNS)
    for k, width in enumerate(widths):
        with style(paper_width=width):
            drawn = [planned.drawing() for planned in planned_figures(result, data)]
            progress(k * len(drawn), len(widths) * len(drawn))
            written += save_pdf(drawn, out_dir / FOLDER, width)
    return written


def planned_figures(result: Result, data: ShownCampaign) -> list[Planned]:
    """Every figure that the campaign has data for, in order and numbered, yet to be drawn.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    parts = shares_of(result, data)
    planned = []
    for draw in figures_of(result, data):
        made = partial(draw, result, data)
        draws: list[Callable[[], Drawing]] = [made]
        if parts and draw in ALONG_FREQUENCY:  # campaigns may be far apart on that axis
            draws = [partial(_of_series, draw, *part) for part in parts]
        planned += [Planned(name=NAMES[draw], draw=own) for own in draws]
    planned += [
        Planned(name=described.name, draw=partial(draw_measurement, described, data))
        for described in data.figures
    ]
    if result.knowledge is not None:
        planned += knowledge_figures(result, data.title, synthetic=data.synthetic)
    return numbered(planned, result, [described.name for described in data.figures])


def _of_series(
    draw: Callable[[Result, ShownCampaign], Drawing],
    series: str,
    share: Result,
    member: ShownCampaign,
) -> Drawing:
    """A figure of one campaign of several."""
    drawing = draw(share, member)
    return replace(drawing, series=series, title=f"{drawing.title}, {series}")


def longest_first(planned: Sequence[Planned]) -> list[Planned]:
    """Figures in the order in which several that draw begin them.

    Args:
        planned: figures in the order of the page.
    """
    ranks = {name: LONGEST.index(name) for name in LONGEST}
    return sorted(planned, key=lambda figure: ranks.get(figure.name, len(LONGEST)))


def settled(planned: Sequence[Planned], data: ShownCampaign) -> list[Planned]:
    """Figures that the fit alone settles: those of peaks, and what measurements show of themselves.

    They are the same bytes for results of the same peaks and deviations.

    Args:
        planned: all figures.
        data: what is shown of the campaign.
    """
    names = {NAMES[draw] for draw in OF_PEAKS} | {figure.name for figure in data.figures}
    return [figure for figure in planned if figure.name in names]


def figures_of(
    result: Result, data: ShownCampaign
) -> list[Callable[[Result, ShownCampaign], Drawing]]:
    """The figures to draw of any reconstruction, in order: those of peaks need experiments.

    What its measurements show of themselves is not among them (`ShownCampaign.figures`).

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    draws: list[Callable[[Result, ShownCampaign], Drawing]] = []
    if result.peaks:
        draws += [draw_drive, draw_over_frequency, draw_improvement]
    if result.history:
        draws.append(draw_convergence)
    if result.peaks and varying(result):
        draws.append(draw_derived)
    if result.peaks:
        draws.append(draw_per_experiment)
    return draws
