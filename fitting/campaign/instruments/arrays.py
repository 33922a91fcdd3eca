"""Files that hold named arrays (HDF5, MATLAB, TDMS): which of them are the columns of one sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.recording import (
    Channel,
    Numbers,
    Recording,
    channel_of,
    numbered_points,
)
from fitting.campaign.instruments.roles import FREQUENCY, TIME, plain_name
from fitting.campaign.instruments.trace import MIN_POINTS, Selection
from fitting.text.errors import BadInput
from fitting.text.loose_tables import suffixed_unit
from fitting.text.notation import how_many
from fitting.text.tables import named_column

#: Columns of a matrix that are taken for columns of a table; more are a map or a picture.
MOST_COLUMNS = 16
HERTZ = ("Hz", "kHz", "MHz", "GHz")
#: Names in a complaint.
SHOWN = 8


@dataclass(frozen=True, eq=False)
class NamedArray:
    """An array by its name in the file, "group/name", with its unit where the file states it.

    ``matrix`` is the name of the matrix whose column it is; empty for an array by itself.
    """

    name: str
    values: Numbers
    unit: str | None = None
    matrix: str = ""

    @property
    def folder(self) -> str:
        """The group that it is in, with those around it; empty: none."""
        return self.name.rpartition("/")[0]

    @property
    def plain(self) -> str:
        """Its name without a unit, in small letters."""
        return named_column(self.name, 0).name.lower()

    @property
    def rises(self) -> bool:
        """Whether its values are real and rise."""
        return not np.iscomplexobj(self.values) and bool(np.all(np.diff(self.values) > 0.0))

    def channel(self, folder: str) -> Channel:
        """The column, by its name within a folder.

        Args:
            folder: that of the axis.
        """
        name = self.name.removeprefix(f"{folder}/") if folder else self.name
        written = named_column(name, 0)
        unit = self.unit or written.unit or suffixed_unit(written.name)[1]
        made = channel_of(written.name, unit, self.values)
        return replace(made, whole=named_column(self.name, 0).name if "/" in self.name else "")

    def is_of(self, names: Sequence[str], units: Sequence[str]) -> bool:
        """Whether its name or its unit is one of these.

        Args:
            names: small letters.
            units: as they are usually spelt.
        """
        channel = self.channel(self.folder)
        return plain_name(channel) in names or channel.unit in units


def columns_of(name: str, values: np.ndarray, unit: str | None = None) -> list[NamedArray]:
    """The columns that an array holds: itself, those of a narrow matrix, or none.

    Args:
        name: of the array.
        values: of any shape and type.
        unit: as the file states it.
    """
    array = np.asarray(values)
    if array.dtype.names is not None and array.ndim == 1:
        fields = [(f"{name}/{field}", array[field]) for field in array.dtype.names]
        return [column for field, part in fields for column in columns_of(field, part, unit)]
    if array.dtype.kind not in "iufc" or array.size < MIN_POINTS:
        return []
    numbers = array.astype(complex if array.dtype.kind == "c" else float)
    if max(array.shape) == array.size:
        return [NamedArray(name, numbers.ravel(), unit)]
    if array.ndim != 2 or min(array.shape) > MOST_COLUMNS:
        return []
    table = numbers if array.shape[0] >= array.shape[1] else numbers.T
    return [NamedArray(f"{name} {k + 1}", table[:, k], unit, name) for k in range(table.shape[1])]


def recording_of(
    path: Path, arrays: Sequence[NamedArray], words: str, selection: Selection
) -> Recording:
    """The columns that belong to one frequency axis.

    Args:
        path: of the file.
        arrays: that it holds.
        words: that state what the file is.
        selection: names of columns, where they are not the usual ones.

    Raises:
        BadInput: no array of numbers, or several sweeps of which none is named; lists them.
    """
    if not arrays:
        raise BadInput(f"{path}: is {words}; it holds no arrays of numbers that could be a sweep")
    grouped = [name for name in selection.values if "/" in named_column(name, 0).name]
    if selection.axis:
        axis = _named(path, arrays, selection.axis)
    else:
        folder = _named(path, arrays, grouped[0]).folder if grouped else None
        axis = _axis(path, [a for a in arrays if a.folder == folder] or arrays, words)
    alike = [a for a in arrays if a.values.size == axis.values.size]
    chosen = [axis, *(a for a in alike if a.folder == axis.folder)]
    if all(a is axis for a in chosen):  # alone in its folder
        chosen += alike
    for name in grouped:
        array = _named(path, arrays, name, axis)
        if array.values.size != axis.values.size:
            raise BadInput(
                f"{path}: '{array.name}' has {how_many(array.values.size, 'value')}, "
                f"'{axis.name}' {axis.values.size}; wanted columns of one length"
            )
        chosen.append(array)
    once = {id(array): array for array in chosen}.values()
    return Recording(
        path=path,
        channels=tuple(array.channel(axis.folder) for array in once),
        places=numbered_points(axis.values.size),
        headed=bool(selection.axis) or axis.is_of((*FREQUENCY, *TIME), HERTZ),
        words=f"{words}, {axis.name}" if "/" in axis.name else words,
    )


def _axis(path: Path, arrays: Sequence[NamedArray], words: str) -> NamedArray:
    """The axis of a file of which none is named: frequencies, times, or a column that rises."""
    distinct: list[NamedArray] = []  # one of each folder, or several sweeps in it
    frequencies = [a for a in arrays if a.is_of(FREQUENCY, HERTZ)]
    for folder in dict.fromkeys(a.folder for a in frequencies):
        here = [a for a in frequencies if a.folder == folder]
        usual = [a for a in here if a.is_of(FREQUENCY, ())]
        distinct += usual[:1] or _different(here)
    times = {a.folder: a for a in reversed(arrays) if a.is_of(TIME, ())}
    tables: dict[str, list[NamedArray]] = {}
    for array in arrays:
        tables.setdefault(array.matrix or array.folder, []).append(array)
    unnamed = [
        first
        for first, *rest in tables.values()
        if first.rises and any(a.values.size == first.values.size for a in rest)
    ]
    for axes, what, key in (
        (distinct, "sweeps", "frequency"),
        ([a for a in arrays if a is times.get(a.folder)], "recordings over time", "time"),
        (unnamed, "tables without names of columns", "frequency"),
    ):
        if len(axes) > 1:
            names = "; ".join(
                f"{a.name} ({how_many(a.values.size, 'point')})" for a in axes[:SHOWN]
            )
            more = f"; {len(axes) - SHOWN} more" if len(axes) > SHOWN else ""
            raise BadInput(
                f"{path}: is {words}; it holds {len(axes)} {what}: {names}{more}; wanted one of "
                f'them, by --{key} "{axes[0].name}", or in the campaign, as columns = {{ {key} = '
                f'"{axes[0].name}" }}'
            )
        if axes and axes is not unnamed:
            return axes[0]
    size = Counter(a.values.size for a in arrays).most_common(1)[0][0]
    return next(a for a in arrays if a.values.size == size)


def _named(
    path: Path, arrays: Sequence[NamedArray], name: str, axis: NamedArray | None = None
) -> NamedArray:
    """The array of a name, whole or without its folders, which must then be in one folder only.

    Args:
        path: of the file.
        arrays: that it holds.
        name: as it was asked for.
        axis: next to which it is looked for first; None: anywhere.

    Raises:
        BadInput: there is none, or several.
    """
    wanted = {name.lower(), named_column(name, 0).name.lower()}
    there = [a for a in arrays if {a.name.lower(), a.plain} & wanted]
    if not there:  # without its folders: whole names of groups and array
        ends = tuple(f"/{each}" for each in wanted)
        there = [a for a in arrays if f"/{a.plain}".endswith(ends)]
    if axis is not None and len(there) > 1:
        there = [a for a in there if a.folder == axis.folder] or there
    if len(there) == 1:
        return there[0]
    names = ", ".join(a.name for a in (there or arrays)[:SHOWN])
    if there:
        raise BadInput(f"{path}: '{name}' is in several groups: {names}; wanted one with its group")
    raise BadInput(f"{path}: no array '{name}'; there is: {names}")


def _different(axes: Sequence[NamedArray]) -> list[NamedArray]:
    """Axes of different sweeps: one in several units is one, a bandwidth or an offset none."""
    different: list[NamedArray] = []
    for axis in axes:
        same_size = (d for d in different if d.values.size == axis.values.size)
        ratios = (axis.values / d.values for d in same_size)
        known = any(np.allclose(ratio, ratio[0], rtol=1e-9) for ratio in ratios)
        if axis.rises and axis.values.real[0] > 0.0 and not known:
            different.append(axis)
    return different or list(axes[:1])


def flattened(values: Mapping[str, object], prefix: str = "") -> list[tuple[str, np.ndarray]]:
    """Arrays of nested mappings with their path as name.

    Args:
        values: by name; mappings within are gone through.
        prefix: of the names.
    """
    result: list[tuple[str, np.ndarray]] = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            result += flattened(value, f"{prefix}{name}/")
        elif isinstance(value, np.ndarray):
            result.append((f"{prefix}{name}", value))
    return result
