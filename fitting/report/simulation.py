"""Files of a drive or a sweep of an FMU: CSV tables and figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from fitting.fmu.description import FmuDescription
from fitting.report.figures.simulate import save_figures, save_frf
from fitting.signal.combinations import combination_name
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import DriveResponse
from fitting.text.arrays import FloatArray
from fitting.text.results_folder import write_whole
from fitting.text.tables import csv_text


def write_drive(
    response: DriveResponse, description: FmuDescription, out: Path
) -> tuple[Path, ...]:
    """Traces, spectrum, peaks and lines of a drive as CSV, and figures; the files written.

    Args:
        response: of the FMU.
        description: of the FMU, for units and the model's name.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    drive, spectrum, beating = response.drive, response.spectrum, response.beating
    units = [_unit(description, name) for name in drive.outputs]
    columns = [f"{name} ({unit})" for name, unit in zip(drive.outputs, units, strict=True)]
    titles = [combination_name(line.factors, drive.names) for line in response.lines]
    paths = []
    if response.lines:
        rows = [
            [title, *map(repr, [line.frequency_hz, *line.amplitudes.tolist()])]
            for title, line in zip(titles, response.lines, strict=True)
        ]
        paths.append(_write(out / "lines.csv", ["combination", "frequency (Hz)", *columns], rows))
    tables: list[tuple[str, str, list[FloatArray]]] = [
        ("carrier.csv", "time (s)", [response.carrier.times_s, response.carrier.values]),
        ("spectrum.csv", "frequency (Hz)", [spectrum.frequencies_hz, spectrum.amplitudes]),
        ("peaks.csv", "frequency (Hz)", [np.array(drive.tones_hz), response.peaks]),
    ]
    if beating is not None:
        tables.append(("beating.csv", "time (s)", [beating.times_s, beating.values]))
    for name, first, arrays in tables:
        paths.append(_write(out / name, [first, *columns], _numbers(np.column_stack(arrays))))
    named = list(zip(titles, response.lines, strict=True))
    return (*paths, *save_figures(response, description.model_name, units, out, named))


def write_sweep(
    response: SweepResponse, description: FmuDescription, out: Path
) -> tuple[Path, ...]:
    """Curves of a sweep as CSV, and a figure; the files written.

    Args:
        response: of the FMU.
        description: of the FMU, for units and the model's name.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    sweep = response.sweep
    unit = _unit(description, sweep.output)
    head = ["frequency (Hz)", *(f"{sweep.output} {c.direction} ({unit})" for c in response.curves)]
    table = np.column_stack([sweep.frequencies_hz, *(c.amplitudes for c in response.curves)])
    path = _write(out / "sweep.csv", head, _numbers(table))
    return (path, *save_frf(response, description.model_name, unit, out))


def _unit(description: FmuDescription, name: str) -> str:
    return description.variables[name].unit or "1"


def _numbers(table: FloatArray) -> Iterable[Sequence[str]]:
    return (list(map(repr, row)) for row in table.tolist())


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Path:
    write_whole(path, csv_text([head, *rows]))
    return path
