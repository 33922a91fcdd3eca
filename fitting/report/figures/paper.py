"""Figures as journals want them: PDF in the widths of one and two columns, no title inside."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path

from fitting.report.figures.style import Drawing
from fitting.text.files import write_whole

#: Widths of one and of two columns, inches.
ONE_COLUMN, TWO_COLUMNS = 3.4, 7.0


def save_pdf(drawings: Iterable[Drawing], folder: Path, width: float) -> list[Path]:
    """Write drawings of a width as PDF, whole or not at all; the same drawing, the same bytes.

    Args:
        drawings: made in the style of that width.
        folder: where the files go.
        width: of all of them, inch; figures with panels beside each other need two columns.

    Raises:
        BadInput: the folder cannot be written.
    """
    written = []
    for drawing in drawings:
        if width < TWO_COLUMNS and not _is_of_one_column(drawing):
            continue
        path = folder / f"{drawing.stem}_{width:g}in.pdf"
        words = {"Title": drawing.title, "Subject": drawing.caption, "CreationDate": None}
        image = io.BytesIO()
        drawing.figure.savefig(image, format="pdf", metadata=words)
        write_whole(path, image.getvalue())
        written.append(path)
    return written


def _is_of_one_column(drawing: Drawing) -> bool:
    specs = (axes.get_subplotspec() for axes in drawing.figure.axes)
    return all(spec is None or spec.get_gridspec().ncols == 1 for spec in specs)
