"""Files of one resonance: numbers, points, figure."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.style import save, style
from fitting.report.shown import ShownCampaign
from fitting.resonance.figure import line_figure
from fitting.resonance.line import Line
from fitting.resonance.ringdown import Ringdown
from fitting.resonance.ringdown_figure import ringdown_figure
from fitting.text.files import write_whole
from fitting.text.records import write_json


def write_line(line: Line | Ringdown, out: Path) -> tuple[Path, ...]:
    """Write line.json, line.csv and the figure; the files written.

    Args:
        line: as it was fitted, of a sweep or of a ringdown.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    write_json(out / "line.json", line)
    write_whole(out / "line.csv", _table(line))
    with style():
        shown = ShownCampaign(title=Path(line.source).name, synthetic=False)
        drawn = line_figure(line) if isinstance(line, Line) else ringdown_figure(line)
        figure = save(draw_measurement(drawn, shown), out)
    return (out / "line.json", out / "line.csv", figure.png, figure.svg)


def _table(line: Line | Ringdown) -> str:
    points, unit = line.points, f"({line.unit})"
    columns = {f"measured {unit}": points.measured, f"fitted {unit}": points.fitted}
    if line.is_complex:
        columns = {
            f"measured X {unit}": points.measured,
            f"measured Y {unit}": points.measured_imaginary,
            f"fitted X {unit}": points.fitted,
            f"fitted Y {unit}": points.fitted_imaginary,
        }
    axis = (
        {"time (s)": line.points.time_s}
        if isinstance(line, Ringdown)
        else {"frequency (Hz)": line.points.frequency_hz}
    )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = {**axis, **columns}
    writer.writerow(list(columns))
    rows = zip(*columns.values(), strict=True)
    writer.writerows([repr(value) for value in row] for row in rows)
    return text.getvalue()
