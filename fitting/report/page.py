"""A page of this program: one self-contained HTML file, figures embedded, nothing fetched."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

import fitting
from fitting.report.figures.style import FigureFile
from fitting.report.table import Table, environment
from fitting.text.files import write_whole

NAME = "report.html"


@dataclass(frozen=True)
class Section:
    """One section: `id` for links, sentences, a list, tables, figures (in this order)."""

    id: str
    title: str
    _: KW_ONLY
    paragraphs: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureFile, ...] = ()


@dataclass(frozen=True)
class Status:
    """How something ended: in a word or two, in a sentence, and whether that is `good`.

    `doubtful`: good, but for something that the sentence says.
    """

    words: str
    message: str
    good: bool
    doubtful: bool = False

    @property
    def mark(self) -> str:
        """Style class of the box."""
        return "doubt" if self.good and self.doubtful else "" if self.good else "bad"


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page: what it is about, its kind in the title bar, how it ended, warnings, sections."""

    title: str
    kind: str
    status: Status
    sections: tuple[Section, ...]
    synthetic: bool
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Picture:
    """An embedded figure: its number in the report and the data URI of its drawing."""

    number: int
    source: str
    alt: str
    title: str
    caption: str


def write_page(page: Page, folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    The same page gives the same bytes.

    Args:
        page: sections and heading.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    path = folder / NAME
    write_whole(path, render(page))
    return path


def render(page: Page) -> str:
    """The page as HTML text.

    Args:
        page: sections and heading.
    """
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            page=page,
            sections=_numbered(page.sections),
            version=fitting.__version__,
        )
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
            pictures.append(
                Picture(
                    number=count,
                    source=source,
                    alt=figure.alt,
                    title=figure.title,
                    caption=figure.caption,
                )
            )
        shown.append({**vars(section), "figures": pictures})
    return shown


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")
