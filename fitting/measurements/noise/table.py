"""The table [[noise_spectrum]] of a campaign, and the columns that its files hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Self

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import unit_of
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.variables import READABLE
from fitting.measurements.labels import labels_of
from fitting.measurements.noise.record import (
    COLOURED,
    FORCES,
    THERMAL,
    WHITE,
    WINDOWS,
    NoiseRecord,
)
from fitting.measurements.noise.spectra import NoiseSpectra
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, gathered
from fitting.text.keys import (
    FileName,
    Keys,
    Missing,
    OneOf,
    Positive,
    Refused,
    Switch,
    Text,
    Value,
)
from fitting.text.tables import Column, Table, read_table
from fitting.text.units import convert
from fitting.text.written import above_zero

#: Units of what is seen whose squares per Hz a density may have.
TOLD = {"temperature": "K", "mass": "kg", "spring_constant": "N/m"}
SEEN_UNITS = ("m", "V", "m/s", "m/s**2", "A", "1")


@dataclass(frozen=True, kw_only=True)
class WrittenNoiseColumns(Keys):
    """Names of a noise spectrum's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies; without it "frequency"."""
    density: Text = ""
    """Column of the power spectral density; without it "density"."""
    force: Text = ""
    """(coloured) column of the force's density, in any unit; without it "force"."""


