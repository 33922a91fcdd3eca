"""The table [[complex_sweep]] of a campaign, and the curves that its files hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.complex_trace import read_complex
from fitting.campaign.file import check_layout_keys, layout_keys
from fitting.campaign.instruments import LAYOUTS
from fitting.campaign.kind import MeasurementTable
from fitting.campaign.stated import bind_sigmas
from fitting.fmu.variables import READABLE
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.keys import ComplexKeys
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.labels import labels_of
from fitting.text.errors import gathered
from fitting.text.keys import Count, FileName, OneOf, Text, Usually, Value, WholeNumber


@dataclass(frozen=True, kw_only=True)
class ComplexSweepTable(MeasurementTable, ComplexKeys):
    """A complex frequency response: lock-in amplifier or network analyser, over drive frequency.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "complex_sweep"
    REPEATED: ClassVar[bool] = True

    file: FileName
    """Frequency with X and Y, real and imaginary part, amplitude and phase, or dB and phase, each
    column with its unit."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """How the instrument writes; without it the file's content tells."""
    trace: Annotated[Count | None, Usually(1)] = None
    """(rohde-schwarz, keysight) which trace or block of the file, from 1."""
    chunk: WholeNumber | None = None
    """(zurich only) which sweep of the file; without it the only one there is."""
    header_row: Count | None = None
    """(csv only) row of the names of columns, from 1; without it the one above the numbers."""
    label: Text = ""
    """Name of the sweep, for values of its own; without it "1", "2" where there are several."""
    set: Mapping[str, Value] = field(default_factory=dict)
    """Start values of the FMU during the sweep."""
    set_sigma: Mapping[str, Value] = field(default_factory=dict)
    """Standard deviations of values in set, as { eta = "0.2 Hz" }: an offset of each is fitted."""

    def __post_init__(self) -> None:
        self.check()
        told = {"trace": self.trace, "chunk": self.chunk, "header_row": self.header_row}
        check_layout_keys(told, layout_keys(self.layout), f'layout = "{self.layout}"')

    def curve(self, label: str) -> ComplexCurve:
        """The sweep of the file; settings and output are bound later.

        Args:
            label: of the sweep.
        """
        measured = read_complex(
            self.file,
            self.layout,
            self.columns,
            trace=self.trace or 1,
            chunk=self.chunk,
            header_row=self.header_row,
        )
        return self.curve_of(measured, label)

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadComplexSweeps:
        """All sweeps, with the labels that they are told apart by."""
        labels = labels_of(tables, "sweep", cls.TABLE)
        pairs = zip(tables, labels, strict=True)
        curves = gathered(_reader(table, label) for table, label in pairs)
        return ReadComplexSweeps(tuple(tables), tuple(curves))


def _reader(table: ComplexSweepTable, label: str) -> Any:
    return lambda: table.curve(label)


@dataclass(frozen=True)
class ReadComplexSweeps:
    """The sweeps of all tables [[complex_sweep]], as their files have them."""

    tables: tuple[ComplexSweepTable, ...]
    curves: tuple[ComplexCurve, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all tables, each once."""
        return tuple(dict.fromkeys(table.file for table in self.tables))

    def bind(self, binder: Binder, setup: Setup) -> ComplexSweep:
        """The sweeps with settings and outputs of the FMU."""
        gathered(look for table in self.tables for look in _names(table, binder, setup))
        pairs = zip(self.tables, self.curves, strict=True)
        bound = tuple(
            replace(
                curve,
                settings=binder.settings(table.set),
                setting_sigma=bind_sigmas(table.set_sigma, binder),
                output=table.output or "",
            )
            for table, curve in pairs
        )
        return ComplexSweep(setup=setup, curves=bound)


def _names(
    table: ComplexSweepTable, binder: Binder, setup: Setup
) -> Iterator[Callable[[], object]]:
    """What looks at each name and value by itself."""
    if table.output:
        where = f"{setup.source}: [complex_sweep] output"
        yield partial(binder.real, table.output, where, READABLE, "observed")
    yield partial(binder.settings, table.set)
    yield partial(bind_sigmas, table.set_sigma, binder)
