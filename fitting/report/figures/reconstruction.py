"""The figures of a reconstruction: which belong to a campaign, drawn and saved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from fitting.report.figures.file import FigureFile
from fitting.report.figures.fit import draw_convergence, draw_derived, varying
from fitting.report.figures.inference import knowledge_figures
from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.numbers import numbered
from fitting.report.figures.paper import ONE_COLUMN, TWO_COLUMNS, save_pdf
from fitting.report.figures.style import Drawing, save, style
from fitting.report.figures.tones import (
    draw_drive,
    draw_improvement,
    draw_over_frequency,
    draw_per_experiment,
)
from fitting.report.shown import ShownCampaign, shares_of
from fitting.result.result import Result

FOLDER = "figures"
#: Figures over frequency: of campaigns that were fitted together every one has its own.
ALONG_FREQUENCY = (draw_drive, draw_over_frequency, draw_improvement)


def write_figures(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    progress: Callable[[int, int], None] = lambda done, of: None,
    share: tuple[int, int] = (0, 1),
) -> list[FigureFile]:
    """Draw every figure that the campaign has data for, as SVG, PNG and CSV in `out_dir`/figures.

    The same result gives the same bytes.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
        out_dir: where the files go.
        progress: is told how many are drawn, of how many.
        share: which ones: from this on, each so many-th.

    Raises:
        BadInput: the folder cannot be written.
    """
    written = []
    with style():
        drawn = _drawings(result, data)
        for done in range(share[0], len(drawn), share[1]):
            progress(done, len(drawn))
            written.append(save(drawn[done], out_dir / FOLDER, for_page=True))
    progress(len(drawn), len(drawn))
    return written


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
            drawn = _drawings(result, data)
            progress(k * len(drawn), len(widths) * len(drawn))
            written += save_pdf(drawn, out_dir / FOLDER, width)
    return written


def _drawings(result: Result, data: ShownCampaign) -> list[Drawing]:
    """Every figure that the campaign has data for, in order and numbered."""
    parts = shares_of(result, data)
    drawn = []
    for draw in figures_of(result, data):
        if parts and draw in ALONG_FREQUENCY:  # campaigns may be far apart on that axis
            drawn += [_named(draw(share, member), name) for name, share, member in parts]
        else:
            drawn.append(draw(result, data))
    drawn += [draw_measurement(described, data) for described in data.figures]
    if result.knowledge is not None:
        drawn += knowledge_figures(result.knowledge, data.title, synthetic=data.synthetic)
    return numbered(drawn, result, [described.name for described in data.figures])


def _named(drawing: Drawing, series: str) -> Drawing:
    """A figure of one campaign of several."""
    return replace(drawing, series=series, title=f"{drawing.title}, {series}")


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
