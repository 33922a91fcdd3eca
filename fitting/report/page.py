"""A page of this program: one self-contained HTML file, figures embedded, nothing fetched."""

from __future__ import annotations

import base64
import gzip
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import fitting
from fitting.measurements.figure import Figure
from fitting.report.screen import phrase, phrases
from fitting.report.table import environment, table
from fitting.text.notation import listed
from fitting.text.results_folder import write_whole

NAME = "report.html"
#: Bytes of a figure's numbers that the page holds; of longer ones it names the file.
LONGEST = 60_000
#: Characters of a page up to which figures are made interactive.
MOST = 4_800_000
#: Of most pages.
USUAL = {"mark": "", "synthetic": False, "warnings": (), "notes": (), "published": False}


def write_page(folder: Path, template: str, **content: Any) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    The same content gives the same bytes.

    Args:
        folder: where the file goes.
        template: of the page.
        content: as `render` takes it.

    Raises:
        BadInput: the folder cannot be written.
    """
    path = folder / NAME
    write_whole(path, render(template, **content))
    return path


def render(
    template: str, *, figures: Sequence[Figure] = (), lead: Figure | None = None, **content: Any
) -> str:
    """A page as HTML text.

    Args:
        template: of the page, which extends `report.html.j2`.
        figures: those of the sections, saved for a page.
        lead: the figure that shows most, below the answer.
        content: ``title``, ``kind`` of the page in the title bar, ``status`` in a word or two and
            ``message`` in sentences, the status's ``mark`` ("doubt", "bad"), whether the data are
            ``synthetic``, ``warnings``, ``notes`` below the answer, whether the ``published``
            method was used, which the page then cites, and what the template needs further.
    """
    shelf, ids = list(figures), itertools.count(1)

    def take(*names: str) -> list[Figure]:
        """Figures that are not on the page yet: of these names in their order, or all."""
        order = names or tuple(dict.fromkeys(figure.name for figure in shelf))
        taken = [figure for name in order for figure in shelf if figure.name == name]
        shelf[:] = [figure for figure in shelf if figure not in taken]
        return taken

    every = [*([lead] if lead else []), *figures]
    templates = environment()
    templates.filters |= {"source": _source, "links": _links, "contents": _contents}
    templates.globals |= {"table": table, "table_id": lambda: f"table-{next(ids)}", "take": take}
    templates.globals |= {"phrase": phrase, "phrases": phrases}
    parts = {"missing": _missing(every), "live": _live(every), "version": fitting.__version__}
    return templates.get_template(template).render({**USUAL, "lead": lead, **parts, **content})


def _contents(sections: str) -> list[tuple[str, str]]:
    return re.findall(r'<h2 id="([^"]*)">(.*?)</h2>', sections)


def _source(figure: Figure) -> str:
    """The drawing as data."""
    return f"data:image/svg+xml;base64,{_base64(figure.file('svg'))}"


def _links(figure: Figure) -> list[tuple[str, str, str]]:
    """The kinds of files of a figure, where each is, and its name: numbers are in the page."""
    result = []
    for path in sorted(figure.files):
        kind = path.suffix[1:]
        to = f"{quote(path.parent.name)}/{quote(path.name)}"
        if kind == "csv" and path.stat().st_size <= LONGEST:
            to = f"data:text/csv;charset=utf-8;base64,{_base64(path)}"
        result.append((kind.upper(), to, path.name))
    return result


def _missing(figures: Sequence[Figure]) -> str:
    """Numbers of figures that this page has none of; numbers are those of every fit."""
    numbers = {figure.number for figure in figures}
    return listed(str(k) for k in range(1, max(numbers, default=0)) if k not in numbers)


def _live(figures: Sequence[Figure]) -> dict[str, Any]:
    """What makes figures interactive, in their order, as far as the page stays short."""
    wanted = {figure.number: packed(figure.live) for figure in figures if figure.live}
    if not wanted:
        return {"library": "", "figures": {}}
    from fitting.report.interactive import library  # needs Bokeh, which was requested

    script = packed(library())
    size = len(script) + sum(
        len(_source(f)) + sum(len(to) for _, to, _ in _links(f)) for f in figures
    )
    kept: dict[int, str] = {}
    for number, data in wanted.items():
        size += len(data)
        if size <= MOST:
            kept[number] = data
    return {"library": script, "figures": kept}


def packed(text: str) -> str:
    """Text as a page holds it: compressed, in letters and digits; equal texts give equal ones.

    Args:
        text: any.
    """
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode("ascii")


def _base64(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")
