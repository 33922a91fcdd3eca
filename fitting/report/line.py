"""Files of one resonance: numbers, points, figure."""

from __future__ import annotations

from pathlib import Path

from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.style import save, style
from fitting.report.shown import ShownCampaign
from fitting.resonance.figure import figure_of
from fitting.resonance.noise_line import NoiseLine
from fitting.resonance.record import MeasuredLine
from fitting.text.csv_cells import csv_text
from fitting.text.files import write_whole
from fitting.text.records import write_json


def write_line(line: MeasuredLine, out: Path) -> tuple[Path, ...]:
    """Write line.json, line.csv and the figure; the files written.

    Args:
        line: as it was fitted, of a sweep, of a ringdown or of a noise spectrum.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    write_json(out / "line.json", line)
    write_whole(out / "line.csv", _table(line))
    with style():
        shown = ShownCampaign(title=Path(line.source).name, synthetic=False)
        figure = save(draw_measurement(figure_of(line), shown), out, formats=("png",))
    return (out / "line.json", out / "line.csv", figure.file("png"), figure.file("svg"))


def _table(line: MeasuredLine) -> str:
    unit, points = f"({line.unit})", line.points
    if isinstance(line, NoiseLine):
        unit = "(relative)" if line.unit == "1" else f"({line.unit}**2/Hz)"
    columns = {"time (s)" if points.time_s else "frequency (Hz)": points.place}
    if line.is_complex:
        columns |= {
            f"measured X {unit}": points.measured,
            f"measured Y {unit}": points.measured_imaginary,
            f"fitted X {unit}": points.fitted,
            f"fitted Y {unit}": points.fitted_imaginary,
        }
    else:
        columns |= {f"measured {unit}": points.measured, f"fitted {unit}": points.fitted}
    rows = zip(*columns.values(), strict=True)
    return csv_text([columns, *(map(repr, row) for row in rows)])
