"""Tables of complex sweeps: [[complex_sweep]], and [complex_control_sweep] over a control.

A file has complex values in one of four ways, each column with its unit: X and Y, real and
imaginary part, amplitude and phase, or dB and phase. Phases may be wrapped or not. Values count
phases as output(t) = Re[value exp(i 2 pi u t)]: the phase of a response falls with frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.file import LayoutKeys
from fitting.campaign.instruments import LAYOUTS, read_recording
from fitting.campaign.instruments.recording import (
    Channel,
    ComplexColumns,
    Recording,
    Selection,
    check_axis,
    unit_of,
)
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
from fitting.fmu.description import READABLE
from fitting.lines.starts import complex_line
from fitting.measurements.complex_curve import BACKGROUNDS, WIRINGS, ComplexCurve, Wiring
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.control_tables import ControlPlace, ControlTable, cut_off
from fitting.measurements.records import StatedTable
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import prefixed
from fitting.text.schema import FileName, Keys, OneOf, Refused, Switch, Text, Value, refusing
from fitting.text.tables import hertz_of
from fitting.text.units import convert, in_unit, parse_quantity

#: A sweep is told to count phases the wrong way, or to have another unit of phase, only where one
#: mode describes it that well the other way: root mean square over that of the data.
PLAIN_LINE = 0.15
#: How many times better a mode has to describe the data with the other unit of phase.
MUCH_BETTER = 5.0

#: Turns over a sweep from which a cable can be told from what a line turns by itself.
LEAST_CABLE = 0.25


@dataclass(frozen=True, kw_only=True)
class ComplexKeys(Keys):
    """How complex values are read, and how the response stands in them."""

    columns: ComplexColumns = field(default_factory=ComplexColumns)
    """Columns of other than the usual names, with unit as "X1 (mV)" if the file states none."""
    conjugate: Switch = False
    """Phases are counted the other way: that of a response rises with frequency."""
    sigma: Value | None = None
    """Standard deviation of each quadrature, as "0.1 uV"; without it from the residuals."""
    output: Text | None = None
    """The observed FMU output; without it that of [observe]."""
    wiring: Annotated[Text, OneOf(WIRINGS)] = "transmission"
    """How the response is part of the values, see `fmu-fit help phases`."""
    background: Annotated[Text, OneOf(BACKGROUNDS)] = "none"
    """Complex background next to the response, solved for."""
    delay: Text = "none"
    """Of the cable: "none", "fit", or a known one as "40 ns"."""
    scale: Annotated[Text, OneOf(("own", "shared"))] = "own"
    """Complex gain: its own, or one for all that share it."""
    restarted: Switch = False
    """With scale = "shared": its phase of the gain is its own, as after a restart of the
    instrument."""

    def check(self) -> None:
        """Complain of keys that do not go together.

        Raises:
            Refused: names the key.
        """
        if self.restarted and self.scale != "shared":
            raise Refused('has a meaning with scale = "shared" only', "restarted")
        if self.wiring != "transmission":
            if self.scale == "shared":
                raise Refused(f'wanted "own" with wiring = "{self.wiring}"', "scale")
            if self.background == "constant":
                raise Refused(
                    f'"constant" is what passes by in wiring = "{self.wiring}" anyway; wanted '
                    '"none" or "slope"',
                    "background",
                )
        with refusing("delay"):
            self.delay_s("")

    def delay_s(self, where: str) -> float | None:
        """Known delay, s; None: it is fitted.

        Args:
            where: what complaints name.

        Raises:
            BadInput: it is no time.
        """
        if self.delay in ("none", "fit"):
            return 0.0 if self.delay == "none" else None
        value, unit = parse_quantity(self.delay, where=where, wanted="s")
        if unit is None:
            raise BadInput(
                f'{where}: found "{self.delay}", wanted "none", "fit" or a time as "40 ns"'
            )
        return convert(value, unit, "s", where=where)

    def curve_of(self, measured: ComplexCurve, label: str) -> ComplexCurve:
        """A sweep as it was measured; settings and output are bound later.

        Args:
            measured: its values as the file has them.
            label: of the sweep.

        Raises:
            BadInput: phases that run the wrong way, or as behind another cable; no noise at all.
        """
        if self.conjugate:
            measured = replace(measured, values=np.conj(measured.y))
        delay_s, where = self.delay_s(""), measured.source
        check_sense(measured, delay_s, where)
        check_delay(measured, delay_s, where)
        sigma = 0.0
        if self.sigma is not None:
            sigma = in_unit(self.sigma, measured.unit)
            if not sigma > 0.0:
                raise BadInput(f"{self.sigma.where}: found {sigma:g}, wanted more than zero")
        f, values = measured.u_hz, measured.y
        cut, left_out = cut_off(f, values, measured.unit, f"{where}{f', {label}' * bool(label)}")
        return replace(
            measured,
            frequency_hz=f[~cut],
            values=values[~cut],
            sigma=sigma,
            label=label,
            wiring=Wiring(kind=self.wiring, background=self.background),
            delay_s=delay_s,
            shared=self.scale == "shared",
            restarted=self.restarted,
            left_out=(*measured.left_out, *left_out),
        )


def read_complex(
    path: Path, layout: str | None = None, selection: Selection | None = None
) -> ComplexCurve:
    """A complex trace of a file.

    Args:
        path: of the file.
        layout: how the instrument writes; None: recognised by the content.
        selection: what is taken of the file; None: the usual columns.

    Raises:
        BadInput: a column or unit is missing, a cell is no number, frequencies do not rise,
            radians that are degrees or degrees that are radians.
    """
    selection = selection or Selection()
    return complex_of(read_recording(path, layout, selection), selection)


def complex_of(recording: Recording, columns: ComplexColumns) -> ComplexCurve:
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
    result = ComplexCurve(
        frequency_hz=hertz_of(axis, written, where=f"{path}: column 'frequency'"),
        values=values,
        unit=unit,
        source=str(path),
        left_out=left_out,
    )
    for channel, what, its_unit in varying:
        column = recording.numbers(channel)
        if np.all(column == column[0]):
            raise BadInput(
                f"{path}: {what} is {column[0]:.6g} {its_unit} at all {column.size} points; "
                "wanted values that change over a resonance"
            )
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
    """Refuse a column that is taken twice, and cells that are no numbers."""
    names = [channel.name for channel in channels]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(
                f"{recording.path}: column '{name}' is taken for two things; wanted a column for "
                "each"
            )
    recording.check(channels)


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


def _check_phase(result: ComplexCurve, phase_rad: FloatArray, unit: str) -> None:
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


def _fits_better(result: ComplexCurve, phase_rad: FloatArray) -> bool:
    """Whether one mode describes the amplitudes far better with these phases."""
    other = np.abs(result.y) * np.exp(1j * phase_rad)
    here = complex_line(result.u_hz, result.y, None).misfit
    there = complex_line(result.u_hz, other, None).misfit
    return there < PLAIN_LINE and there * MUCH_BETTER < here


def check_sense(result: ComplexCurve, delay_s: float | None, where: str) -> None:
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


def check_delay(result: ComplexCurve, delay_s: float | None, where: str) -> None:
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


@dataclass(frozen=True, kw_only=True)
class ComplexSweepTable(StatedTable, LayoutKeys, ComplexKeys):
    """A complex frequency response: lock-in amplifier or network analyser, over drive frequency.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "complex_sweep"
    TOGETHER = ComplexSweep

    file: FileName
    """Frequency with X and Y, or amplitude or dB and phase, each with its unit."""

    def __post_init__(self) -> None:
        self.check()
        self.check_layout()

    def record(self, label: str) -> ComplexCurve:
        """The sweep of the file.

        Args:
            label: of the sweep.
        """
        measured = read_complex(self.file, self.layout, self.selection(self.columns))
        return self.curve_of(measured, label)


