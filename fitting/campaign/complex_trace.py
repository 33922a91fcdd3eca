"""Complex traces: what a lock-in amplifier or a network analyser wrote, as complex values.

A file tells them in one of four ways, each column with its unit: X and Y, real and imaginary part,
amplitude and phase, or dB and phase. Phases may be wrapped or not. Values count phases as
output(t) = Re[value exp(i 2 pi u t)]: the phase of a response falls with frequency.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting.campaign.instruments import PLAIN, RawTrace, Selection, read_trace, unit_of
from fitting.campaign.instruments.trace import check_axis
from fitting.signal.complex_line import complex_line
from fitting.signal.peaks import MIN_SWEEP_POINTS
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.keys import Keys, Text
from fitting.text.tables import Column, Table, read_table
from fitting.text.units import convert

#: Usual names of columns, the first that is there is taken.
FREQUENCY = ("frequency", "freq", "f")
X = ("x", "re", "real", "in-phase")
Y = ("y", "im", "imag", "imaginary", "quadrature")
AMPLITUDE = ("amplitude", "magnitude", "level", "r", "voltage", "db")
PHASE = ("phase", "theta")
#: A sweep is told to count phases the wrong way, or to have another unit of phase, only where one
#: mode describes it that well the other way: root mean square over that of the data.
PLAIN_LINE = 0.15
#: How many times better a mode has to describe the data with the other unit of phase.
MUCH_BETTER = 5.0


@dataclass(frozen=True, kw_only=True)
class WrittenComplexColumns(Keys):
    """Names of a complex trace's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies."""
    x: Text = ""
    """Column of X, the real part."""
    y: Text = ""
    """Column of Y, the imaginary part."""
    amplitude: Text = ""
    """Column of amplitudes, or of dB."""
    phase: Text = ""
    """Column of phases."""
    drive: Text = ""
    """Column of the drive's amplitude, which values are divided by; without it the drive is
    constant."""


@dataclass(frozen=True, kw_only=True)
class MeasuredComplex:
    """Complex values (n,) in ``unit`` at ``frequency_hz`` (n,), Hz, rising.

    Raises:
        BadInput: shapes that differ, fewer than 8 points, frequencies that do not rise from above
            zero, values that are no numbers or all zero.
    """

    frequency_hz: FloatArray
    values: ComplexArray
    unit: str = "V"
    source: Path = Path("arrays")

    def __post_init__(self) -> None:
        where = str(self.source)
        f, values = np.asarray(self.frequency_hz, dtype=float), np.asarray(self.values)
        if f.ndim != 1 or f.shape != values.shape:
            raise BadInput(
                f"{where}: frequencies {f.shape} and values {values.shape}; wanted (n,) for both"
            )
        if f.size < MIN_SWEEP_POINTS:
            raise BadInput(
                f"{where}: {f.size} points are too few for a sweep; wanted at least "
                f"{MIN_SWEEP_POINTS}"
            )
        for name, numbers in (("frequency", f), ("X", values.real), ("Y", values.imag)):
            for i in np.flatnonzero(~np.isfinite(numbers))[:1]:
                raise BadInput(
                    f"{where}: {name} number {i + 1} is {numbers[i]}, wanted a finite number"
                )
        if f[0] <= 0.0 or np.any(np.diff(f) <= 0.0):
            raise BadInput(f"{where}: wanted frequencies above zero that rise strictly")
        if not np.any(np.abs(values) > 0.0):
            raise BadInput(f"{where}: every value is zero; wanted a resonance")
        object.__setattr__(self, "frequency_hz", f)
        object.__setattr__(self, "values", values.astype(complex))


