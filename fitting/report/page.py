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
#: Bytes of an SVG from which a shorter PNG is embedded instead.
LONG = 200_000
#: Bytes of a figure's numbers that the page holds.
LONGEST = 500_000


@dataclass(frozen=True)
class Section:
    """One section: `id` for links, sentences, a list, tables, figures (in this order).

    A `folded` one shows its title alone until it is opened; on paper all of it.
    """

    id: str
    title: str
    _: KW_ONLY
    paragraphs: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureFile, ...] = ()
    folded: bool = False


@dataclass(frozen=True)
class Line:
    """One line of the answer: its `head`, values that stand out, the rest, something to type."""

    head: str
    _: KW_ONLY
    values: tuple[tuple[str, str], ...] = ()
    words: str = ""
    command: str = ""


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
    """A page: what it is about, its kind in the title bar, how it ended, warnings, sections.

    `answer` and `notes` on it stand first, with the figure that shows most, the `lead`.
    """

    title: str
    kind: str
    status: Status
    sections: tuple[Section, ...]
    synthetic: bool
    warnings: tuple[str, ...] = ()
    answer: tuple[Line, ...] = ()
    notes: tuple[str, ...] = ()
    lead: FigureFile | None = None


@dataclass(frozen=True, kw_only=True)
class Picture:
    """An embedded figure: its number in the report and the data URI of its drawing.

    `numbers` is that of what is drawn, as CSV; empty where there is no such file, or a long one.
    """

    number: int
    source: str
    alt: str
    title: str
    caption: str
    name: str = ""
    numbers: str = ""


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
    lead = None if page.lead is None else _picture(page.lead)
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            page=page,
            lead=lead,
            sections=_with_pictures(page.sections),
            version=fitting.__version__,
        )
    )


def _with_pictures(sections: Sequence[Section]) -> list[dict[str, object]]:
    """Sections with their figures embedded."""
    return [{**vars(s), "figures": [_picture(f) for f in s.figures]} for s in sections]


def _picture(figure: FigureFile) -> Picture:
    """A figure embedded: as SVG, unless that is long and the picture of it shorter."""
    kind, path = "svg+xml", figure.svg
    if path.stat().st_size > LONG and figure.png.stat().st_size < path.stat().st_size:
        kind, path = "png", figure.png
    return Picture(
        number=figure.number,
        source=f"data:image/{kind};base64,{_base64(path)}",
        alt=figure.alt,
        title=figure.title,
        caption=figure.caption,
        name=figure.name,
        numbers=_numbers(figure),
    )


def _numbers(figure: FigureFile) -> str:
    """What a figure shows as a file to be downloaded from the page itself."""
    if figure.csv is None or figure.csv.stat().st_size > LONGEST:
        return ""
    return f"data:text/csv;charset=utf-8;base64,{_base64(figure.csv)}"


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")