@dataclass(frozen=True, kw_only=True)
class ComplexControlSweepTable(ControlTable, ComplexKeys):
    """Complex sweeps over drive frequency at several values of a control, fitted as a whole."""

    TABLE: ClassVar[str] = "complex_control_sweep"

    file: FileName
    """A row for each point: controls, frequency, X and Y (or amplitude or dB and phase); or for
    each sweep: controls, and its file in the column file."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """Format of the instrument; without it recognised."""

    def __post_init__(self) -> None:
        self.check()
        self.check_controls("X", "Y", "phase", *vars(self.columns).values())

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> ComplexCurve:
        """The complex values of a place in Hz, as far as they are in the range."""
        if place.file != recording.path:
            measured = read_complex(place.file, self.layout, Selection(**vars(self.columns)))
        else:
            measured = complex_of(recording.part(place.rows), self.columns)
        kept = self.inside(measured.u_hz, f"{measured.source}: the sweep at {place.label}")
        part = replace(measured, frequency_hz=measured.u_hz[kept], values=measured.y[kept])
        return self.curve_of(part, place.label)

    def bind_spectra(
        self,
        places: Sequence[ControlPlace],
        spectra: Sequence[ComplexCurve],
        binder: Binder,
        setup: Setup,
    ) -> ComplexSweep:
        """The sweeps with the controls in the units of laws and of the FMU."""
        output = self.output or ""
        if output:
            where = f"{setup.source}: [{self.TABLE}] output"
            binder.real(output, where, READABLE, "observed")
        curves = []
        for place, curve in zip(places, spectra, strict=True):
            settings = {n: float(binder.setting(n, w)) for n, w in place.controls.items()}
            curves.append(replace(curve, settings=settings, output=output))
        return ComplexSweep(
            setup=setup, curves=tuple(curves), units=self.control_units(binder), one_delay=True
        )
