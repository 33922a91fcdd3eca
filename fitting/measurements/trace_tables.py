"""The tables [[trace]] and [[demodulated_trace]] of a campaign, and the columns of their files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import read_recording
from fitting.campaign.instruments.recording import Recording, Selection
from fitting.fmu.description import FmuVariable
from fitting.measurements.demodulated import DemodulatedRecord, DemodulatedTraces
from fitting.measurements.records import ReadColumn, StatedTable
from fitting.measurements.time_record import BEGINS, DETECTED, FIRST
from fitting.measurements.traces import FIT, GAINS, ONE, REST, STARTS, UNKNOWN, TraceRecord, Traces
from fitting.measurements.waveform import INTERPOLATIONS, LINEAR, Chirp, Pulse, Waveform
from fitting.signal.time_grid import spacing_s
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, note
from fitting.text.schema import (
    Count,
    FileName,
    Keys,
    Missing,
    OneOf,
    Refused,
    Switch,
    Text,
    Texts,
    Usually,
    Value,
)
from fitting.text.units import Written, in_unit, sigma_in

#: Times, output, input that was recorded, and further inputs by name.
ReadColumns = tuple[ReadColumn, ReadColumn, ReadColumn | None, Mapping[str, ReadColumn]]

STEP, PULSE, CHIRP = SIGNALS = ("step", "pulse", "chirp")
#: States that decay after an unknown start, where nothing is written: one mode.
ONE_MODE = 2


@dataclass(frozen=True, kw_only=True)
class WrittenTraceColumns(Keys):
    """Names of a trace's columns where they are not the usual ones (empty)."""

    time: Text = ""
    """Column of times; without it "time"."""
    input: Text = ""
    """Column of the input; without it the input's name."""
    output: Text = ""
    """Column of the output; without it the output's name."""


@dataclass(frozen=True, kw_only=True)
class WrittenSignal(Keys):
    """An input that is declared instead of recorded."""

    kind: Annotated[Text, OneOf(SIGNALS)]
    """A level from a time on ("step") or for a while ("pulse"), or a sine through frequencies
    ("chirp")."""
    level: Value
    """Height of the step or pulse, amplitude of the chirp."""
    at: Value | None = None
    """Begin, on the clock of the trace; without it 0 s."""
    length: Value | None = None
    """(pulse, chirp) duration."""
    start: Value | None = None
    """(chirp) first frequency."""
    stop: Value | None = None
    """(chirp) last frequency."""

    def __post_init__(self) -> None:
        own = {STEP: (), PULSE: ("length",), CHIRP: ("length", "start", "stop")}[self.kind]
        for key in ("length", "start", "stop"):
            if key in own and getattr(self, key) is None:
                raise Refused(f"key '{key}' is missing, wanted for a {self.kind}")
            if key not in own and getattr(self, key) is not None:
                raise Refused(f'has no meaning with kind = "{self.kind}"', key)

    def waveform(self, unit: str | None) -> Waveform:
        """The input in a unit.

        Args:
            unit: of the FMU's input; None: it has none.
        """
        level, at_s = in_unit(self.level, unit), _in(self.at, "s")
        if self.kind == STEP:
            return Pulse(level=level, at_s=at_s)
        if self.kind == PULSE:
            return Pulse(level=level, at_s=at_s, length_s=_in(self.length, "s"))
        return Chirp(
            start_hz=_in(self.start, "Hz"),
            stop_hz=_in(self.stop, "Hz"),
            length_s=_in(self.length, "s"),
            level=level,
            at_s=at_s,
        )


def _in(written: Written | None, unit: str) -> float:
    return 0.0 if written is None else in_unit(written, unit)


