"""Files of one resonance: numbers, points, figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.lines.noise_spectrum import NoiseLine
from fitting.lines.record import MeasuredLine
from fitting.measurements.figure import Axis, Form, Layer, Panel, Role, worded
from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.style import save, style
from fitting.report.shown import ShownCampaign
from fitting.resonance.figure import figure_of
from fitting.text.records import write_json
from fitting.text.results_folder import write_whole
from fitting.text.tables import csv_text

#: Columns of lines.csv, by the keys of a row.
COLUMNS = {
    "file": "file",
    "control": "control",
    "frequency": "frequency (Hz)",
    "frequency_std": "frequency std (Hz)",
    "width": "FWHM (Hz)",
    "width_std": "FWHM std (Hz)",
    "q": "Q",
    "q_std": "Q std",
    "amplitude": "amplitude",
    "amplitude_std": "amplitude std",
    "unit": "unit",
    "findings": "findings",
    "reason": "reason",
}


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


def write_lines(
    rows: Sequence[Mapping[str, str | float]], control: tuple[str, str], out: Path
) -> tuple[Path, ...]:
    """Write lines.csv and the figure of many files; the files written.

    Args:
        rows: one for each file, by the keys of `COLUMNS`.
        control: name and unit of what differs from file to file; unit "1": none.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    name, unit = control[0], "" if control[1] == "1" else control[1]
    heads = {**COLUMNS, "control": f"{name} ({unit})" if unit else name}
    cells = [[_cell(row[key]) for key in heads] for row in rows]
    write_whole(out / "lines.csv", csv_text([heads.values(), *cells]))
    x = np.array([row["control"] for row in rows], dtype=float)
    panels = []
    for key, label in (("frequency", "frequency f"), ("width", "FWHM")):
        y, sigma = (np.array([row[k] for row in rows], dtype=float) for k in (key, f"{key}_std"))
        known = np.isfinite(y)
        layer = Layer(
            Role.MEASURED, Form.POINTS, x[known], y[known], label=label, sigma=sigma[known]
        )
        if np.any(known):
            panels.append(Panel(x=Axis(name, unit), y=Axis(label, "Hz"), layers=(layer,)))
    rows_of_panels = [[panel] for panel in panels]
    drawn = worded("lines_of_files", rows_of_panels, name="lines", control=name, count=len(rows))
    with style():
        shown = ShownCampaign(title=f"{len(rows)} files", synthetic=False)
        figure = save(draw_measurement(drawn, shown), out, formats=("png",))
    return (out / "lines.csv", figure.file("png"), figure.file("svg"))


def _cell(value: str | float) -> str:
    """A number in full, nothing of one that is unknown."""
    return value if isinstance(value, str) else repr(float(value)) if value == value else ""


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
