"""What the campaign room asks of a kind of measurement: a table, its data, and these in FMU units.

    [lock_in]                    the table as written       MeasurementTable, a record of its keys
    file = "lock_in.csv"         its files, read            ReadMeasurement
                                 in names and units of      BoundMeasurement
                                 one FMU

A kind is a class that is derived from `MeasurementTable`, in a room above this one; readers of
campaigns are given the kinds that a file may contain (`fitting.measurements.kinds`). Experiments
and the sweep are fields of the campaign itself, because drift, noise and scale rest on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, Self

from fitting.text.arrays import Scalar
from fitting.text.schema import Keys

if TYPE_CHECKING:  # they take what is read here
    from fitting.campaign.binder import Binder
    from fitting.campaign.bound import Setup
    from fitting.campaign.parameters import Parameter


class SeriesMeasurement(Protocol):
    """Data of one kind as a program has them: part of a series."""

    @property
    def setup(self) -> Setup:
        """How it drives the FMU."""

    @property
    def series(self) -> str:
        """Name of the series that it belongs to."""

    @property
    def rows(self) -> int:
        """Number of residual rows."""

    def within(self, setup: Setup, series: str) -> BoundMeasurement:
        """The same as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """


class BoundMeasurement(SeriesMeasurement, Protocol):
    """Data of one kind in the names and units of an FMU: a `Measurement` of the room above."""

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of everything that was measured."""

    @property
    def control_units(self) -> Mapping[str, str]:
        """Units of those settings that no variable of the FMU holds, for laws."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is fitted next to the FMU's parameters, as the delay of a cable."""

    @property
    def line_width_hz(self) -> float | None:
        """Width of a line that the data show, Hz; None where they show none."""

    @property
    def setting_sigmas(self) -> Mapping[str, Mapping[str, float]]:
        """Declared standard deviations of settings, by label, of kinds that can declare them."""

    def named(self, label: str) -> BoundMeasurement:
        """The same, with a label for the place that has none.

        Args:
            label: of the place.
        """


class ReadMeasurement(Protocol):
    """Data of one kind as its files have them; what depends on the FMU is still as written."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read."""

    def bind(self, binder: Binder, setup: Setup) -> BoundMeasurement:
        """The same in the names and units of the FMU.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.

        Raises:
            BadInput: a variable that is not there, a unit or a value that does not fit.
        """


class MeasurementTable(Keys):
    """A table of campaign.toml that describes one measurement: a frozen record of its keys.

    ``TABLE`` is its name in the file. With ``REPEATED`` it is an array of tables, [[TABLE]], which
    are read and fitted together. With ``TRANSIENT`` its runs begin with the record: they need
    neither a [drive] nor time to settle.
    """

    TABLE: ClassVar[str]
    TRANSIENT: ClassVar[bool] = False
    REPEATED: ClassVar[bool] = False

    def read(self) -> ReadMeasurement:
        """Its files, read and checked.

        Raises:
            BadInput: one line with file, row, column or key, what was found, what is wanted.
        """
        raise NotImplementedError

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadMeasurement:
        """The files of all its tables in a campaign, where it is ``REPEATED``.

        Args:
            tables: one or more, in the order of the file.

        Raises:
            BadInput: one line with file, row, column or key, what was found, what is wanted.
        """
        raise NotImplementedError


def labels_of(measurements: Iterable[BoundMeasurement]) -> Sequence[str]:
    """Names of single places of measurements, which may have values of their own.

    Args:
        measurements: in the names and units of the FMU.
    """
    return [label for m in measurements for label, _ in m.places if label]