def read_complex(
    path: Path,
    layout: str = PLAIN,
    columns: WrittenComplexColumns | None = None,
    *,
    chunk: int | None = None,
) -> MeasuredComplex:
    """A complex trace of a file.

    Args:
        path: of the file.
        layout: how the instrument writes.
        columns: names of columns, where they are not the usual ones.
        chunk: (zurich) which sweep of the file.

    Raises:
        BadInput: a column or unit is missing, a cell is no number, frequencies do not rise,
            radians that are degrees or degrees that are radians.
    """
    columns = columns or WrittenComplexColumns()
    if layout != PLAIN:
        selection = Selection(amplitude=columns.amplitude, phase=columns.phase, chunk=chunk)
        return _of_trace(read_trace(path, layout, selection))
    table = read_table(path)
    frequency = _column(table, columns.frequency, FREQUENCY)
    if frequency is None:
        raise _missing(table, "frequency")
    x, y = _column(table, columns.x, X), _column(table, columns.y, Y)
    amplitude = _column(table, columns.amplitude, AMPLITUDE)
    phase = _column(table, columns.phase, PHASE)
    drive = table.column(columns.drive) if columns.drive else None
    if x is not None and y is not None:
        return _driven(_of_parts(table, frequency, x, y), table, drive)
    if amplitude is not None and phase is not None:
        unit = unit_of(table, amplitude, f"{amplitude.name} (uV)")
        found = _of_trace(
            RawTrace(
                path=path,
                frequency=table.numbers(frequency),
                frequency_unit=unit_of(table, frequency, "frequency (MHz)"),
                amplitude=table.numbers(amplitude),
                amplitude_unit=unit,
                phase=table.numbers(phase),
                phase_unit=unit_of(table, phase, "phase (deg)"),
                places=tuple(f"row {n}" for n in table.lines),
            )
        )
        return _driven(found, table, drive)
    if x is not None or y is not None:
        raise _missing(table, "Y" if y is None else "X")
    raise _missing(table, "amplitude" if amplitude is None else "phase")


def _driven(found: MeasuredComplex, table: Table, drive: Column | None) -> MeasuredComplex:
    """Values over the amplitude of the drive, relative to that of the first point."""
    if drive is None:
        return found
    unit_of(table, drive, f"{drive.name} (V)")
    level = table.numbers(drive)
    for i in np.flatnonzero(level <= 0.0)[:1]:
        raise BadInput(
            f"{table.path}: row {table.lines[i]}, column '{drive.name}': {level[i]:.6g}; wanted "
            "the amplitude of the drive, above zero"
        )
    return replace(found, values=found.values * (level[0] / level))


def _column(table: Table, wanted: str, usual: tuple[str, ...]) -> Column | None:
    if wanted:
        return table.column(wanted)
    return next((c for c in map(table.find, usual) if c is not None), None)


def _missing(table: Table, what: str) -> BadInput:
    there = ", ".join(c.name for c in table.columns)
    return BadInput(
        f"{table.path}: no column '{what}'; wanted frequency with X and Y, Re and Im, amplitude "
        f"and phase, or dB and phase, there is: {there}"
    )


def _of_parts(table: Table, frequency: Column, x: Column, y: Column) -> MeasuredComplex:
    unit = unit_of(table, x, f"{x.name} (uV)")
    other = unit_of(table, y, f"{y.name} (uV)")
    factor = convert(1.0, other, unit, where=f"{table.path}: column '{y.name}'")
    trace = RawTrace(
        path=table.path,
        frequency=table.numbers(frequency),
        frequency_unit=unit_of(table, frequency, "frequency (MHz)"),
        amplitude=table.numbers(x),
        amplitude_unit=unit,
        places=tuple(f"row {n}" for n in table.lines),
    )
    return _measured(trace, trace.amplitude + 1j * factor * table.numbers(y), unit)


