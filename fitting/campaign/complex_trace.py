"""Complex traces: what a lock-in amplifier or a network analyser wrote, as complex values.

A file has them in one of four ways, each column with its unit: X and Y, real and imaginary part,
amplitude and phase, or dB and phase. Phases may be wrapped or not. Values count phases as
output(t) = Re[value exp(i 2 pi u t)]: the phase of a response falls with frequency.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fitting.campaign.instruments import (
    Channel,
    ComplexColumns,
    Recording,
    Selection,
    read_recording,
    unit_of,
)
from fitting.campaign.instruments.recording import check_axis
from fitting.campaign.instruments.roles import (
    PHASE,
    X,
    Y,
    amplitude_of,
    frequency_of,
    parts_of,
    requested_column,
    without_zero,
)
from fitting.campaign.measured import check_count, check_rising
from fitting.signal.complex_line import complex_line
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding
from fitting.text.frequency import hertz_of
from fitting.text.notation import prefixed
from fitting.text.numbers import as_numbers, as_values, require_size
from fitting.text.units import convert

#: A sweep is told to count phases the wrong way, or to have another unit of phase, only where one
#: mode describes it that well the other way: root mean square over that of the data.
PLAIN_LINE = 0.15
#: How many times better a mode has to describe the data with the other unit of phase.
MUCH_BETTER = 5.0

#: Turns over a sweep from which a cable can be told from what a line turns by itself.
LEAST_CABLE = 0.25


@dataclass(frozen=True, eq=False)
class MeasuredComplex:
    """Complex values (n,) in ``unit`` at ``frequency_hz`` (n,), Hz, rising.

    As arrays they are ``y`` and ``u_hz``. ``left_out`` states which rows of the file are not here,
    and why; empty: none.

    Raises:
        BadInput: shapes that differ, fewer than 8 points, frequencies that do not rise from above
            zero, values that are no numbers or all zero.
    """

    frequency_hz: npt.ArrayLike
    values: npt.ArrayLike
    unit: str = field(default="V", kw_only=True)
    source: str = field(default="arrays", kw_only=True)
    left_out: tuple[Finding, ...] = field(default=(), kw_only=True)
    u_hz: FloatArray = field(init=False)
    y: ComplexArray = field(init=False)

    def __post_init__(self) -> None:
        where = self.source
        f = as_numbers(self.frequency_hz, f"{where}: frequencies")
        values = np.asarray(as_values(self.values, f"{where}: values"), dtype=complex)
        if f.ndim != 1 or f.shape != values.shape:
            raise BadInput(
                f"{where}: frequencies {f.shape} and values {values.shape}; wanted (n,) for both"
            )
        check_count(f.size, where)
        for name, numbers in (("frequency", f), ("X", values.real), ("Y", values.imag)):
            for i in np.flatnonzero(~np.isfinite(numbers))[:1]:
                raise BadInput(
                    f"{where}: {name} number {i + 1} is {numbers[i]}, wanted a finite number"
                )
        require_size(values, f"{where}: values")
        check_rising(f, where)
        if not np.any(np.abs(values) > 0.0):
            raise BadInput(f"{where}: every value is zero; wanted a resonance")
        object.__setattr__(self, "u_hz", f)
        object.__setattr__(self, "y", values)


def read_complex(
    path: Path,
    layout: str | None = None,
    columns: ComplexColumns | None = None,
    *,
    trace: int = 1,
    chunk: int | None = None,
    header_row: int | None = None,
) -> MeasuredComplex:
    """A complex trace of a file.

    Args:
        path: of the file.
        layout: how the instrument writes; None: recognised by the content.
        columns: names of columns, where they are not the usual ones.
        trace: (rohde-schwarz) which trace, from 1.
        chunk: (zurich) which sweep of the file.
        header_row: (csv) row of the names of columns, from 1; None: it is found.

    Raises:
        BadInput: a column or unit is missing, a cell is no number, frequencies do not rise,
            radians that are degrees or degrees that are radians.
    """
    columns = columns or ComplexColumns()
    selection = Selection(**vars(columns), trace=trace, chunk=chunk, header_row=header_row)
    return complex_of(read_recording(path, layout, selection), columns)


def complex_of(recording: Recording, columns: ComplexColumns) -> MeasuredComplex:
    """The complex values that columns of a recording hold.

    Args:
        recording: as it was read, one sweep.
        columns: names of columns, where they are not the usual ones.

    Raises:
        BadInput: as `read_complex`.
    """
    path = recording.path
    frequency = frequency_of(recording, columns.frequency)
    recording, frequency, left_out = without_zero(recording, frequency)
    drive = recording.column(columns.drive) if columns.drive else None
    x, y = requested_column(recording, columns.x, X), requested_column(recording, columns.y, Y)
    amplitude = amplitude_of(recording, columns.amplitude) if columns.amplitude else None
    varying: list[tuple[Channel, str, str]] = []  # what is no resonance if it is one number
    radians, phase_unit = None, ""
    if amplitude is None and x is not None and y is not None:
        _check_different(recording, frequency, x, y)
        recording.check((frequency, x, y))
        values, unit = parts_of(recording, x, y)
        varying = [(part, f"column '{part.name}'", part.unit or unit) for part in (x, y)]
    else:
        amplitude = amplitude or amplitude_of(recording, "")
        whole = amplitude is not None and amplitude.is_complex
        phase = None if whole else requested_column(recording, columns.phase, PHASE)
        if amplitude is not None and whole:
            unit = unit_of(recording, amplitude, f"{amplitude.name} (uV)")
            values = recording.values(amplitude)
        elif amplitude is not None and phase is not None:
            _check_different(recording, frequency, amplitude, phase)
            recording.check((frequency, amplitude, phase))
            phase_unit = unit_of(recording, phase, "phase (deg)")
            factor = convert(1.0, phase_unit, "rad", where=f"{path}: phase")
            radians = recording.numbers(phase) * factor
            sizes, unit = _sizes(recording, amplitude)
            values = np.asarray(sizes * np.exp(1j * radians), dtype=complex)
            varying = [(phase, "the phase", phase_unit)]
        else:
            if (x is None) != (y is None):
                parts_of(recording, x, y)  # names the one that is missing
            what = "amplitude" if amplitude is None else "phase"
            there = ", ".join(c.name for c in recording.channels)
            raise BadInput(
                f"{path}: no column '{what}'; wanted frequency with X and Y, Re and Im, "
                f"amplitude and phase, or dB and phase, there is: {there}"
            )
    written = unit_of(recording, frequency, "frequency (MHz)")
    axis = recording.numbers(frequency)
    check_axis(path, axis, written, recording.places)
    result = MeasuredComplex(
        frequency_hz=hertz_of(axis, written, where=f"{path}: column 'frequency'"),
        values=values,
        unit=unit,
        source=str(path),
        left_out=left_out,
    )
    for channel, what, its_unit in varying:
        _check_varies(recording.numbers(channel), f"{path}: {what}", its_unit)
    if radians is not None:
        _check_phase(result, radians, phase_unit)
    if drive is None:
        return result
    unit_of(recording, drive, f"{drive.name} (V)")
    level = recording.numbers(drive)
    for i in np.flatnonzero(level <= 0.0)[:1]:
        raise BadInput(
            f"{path}: {recording.places[i]}, column '{drive.name}': {level[i]:.6g}; wanted the "
            "amplitude of the drive, above zero"
        )
    return replace(result, values=result.y * (level[0] / level))  # relative to the first point's


def _check_different(recording: Recording, *channels: Channel) -> None:
    names = [channel.name for channel in channels]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(
                f"{recording.path}: column '{name}' is taken for two things; wanted a column for "
                "each"
            )


def _sizes(recording: Recording, amplitude: Channel) -> tuple[FloatArray, str]:
    """Magnitudes of a column of amplitudes, or of dB, and their unit."""
    unit = unit_of(recording, amplitude, f"{amplitude.name} (uV)")
    sizes = written = recording.numbers(amplitude)
    if unit in ("dB", "dBm"):  # the load of dBm is a factor, which the gain takes
        sizes, unit = 10.0 ** (written / 20.0), "1"
    for i in np.flatnonzero(sizes < 0.0)[:1]:
        raise BadInput(
            f"{recording.path}: {recording.places[i]}, column '{amplitude.name}': "
            f"{written[i]:.6g} {unit}; wanted a magnitude (are columns exchanged, or is it in dB?)"
        )
    return sizes, unit


def _check_varies(values: FloatArray, where: str, unit: str) -> None:
    """Complain of a column that is filled with one number."""
    if np.all(values == values[0]):
        raise BadInput(
            f"{where} is {values[0]:.6g} {unit} at all {values.size} points; wanted values that "
            "change over a resonance"
        )


def _check_phase(result: MeasuredComplex, phase_rad: FloatArray, unit: str) -> None:
    """Complain of radians that are degrees, and the other way round.

    Radians beyond a turn are unwrapped ones, whose neighbours are less than half a turn apart; and
    one mode with a delay describes the data as they are, not with the other unit.
    """
    written_radians = bool(np.isclose(convert(1.0, unit, "rad", where=""), 1.0))
    largest = float(np.max(np.abs(phase_rad)))
    if written_radians and largest > 2.0 * np.pi:
        jumps = float(np.max(np.abs(np.diff(phase_rad)))) > np.pi * (1.0 + 1e-9)
        if jumps or _fits_better(result, np.deg2rad(phase_rad)):
            raise BadInput(
                f"{result.source}: phases up to {largest:.4g} are declared to be in {unit}; wanted "
                "radians within 2 pi or unwrapped ones, or the unit deg"
            )
    degrees = np.rad2deg(phase_rad)
    smallest = float(np.max(np.abs(degrees)))
    if not written_radians and smallest <= 2.0 * np.pi and _fits_better(result, degrees):
        raise BadInput(
            f"{result.source}: phases up to {smallest:.4g} are declared to be in {unit}; wanted "
            "degrees, or the unit rad"
        )


def _fits_better(result: MeasuredComplex, phase_rad: FloatArray) -> bool:
    """Whether one mode describes the amplitudes far better with these phases."""
    other = np.abs(result.y) * np.exp(1j * phase_rad)
    here = complex_line(result.u_hz, result.y, None).misfit
    there = complex_line(result.u_hz, other, None).misfit
    return there < PLAIN_LINE and there * MUCH_BETTER < here


def check_sense(result: MeasuredComplex, delay_s: float | None, where: str) -> None:
    """Complain of phases that plainly run the wrong way over a resonance.

    Args:
        result: complex values.
        delay_s: of the cable, s; None: not known.
        where: file and table, for complaints.

    Raises:
        BadInput: one mode describes the data, but with phases counted the other way.
    """
    line = complex_line(result.u_hz, result.y, delay_s)
    spacing = float(np.median(np.diff(result.u_hz)))
    inside = result.u_hz[0] <= line.eta_hz <= result.u_hz[-1]
    observed = 2.0 * spacing < -line.width_hz < float(np.ptp(result.u_hz))
    if line.misfit < PLAIN_LINE and inside and observed:
        raise BadInput(
            f"{where}: the phase rises with frequency over the resonance at {line.eta_hz:.9g} Hz; "
            "wanted X and Y in this order, or conjugate = true for an instrument that counts "
            "phases the other way"
        )


def check_delay(result: MeasuredComplex, delay_s: float | None, where: str) -> None:
    """Complain of a cable that turns the phases by more than a turn and that was not stated.

    Args:
        result: complex values.
        delay_s: of the cable as it was stated, s; None: it is fitted.
        where: file and table, for complaints.

    Raises:
        BadInput: one mode describes the data, but behind another delay.
    """
    if delay_s is None:
        return
    given = complex_line(result.u_hz, result.y, delay_s)
    free = complex_line(result.u_hz, result.y, None)
    turns = (free.delay_s - delay_s) * float(np.ptp(result.u_hz))
    if abs(turns) < 1.0 or free.misfit > PLAIN_LINE or free.misfit * MUCH_BETTER > given.misfit:
        return
    unit_text = f"{_seconds(delay_s)} were stated" if delay_s else "no delay was stated"
    is_cable = abs(free.delay_s) * float(np.ptp(result.u_hz)) >= LEAST_CABLE
    cable_s = free.delay_s
    if cable_s < 0.0:  # frequencies an equal step apart tell a delay up to one over the step
        cable_s += 1.0 / float(np.median(np.diff(result.u_hz)))
    observed = f"behind a cable of {_seconds(cable_s)}" if is_cable else "without a cable"
    wanted = "the one of the cable" if is_cable else '"none"'
    raise BadInput(
        f'{where}: the phases turn as {observed}, {unit_text}; wanted delay = "fit", or {wanted}'
    )


def _seconds(value: float) -> str:
    factor, unit = prefixed(abs(value), "s")
    return f"{value / factor:.3g} {unit}"


def conjugated(result: MeasuredComplex) -> MeasuredComplex:
    """The same of an instrument that counts phases the other way.

    Args:
        result: complex values.
    """
    return replace(result, values=np.conj(result.y))
