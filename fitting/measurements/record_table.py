"""Tables of a campaign of which each holds one record, and which are fitted together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar, cast

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.drift import bind_sigmas
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.description import READABLE
from fitting.measurements.record import Record
from fitting.measurements.together import Together
from fitting.measurements.traces.time_record import BEGINS, FIRST
from fitting.text.errors import BadInput, gathered
from fitting.text.schema import FileName, OneOf, Switch, Text, Value

Made = TypeVar("Made")


@dataclass(frozen=True, kw_only=True)
class RecordTable(MeasurementTable):
    """What all repeated tables of records tell: the file, the output, the label, start values."""

    REPEATED: ClassVar[bool] = True
    #: The measurement that their records are together.
    TOGETHER: ClassVar[type[Together[Any]]]

    file: FileName
    """Columns with their units."""
    output: Text | None = None
    """The FMU output that is observed; without it that of [observe]."""
    label: Text = ""
    """Name of this record, for values of its own; without it "1", "2" where there are several."""
    set: Mapping[str, Value] = field(default_factory=dict)
    """Start values of the FMU during the record."""

    def record(self, label: str) -> Record:
        """What the file holds; what depends on the FMU follows in `bound`.

        Args:
            label: of the record.

        Raises:
            BadInput: one line with file, column or key, what was found, what is wanted.
        """
        raise NotImplementedError

    def bound(self, binder: Binder, setup: Setup, label: str) -> Record:
        """What the file holds, with settings and output in the names and units of the FMU.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
            label: of the record.
        """
        record = self.checked(partial(self.record, label), binder, setup)
        return replace(record, **self.known(binder, setup))

    def checked(self, read: Callable[[], Made], binder: Binder, setup: Setup) -> Made:
        """What is read of the file: what is wrong in it and in the table is reported together.

        Args:
            read: reads the file.
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
        """
        made: list[Any] = gathered((read, *self.checks(binder, setup)))
        return cast("Made", made[0])

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
        """
        if self.output or self.TRANSIENT:
            where = f"{setup.source}: [[{self.TABLE}]] output"
            yield partial(binder.real, self.output or setup.output, where, READABLE, "observed")
        yield partial(binder.settings, self.set)

    def known(self, binder: Binder, setup: Setup) -> dict[str, Any]:
        """Fields of the record that follow from the table and the FMU, by name.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
        """
        return {"settings": binder.settings(self.set), "output": self.output or ""}

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadRecords:
        """All tables, with the labels that distinguish them; their files are read when bound."""
        return ReadRecords(tuple(tables), labels_of(tables))


@dataclass(frozen=True, kw_only=True)
class StatedTable(RecordTable):
    """A table whose start values may have declared errors."""

    set_sigma: Mapping[str, Value] = field(default_factory=dict)
    """Standard deviations of values in set, as { eta = "0.2 Hz" }: an offset of each is fitted."""

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, errors of start values as well."""
        yield from super().checks(binder, setup)
        yield partial(bind_sigmas, self.set_sigma, binder)

    def known(self, binder: Binder, setup: Setup) -> dict[str, Any]:
        """Settings, their errors, and the output."""
        return super().known(binder, setup) | {"setting_sigma": bind_sigmas(self.set_sigma, binder)}


@dataclass(frozen=True)
class ReadRecords:
    """All tables of one kind; their files are read when they are bound."""

    tables: tuple[RecordTable, ...]
    labels: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all tables, each once."""
        return tuple(dict.fromkeys(table.file for table in self.tables))

    def bind(self, binder: Binder, setup: Setup) -> Together[Any]:
        """All records, in the names and units of the FMU, as one measurement."""
        pairs = zip(self.tables, self.labels, strict=True)
        bound = gathered(partial(table.bound, binder, setup, label) for table, label in pairs)
        kind: Any = self.tables[0].TOGETHER
        return kind(setup=setup, **{kind.FIELD: tuple(bound)})  # type: ignore[no-any-return]


def labels_of(tables: Sequence[RecordTable]) -> tuple[str, ...]:
    """The label of every table: as written, else its number, from 1; none where it is alone.

    Args:
        tables: one or more, in the order of the file.

    Raises:
        BadInput: two of one label.
    """
    alone = len(tables) == 1
    labels = [x.label or ("" if alone else str(k)) for k, x in enumerate(tables, start=1)]
    for k, label in enumerate(labels):
        if label in labels[:k]:
            raise BadInput(
                f"{tables[k].file}: is the second {tables[k].TOGETHER.NOUN} of the label "
                f"'{label}'; wanted a label of its own for every [[{tables[k].TABLE}]]"
            )
    return tuple(labels)


@dataclass(frozen=True, kw_only=True)
class TimeTable(StatedTable):
    """A table of a record over time, whose runs begin with it."""

    TRANSIENT: ClassVar[bool] = True

    input: Text | None = None
    """The FMU input that is driven; without it none is."""
    offset: Switch = False
    """Whether an offset of the read-out is solved for, of X and Y as of a reference that leaks."""
    sigma: Value | None = None
    """Standard deviation of the samples, of X and of Y each, as "1 mV"; without it, it follows from
    the residuals."""
    begin: Annotated[Text, OneOf(BEGINS)] = FIRST
    """(free decay) "first": the record begins with its first sample; "found": where the free decay
    begins, after the drive was switched off or a blow; samples before are not used."""

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, the input as well."""
        yield from super().checks(binder, setup)
        if self.input is not None:
            where = f"{setup.source}: [[{self.TABLE}]] input"
            yield partial(binder.real, self.input, where, ("input",), "driven")
