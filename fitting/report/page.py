"""A result as one self-contained HTML file: figures embedded, nothing fetched from anywhere."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

import fitting
from fitting.fit.result import STATUSES, Result
from fitting.report.figures.reconstruction import write_figures
from fitting.report.figures.style import FigureFile
from fitting.report.sections import Section, sections_of
from fitting.report.shown import ShownCampaign
from fitting.text.files import write_whole

TEMPLATES = Path(__file__).parent / "templates"
NAME = "report.html"


@dataclass(frozen=True)
class Picture:
    """An embedded figure: its number in the report and the data URI of its drawing."""

    number: int
    source: str
    alt: str
    title: str
    caption: str


def write_report(
    result: Result,
    data: ShownCampaign,
    out_dir: Path,
    figures: Sequence[FigureFile] | None = None,
) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Figures are drawn (`out_dir`/figures) unless they are handed in. The same result gives the same
    bytes.

    Raises:
        BadInput: the folder cannot be written.
    """
    drawn = write_figures(result, data, out_dir) if figures is None else figures
    path = out_dir / NAME
    write_whole(path, render(result, data, drawn))
    return path


def render(result: Result, data: ShownCampaign, figures: Sequence[FigureFile]) -> str:
    """The report as HTML text."""
    return page(
        result.title,
        "reconstruction",
        sections_of(result, data, figures),
        synthetic=result.synthetic,
        good=result.status == STATUSES[0],
        status=(result.status, result.message),
        warnings=result.warnings,
    )


def page(
    title: str,
    kind: str,
    sections: Sequence[Section],
    *,
    synthetic: bool,
    good: bool,
    status: tuple[str, str],
    warnings: Sequence[str] = (),
) -> str:
    """Any report of this program as HTML text: sections under a status and its message."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["exact"] = repr
    return environment.get_template("report.html.j2").render(
        title=title,
        kind=kind,
        synthetic=synthetic,
        converged=good,
        status=status[0],
        message=status[1],
        warnings=warnings,
        sections=_numbered(sections),
        version=fitting.__version__,
    )


def _numbered(sections: Sequence[Section]) -> list[dict[str, object]]:
    """Sections with their figures embedded and numbered in the order of the page."""
    shown: list[dict[str, object]] = []
    count = 0
    for section in sections:
        pictures = []
        for figure in section.figures:
            count += 1
            source = f"data:image/svg+xml;base64,{_base64(figure.svg)}"
            pictures.append(Picture(count, source, figure.alt, figure.title, figure.caption))
        shown.append({**vars(section), "figures": pictures})
    return shown


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")
