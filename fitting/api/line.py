"""One resonance of a file or of arrays: frequency, width, quality, without any FMU."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy.typing as npt

import fitting.resonance.line as resonance
from fitting.api.noise_line import NoiseLine
from fitting.api.ringdown import Ringdown
from fitting.report.resonance import text
from fitting.resonance.decay_reading import read_decay_of
from fitting.resonance.dip_reading import DipReading
from fitting.resonance.line import WIRINGS, line_of
from fitting.resonance.reading import Columns, read_trace_of
from fitting.resonance.trace import trace_of
from fitting.signal.line_record import fields_of
from fitting.text.arguments import checked
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder

__all__ = [
    "LINE_FILES",
    "WIRINGS",
    "Columns",
    "DipReading",
    "Line",
    "line",
    "write_line",
]

#: What `write_line` writes.
LINE_FILES = ("line.json", "line.csv", "line.png", "line.svg")


@dataclass(frozen=True, kw_only=True, repr=False)
class Line(resonance.Line):
    """One resonance of a measured response; printed, it says what the command ``line`` says.

    Numbers are `Estimate` records: ``value``, ``std``, half of the interval that holds the truth in
    68 of 100 such sweeps, ``ci95`` that holds it in 95, and ``unit``.

    Attributes:
        frequency: eigenfrequency, Hz.
        width: full width at half of the power, Hz.
        q: their ratio.
        amplitude: of the line alone at its eigenfrequency, in ``unit``.
        wiring: the form that was taken.
        forms: every form that was tried, the one that was taken first.
        readings: where the line is a dip, what it means in each wiring.
        structure: what the residuals show of the noise, ``dof`` its degrees of freedom.
        residual: root mean square of the residuals, over ``amplitude``.
        points: what was measured and fitted.

    `fitting.resonance.line.Line` has the rest.
    """

    def __repr__(self) -> str:
        return text(self)


@checked
def line(
    source: str | Path | npt.ArrayLike,
    values: npt.ArrayLike | None = None,
    *,
    unit: str = "1",
    within_hz: tuple[float | None, float | None] = (None, None),
    wiring: str = "",
    columns: Columns | None = None,
) -> Line:
    """One resonance of a measured response: eigenfrequency, full width and quality, with errors.

    What stands beside the line, nothing, a constant or a slope, is found by comparing, see
    `fitting.resonance.form` for the formula. Where points outside of ``within_hz`` show another
    line, its tail is fitted, too. Errors hold for noise as it is seen in what the fit
    leaves, and are wider where neighbouring points follow each other.

    Args:
        source: A file, whose kind is recognised; or frequencies, shape (n,), Hz.
        values: With frequencies: amplitudes, or complex values whose phase falls over a resonance,
            shape (n,).
        unit: Of these values.
        within_hz: First and last frequency that are taken, Hz; None: as far as there are points.
        wiring: "transmission", "fano", "sloped", "notch" or "reflection", of amplitudes also
            "offset", "floor", "rice", "single" or "tail"; empty: they are compared.
        columns: Of a file, what it does not tell.

    Returns:
        ``frequency``, ``width``, ``q`` and ``amplitude``, each with its ``std`` and ``ci95``;
        ``forms`` has what else was tried.

    Raises:
        BadInput: a file that is not read, no resonance, one that the ends of the sweep cut off, two
            of them, or too few points.
    """
    if isinstance(source, str | PathLike):
        if values is not None:
            raise BadInput(
                "line: found a file and values, wanted frequencies and values, or a file"
            )
        trace = read_trace_of(Path(source), columns or Columns())
    elif values is None:
        raise BadInput("line: found frequencies alone, wanted values with them, or a file")
    else:
        trace = trace_of(source, values, unit)
    found = line_of(trace.within(*within_hz), wiring)
    return Line(**fields_of(found, resonance.Line))


def ends_of(source: Path, columns: Columns, *, over_time: bool) -> tuple[float, float]:
    """First and last frequency of a file, Hz; of a recording over time its times, s.

    Args:
        source: The file.
        columns: What it does not tell.
        over_time: Whether it holds a recording over time.

    Raises:
        BadInput: a file that is not read.
    """
    if over_time:
        axis = read_decay_of(source, columns).time_s
    else:
        axis = read_trace_of(source, columns).frequency_hz
    return float(axis[0]), float(axis[-1])


def columns_of(**given: Any) -> Columns:
    """The columns of a file, as far as they are given.

    Args:
        **given: fields of `Columns`; None counts as not given.
    """
    known = {field.name for field in fields(Columns)}
    return Columns(**{k: v for k, v in given.items() if k in known and v is not None})


def write_line(found: Line | Ringdown | NoiseLine, out: str | Path) -> tuple[Path, ...]:
    """Write line.json, line.csv and a figure of data, fit and residual.

    Args:
        found: What `line`, `ringdown` or `noise_line` returned.
        out: Folder, made where there is none.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names that are not ours.
    """
    # matplotlib takes a second to import: only where something is drawn
    report = importlib.import_module("fitting.report.line")
    with results_folder(Path(out), "line", LINE_FILES):
        files: tuple[Path, ...] = report.write_line(found, Path(out))
        remove_earlier(Path(out), LINE_FILES)
    return files
