"""Tables of spectra over a control: their keys, their places, and what their files hold.

A place is one value of the controls. Points that an instrument cut off are left out, with a
finding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import LAYOUTS, read_trace
from fitting.campaign.instruments.plain import LEAST_POINTS, read_spectra_table
from fitting.campaign.instruments.recording import Channel, Recording, Selection, of_table, unit_of
from fitting.campaign.instruments.roles import AMPLITUDE, FREQUENCY
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.description import READABLE
from fitting.lines.excluded import clipped_points
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.measurements.control_sweep import SCALES, ControlSpectrum, ControlSweep
from fitting.measurements.measurement import Measurement
from fitting.signal.amplitudes import Amplitude, declared_amplitude, to_peak
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput, gathered
from fitting.text.finding import Finding, left_out
from fitting.text.formula import Formula
from fitting.text.notation import hertz, how_many
from fitting.text.schema import (
    FileName,
    Frequencies,
    Keys,
    Missing,
    OneOf,
    Quantity,
    Refused,
    Share,
    Text,
    Texts,
    Usually,
    Value,
    refusing,
)
from fitting.text.tables import Table, hertz_of, named_column
from fitting.text.units import Written, in_unit, sigma_in


def cut_off(
    u_hz: FloatArray, values: FloatArray | ComplexArray, unit: str, source: str
) -> tuple[BoolArray, tuple[Finding, ...]]:
    """Points that are cut off, (n,), and a finding on them; none where too few would be left.

    Args:
        u_hz: frequencies of the tone, rising, shape (n,), Hz.
        values: amplitudes, or X + i Y, shape (n,).
        unit: of the values.
        source: name of the file, with the curve.
    """
    cut, limit = clipped_points(u_hz, values)
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return np.zeros(cut.size, dtype=np.bool_), ()
    ends = {"low_hz": float(u_hz[cut][0]), "high_hz": float(u_hz[cut][-1])}
    numbers = {"limit": limit, "parts": float(np.iscomplexobj(values)), **ends}
    result = left_out(source, int(np.sum(cut)), **numbers)
    return cut, (replace(result, names={**result.names, "unit": (unit,)}),)


#: Column that names the file of each spectrum.
FILE = "file"
#: Columns that a spectrum's own points, or their file, are in.
OWN_COLUMNS = ("frequency", "amplitude", FILE)


@dataclass(frozen=True, kw_only=True)
class ControlPlace:
    """One value of the controls: its label, the controls as written, its rows in the table (n,).

    ``file`` is that of the spectrum: its own, or the table.
    """

    label: str
    controls: Mapping[str, Written]
    rows: IntArray
    file: Path


@dataclass(frozen=True, kw_only=True)
class ControlTable(MeasurementTable):
    """What was changed from spectrum to spectrum, and what of each is fitted."""

    controls: Texts
    """Columns with units of the control quantities: of laws, or variables of the FMU."""
    range: Annotated[Frequencies | None, Usually(None)] = None
    """First and last fitted frequency."""
    file: FileName
    """A table of all points, or of a spectrum's own file in each row."""

    def check_controls(self, *own: str) -> None:
        """Refuse controls that are none, and a range that is none.

        Args:
            own: further columns of a spectrum's own points.

        Raises:
            Refused: names the key.
        """
        if not self.controls:
            raise Refused("is empty, wanted at least one column", "controls")
        points = {named_column(each, 0).name.lower() for each in (*OWN_COLUMNS, *own) if each}
        for name in self.controls:
            if name.lower() in points:
                raise Refused(
                    f"'{name}' is the axis of a spectrum or a measured quantity; wanted columns of "
                    "what was changed from spectrum to spectrum",
                    "controls",
                )
        if self.range is None:
            return
        if len(self.range) != 2:
            raise Refused(
                f"{how_many(len(self.range), 'value')}, wanted the first and last one", "range"
            )
        with refusing("range"):
            low, high = self.range_hz
        if not low < high:
            raise Refused(
                f"from {hertz(low)} to {hertz(high)}, wanted the smaller frequency first", "range"
            )

    @property
    def range_hz(self) -> tuple[float, float]:
        """First and last frequency that is fitted, Hz; without a range all."""
        if self.range is None:
            return 0.0, float("inf")
        low, high = (in_unit(w, "Hz") for w in self.range)
        return low, high

    def read(self) -> ReadSpectra:
        """Its files: spectra in Hz, controls as written.

        Raises:
            BadInput: one line with file, row, column or key, what was found, what is wanted.
        """
        table = read_spectra_table(self.file)
        places = self._places(table)
        read = partial(self.spectrum_at, of_table(table))
        try:
            spectra = gathered([partial(read, place) for place in places])
        except BadInput as error:
            if table.find(FILE) is not None:
                raise
            # one table: what is wrong with its first spectrum is mostly wrong with all
            further = f" (and {len(error.args) - 1} more such complaints)" * (len(error.args) > 1)
            raise BadInput(f"{error.args[0]}{further}") from error
        return ReadSpectra(self, places, tuple(spectra))

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> Any:
        """The spectrum of a place, without what depends on the FMU.

        Args:
            recording: of the table.
            place: one value of the controls.

        Raises:
            BadInput: the spectrum cannot be read.
        """
        raise NotImplementedError

    def bind_spectra(
        self, places: Sequence[ControlPlace], spectra: Sequence[Any], binder: Binder, setup: Setup
    ) -> Measurement:
        """The spectra in the names and units of the FMU, as one measurement.

        Args:
            places: one value of the controls each.
            spectra: of the places.
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.

        Raises:
            BadInput: a variable that is not there, a unit or a value that does not fit.
        """
        raise NotImplementedError

    def control_units(self, binder: Binder) -> dict[str, str]:
        """Units of the controls: of laws, or of the FMU's own variables.

        Args:
            binder: of the campaign to its FMU.
        """
        return {
            name: binder.control_units.get(name)
            or getattr(binder.variables.get(name), "unit", None)
            or ""
            for name in self.controls
        }

    def inside(self, frequency_hz: FloatArray, where: str) -> BoolArray:
        """Which points of a spectrum lie within the range that is fitted, (n,).

        Args:
            frequency_hz: of the points, (n,), Hz.
            where: what errors name.

        Raises:
            BadInput: fewer than a spectrum has.
        """
        low, high = self.range_hz
        kept = (frequency_hz >= low) & (frequency_hz <= high)
        kept &= frequency_hz > 0.0  # spectra of Fourier transforms begin with a constant
        count = int(np.count_nonzero(kept))
        if count < LEAST_POINTS:
            between = "" if high == np.inf else f" from {hertz(low)} to {hertz(high)}"
            raise BadInput(
                f"{where} has {how_many(count, 'point')} to fit{between}; wanted at least "
                f"{LEAST_POINTS}"
            )
        return np.asarray(kept)

    def _places(self, table: Table) -> tuple[ControlPlace, ...]:
        """The values of the controls in a table, in its order: a row each, where it names files."""
        columns = [table.column(name) for name in self.controls]
        units = [unit_of(table, c, f"{c.name} (V)") for c in columns]
        values = np.column_stack([table.numbers(c) for c in columns])
        listed = table.find(FILE)
        if listed is not None:
            rows = [np.array([i]) for i in range(len(values))]
            files = [table.path.parent / name for name in table.texts(listed)]
        else:
            _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
            order = np.argsort(first)  # as the file has them
            rows = [np.flatnonzero(group.ravel() == k) for k in order]
            files = [table.path] * len(rows)
        places: dict[str, ControlPlace] = {}
        for own, file in zip(rows, files, strict=True):
            line, names = table.lines[own[0]], zip(columns, values[own[0]], units, strict=True)
            controls = {
                c.name: Written(float(v), unit, f"{table.path}: row {line}, '{c.name}'")
                for c, v, unit in names
            }
            label = ", ".join(f"{w.value:g} {w.unit}".removesuffix(" 1") for w in controls.values())
            if label in places:
                raise BadInput(
                    f"{table.path}: row {line}: is the second spectrum at {label}; wanted one"
                )
            places[label] = ControlPlace(label=label, controls=controls, rows=own, file=file)
        control_names = ", ".join(self.controls)
        if len(places) < 2:
            raise BadInput(
                f"{table.path}: one spectrum, at {next(iter(places))}; wanted several values of "
                f"{control_names}"
            )
        most = max(place.rows.size for place in places.values())
        if listed is None and most < LEAST_POINTS:
            raise BadInput(
                f"{table.path}: {len(places)} values of {control_names}, at each "
                f"{how_many(most, 'point')} or fewer; wanted at least {LEAST_POINTS} at each (rows "
                f"of one spectrum have the very same value of {control_names})"
            )
        return tuple(places.values())


