"""What faults of curves are put into: a control sweep with laws, a complex sweep, complex tones.

All of the FMU of `tests.faults.scene`, one mode that is driven and observed, in closed form.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.toml import toml_text
from tests.faults.scene import CAMPAIGN, D_HZ, ETA_HZ, EXPERIMENTS, FMU

MAP, COMPLEX = "map.csv", "complex.csv"
Files = dict[str, str]
Tables = dict[str, Any]
#: What a fault changes: tables of the campaign, or columns of the data file.
Change = Callable[[Tables], object]
Columns = Mapping[str, Sequence[float | str]]

_COMMON: Mapping[str, Any] = {
    "title": "One mode",
    "synthetic": True,
    "fmu": {
        "file": FMU,
        "start": {"theta": 0.0, "d2": "30 Hz", "A2": 0.0, "periodic_start": True},
    },
    "observe": {"output": "q1_hybrid", "steady_start": True},
    "drive": {"kind": "tones", "frequencies": ["u1"], "amplitudes": ["A1"]},
    "continuation": {"starts": 1, "iterations": 1, "misfit": "squares"},
}
_WIDTH = {"name": "d1", "lower": "1 Hz", "upper": "100 Hz", "start": "40 Hz"}
_ETA = {"name": "eta_plus", "lower": "310 Hz", "upper": "330 Hz", "start": "320 Hz"}
_FIXED = {"eta_minus": "500 Hz"}

VOLTS = (-1.0, 0.0, 1.0, 2.0)
SLOPE_HZ = 3.0
MAP_HZ = np.linspace(292.0, 352.0, 13)
SWEPT_HZ = np.linspace(202.0, 442.0, 49)
TONES_HZ = (300.0, 310.0, 320.0, 330.0, 340.0)


def response(f: FloatArray, eta_hz: float = ETA_HZ) -> ComplexArray:
    """Of the mode in V at some gain, as Re[value exp(i 2 pi f t)]."""
    eta, u = 2 * np.pi * eta_hz, 2 * np.pi * f
    return np.asarray(1e3 / (eta**2 - u**2 + 2j * np.pi * D_HZ * u))


@dataclass(frozen=True)
class Fault:
    """A campaign with a fault, and the words that its sentence has to hold, all of them.

    ``complaints`` are more than one where what is missing is missed at several places.
    """

    name: str
    files: Files
    says: tuple[str, ...]
    complaints: int = 1


#: Faults by their name: what is told, or the columns, and the words that the sentence has to hold.
Told = Mapping[str, tuple[Mapping[str, Any], tuple[str, ...]]]
Corrupted = Mapping[str, tuple[Columns, tuple[str, ...]]]


def csv(columns: Columns) -> str:
    """Columns with their headers as a table."""
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(_cell, row)) for row in rows), ""])


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{float(value):.10g}"


def map_columns() -> dict[str, list[float]]:
    """A row for each point: voltage, frequency, amplitude."""
    found: dict[str, list[float]] = {"V (V)": [], "frequency (Hz)": [], "amplitude (V)": []}
    for volt in VOLTS:
        amplitudes = np.abs(response(MAP_HZ, ETA_HZ + SLOPE_HZ * volt))
        for column, values in zip(
            found.values(), (np.full(MAP_HZ.size, volt), MAP_HZ, amplitudes), strict=True
        ):
            column.extend(values.tolist())
    return found


def complex_map_columns() -> dict[str, list[float]]:
    """A row for each point: voltage, frequency, X, Y."""
    parts = [response(MAP_HZ, ETA_HZ + SLOPE_HZ * volt) for volt in VOLTS]
    values = np.concatenate(parts)
    return {
        "V (V)": np.repeat(VOLTS, MAP_HZ.size).tolist(),
        "frequency (Hz)": np.tile(MAP_HZ, len(parts)).tolist(),
        "X (V)": values.real.tolist(),
        "Y (V)": values.imag.tolist(),
    }


def xy_columns() -> dict[str, list[float]]:
    """A complex sweep by its quadratures."""
    s = response(SWEPT_HZ)
    return {"frequency (Hz)": SWEPT_HZ.tolist(), "X (V)": s.real.tolist(), "Y (V)": s.imag.tolist()}


def polar_columns(values: ComplexArray | None = None) -> dict[str, list[float]]:
    """A complex sweep by amplitude and phase, rad, unwrapped."""
    s = response(SWEPT_HZ) if values is None else values
    return {
        "frequency (Hz)": SWEPT_HZ.tolist(),
        "amplitude (V)": np.abs(s).tolist(),
        "phase (rad)": np.unwrap(np.angle(s)).tolist(),
    }


def tone_columns() -> dict[str, list[float | str]]:
    """Experiments with a tone each: amplitude and phase, deg."""
    s = response(np.array(TONES_HZ))
    return {
        "experiment": ["a", "b", "c", "d", "e"],
        "u1 (Hz)": list(TONES_HZ),
        "peak (V)": np.abs(s).tolist(),
        "phase (deg)": np.degrees(np.angle(s)).tolist(),
    }


def part_columns() -> dict[str, list[float | str]]:
    """Experiments with a tone each: X and Y."""
    s = response(np.array(TONES_HZ))
    named = {"experiment": ["a", "b", "c", "d", "e"], "u1 (Hz)": list(TONES_HZ)}
    return {**named, "X (V)": s.real.tolist(), "Y (V)": s.imag.tolist()}


def _tables(own: Mapping[str, Any], parameters: Sequence[Mapping[str, Any]]) -> Tables:
    tables = copy.deepcopy({**_COMMON, **own, "parameters": [dict(p) for p in parameters]})
    tables["fmu"]["start"] |= _FIXED
    return tables


def control(change: Change | None = None, columns: Columns | None = None) -> Files:
    """Spectra over a voltage, which the eigenfrequency follows by a law."""
    table = {"control_sweep": {"file": MAP, "controls": ["V"], "amplitude": "V peak"}}
    return _over_a_voltage(table, change, map_columns() if columns is None else columns)


def complex_control(change: Change | None = None, columns: Columns | None = None) -> Files:
    """The same with both quadratures."""
    table = {"complex_control_sweep": {"file": MAP, "controls": ["V"]}}
    return _over_a_voltage(table, change, complex_map_columns() if columns is None else columns)


def _over_a_voltage(table: Mapping[str, Any], change: Change | None, columns: Columns) -> Files:
    tables = _tables(
        {
            **table,
            "laws": {"eta_plus": "e0 + e1*V/V0"},
            "constants": {"V0": "1 V"},
        },
        (
            _WIDTH,
            {**_ETA, "name": "e0"},
            {"name": "e1", "lower": "-10 Hz", "upper": "10 Hz", "start": "2 Hz"},
        ),
    )
    return _files(tables, change, {MAP: columns})


def sweep(change: Change | None = None, columns: Columns | None = None) -> Files:
    """One complex sweep."""
    tables = _tables({"complex_sweep": [{"file": COMPLEX}]}, (_WIDTH, _ETA))
    return _files(tables, change, {COMPLEX: xy_columns() if columns is None else columns})


def tones(change: Change | None = None, columns: Columns | None = None) -> Files:
    """Tones with peaks and phases."""
    told = {"amplitude": "V peak", "peaks": ["peak"], "phases": ["phase"], "unknown": "gain"}
    return _tones(told, change, tone_columns() if columns is None else columns)


def parts(change: Change | None = None, columns: Columns | None = None) -> Files:
    """Tones with X and Y."""
    told = {"amplitude": "V peak", "x": ["X"], "y": ["Y"], "unknown": "gain"}
    return _tones(told, change, part_columns() if columns is None else columns)


def _tones(told: Mapping[str, Any], change: Change | None, columns: Columns) -> Files:
    tables = _tables({"experiments": {"file": EXPERIMENTS, **told}}, (_WIDTH, _ETA))
    return _files(tables, change, {EXPERIMENTS: columns})


def _files(tables: Tables, change: Change | None, data: Mapping[str, Columns]) -> Files:
    if change is not None:
        change(tables)
    return {CAMPAIGN: toml_text(tables), **{name: csv(c) for name, c in data.items()}}


def renamed(columns: Columns, old: str, new: str) -> Columns:
    """Columns of which one has another head."""
    return {new if name == old else name: values for name, values in columns.items()}


def without(columns: Columns, *names: str) -> Columns:
    """Columns, some left out."""
    return {name: values for name, values in columns.items() if name not in names}


def rows_of(columns: Columns, rows: Sequence[int]) -> Columns:
    """Rows of columns, in this order."""
    return {name: [values[i] for i in rows] for name, values in columns.items()}


def celled(columns: Columns, name: str, row: int, cell: float | str) -> Columns:
    """Columns with another cell."""
    values = [cell if i == row else v for i, v in enumerate(columns[name])]
    return {**columns, name: values}


def said(key: str, told: Mapping[str, Any]) -> Change:
    """What sets keys of a table, the first where there are several of its name."""

    def change(tables: Tables) -> None:
        table = tables[key]
        (table[0] if isinstance(table, list) else table).update(told)

    return change