@dataclass(frozen=True, kw_only=True)
class NoiseSpectrumTable(MeasurementTable):
    """A power spectral density of one output of the FMU under a random force.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "noise_spectrum"
    REPEATED: ClassVar[bool] = True

    file: Annotated[FileName, Missing("wanted a table of frequencies and densities with units")]
    """Columns frequency and density, each with its unit, as "density (V2/Hz)"; one-sided."""
    averages: Positive | None = None
    """Number of independent periodograms that were averaged; without it their scatter tells it."""
    columns: WrittenNoiseColumns = field(default_factory=WrittenNoiseColumns)
    """Names of columns, where they are not the usual ones."""
    output: Text | None = None
    """The FMU output that is seen; without it that of [observe]."""
    force: Annotated[Text, OneOf(FORCES)] = WHITE
    """"white": a force of constant density; "thermal": the one that the damping asks for;
    "coloured": one whose density stands in a column."""
    temperature: Value | None = None
    """(thermal) of the resonator, as "300 K"; without it, it is solved for from a displacement."""
    mass: Value | None = None
    """(thermal) of the mode, where the FMU's drive is an acceleration; without it the drive is a
    force."""
    spring_constant: Value | None = None
    """(thermal) instead of the mass."""
    floor: Switch = True
    """Whether a white floor is solved for."""
    window: Annotated[Text, OneOf(WINDOWS)] = "none"
    """Of the periodograms, whose length is one over the spacing of the frequencies."""
    label: Text = ""
    """Name of the spectrum, for values of its own; without it "1", "2" where there are several."""
    set: dict[str, Value] = field(default_factory=dict)
    """Start values of the FMU during the spectrum."""

    def __post_init__(self) -> None:
        if self.averages is not None and self.averages < 1.0:
            raise Refused(f"found {self.averages:g}, wanted 1 or more", "averages")
        for key in ("temperature", "mass", "spring_constant"):
            if getattr(self, key) is not None and self.force != THERMAL:
                raise Refused('has a meaning with force = "thermal" only', key)
        if self.mass is not None and self.spring_constant is not None:
            raise Refused("stands beside mass; wanted one of them", "spring_constant")

    def columns_read(self) -> ReadNoise:
        """The columns of the file, in SI units.

        Raises:
            BadInput: a column or unit that is missing, or no unit of a power spectral density.
        """
        table, names = read_table(self.file), self.columns
        frequency = self._column(table, names.frequency, "frequency")
        density = self._column(table, names.density, "density")
        hertz = unit_of(table, frequency, "frequency (Hz)")
        where = f"{self.file}: column '{frequency.name}'"
        to_hz = convert(1.0, hertz, "Hz", where=where)
        unit = unit_of(table, density, "density (V2/Hz)")
        seen, factor = _seen_unit(unit, f"{self.file}: column '{density.name}'")
        force = None
        if self.force == COLOURED:
            force = table.numbers(self._column(table, names.force, "force"))
        elif names.force:
            raise BadInput(f'{self.file}: columns.force has a meaning with force = "{COLOURED}"')
        return ReadNoise(
            self,
            to_hz * table.numbers(frequency),
            factor * table.numbers(density),
            unit=seen,
            force=force,
        )

    def _column(self, table: Table, name: str, usual: str) -> Column:
        """A column by its name in the campaign, else by its usual one."""
        if name or table.find(usual) is not None:
            return table.column(name or usual)
        there = ", ".join(column.name for column in table.columns)
        raise BadInput(
            f"{self.file}: no column '{usual}'; there is: {there}; wanted its name in "
            f'[[{self.TABLE}]], as columns = {{ {usual} = "NAME" }}'
        )

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadNoiseSpectra:
        """All spectra, with the labels that they are told apart by."""
        labels = labels_of(tables, "spectrum", cls.TABLE)
        return ReadNoiseSpectra(tuple(gathered(x.columns_read for x in tables)), tuple(labels))


def _seen_unit(unit: str, where: str) -> tuple[str, float]:
    """SI unit of what is seen, and the factor to its square per Hz."""
    for seen in SEEN_UNITS:
        try:
            return seen, convert(1.0, unit, f"({seen})**2/Hz", where=where)
        except BadInput:
            continue
    raise BadInput(
        f"{where}: found unit '{unit}', wanted that of a power spectral density, as V2/Hz or nm2/Hz"
    )


@dataclass(frozen=True, eq=False)
class ReadNoise:
    """The columns of one table [[noise_spectrum]], (n,), and the unit of what is seen.

    `force` is the density of the force, None where no column has it.
    """

    table: NoiseSpectrumTable
    frequency_hz: FloatArray
    density: FloatArray
    _: KW_ONLY
    unit: str
    force: FloatArray | None = None

    def record(self, binder: Binder, setup: Setup, label: str) -> NoiseRecord:
        """The spectrum in the names and units of the FMU.

        Args:
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.
            label: of the spectrum.
        """
        table = self.table
        gathered(self._readers(binder, setup))
        numbers = {key: above_zero(getattr(table, key), unit) for key, unit in TOLD.items()}
        return NoiseRecord(
            self.frequency_hz,
            self.density,
            averages=table.averages,
            force=table.force,
            force_density=self.force,
            temperature_k=numbers["temperature"],
            mass_kg=numbers["mass"],
            spring_constant=numbers["spring_constant"],
            floor=table.floor,
            window=table.window,
            settings=binder.settings(table.set),
            label=label,
            output=table.output or "",
            unit=self.unit,
            source=str(table.file),
        )

    def _readers(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What looks at each name and value by itself."""
        table = self.table
        if table.output:
            where = f"{setup.source}: [[noise_spectrum]] output"
            yield partial(binder.real, table.output, where, READABLE, "observed")
        for key, unit in TOLD.items():
            yield partial(above_zero, getattr(table, key), unit)
        yield partial(binder.settings, table.set)


@dataclass(frozen=True)
class ReadNoiseSpectra:
    """The spectra of all tables [[noise_spectrum]], as their files have them."""

    read: tuple[ReadNoise, ...]
    labels: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all tables, each once."""
        return tuple(dict.fromkeys(one.table.file for one in self.read))

    def bind(self, binder: Binder, setup: Setup) -> NoiseSpectra:
        """The spectra in the names and units of the FMU."""
        pairs = zip(self.read, self.labels, strict=True)
        records = gathered(partial(one.record, binder, setup, label) for one, label in pairs)
        return NoiseSpectra(setup=setup, spectra=tuple(records))
