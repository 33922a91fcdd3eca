"""The table [complex_control_sweep] of a campaign: complex sweeps at values of a control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.complex_trace import MeasuredComplex, complex_of, read_complex
from fitting.campaign.control_table import (
    ControlPlace,
    file_at,
    inside,
    places_of,
    spectra_at,
)
from fitting.campaign.instruments import LAYOUTS
from fitting.campaign.instruments.plain import read_spectra_table
from fitting.campaign.instruments.recording import Recording, of_table
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.variables import READABLE
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.keys import ComplexKeys
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.control.keys import ControlKeys
from fitting.text.keys import FileName, OneOf, Text
from fitting.text.tables import Table
from fitting.text.written import Written


@dataclass(frozen=True, kw_only=True)
class ComplexControlSweepTable(MeasurementTable, ComplexKeys, ControlKeys):
    """Complex sweeps over drive frequency at several values of a control, fitted as a whole."""

    TABLE: ClassVar[str] = "complex_control_sweep"

    file: FileName
    """Either all points, a row each: the controls, frequency, X and Y (or Re and Im, amplitude and
    phase, dB and phase); or a row for each sweep: the controls, and in the column file the name of
    the sweep's own file."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """How the instrument writes the sweeps' own files; without it their content tells."""

    def __post_init__(self) -> None:
        self.check()
        self.check_controls("X", "Y", "phase", *vars(self.columns).values())

    def read(self) -> ReadComplexControlSweep:
        """Its files: Hz, complex values, controls as written."""
        table = read_spectra_table(self.file)
        places = places_of(table, self.controls)
        recording = of_table(table)
        curves = spectra_at(table, places, partial(self._curve_at, table, recording))
        return ReadComplexControlSweep(self, places, tuple(curves))

    def _curve_at(self, table: Table, recording: Recording, place: ControlPlace) -> ComplexCurve:
        path = file_at(table, place)
        if path is None:
            measured = complex_of(recording.part(place.rows), self.columns)
        else:
            measured = read_complex(path, self.layout, self.columns)
        return self.curve_of(self._inside(measured, place), place.label)

    def _inside(self, measured: MeasuredComplex, place: ControlPlace) -> MeasuredComplex:
        where = f"{measured.source}: the sweep at {place.label}"
        kept = inside(measured.u_hz, self.range_hz, where)
        return replace(measured, frequency_hz=measured.u_hz[kept], values=measured.y[kept])


@dataclass(frozen=True)
class ReadComplexControlSweep:
    """Sweeps as `table` tells of them, and as their files have them, at `places`."""

    table: ComplexControlSweepTable
    places: tuple[ControlPlace, ...]
    curves: tuple[ComplexCurve, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read."""
        own = (Path(c.source) for c in self.curves)
        return tuple(dict.fromkeys((self.table.file, *own)))

    def bind(self, binder: Binder, setup: Setup) -> ComplexSweep:
        """The same with the controls in the units of laws and of the FMU."""
        output = self.table.output or ""
        if output:
            where = f"{setup.source}: [{self.table.TABLE}] output"
            binder.real(output, where, READABLE, "observed")
        curves = tuple(
            replace(curve, settings=_bound(binder, place.controls), output=output)
            for place, curve in zip(self.places, self.curves, strict=True)
        )
        return ComplexSweep(
            setup=setup, curves=curves, units=self.table.control_units(binder), one_delay=True
        )


def _bound(binder: Binder, controls: Mapping[str, Written]) -> dict[str, float]:
    return {name: float(binder.setting(name, written)) for name, written in controls.items()}
