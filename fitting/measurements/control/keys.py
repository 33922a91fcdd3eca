"""Tables of spectra over a control: their keys, and the places, one value of the controls each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import unit_of
from fitting.campaign.instruments.plain import LEAST_POINTS, read_spectra_table
from fitting.campaign.instruments.recording import Recording, of_table
from fitting.campaign.kind import MeasurementTable
from fitting.measurements.measurement import Measurement
from fitting.text.arrays import BoolArray, FloatArray, IntArray
from fitting.text.errors import BadInput, gathered
from fitting.text.notation import hertz, how_many
from fitting.text.schema import FileName, Frequencies, Refused, Texts, Usually, refusing
from fitting.text.tables import Table, named_column
from fitting.text.units import Written, in_unit

#: Column that names the file of each spectrum.
FILE = "file"
#: Columns that a spectrum's own points, or their file, are in.
OWN_COLUMNS = ("frequency", "amplitude", FILE)


@dataclass(frozen=True, kw_only=True)
class ControlPlace:
    """One value of the controls: its label, the controls as written, its rows in the table (n,).

    ``file`` is that of the spectrum: its own, or the table.
    """

    label: str
    controls: Mapping[str, Written]
    rows: IntArray
    file: Path


@dataclass(frozen=True, kw_only=True)
class ControlTable(MeasurementTable):
    """What was changed from spectrum to spectrum, and what of each is fitted."""

    controls: Texts
    """Columns of the control quantities, each with its unit: what laws name, or variables of the
    FMU."""
    range: Annotated[Frequencies | None, Usually(None)] = None
    """First and last frequency that is fitted."""
    file: FileName
    """A table of all points, or of a spectrum's own file in each row."""

    def check_controls(self, *own: str) -> None:
        """Refuse controls that are none, and a range that is none.

        Args:
            own: further columns of a spectrum's own points.

        Raises:
            Refused: names the key.
        """
        if not self.controls:
            raise Refused("is empty, wanted at least one column", "controls")
        points = {named_column(each, 0).name.lower() for each in (*OWN_COLUMNS, *own) if each}
        for name in self.controls:
            if name.lower() in points:
                raise Refused(
                    f"'{name}' is the axis of a spectrum or a measured quantity; wanted columns of "
                    "what was changed from spectrum to spectrum",
                    "controls",
                )
        if self.range is None:
            return
        if len(self.range) != 2:
            raise Refused(
                f"{how_many(len(self.range), 'value')}, wanted the first and last one", "range"
            )
        with refusing("range"):
            low, high = self.range_hz
        if not low < high:
            raise Refused(
                f"from {hertz(low)} to {hertz(high)}, wanted the smaller frequency first", "range"
            )

    @property
    def range_hz(self) -> tuple[float, float]:
        """First and last frequency that is fitted, Hz; without a range all."""
        if self.range is None:
            return 0.0, float("inf")
        low, high = (in_unit(w, "Hz") for w in self.range)
        return low, high

    def read(self) -> ReadSpectra:
        """Its files: spectra in Hz, controls as written.

        Raises:
            BadInput: one line with file, row, column or key, what was found, what is wanted.
        """
        table = read_spectra_table(self.file)
        places = self._places(table)
        read = partial(self.spectrum_at, of_table(table))
        try:
            spectra = gathered([partial(read, place) for place in places])
        except BadInput as error:
            if table.find(FILE) is not None:
                raise
            # one table: what is wrong with its first spectrum is mostly wrong with all
            further = f" (and {len(error.args) - 1} more such complaints)" * (len(error.args) > 1)
            raise BadInput(f"{error.args[0]}{further}") from error
        return ReadSpectra(self, places, tuple(spectra))

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> Any:
        """The spectrum of a place, without what depends on the FMU.

        Args:
            recording: of the table.
            place: one value of the controls.

        Raises:
            BadInput: the spectrum cannot be read.
        """
        raise NotImplementedError

    def bind_spectra(
        self, places: Sequence[ControlPlace], spectra: Sequence[Any], binder: Binder, setup: Setup
    ) -> Measurement:
        """The spectra in the names and units of the FMU, as one measurement.

        Args:
            places: one value of the controls each.
            spectra: of the places.
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.

        Raises:
            BadInput: a variable that is not there, a unit or a value that does not fit.
        """
        raise NotImplementedError

    def control_units(self, binder: Binder) -> dict[str, str]:
        """Units of the controls: of laws, or of the FMU's own variables.

        Args:
            binder: of the campaign to its FMU.
        """
        return {
            name: binder.control_units.get(name)
            or getattr(binder.variables.get(name), "unit", None)
            or ""
            for name in self.controls
        }

    def inside(self, frequency_hz: FloatArray, where: str) -> BoolArray:
        """Which points of a spectrum lie within the range that is fitted, (n,).

        Args:
            frequency_hz: of the points, (n,), Hz.
            where: what errors name.

        Raises:
            BadInput: fewer than a spectrum has.
        """
        low, high = self.range_hz
        kept = (frequency_hz >= low) & (frequency_hz <= high)
        kept &= frequency_hz > 0.0  # spectra of Fourier transforms begin with a constant
        count = int(np.count_nonzero(kept))
        if count < LEAST_POINTS:
            between = "" if high == np.inf else f" from {hertz(low)} to {hertz(high)}"
            raise BadInput(
                f"{where} has {how_many(count, 'point')} to fit{between}; wanted at least "
                f"{LEAST_POINTS}"
            )
        return np.asarray(kept)

    def _places(self, table: Table) -> tuple[ControlPlace, ...]:
        """The values of the controls in a table, in its order: a row each, where it names files."""
        columns = [table.column(name) for name in self.controls]
        units = [unit_of(table, c, f"{c.name} (V)") for c in columns]
        values = np.column_stack([table.numbers(c) for c in columns])
        listed = table.find(FILE)
        if listed is not None:
            rows = [np.array([i]) for i in range(len(values))]
            files = [table.path.parent / name for name in table.texts(listed)]
        else:
            _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
            order = np.argsort(first)  # as the file has them
            rows = [np.flatnonzero(group.ravel() == k) for k in order]
            files = [table.path] * len(rows)
        places: dict[str, ControlPlace] = {}
        for own, file in zip(rows, files, strict=True):
            line, names = table.lines[own[0]], zip(columns, values[own[0]], units, strict=True)
            controls = {
                c.name: Written(float(v), unit, f"{table.path}: row {line}, '{c.name}'")
                for c, v, unit in names
            }
            label = ", ".join(f"{w.value:g} {w.unit}".removesuffix(" 1") for w in controls.values())
            if label in places:
                raise BadInput(
                    f"{table.path}: row {line}: is the second spectrum at {label}; wanted one"
                )
            places[label] = ControlPlace(label=label, controls=controls, rows=own, file=file)
        control_names = ", ".join(self.controls)
        if len(places) < 2:
            raise BadInput(
                f"{table.path}: one spectrum, at {next(iter(places))}; wanted several values of "
                f"{control_names}"
            )
        most = max(place.rows.size for place in places.values())
        if listed is None and most < LEAST_POINTS:
            raise BadInput(
                f"{table.path}: {len(places)} values of {control_names}, at each "
                f"{how_many(most, 'point')} or fewer; wanted at least {LEAST_POINTS} at each (rows "
                f"of one spectrum have the very same value of {control_names})"
            )
        return tuple(places.values())


@dataclass(frozen=True)
class ReadSpectra:
    """Spectra of a table as their files have them, one for each of its `places`."""

    table: ControlTable
    places: tuple[ControlPlace, ...]
    spectra: tuple[Any, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read, each once."""
        return tuple(dict.fromkeys((self.table.file, *(place.file for place in self.places))))

    def bind(self, binder: Binder, setup: Setup) -> Measurement:
        """The same with the controls in the units of laws and of the FMU."""
        return self.table.bind_spectra(self.places, self.spectra, binder, setup)
