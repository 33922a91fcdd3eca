"""Tables of complex sweeps: [[complex_sweep]], and [complex_control_sweep] over a control."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.file import LayoutKeys
from fitting.campaign.instruments import LAYOUTS, Recording, Selection
from fitting.fmu.description import READABLE
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.keys import ComplexKeys, complex_of, read_complex
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.control.keys import ControlPlace, ControlTable
from fitting.measurements.record_table import StatedTable
from fitting.text.schema import FileName, OneOf, Text


@dataclass(frozen=True, kw_only=True)
class ComplexSweepTable(StatedTable, LayoutKeys, ComplexKeys):
    """A complex frequency response: lock-in amplifier or network analyser, over drive frequency.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "complex_sweep"
    TOGETHER = ComplexSweep

    file: FileName
    """Frequency with X and Y, real and imaginary part, amplitude and phase, or dB and phase, each
    column with its unit."""

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
    """Either all points, a row each: the controls, frequency, X and Y (or Re and Im, amplitude and
    phase, dB and phase); or a row for each sweep: the controls, and in the column file the name of
    the sweep's own file."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """How the instrument writes the sweeps' own files; without it their content decides."""

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
