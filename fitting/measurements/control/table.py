"""The table [control_sweep] of a campaign, and the spectra that its files hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import LAYOUTS, Channel, Recording, Selection, read_trace, unit_of
from fitting.campaign.instruments.roles import AMPLITUDE, FREQUENCY
from fitting.fmu.description import READABLE
from fitting.measurements.clipped import cut_off
from fitting.measurements.control.keys import ControlPlace, ControlTable
from fitting.measurements.control.scales import SCALES
from fitting.measurements.control.spectrum import ControlSpectrum
from fitting.measurements.control.sweep import ControlSweep
from fitting.signal.amplitudes import Amplitude, declared_amplitude, to_peak
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import BadInput, gathered
from fitting.text.formula import Formula
from fitting.text.schema import (
    FileName,
    Keys,
    Missing,
    OneOf,
    Quantity,
    Refused,
    Share,
    Text,
    Value,
    refusing,
)
from fitting.text.tables import hertz_of
from fitting.text.units import sigma_in

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
    """Either all points, a row each: the controls, frequency, amplitude, or other usual names of
    these, as f and R; or a row for each spectrum: the controls, and in the column file the name of
    the spectrum's own file; or a column of amplitudes for each value of one control, its head as
    "V=1.2 V", or a row for each, with the frequencies in the head."""
    amplitude: Annotated[
        Text, Missing('wanted "V peak", "V rms", "dBm" or "dB"; files do not state which they mean')
    ]
    """What the amplitudes mean: "V peak", "V rms", "dBm", "dB" (to a reference that nobody knows),
    or another detector unit likewise, as "m peak"."""
    impedance: Annotated[float | None, Quantity("ohm")] = None
    """With dBm only, and required there."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """How the instrument writes the spectra's own files; without it their content tells."""
    columns: WrittenSpectrumColumns = field(default_factory=WrittenSpectrumColumns)
    """Names of columns, where they are not the usual ones; with the unit in brackets, as "X1 (mV)",
    where the file tells none."""
    sigma: Value | None = None
    """Standard deviation of every amplitude, as "0.1 uV"; without it, and without relative, that of
    every spectrum is estimated from how its points scatter about a smooth curve."""
    relative: Share = 0.0
    """Standard deviation of every amplitude as a share of it, beside sigma."""
    scale: Annotated[Text, OneOf(SCALES)] = "each"
    """From simulated to measured amplitudes: "each": one for every spectrum, "shared": one for all;
    "none": 1."""
    rectified: bool = True
    """Whether amplitudes are magnitudes of two quadratures with the noise sigma each, as those of
    lock-in and network analysers and of Fourier transforms are: noise then makes them larger."""
    drive: Text | None = None
    """Amplitude of the drive at each frequency, relative to the level: a column of the file, or a
    formula of the frequency f and of constants, as "f0/f" for the harmonics of a square wave."""
    lines: Annotated[float | None, Quantity("Hz")] = None
    """Fundamental of a periodic drive: of each spectrum the odd harmonics are picked, the highest
    point within 0.8 of it, refined by a parabola through the logarithms beside it."""
    output: Text | None = None
    """The FMU output that is seen; without it that of [observe]."""

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