def _of_trace(trace: RawTrace) -> MeasuredComplex:
    """Amplitude, or dB, and phase as complex values."""
    if trace.phase is None:
        raise BadInput(f"{trace.path}: has no phase; wanted a column of phases beside amplitudes")
    phase = trace.phase * convert(1.0, trace.phase_unit, "rad", where=f"{trace.path}: phase")
    amplitude, unit = trace.amplitude, trace.amplitude_unit
    if unit == "dB":
        amplitude, unit = 10.0 ** (amplitude / 20.0), "1"
    for i in np.flatnonzero(amplitude < 0.0)[:1]:
        raise BadInput(
            f"{trace.path}: {trace.places[i]}, column 'amplitude': {trace.amplitude[i]:.6g} "
            f"{unit}; wanted a magnitude (are columns exchanged, or is it in dB?)"
        )
    found = _measured(trace, amplitude * np.exp(1j * phase), unit)
    _check_phase(found, phase, trace.phase_unit)
    return found


def _measured(trace: RawTrace, values: ComplexArray, unit: str) -> MeasuredComplex:
    check_axis(trace)
    where = f"{trace.path}: column 'frequency'"
    hertz = [convert(float(f), trace.frequency_unit, "Hz", where=where) for f in trace.frequency]
    return MeasuredComplex(
        frequency_hz=np.array(hertz), values=values, unit=unit, source=trace.path
    )


def _check_phase(found: MeasuredComplex, phase_rad: FloatArray, unit: str) -> None:
    """Complain of radians that are degrees, and the other way round.

    Radians beyond a turn are unwrapped ones, whose neighbours are less than half a turn apart; and
    one mode with a delay describes the data as they are, not with the other unit.
    """
    said_radians = bool(np.isclose(convert(1.0, unit, "rad", where=""), 1.0))
    largest = float(np.max(np.abs(phase_rad)))
    if said_radians and largest > 2.0 * np.pi:
        jumps = float(np.max(np.abs(np.diff(phase_rad)))) > np.pi * (1.0 + 1e-9)
        if jumps or _fits_better(found, np.deg2rad(phase_rad)):
            raise BadInput(
                f"{found.source}: phases up to {largest:.4g} are said to be in {unit}; wanted "
                "radians within 2 pi or unwrapped ones, or the unit deg"
            )
    degrees = np.rad2deg(phase_rad)
    smallest = float(np.max(np.abs(degrees)))
    if not said_radians and smallest <= 2.0 * np.pi and _fits_better(found, degrees):
        raise BadInput(
            f"{found.source}: phases up to {smallest:.4g} are said to be in {unit}; wanted "
            "degrees, or the unit rad"
        )


def _fits_better(found: MeasuredComplex, phase_rad: FloatArray) -> bool:
    """Whether one mode describes the amplitudes far better with these phases."""
    other = np.abs(found.values) * np.exp(1j * phase_rad)
    here = complex_line(found.frequency_hz, found.values, None).misfit
    there = complex_line(found.frequency_hz, other, None).misfit
    return there < PLAIN_LINE and there * MUCH_BETTER < here


def check_sense(found: MeasuredComplex, delay_s: float | None, where: str) -> None:
    """Complain of phases that plainly run the wrong way over a resonance.

    Args:
        found: complex values.
        delay_s: of the cable, s; None: not known.
        where: file and table, for complaints.

    Raises:
        BadInput: one mode describes the data, but with phases counted the other way.
    """
    line = complex_line(found.frequency_hz, found.values, delay_s)
    spacing = float(np.median(np.diff(found.frequency_hz)))
    inside = found.frequency_hz[0] <= line.eta_hz <= found.frequency_hz[-1]
    seen = 2.0 * spacing < -line.width_hz < float(np.ptp(found.frequency_hz))
    if line.misfit < PLAIN_LINE and inside and seen:
        raise BadInput(
            f"{where}: the phase rises with frequency over the resonance at {line.eta_hz:.9g} Hz; "
            "wanted X and Y in this order, or conjugate = true for an instrument that counts "
            "phases the other way"
        )


def conjugated(found: MeasuredComplex) -> MeasuredComplex:
    """The same of an instrument that counts phases the other way.

    Args:
        found: complex values.
    """
    return replace(found, values=np.conj(found.values))