@dataclass(frozen=True, kw_only=True)
class TimeTable(StatedTable):
    """A table of a record over time, whose runs begin with it."""

    TRANSIENT: ClassVar[bool] = True

    input: Text | None = None
    """The driven FMU input; without it none."""
    offset: Switch = False
    """Whether an offset of the read-out is solved for, of X and Y as of a leaking reference."""
    sigma: Value | None = None
    """Standard deviation of the samples, of X and Y each, as "1 mV"; without it from the
    residuals."""
    begin: Annotated[Text, OneOf(BEGINS)] = FIRST
    """(free decay) begin at the "first" sample, or where it is "found", without earlier samples."""

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, the input as well."""
        yield from super().checks(binder, setup)
        if self.input is not None:
            where = f"{setup.source}: [[{self.TABLE}]] input"
            yield partial(binder.real, self.input, where, ("input",), "driven")


@dataclass(frozen=True, kw_only=True)
class TraceTable(TimeTable):
    """A time series of one output of the FMU, under a recorded or declared input, or none.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "trace"
    TOGETHER = Traces

    file: Annotated[FileName, Missing("wanted a table of times and values, each with its unit")]
    """Columns time, output and a recorded input, each with its unit."""
    columns: WrittenTraceColumns = field(default_factory=WrittenTraceColumns)
    """Columns of other than the usual names."""
    further_inputs: Texts = ()
    """Further driven FMU inputs, by columns of their names, as ["Ti2"]."""
    signal: WrittenSignal | None = None
    """A declared input, instead of a column of the file."""
    interpolation: Annotated[Text | None, OneOf(INTERPOLATIONS), Usually(LINEAR)] = None
    """Of a recorded input between samples: "linear", or "held"."""
    gain: Annotated[Text, OneOf(GAINS)] = ONE
    """Of the read-out: "one", or "fit": solved for."""
    lead: Value | None = None
    """Time from the FMU's start to the first sample."""
    start: Annotated[Text, OneOf(STARTS)] = REST
    """State at the start: "rest": the FMU's; "unknown": solved for, of a linear FMU."""
    states: Annotated[Count | None, Usually(ONE_MODE)] = None
    """(unknown start) states that decay, two for each mode."""

    def __post_init__(self) -> None:
        if self.signal is not None and self.input is None:
            raise Refused("wanted together with 'input', the FMU input that is driven", "signal")
        if self.signal is not None and (self.columns.input or self.interpolation):
            key = "columns" if self.columns.input else "interpolation"
            raise Refused("has no meaning for the input together with 'signal'", key)
        if self.further_inputs and self.input is None:
            raise Refused(
                "wanted together with 'input', the first one that is driven", "further_inputs"
            )
        if self.further_inputs and self.start == UNKNOWN:
            raise Refused('has no meaning with start = "unknown"', "further_inputs")
        if self.states is not None and self.start != UNKNOWN:
            raise Refused('has a meaning with start = "unknown" only', "states")
        if self.start == UNKNOWN and self.input is None:
            raise Refused(
                "key 'input' is missing: an unknown start takes the response to a pulse at it"
            )
        if self.begin == DETECTED and (self.start != UNKNOWN or self.signal is not None):
            raise Refused('has a meaning for a free decay, with start = "unknown", only', "begin")
        if self.start == UNKNOWN and self.lead is not None:
            raise Refused('has no meaning with start = "unknown"', "lead")

    def read_columns(self, output: str) -> ReadColumns:
        """Times, output, input and further inputs of the file, as they are written.

        Args:
            output: name of the output that is seen, where the table names none.

        Raises:
            BadInput: a column or unit that is missing, times that are not an even grid.
        """
        names = self.columns
        named = tuple(filter(None, (names.output, names.input)))
        table = read_recording(self.file, selection=Selection(time=names.time, further=named))
        observed = names.output or self.output or output
        there = map(table.find, (names.time or "time", observed, *self.further_inputs))
        table.check(channel for channel in there if channel is not None)
        time = ReadColumn.of(table, table.column(names.time or "time"), "time (s)").into("s")
        spacing_s(time.values, str(self.file), table.places)
        driven = None
        if self.input is not None and self.signal is None:
            wanted = names.input or self.input
            known = names.input or self.start != UNKNOWN or table.find(wanted) is not None
            if known and self.begin == FIRST:
                driven = ReadColumn.of(table, table.column(wanted), f"{wanted} (V)")
        values = ReadColumn.of(table, table.column(observed), f"{observed} (V)")
        further = {}
        for name in self.further_inputs:  # in that input's unit where it states none
            column = table.column(name)
            where = f"{self.file}: column '{column.name}'"
            further[name] = ReadColumn(table.numbers(column), column.unit or "", where)
        return time, values, driven, further

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, those of inputs as well."""
        yield from super().checks(binder, setup)
        where = f"{setup.source}: [[{self.TABLE}]]"
        for name in self.further_inputs:
            yield partial(binder.real, name, f"{where} further_inputs", ("input",), "driven")

    def bound(self, binder: Binder, setup: Setup, label: str) -> TraceRecord:
        """The trace in the names and units of the FMU."""
        read = partial(self.read_columns, setup.output)
        time, values, recorded, further = self.checked(read, binder, setup)
        variables = binder.variables
        observed = variables[self.output or setup.output]
        driven: tuple[FloatArray, FloatArray] | Waveform | None = None
        if self.input is not None and self.signal is not None:
            driven = self.signal.waveform(variables[self.input].unit)
        elif self.input is not None and recorded is not None:
            # a factor of the one input is solved for, and the FMU has to be linear in it
            if self.gain == FIT and self.start == UNKNOWN and not further:
                with suppress(BadInput):  # in proportion to the input, whatever its unit
                    recorded = recorded.into(variables[self.input].unit)
                driven = np.array(time.values), recorded.values
            else:
                driven = _on_clock(time, binder, variables[self.input], recorded)
        decays = self.start == UNKNOWN and driven is None
        if self.gain == ONE and not decays:  # a free decay has no gain of its own
            if observed.unit is None:
                binder.note_missing_unit(observed)
            try:
                values = values.into(observed.unit)
            except BadInput as error:
                raise BadInput(
                    f'{error}; values that are in proportion to the output want gain = "fit" in '
                    "[[trace]]"
                ) from error
        return TraceRecord(
            time.values,
            values.values,
            input=self.input or "",
            driven=driven,
            further={
                name: _on_clock(time, binder, variables[name], column)
                for name, column in further.items()
            },
            interpolation=self.interpolation or LINEAR,
            gain=self.gain,
            offset=self.offset,
            sigma=sigma_in(self.sigma, values.unit),
            lead_s=_in(self.lead, "s"),
            start=self.start,
            states=self.states or ONE_MODE,
            begin=self.begin,
            label=label,
            unit=values.unit or "1",
            source=str(self.file),
            **self.known(binder, setup),
        )


def _on_clock(
    time: ReadColumn, binder: Binder, driver: FmuVariable, column: ReadColumn
) -> tuple[FloatArray, FloatArray]:
    """Times, and values of a column in the unit of its input."""
    if not column.unit:
        names = {"variable": (driver.name,), "unit": (driver.unit or "1",)}
        binder.note(note(Kind.unit_assumed, column.where, names))
    elif driver.unit is None:
        binder.note_missing_unit(driver)
    try:
        return np.array(time.values), column.into(driver.unit).values
    except BadInput as error:
        raise BadInput(
            f"{error}; an input that is in proportion to it, of a linear FMU, wants "
            'gain = "fit" and start = "unknown" in [[trace]]'
        ) from error


#: Amplitudes in these are levels, 20 to a factor of ten, of a reference that a decay does not need.
LEVELS = ("dB", "dBm", "dBV", "dBuV", "dBu", "dBc", "dBFS")


@dataclass(frozen=True, kw_only=True)
class WrittenDemodulatedColumns(Keys):
    """Names of a demodulated trace's columns where they are not the usual ones (empty)."""

    time: Text = ""
    """Column of times; without it "time"."""
    X: Text = ""
    """Column of the in-phase part; without it "X"."""
    Y: Text = ""
    """Column of the quadrature; without it "Y"."""
    amplitude: Text = ""
    """Column of amplitudes instead of X and Y, as "R (mV)" or in dB; without it "amplitude"."""
    phase: Text = ""
    """Column of phases next to amplitudes, as "theta (deg)"; without it none."""


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
    """The FMU input by which a pulse starts the decay."""
    columns: WrittenDemodulatedColumns = field(default_factory=WrittenDemodulatedColumns)
    """Columns of other than the usual names."""
    modes: Count = 1
    """Number of modes, those nearest to the frequency."""
    floor: Switch = True
    """(amplitudes) whether they have a noise floor: sigma, or from their scatter, or solved for."""

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
        time = ReadColumn.of(table, table.column(names.time or "time"), "time (s)")
        time_s = time.into("s").values
        spacing_s(time_s, str(self.file), table.places)
        amplitudes = names.amplitude or table.find(names.X or "X") is None
        values, unit = self._amplitudes(table) if amplitudes else self._phasors(table)
        if names.phase:
            if not amplitudes:
                raise BadInput(f"{self.file}: a column of phases is given together with X and Y")
            phase = ReadColumn.of(table, table.column(names.phase), "phase (deg)")
            values = values * np.exp(1j * phase.into("rad").values)
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
        x = ReadColumn.of(table, table.column(self.columns.X or "X"), "X (V)")
        y = ReadColumn.of(table, table.column(self.columns.Y or "Y"), "Y (V)")
        return x.values + 1j * y.into(x.unit).values, x.unit

    def _amplitudes(self, table: Recording) -> tuple[FloatArray, str]:
        if not self.columns.amplitude and table.find("amplitude") is None:
            present = ", ".join(f"'{c.name}'" for c in table.channels)
            raise BadInput(
                f"{self.file}: no columns 'X' and 'Y', nor 'amplitude', among {present}; wanted "
                "them, or their names in columns"
            )
        column = table.column(self.columns.amplitude or "amplitude")
        read = ReadColumn.of(table, column, "amplitude (V)")
        if read.unit in LEVELS:
            return 10.0 ** ((read.values - np.max(read.values)) / 20.0), "1"
        return read.values, read.unit
