"""Files that hold named arrays (HDF5, MATLAB, TDMS): which of them are the columns of one sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
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
    """An array by its name in the file, "group/name", with its unit where the file tells it.

    ``matrix`` is the name of the matrix whose column it is; empty for an array by itself.
    """

    name: str
    values: Numbers
    unit: str | None = None
    matrix: str = ""


def columns_of(name: str, values: np.ndarray, unit: str | None = None) -> list[NamedArray]:
    """The columns that an array holds: itself, those of a narrow matrix, or none.

    Args:
        name: of the array.
        values: of any shape and type.
        unit: as the file tells it.
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
        words: that say what the file is.
        selection: names of columns, where they are not the usual ones.

    Raises:
        BadInput: no array of numbers, or several sweeps of which none is named; says what there is.
    """
    if not arrays:
        raise BadInput(f"{path}: is {words}; it holds no arrays of numbers that could be a sweep")
    axis = _axis(path, arrays, words, selection)
    kept = [a for a in arrays if a.values.size == axis.values.size]
    beside = [a for a in kept if _folder(a.name) == _folder(axis.name)]
    others = [a for a in kept if a not in beside] if _alone(axis, beside) else []
    asked = [_named(path, arrays, name, axis) for name in selection.values if _grouped(name)]
    _check_sizes(path, axis, asked)
    chosen = _each_once([axis, *beside, *others, *asked])
    channels = tuple(_channel(a, _folder(axis.name)) for a in chosen)
    return Recording(
        path=path,
        channels=channels,
        places=numbered_points(axis.values.size),
        headed=bool(selection.axis) or _tells(axis, (*FREQUENCY, *TIME), HERTZ),
        words=f"{words}, {axis.name}" if "/" in axis.name else words,
    )


def _grouped(name: str) -> bool:
    """Whether a name tells the group that an array is in; a unit may have a slash, too."""
    return "/" in named_column(name, 0).name


def _each_once(arrays: Sequence[NamedArray]) -> list[NamedArray]:
    return list({id(array): array for array in arrays}.values())


def _check_sizes(path: Path, axis: NamedArray, asked: Sequence[NamedArray]) -> None:
    """Complain of columns that are asked for and belong to another axis."""
    for array in asked:
        if array.values.size != axis.values.size:
            raise BadInput(
                f"{path}: '{array.name}' has {how_many(array.values.size, 'value')}, "
                f"'{axis.name}' {axis.values.size}; wanted columns of one length"
            )


def _axis(path: Path, arrays: Sequence[NamedArray], words: str, selection: Selection) -> NamedArray:
    if selection.axis:
        return _named(path, arrays, selection.axis)
    grouped = [name for name in selection.values if _grouped(name)]
    if grouped:
        folder = _folder(_named(path, arrays, grouped[0]).name)
        arrays = [a for a in arrays if _folder(a.name) == folder] or arrays
    distinct = _sweeps([a for a in arrays if _tells(a, FREQUENCY, HERTZ)])
    if len(distinct) > 1:
        raise _several(path, words, distinct, "sweeps", "frequency")
    if distinct:
        return distinct[0]
    times = _one_a_folder([a for a in arrays if _tells(a, TIME, ())])
    if len(times) > 1:
        raise _several(path, words, times, "recordings over time", "time")
    if times:
        return times[0]
    unnamed = _unnamed(arrays)
    if len(unnamed) > 1:
        raise _several(path, words, unnamed, "tables without names of columns", "frequency")
    size = Counter(a.values.size for a in arrays).most_common(1)[0][0]
    return next(a for a in arrays if a.values.size == size)


def _several(path: Path, words: str, found: Sequence[NamedArray], what: str, key: str) -> BadInput:
    """The complaint of a file that holds more than one axis, of which none is named."""
    names = "; ".join(f"{a.name} ({how_many(a.values.size, 'point')})" for a in found[:SHOWN])
    more = f"; {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return BadInput(
        f"{path}: is {words}; it holds {len(found)} {what}: {names}{more}; wanted one of them, by "
        f'--{key} "{found[0].name}", or in the campaign, as columns = {{ {key} = '
        f'"{found[0].name}" }}'
    )


def _tells(array: NamedArray, names: Sequence[str], units: Sequence[str]) -> bool:
    """Whether the name or the unit of an array is one of these."""
    channel = _channel(array, _folder(array.name))
    return plain_name(channel) in names or channel.unit in units


def _named(
    path: Path, arrays: Sequence[NamedArray], name: str, axis: NamedArray | None = None
) -> NamedArray:
    """The array of a name, whole or without its folders, which must then be in one folder only.

    Args:
        path: of the file.
        arrays: that it holds.
        name: as it was asked for.
        axis: beside which it is looked for first; None: anywhere.

    Raises:
        BadInput: there is none, or several.
    """
    wanted = {name.lower(), named_column(name, 0).name.lower()}
    found = [a for a in arrays if {a.name.lower(), _unitless(a.name)} & wanted]
    found = found or [a for a in arrays if _ends_in(a.name, wanted)]
    if axis is not None and len(found) > 1:
        found = [a for a in found if _folder(a.name) == _folder(axis.name)] or found
    if len(found) == 1:
        return found[0]
    if found:
        there = ", ".join(a.name for a in found[:SHOWN])
        raise BadInput(f"{path}: '{name}' is in several groups: {there}; wanted one with its group")
    there = ", ".join(a.name for a in arrays[:SHOWN])
    raise BadInput(f"{path}: no array '{name}'; there is: {there}")


def _ends_in(name: str, wanted: Collection[str]) -> bool:
    """Whether a name ends in one of these, each as whole names of groups and array."""
    return any(f"/{_unitless(name)}".endswith(f"/{each}") for each in wanted)


def _sweeps(found: Sequence[NamedArray]) -> list[NamedArray]:
    """Frequency axes: one of each folder, or several if there are several sweeps in it."""
    kept: list[NamedArray] = []
    for folder in dict.fromkeys(_folder(a.name) for a in found):
        here = [a for a in found if _folder(a.name) == folder]
        usual = [a for a in here if _tells(a, FREQUENCY, ())]
        kept += (usual or _not_alike(here))[: 1 if usual else None]
    return kept


def _not_alike(axes: Sequence[NamedArray]) -> list[NamedArray]:
    """Axes of different sweeps: one in several units is one, a bandwidth or an offset none."""
    kept: list[NamedArray] = []
    for axis in axes:
        if _rises(axis) and axis.values.real[0] > 0.0 and not any(_alike(axis, k) for k in kept):
            kept.append(axis)
    return kept or list(axes[:1])


def _alike(one: NamedArray, two: NamedArray) -> bool:
    """Whether two axes are the same but for a factor, as in other units."""
    if one.values.size != two.values.size:
        return False
    ratio = one.values / two.values
    return bool(np.allclose(ratio, ratio[0], rtol=1e-9))


def _rises(array: NamedArray) -> bool:
    values = array.values
    return not np.iscomplexobj(values) and bool(np.all(np.diff(values) > 0.0))


def _one_a_folder(found: Sequence[NamedArray]) -> list[NamedArray]:
    """The first of each folder."""
    kept: dict[str, NamedArray] = {}
    for array in found:
        kept.setdefault(_folder(array.name), array)
    return list(kept.values())


def _unnamed(arrays: Sequence[NamedArray]) -> list[NamedArray]:
    """First columns that rise, one of each matrix or folder that holds more columns beside it."""
    tables: dict[str, list[NamedArray]] = {}
    for array in arrays:
        tables.setdefault(array.matrix or _folder(array.name), []).append(array)
    return [
        first
        for first, *rest in tables.values()
        if _rises(first) and any(a.values.size == first.values.size for a in rest)
    ]


def _alone(axis: NamedArray, beside: Sequence[NamedArray]) -> bool:
    return all(a is axis for a in beside)


def _folder(name: str) -> str:
    return name.rpartition("/")[0]


def _unitless(name: str) -> str:
    return named_column(name, 0).name.lower()


def _channel(array: NamedArray, folder: str) -> Channel:
    """A column by its name within the folder of the axis."""
    name = array.name.removeprefix(f"{folder}/") if folder else array.name
    written = named_column(name, 0)
    unit = array.unit or written.unit or suffixed_unit(written.name)[1]
    made = channel_of(written.name, unit, array.values)
    return replace(made, whole=named_column(array.name, 0).name if "/" in array.name else "")


def flattened(values: Mapping[str, object], prefix: str = "") -> list[tuple[str, np.ndarray]]:
    """Arrays of nested mappings with their path as name.

    Args:
        values: by name; mappings within are gone through.
        prefix: of the names.
    """
    found: list[tuple[str, np.ndarray]] = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            found += flattened(value, f"{prefix}{name}/")
        elif isinstance(value, np.ndarray):
            found.append((f"{prefix}{name}", value))
    return found
