"""What the tables of all records over time tell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.measurements.record_table import StatedTable
from fitting.measurements.traces.time_record import BEGINS, FIRST
from fitting.text.keys import OneOf, Switch, Text, Value


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
