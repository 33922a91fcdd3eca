"""The table [[noise_spectrum]] of a campaign, and the columns that its files hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import read_recording
from fitting.campaign.instruments.recording import Channel, Recording, Selection, unit_of
from fitting.campaign.instruments.roles import HOLDS, Density, density_of, relative_density
from fitting.measurements.noise import (
    COLOURED,
    FORCES,
    THERMAL,
    WHITE,
    WINDOWS,
    NoiseRecord,
    NoiseSpectra,
)
from fitting.measurements.records import ReadColumn, RecordTable
from fitting.text.errors import BadInput
from fitting.text.schema import (
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
from fitting.text.units import above_zero, same_kind

#: What a campaign may state of the resonator: by key the field of a record, and its unit.
STATED = {
    "temperature": ("temperature_k", "K"),
    "mass": ("mass_kg", "kg"),
    "spring_constant": ("spring_constant", "N/m"),
}


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
class NoiseSpectrumTable(RecordTable):
    """A power spectral density of one output of the FMU under a random force.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "noise_spectrum"
    TOGETHER = NoiseSpectra

    file: Annotated[FileName, Missing("wanted a table of frequencies and densities with units")]
    """Columns frequency and density, each with its unit, as "density (V2/Hz)"; one-sided."""
    averages: Positive | None = None
    """Independent periodograms that were averaged; without it from the scatter."""
    columns: WrittenNoiseColumns = field(default_factory=WrittenNoiseColumns)
    """Columns of other than the usual names."""
    holds: Annotated[Text | None, OneOf(HOLDS)] = None
    """"density" or its "root", of a column whose unit does not state it: then relative numbers."""
    force: Annotated[Text, OneOf(FORCES)] = WHITE
    """"white": of constant density; "thermal": as the damping requires; "coloured": with a density
    in a column."""
    temperature: Value | None = None
    """(thermal) of the resonator, as "300 K"; without it solved for, of a displacement."""
    mass: Value | None = None
    """(thermal) of the mode, if the FMU's drive is an acceleration; without it a force."""
    spring_constant: Value | None = None
    """(thermal) instead of the mass."""
    floor: Switch = True
    """Whether a white floor is solved for."""
    window: Annotated[Text, OneOf(WINDOWS)] = "none"
    """Of the periodograms, each one over the spacing of the frequencies long."""

    def __post_init__(self) -> None:
        if self.holds is not None and self.holds not in HOLDS:
            raise Refused(f"found '{self.holds}', wanted {' or '.join(HOLDS)}", "holds")
        if self.averages is not None and self.averages < 1.0:
            raise Refused(f"found {self.averages:g}, wanted 1 or more", "averages")
        for key in ("temperature", "mass", "spring_constant"):
            if getattr(self, key) is not None and self.force != THERMAL:
                raise Refused('has a meaning with force = "thermal" only', key)
        if self.mass is not None and self.spring_constant is not None:
            raise Refused("is given together with mass; wanted one of them", "spring_constant")

    def record(self, label: str) -> NoiseRecord:
        """The columns of the file, in SI units.

        Args:
            label: of the spectrum.

        Raises:
            BadInput: a column or unit that is missing, or no unit of a power spectral density.
        """
        names = self.columns
        given = Selection(
            frequency=names.frequency,
            amplitude=names.density,
            further=(names.force,) if names.force else (),
        )
        table = read_recording(self.file, selection=given)
        frequency = self._column(table, names.frequency, "frequency")
        density = self._column(table, names.density, "density")
        f = ReadColumn.of(table, frequency, "frequency (Hz)").into("Hz")
        read = self._density(table, density)
        force = None
        if self.force == COLOURED:
            force = table.numbers(self._column(table, names.force, "force"))
        elif names.force:
            raise BadInput(f'{self.file}: columns.force has a meaning with force = "{COLOURED}"')
        return NoiseRecord(
            f.values,
            read.numbers,
            averages=self.averages,
            force=self.force,
            force_density=force,
            floor=self.floor,
            window=self.window,
            label=label,
            unit=read.unit,
            source=str(self.file),
        )

    def checks(self, binder: Binder, setup: Setup) -> Iterator[Callable[[], object]]:
        """What examines each name and value by itself, what is stated of the resonator as well."""
        yield from super().checks(binder, setup)
        for key, (_, unit) in STATED.items():
            yield partial(above_zero, getattr(self, key), unit)

    def known(self, binder: Binder, setup: Setup) -> dict[str, Any]:
        """Settings, output, what is stated of the resonator, whether the drive is a force."""
        stated = {
            name: above_zero(getattr(self, key), unit) for key, (name, unit) in STATED.items()
        }
        drives_force = self._drives_force(binder, setup)
        return super().known(binder, setup) | stated | {"drives_force": drives_force}

    def _density(self, table: Recording, column: Channel) -> Density:
        """The column as a density, by its unit or by the campaign's declaration of its content."""
        where = f"{self.file}: column '{column.name}'"
        result = None if column.unit is None else density_of(table.numbers(column), column.unit)
        if result is None and self.holds is not None:
            result = relative_density(table.numbers(column), column.unit, self.holds)
        if result is None:
            unit = unit_of(table, column, "density (V2/Hz)")
            raise BadInput(
                f"{where}: found unit '{unit}', wanted that of a power spectral density, as V2/Hz "
                'or nm2/Hz, or of its root, as V/√Hz; or holds = "density" or "root" in '
                f"[[{self.TABLE}]], of relative numbers"
            )
        if result.is_relative and self.temperature is not None:
            raise BadInput(
                f"{where}: its numbers are relative ones; wanted a unit, as V2/Hz, with a "
                "temperature"
            )
        return result

    def _column(self, table: Recording, name: str, usual: str) -> Channel:
        """A column by its name in the campaign, else by its usual one."""
        if name or table.find(usual) is not None:
            return table.column(name or usual)
        there = ", ".join(column.name for column in table.channels)
        raise BadInput(
            f"{self.file}: no column '{usual}'; there is: {there}; wanted its name in "
            f'[[{self.TABLE}]], as columns = {{ {usual} = "NAME" }}'
        )

    def _drives_force(self, binder: Binder, setup: Setup) -> bool:
        """Whether the drive is a force, or an acceleration of a mass that is given.

        Raises:
            BadInput: a temperature is given, and the mass of an acceleration is not.
        """
        drive = setup.drive
        names = [n for n in (*drive.amplitude_names, drive.input) if n in binder.variables]
        units = [binder.variables[n].unit or "" for n in names if n is not None]
        accelerates = any(same_kind(unit, "m/s**2") for unit in units if unit)
        if not accelerates or self.mass is not None or self.spring_constant is not None:
            return True
        if self.temperature is not None:
            raise BadInput(
                f"{setup.source}: [[{self.TABLE}]] temperature: the FMU's drive is an "
                "acceleration; wanted mass or spring_constant with it"
            )
        return False
