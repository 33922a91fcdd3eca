"""What is known of a figure that was saved; it takes no library that draws."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class FigureFile:
    """A saved figure: what its drawing says, its two files, and one of its numbers.

    ``name`` is that of its files, ``kind`` that of the drawing; ``live`` makes it interactive on
    a page (JSON).
    """

    name: str
    kind: str
    number: int
    title: str
    caption: str
    alt: str
    svg: Path
    png: Path
    csv: Path | None = None
    pdf: Path | None = None
    live: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """All its files."""
        return tuple(path for path in (self.svg, self.png, self.csv, self.pdf) if path is not None)
