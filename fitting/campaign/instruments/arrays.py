"""Files that hold named arrays (HDF5, MATLAB, TDMS): which of them are the columns of one sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.recording import Channel, Numbers, Recording, channel_of
from fitting.campaign.instruments.roles import FREQUENCY, TIME, plain_name
from fitting.campaign.instruments.trace import MIN_POINTS, Selection
from fitting.text.errors import BadInput
from fitting.text.loose_tables import suffixed_unit
from fitting.text.tables import named_column

#: Columns of a matrix that are taken for columns of a table; more are a map or a picture.
MOST_COLUMNS = 16
HERTZ = ("Hz", "kHz", "MHz", "GHz")
#: Names in a complaint.
SHOWN = 8


@dataclass(frozen=True, eq=False)
class NamedArray:
    """An array by its name in the file, "group/name", with its unit where the file tells it."""

    name: str
    values: Numbers
    unit: str | None = None


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
    return [NamedArray(f"{name} {k + 1}", table[:, k], unit) for k in range(table.shape[1])]


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
    chosen = [axis, *(a for a in (*beside, *others) if a is not axis)]
    channels = tuple(_channel(a, _folder(axis.name)) for a in chosen)
    return Recording(
        path=path,
        channels=channels,
        places=tuple(f"point {k + 1}" for k in range(axis.values.size)),
        headed=bool(selection.frequency) or _tells(axis, (*FREQUENCY, *TIME), HERTZ),
        words=f"{words}, {axis.name}" if "/" in axis.name else words,
    )


def _axis(path: Path, arrays: Sequence[NamedArray], words: str, selection: Selection) -> NamedArray:
    if selection.frequency:
        return _named(path, arrays, selection.frequency)
    if selection.amplitude and "/" in selection.amplitude:
        folder = _folder(_named(path, arrays, selection.amplitude).name)
        arrays = [a for a in arrays if _folder(a.name) == folder] or arrays
    distinct = _without_equal([a for a in arrays if _tells(a, FREQUENCY, HERTZ)])
    if len(distinct) > 1:
        names = "; ".join(f"{a.name} ({a.values.size} points)" for a in distinct[:SHOWN])
        more = f"; {len(distinct) - SHOWN} more" if len(distinct) > SHOWN else ""
        raise BadInput(
            f"{path}: is {words}; it holds {len(distinct)} sweeps: {names}{more}; wanted one named "
            f'in the campaign, as columns = {{ frequency = "{distinct[0].name}" }}'
        )
    if distinct:
        return distinct[0]
    time = next((a for a in arrays if _tells(a, TIME, ())), None)
    if time is not None:
        return time
    size = Counter(a.values.size for a in arrays).most_common(1)[0][0]
    return next(a for a in arrays if a.values.size == size)


def _tells(array: NamedArray, names: Sequence[str], units: Sequence[str]) -> bool:
    """Whether the name or the unit of an array is one of these."""
    channel = _channel(array, _folder(array.name))
    return plain_name(channel) in names or channel.unit in units


def _named(path: Path, arrays: Sequence[NamedArray], name: str) -> NamedArray:
    wanted = {name.lower(), named_column(name, 0).name.lower()}
    whole = (a for a in arrays if {a.name.lower(), _unitless(a.name)} & wanted)
    found = next(whole, None)
    found = found or next((a for a in arrays if _unitless(_last(a.name)) in wanted), None)
    if found is None:
        there = ", ".join(a.name for a in arrays[:SHOWN])
        raise BadInput(f"{path}: no array '{name}'; there is: {there}")
    return found


def _without_equal(found: Sequence[NamedArray]) -> list[NamedArray]:
    """Frequency axes in folders of their own; twice the same in one folder is one sweep."""
    kept: dict[str, NamedArray] = {}
    for array in found:
        kept.setdefault(_folder(array.name), array)
    return list(kept.values())


def _alone(axis: NamedArray, beside: Sequence[NamedArray]) -> bool:
    return all(a is axis for a in beside)


def _folder(name: str) -> str:
    return name.rpartition("/")[0]


def _unitless(name: str) -> str:
    return named_column(name, 0).name.lower()


def _last(name: str) -> str:
    return name.rpartition("/")[2]


def _channel(array: NamedArray, folder: str) -> Channel:
    """A column by its name within the folder of the axis."""
    name = array.name.removeprefix(f"{folder}/") if folder else array.name
    written = named_column(name, 0)
    unit = array.unit or written.unit or suffixed_unit(written.name)[1]
    return channel_of(written.name, unit, array.values)


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
