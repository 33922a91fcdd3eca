"""The table [[demodulated_trace]] of a campaign, and the columns that its files hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np

from fitting.campaign.instruments import Recording, Selection, read_recording, unit_of
from fitting.measurements.demodulated.record import DemodulatedRecord
from fitting.measurements.demodulated.traces import DemodulatedTraces
from fitting.measurements.record_table import TimeTable
from fitting.signal.time_grid import spacing_s
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.schema import Count, FileName, Keys, Missing, Refused, Switch, Text, Value
from fitting.text.units import convert, in_unit, sigma_in

#: Amplitudes in these are levels, 20 to a factor of ten, of a reference that a decay does not need.
LEVELS = ("dB", "dBm", "dBV", "dBuV", "dBu", "dBc", "dBFS")


@dataclass(frozen=True, kw_only=True)
class WrittenDemodulatedColumns(Keys):
    """Names of a demodulated trace's columns where they are not the usual ones (empty)."""

    time: Text = ""
    """Column of times; without it "time"."""
    X: Text = ""
    """Column of the in-phase part; without it "X", where there is such a column."""
    Y: Text = ""
    """Column of the quadrature; without it "Y"."""
    amplitude: Text = ""
    """Column of amplitudes, instead of X and Y, as "R (mV)" or in dB; without it "amplitude"."""
    phase: Text = ""
    """Column of phases beside amplitudes, as "theta (deg)"; without it there are none."""


@dataclass(frozen=True, kw_only=True)
class DemodulatedTable(TimeTable):
    """A free decay of one output of the FMU, demodulated at a frequency.

    A lock-in amplifier records it, or a spectrum analyser with a span of zero. Several of these
    tables are fitted together.
    """

    TABLE: ClassVar[str] = "demodulated_trace"
    TOGETHER = DemodulatedTraces

    file: Annotated[FileName, Missing("wanted a table of times and X and Y, or of amplitudes")]
    """Columns time and X and Y, or amplitude, each with its unit."""
    frequency: Annotated[Value, Missing('wanted what was demodulated at, as "1.2 MHz"')]
    """Frequency of the demodulator, as "1.2 MHz"."""
    input: Annotated[Text, Missing("wanted the FMU input by which a pulse sets it moving")]
    """The FMU input by which a pulse sets it moving."""
    columns: WrittenDemodulatedColumns = field(default_factory=WrittenDemodulatedColumns)
    """Names of columns, where they are not the usual ones."""
    modes: Count = 1
    """How many modes are seen: those nearest to the frequency."""
    floor: Switch = True
    """(amplitudes) whether they do not fall below their noise: sigma, or what their scatter tells,
    or where they drown in it what is solved for."""

    def __post_init__(self) -> None:
        named = self.columns
        if named.amplitude and (named.X or named.Y):
            raise Refused("is given together with X or Y; wanted one of them", "columns.amplitude")
        if self.modes < 1:
            raise Refused(f"found {self.modes}, wanted 1 or more", "modes")

    def record(self, label: str) -> DemodulatedRecord:
        """Times and values, phasors or amplitudes, in the unit of the file.

        Args:
            label: of the trace.

        Raises:
            BadInput: a column or unit that is missing, times that are not an even grid.
        """
        names = self.columns
        given = Selection(
            time=names.time, amplitude=names.amplitude, phase=names.phase, x=names.X, y=names.Y
        )
        table = read_recording(self.file, selection=given)
        column = table.column(names.time or "time")
        where = f"{self.file}: column '{column.name}'"
        factor = convert(1.0, unit_of(table, column, "time (s)"), "s", where=where)
        time_s = factor * table.numbers(column)
        spacing_s(time_s, str(self.file), table.places)
        amplitudes = names.amplitude or table.find(names.X or "X") is None
        values, unit = self._amplitudes(table) if amplitudes else self._phasors(table)
        if names.phase:
            if not amplitudes:
                raise BadInput(f"{self.file}: a column of phases is given together with X and Y")
            values = values * np.exp(1j * self._phases(table))
        return DemodulatedRecord(
            time_s,
            values,
            frequency_hz=in_unit(self.frequency, "Hz"),
            input=self.input,
            modes=self.modes,
            offset=self.offset,
            floor=self.floor,
            sigma=sigma_in(self.sigma, unit),
            begin=self.begin,
            label=label,
            unit=unit,
            source=str(self.file),
        )

    def _phasors(self, table: Recording) -> tuple[ComplexArray, str]:
        x, y = table.column(self.columns.X or "X"), table.column(self.columns.Y or "Y")
        unit, other = unit_of(table, x, "X (V)"), unit_of(table, y, "Y (V)")
        factor = convert(1.0, other, unit, where=f"{self.file}: column '{y.name}'")
        return table.numbers(x) + 1j * factor * table.numbers(y), unit

    def _amplitudes(self, table: Recording) -> tuple[FloatArray, str]:
        if not self.columns.amplitude and table.find("amplitude") is None:
            present = ", ".join(f"'{c.name}'" for c in table.channels)
            raise BadInput(
                f"{self.file}: no columns 'X' and 'Y', nor 'amplitude', among {present}; wanted "
                "them, or their names in columns"
            )
        column = table.column(self.columns.amplitude or "amplitude")
        unit = unit_of(table, column, "amplitude (V)")
        if unit in LEVELS:
            levels = table.numbers(column)
            return 10.0 ** ((levels - np.max(levels)) / 20.0), "1"
        return table.numbers(column), unit

    def _phases(self, table: Recording) -> FloatArray:
        column = table.column(self.columns.phase)
        unit = unit_of(table, column, "phase (deg)")
        factor = convert(1.0, unit, "rad", where=f"{self.file}: column '{column.name}'")
        return factor * table.numbers(column)
