"""The table [control_sweep] of a campaign, and the spectra that its files hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.control_table import (
    MeasuredSpectrum,
    read_spectra,
)
from fitting.campaign.file import TraceFormat
from fitting.campaign.instruments import LAYOUTS, Selection
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.variables import READABLE
from fitting.measurements.clipped import cut_off
from fitting.measurements.control.keys import ControlKeys
from fitting.measurements.control.scales import SCALES
from fitting.measurements.control.spectrum import ControlSpectrum
from fitting.measurements.control.sweep import ControlSweep
from fitting.signal.amplitudes import declared_amplitude
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, gathered
from fitting.text.formula import Formula
from fitting.text.keys import (
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
from fitting.text.written import sigma_in


@dataclass(frozen=True, kw_only=True)
class WrittenSpectrumColumns(Keys):
    """Names of a spectrum's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies."""
    amplitude: Text = ""
    """Column of amplitudes."""


@dataclass(frozen=True, kw_only=True)
class ControlSweepTable(MeasurementTable, ControlKeys):
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

    def read(self) -> ReadControlSweep:
        """Its files: Hz, peak amplitudes, controls as written."""
        how = TraceFormat(
            layout=self.layout,
            amplitude=declared_amplitude(self.amplitude, self.impedance, ""),
            selection=Selection(frequency=self.columns.frequency, amplitude=self.columns.amplitude),
        )
        spectra = read_spectra(
            self.file, how, self.controls, self.drive or "", self.lines, self.range_hz
        )
        return ReadControlSweep(self, how, spectra)


@dataclass(frozen=True)
class ReadControlSweep:
    """Spectra as `table` tells of them, and as their files have them."""

    table: ControlSweepTable
    format: TraceFormat
    spectra: tuple[MeasuredSpectrum, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read."""
        own = (s.source for s in self.spectra if s.source != self.table.file)
        return (self.table.file, *own)

    def bind(self, binder: Binder, setup: Setup) -> ControlSweep:
        """The same with the controls in the units of laws and of the FMU."""
        table, where = self.table, f"{setup.source}: [control_sweep]"
        unit = self.format.amplitude.unit
        gathered(self._names(binder, f"{where} output", unit))
        sigma = sigma_in(table.sigma, unit)
        return ControlSweep(
            setup=setup,
            spectra=tuple(
                self._spectrum(s, binder, sigma, self._drive(s, setup, where), unit)
                for s in self.spectra
            ),
            units=table.control_units(binder),
            scaled_by=table.scale,
            rectified=table.rectified,
            estimated=table.sigma is None and not table.relative and table.lines is None,
            logarithmic=self.format.amplitude.kind == "dB",
            output=table.output or "",
            unit=unit,
        )

    def _spectrum(
        self, s: MeasuredSpectrum, binder: Binder, sigma: float, drive: FloatArray, unit: str
    ) -> ControlSpectrum:
        """One spectrum, without what the instrument cut off at its limit."""
        source = f"{s.source}{f', {s.label}' * bool(s.label)}"
        cut, left_out = cut_off(s.frequency_hz, s.amplitude, unit, source)
        return ControlSpectrum(
            s.frequency_hz[~cut],
            s.amplitude[~cut],
            {name: float(binder.setting(name, w)) for name, w in s.controls.items()},
            label=s.label,
            sigma=np.hypot(sigma, self.table.relative * s.amplitude)[~cut],
            drive=drive[~cut],
            left_out=left_out,
        )

    def _names(self, binder: Binder, where: str, unit: str) -> Iterator[Callable[[], object]]:
        """What looks at each name and value by itself."""
        if self.table.output:
            yield partial(binder.real, self.table.output, where, READABLE, "observed")
        yield partial(sigma_in, self.table.sigma, unit)
        for spectrum in self.spectra[:1]:  # one column: what is wrong with it is told once
            yield partial(binder.settings, spectrum.controls)

    def _drive(self, spectrum: MeasuredSpectrum, setup: Setup, where: str) -> FloatArray:
        """Amplitude of the drive over its level, at every point of a spectrum."""
        if spectrum.drive is not None:
            return spectrum.drive
        if self.table.drive is None:
            return np.ones(spectrum.frequency_hz.size)
        formula = Formula(self.table.drive, f"{where} drive")
        if formula.names != ("f",):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is neither a column of the file nor a formula "
                "of the frequency f alone, in Hz"
            )
        values = formula.value({"f": spectrum.frequency_hz})
        if not np.all(np.isfinite(values) & (values > 0.0)):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is no positive number at all frequencies"
            )
        return np.asarray(values)
