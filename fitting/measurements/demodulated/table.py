"""The table [[demodulated_trace]] of a campaign, and the columns that its files hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import Recording, Selection, read_recording, unit_of
from fitting.campaign.kind import MeasurementTable
from fitting.campaign.stated import bind_sigmas
from fitting.fmu.variables import READABLE
from fitting.measurements.demodulated.record import DemodulatedRecord
from fitting.measurements.demodulated.traces import DemodulatedTraces
from fitting.measurements.labels import labels_of
from fitting.measurements.traces.grid import spacing_s
from fitting.measurements.traces.time_record import BEGINS, FIRST
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput, gathered
from fitting.text.keys import Count, FileName, Keys, Missing, OneOf, Refused, Switch, Text, Value
from fitting.text.units import convert
from fitting.text.written import in_unit, sigma_in

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
class DemodulatedTable(MeasurementTable):
    """A free decay of one output of the FMU, demodulated at a frequency.

    A lock-in amplifier records it, or a spectrum analyser with a span of zero. Several of these
    tables are fitted together.
    """

    TABLE: ClassVar[str] = "demodulated_trace"
    REPEATED: ClassVar[bool] = True
    TRANSIENT: ClassVar[bool] = True

    file: Annotated[FileName, Missing("wanted a table of times and X and Y, or of amplitudes")]
    """Columns time and X and Y, or amplitude, each with its unit."""
    frequency: Annotated[Value, Missing('wanted what was demodulated at, as "1.2 MHz"')]
    """Frequency of the demodulator, as "1.2 MHz"."""
    input: Annotated[Text, Missing("wanted the FMU input by which a pulse sets it moving")]
    """The FMU input by which a pulse sets it moving."""
    columns: WrittenDemodulatedColumns = field(default_factory=WrittenDemodulatedColumns)
    """Names of columns, where they are not the usual ones."""
    output: Text | None = None
    """The FMU output that is seen; without it that of [observe]."""
    modes: Count = 1
    """How many modes are seen: those nearest to the frequency."""
    offset: Switch = False
    """(X and Y) whether a constant is solved for, as of a reference that leaks."""
    floor: Switch = True
    """(amplitudes) whether they do not fall below their noise: sigma, or what their scatter tells,
    or where they drown in it what is solved for."""
    sigma: Value | None = None
    """Standard deviation of X and of Y, as "1 mV"; without it the residuals tell it."""
    begin: Annotated[Text, OneOf(BEGINS)] = FIRST
    """"first": the decay begins with the first sample; "found": where it is found to; samples
    before are not used."""
    label: Text = ""
    """Name of the trace, for values of its own; without it "1", "2" where there are several."""
    set: dict[str, Value] = field(default_factory=dict)
    """Start values of the FMU during the trace."""
    set_sigma: dict[str, Value] = field(default_factory=dict)
    """Standard deviations of values in set, as { eta = "0.2 Hz" }: an offset of each is fitted."""

    def __post_init__(self) -> None:
        named = self.columns
        if named.amplitude and (named.X or named.Y):
            raise Refused("stands beside X or Y; wanted one of them", "columns.amplitude")
        if self.modes < 1:
            raise Refused(f"found {self.modes}, wanted 1 or more", "modes")

    def read_columns(self) -> ReadDemodulated:
        """Times and values, phasors or amplitudes, in the unit of the file.

        Raises:
            BadInput: a column or unit that is missing, times that are not an even grid.
        """
        names = self.columns
        told = Selection(
            time=names.time, amplitude=names.amplitude, phase=names.phase, x=names.X, y=names.Y
        )
        table = read_recording(self.file, selection=told)
        column = table.column(names.time or "time")
        where = f"{self.file}: column '{column.name}'"
        factor = convert(1.0, unit_of(table, column, "time (s)"), "s", where=where)
        time_s = factor * table.numbers(column)
        spacing_s(time_s, str(self.file), table.places)
        amplitudes = names.amplitude or table.find(names.X or "X") is None
        values, unit = self._amplitudes(table) if amplitudes else self._phasors(table)
        if names.phase:
            if not amplitudes:
                raise BadInput(f"{self.file}: a column of phases stands beside X and Y")
            values = values * np.exp(1j * self._phases(table))
        return ReadDemodulated(self, time_s, values, unit)

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

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadDemodulatedTraces:
        """All traces, with the labels that they are told apart by."""
        labels = labels_of(tables, "trace", cls.TABLE)
        read = gathered(table.read_columns for table in tables)
        return ReadDemodulatedTraces(tuple(read), tuple(labels))


@dataclass(frozen=True, eq=False)
class ReadDemodulated:
    """The columns of one table [[demodulated_trace]]."""

    table: DemodulatedTable
    time_s: FloatArray
    values: FloatArray | ComplexArray
    unit: str

    def record(self, binder: Binder, setup: Setup, label: str) -> DemodulatedRecord:
        """The trace in the names and units of the FMU.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
            label: of the trace.
        """
        table = self.table
        gathered(self._readers(binder, setup))
        return DemodulatedRecord(
            self.time_s,
            self.values,
            frequency_hz=in_unit(table.frequency, "Hz"),
            input=table.input,
            output=table.output or "",
            modes=table.modes,
            offset=table.offset,
            floor=table.floor,
            sigma=sigma_in(table.sigma, self.unit),
            begin=table.begin,
            settings=binder.settings(table.set),
            setting_sigma=bind_sigmas(table.set_sigma, binder),
            label=label,
            unit=self.unit,
            source=str(table.file),
        )

    def _readers(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What looks at each name and value by itself."""
        table, where = self.table, f"{setup.source}: [[demodulated_trace]]"
        seen = table.output or setup.output
        yield partial(binder.real, seen, f"{where} output", READABLE, "observed")
        yield partial(binder.real, table.input, f"{where} input", ("input",), "driven")
        yield partial(sigma_in, table.sigma, self.unit)
        yield partial(in_unit, table.frequency, "Hz")
        yield partial(binder.settings, table.set)
        yield partial(bind_sigmas, table.set_sigma, binder)


@dataclass(frozen=True)
class ReadDemodulatedTraces:
    """The traces of all tables [[demodulated_trace]], as their files have them."""

    read: tuple[ReadDemodulated, ...]
    labels: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all tables, each once."""
        return tuple(dict.fromkeys(one.table.file for one in self.read))

    def bind(self, binder: Binder, setup: Setup) -> DemodulatedTraces:
        """The traces in the names and units of the FMU."""
        pairs = zip(self.read, self.labels, strict=True)
        records = gathered(partial(one.record, binder, setup, label) for one, label in pairs)
        return DemodulatedTraces(setup=setup, traces=tuple(records))
