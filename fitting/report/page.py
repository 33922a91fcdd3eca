"""A page of this program: one self-contained HTML file, figures embedded, nothing fetched."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import fitting
from fitting.report.figures.file import FigureFile
from fitting.report.table import Table, environment
from fitting.text.files import write_whole
from fitting.text.notation import listed

NAME = "report.html"
#: Bytes of an SVG from which a shorter PNG is embedded instead.
LONG = 200_000
#: Bytes of a figure's numbers, and of what makes it interactive, that the page holds.
LONGEST = 500_000
#: Characters of a page up to which figures are made interactive.
MOST = 4_800_000


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
    `published`: what it tells was found by the published method, which it then cites.
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
    published: bool = False


@dataclass(frozen=True, kw_only=True)
class Picture:
    """An embedded figure: its number in the report and the data URI of its drawing.

    `links` are what it can be had as, by name, with the name of the file: as data, else the file
    beside the page. `live` is what makes it interactive, packed; empty: nothing does.
    """

    number: int
    source: str
    alt: str
    title: str
    caption: str
    links: tuple[tuple[str, str, str], ...] = ()
    live: str = ""


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
    sections = _with_pictures(page.sections)
    pictures = [*([lead] if lead else []), *(f for s in sections for f in s["figures"])]
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            page=page,
            lead=lead,
            sections=sections,
            missing=_missing(pictures),
            live=_live(pictures),
            version=fitting.__version__,
        )
    )


def _with_pictures(sections: Sequence[Section]) -> list[dict[str, Any]]:
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
        links=_links(figure),
        live=packed(figure.live) if figure.live else "",
    )


def _links(figure: FigureFile) -> tuple[tuple[str, str, str], ...]:
    """What a figure can be had as: its numbers from the page itself, the rest beside it."""
    if figure.csv is None or figure.pdf is None:
        return ()
    numbers = _beside(figure.csv)
    if figure.csv.stat().st_size <= LONGEST:
        numbers = f"data:text/csv;charset=utf-8;base64,{_base64(figure.csv)}"
    files = (("SVG", figure.svg), ("PDF", figure.pdf))
    return (
        ("CSV", numbers, figure.csv.name),
        *((kind, _beside(path), path.name) for kind, path in files),
    )


def _beside(path: Path) -> str:
    """Where a file of the folder of figures lies, as seen from the page."""
    return f"{quote(path.parent.name)}/{quote(path.name)}"


def _missing(pictures: Sequence[Picture]) -> str:
    """Numbers of figures that this page has none of; numbers are those of every fit."""
    numbers = {picture.number for picture in pictures}
    return listed(str(k) for k in range(1, max(numbers, default=0)) if k not in numbers)


def _live(pictures: Sequence[Picture]) -> dict[str, Any]:
    """What makes figures interactive, in their order, as far as the page stays short."""
    # takes half a second to import: only where there is a page
    from fitting.report.interactive.document import library

    wanted = [picture for picture in pictures if 0 < len(picture.live) <= LONGEST]
    if not wanted:
        return {"library": "", "figures": {}}
    script = packed(library())
    size = len(script) + sum(len(p.source) + sum(len(to) for _, to, _ in p.links) for p in pictures)
    kept: dict[int, str] = {}
    for picture in wanted:
        size += len(picture.live)
        if size <= MOST:
            kept[picture.number] = picture.live
    return {"library": script, "figures": kept}


def packed(text: str) -> str:
    """Text as a page holds it: compressed, in letters and digits; equal texts give equal ones.

    Args:
        text: any.
    """
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode("ascii")


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")