@dataclass(frozen=True)
class ReadSpectra:
    """Spectra of a table as their files have them, one for each of its `places`."""

    table: ControlTable
    places: tuple[ControlPlace, ...]
    spectra: tuple[Any, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read, each once."""
        return tuple(dict.fromkeys((self.table.file, *(place.file for place in self.places))))

    def bind(self, binder: Binder, setup: Setup) -> Measurement:
        """The same with the controls in the units of laws and of the FMU."""
        return self.table.bind_spectra(self.places, self.spectra, binder, setup)


#: A line is looked for so far from its harmonic, in fundamentals: odd ones are two apart.
REACH = 0.8


@dataclass(frozen=True, kw_only=True)
class WrittenSpectrumColumns(Keys):
    """Names of a spectrum's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies."""
    amplitude: Text = ""
    """Column of amplitudes."""


@dataclass(frozen=True, kw_only=True)
class ControlSweepTable(ControlTable):
    """Spectra over drive frequency at several values of a control quantity, fitted as a whole."""

    TABLE: ClassVar[str] = "control_sweep"

    file: FileName
    """A row for each point: controls, frequency, amplitude; or for each spectrum: controls, and its
    file in the column file; or amplitudes of each value of one control: a column headed as "V=1.2
    V", or a row below a head of frequencies."""
    amplitude: Annotated[
        Text, Missing('wanted "V peak", "V rms", "dBm" or "dB"; files do not state which they mean')
    ]
    """Unit of the amplitudes: "V peak", "V rms", "dBm", "dB" (to an unknown reference), or another
    as "m peak"."""
    impedance: Annotated[float | None, Quantity("ohm")] = None
    """Required with dBm, and only there."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """Format of the instrument; without it recognised."""
    columns: WrittenSpectrumColumns = field(default_factory=WrittenSpectrumColumns)
    """Columns of other than the usual names, with unit as "X1 (mV)" if the file states none."""
    sigma: Value | None = None
    """Standard deviation of every amplitude, as "0.1 uV"; without it and relative each spectrum's
    scatter about a smooth curve."""
    relative: Share = 0.0
    """Standard deviation of every amplitude over it, next to sigma."""
    scale: Annotated[Text, OneOf(SCALES)] = "each"
    """From simulated to measured amplitudes: one for "each" spectrum, one "shared" by all; "none":
    1."""
    rectified: bool = True
    """Whether amplitudes are magnitudes of two quadratures with noise sigma each, as of lock-in
    amplifiers and analysers."""
    drive: Text | None = None
    """Amplitude of the drive over its level: a column, or a formula of frequency f and constants,
    as "f0/f" of a square wave."""
    lines: Annotated[float | None, Quantity("Hz")] = None
    """Fundamental of a periodic drive: only the odd harmonics of each spectrum are used, the peak
    within 0.8 of it."""
    output: Text | None = None
    """The observed FMU output; without it that of [observe]."""

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            declared_amplitude(self.amplitude, self.impedance, "")
        self.check_controls(*vars(self.columns).values())
        if self.scale == "none" and self.amplitude == "dB":
            raise Refused(
                'wanted "each" or "shared": dB have a reference that is not known', "scale"
            )

    @property
    def detector(self) -> Amplitude:
        """What the amplitudes mean."""
        return declared_amplitude(self.amplitude, self.impedance, "")

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> ControlSpectrum:
        """The peak amplitudes of a place in Hz, with the drive where a column states it."""
        drive: FloatArray | None = None
        if place.file != recording.path:
            wanted = Selection(frequency=self.columns.frequency, amplitude=self.columns.amplitude)
            raw = read_trace(place.file, self.layout, wanted)
            f = raw.frequency * _hertz(raw.frequency_unit, f"{place.file}: column 'frequency'")
            sizes, unit, rows = raw.amplitude, raw.amplitude_unit, raw.places
        else:
            f, sizes, unit, drive = self._points(recording, place.rows)
            rows = tuple(recording.places[i] for i in place.rows)
        amplitude = to_peak(sizes, unit, self.detector, str(place.file), rows)
        if self.lines is not None:
            f, amplitude, bins = odd_harmonics(f, amplitude, self.lines)
            drive = None if drive is None else drive[bins]
        where = f"{place.file}: the spectrum at {place.label}"
        kept = self.inside(f, where)
        if not np.any(amplitude[kept] > 0.0):
            raise BadInput(f"{where}: every amplitude is zero; wanted a resonance")
        return ControlSpectrum(
            f[kept],
            amplitude[kept],
            {},
            label=place.label,
            drive=1.0 if drive is None else drive[kept],
        )

    def _points(
        self, recording: Recording, rows: IntArray
    ) -> tuple[FloatArray, FloatArray, str, FloatArray | None]:
        """Frequencies in Hz, amplitudes, their unit and the drive in rows of a table, (n,) each."""
        path, places = recording.path, [recording.places[i] for i in rows]
        taken = {name.lower() for name in (*self.controls, self.drive or "")}

        def column(name: str, usual: Sequence[str]) -> Channel:
            """The column of the wanted name, else of the first usual one that is no control."""
            if name:
                return recording.column(name)
            there = (recording.find(each) for each in usual if each not in taken)
            first = next((each for each in there if each is not None), None)
            return first or recording.column(usual[0])

        frequency = column(self.columns.frequency, FREQUENCY)
        amplitude = column(self.columns.amplitude, AMPLITUDE)
        unit = unit_of(recording, frequency, "frequency (Hz)")
        hertz = _hertz(unit, f"{path}: column '{frequency.name}'")
        f = hertz * recording.numbers(frequency)[rows]
        for i in np.flatnonzero(f < 0.0)[:1]:
            raise BadInput(
                f"{path}: {places[i]}: frequency {f[i]:.12g} Hz; wanted one from zero on"
            )
        for i in np.flatnonzero(np.diff(f) <= 0.0)[:1]:
            raise BadInput(
                f"{path}: {places[i + 1]}: frequency {f[i + 1]:.12g} Hz follows {f[i]:.12g} Hz; "
                "wanted strictly rising ones at each value of the controls"
            )
        unit = unit_of(recording, amplitude, "amplitude (uV)")
        values = recording.numbers(amplitude)[rows]
        driven = recording.find(self.drive) if self.drive else None
        drive = None if driven is None else recording.numbers(driven)[rows]
        if drive is not None and np.any(drive <= 0.0):
            bad = places[int(np.argmax(drive <= 0.0))]
            raise BadInput(f"{path}: {bad}, column '{self.drive}': wanted more than zero")
        return f, values, unit, drive

    def bind_spectra(
        self,
        places: Sequence[ControlPlace],
        spectra: Sequence[ControlSpectrum],
        binder: Binder,
        setup: Setup,
    ) -> ControlSweep:
        """The spectra with the controls in the units of laws and of the FMU."""
        where, unit = f"{setup.source}: [control_sweep]", self.detector.unit
        names: list[Callable[[], object]] = []
        if self.output:
            names += [partial(binder.real, self.output, f"{where} output", READABLE, "observed")]
        # one column: what is wrong with it is reported once
        names += [partial(sigma_in, self.sigma, unit), partial(binder.settings, places[0].controls)]
        gathered(names)
        sigma = sigma_in(self.sigma, unit)
        bound = []
        for place, spectrum in zip(places, spectra, strict=True):
            level = self._level(spectrum, f"{where} drive")
            source = f"{place.file}{f', {place.label}' * bool(place.label)}"
            cut, left_out = cut_off(spectrum.u_hz, spectrum.y, unit, source)
            settings = {n: float(binder.setting(n, w)) for n, w in place.controls.items()}
            bound.append(
                replace(
                    spectrum,
                    frequency_hz=spectrum.u_hz[~cut],
                    amplitude=spectrum.y[~cut],
                    settings=settings,
                    sigma=np.hypot(sigma, self.relative * spectrum.y)[~cut],
                    drive=level[~cut],
                    left_out=left_out,
                )
            )
        return ControlSweep(
            setup=setup,
            spectra=tuple(bound),
            units=self.control_units(binder),
            scaled_by=self.scale,
            rectified=self.rectified,
            estimated=self.sigma is None and not self.relative and self.lines is None,
            logarithmic=self.detector.kind == "dB",
            output=self.output or "",
            unit=unit,
        )

    def _level(self, spectrum: ControlSpectrum, where: str) -> FloatArray:
        """Amplitude of the drive over its level, at every point of a spectrum."""
        if self.drive is None or np.ndim(spectrum.drive):  # none, or a column of the file
            return spectrum.level
        formula = Formula(self.drive, where)
        if formula.names != ("f",):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is neither a column of the file nor a formula "
                "of the frequency f alone, in Hz"
            )
        values = formula.value({"f": spectrum.u_hz})
        if not np.all(np.isfinite(values) & (values > 0.0)):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is no positive number at all frequencies"
            )
        return np.asarray(values)


def _hertz(unit: str, where: str) -> float:
    """Hz in one of the unit: of many points at once, each rounded twice."""
    return float(hertz_of([1.0], unit, where=where)[0])


def odd_harmonics(
    frequency_hz: FloatArray, amplitude: FloatArray, fundamental_hz: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The odd harmonics of a periodic drive that a spectrum shows: Hz, amplitude, point, (k,) each.

    Of the points within 0.8 fundamentals of a harmonic the highest is taken if it is above both
    its neighbours; the amplitude is that of the parabola through the logarithms of the three, which
    is the line's own where the window of the transform is smooth, not the one of the nearest bin.

    Args:
        frequency_hz: of the points, (n,), Hz, rising.
        amplitude: of the points, (n,).
        fundamental_hz: frequency of the drive's period, Hz.
    """
    f, a = frequency_hz, amplitude
    result = []
    for n in range(1, int(f[-1] / fundamental_hz) + 1, 2):
        near = np.flatnonzero(np.abs(f - n * fundamental_hz) < REACH * fundamental_hz)
        k = int(near[np.argmax(a[near])]) if near.size else 0
        if not 0 < k < f.size - 1 or min(a[k - 1 : k + 2]) <= 0.0:
            continue
        left, top, right = np.log(a[k - 1 : k + 2])
        bend = left - 2.0 * top + right
        if bend < 0.0 and top >= max(left, right):
            height = top - (left - right) ** 2 / (8.0 * bend)
            result.append((n * fundamental_hz, float(np.exp(height)), k))
    lines, heights, points = np.array(result).reshape(-1, 3).T
    return lines, heights, points.astype(int)
