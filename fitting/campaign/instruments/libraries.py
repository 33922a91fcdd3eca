"""Formats that libraries read: HDF5, MATLAB, TDMS, Touchstone, Universal Files.

Files of named arrays (HDF5, MATLAB, TDMS) may hold several sweeps: `recording_of` takes the columns
that belong to one frequency axis. A library is imported within its reader, under `understood`:
without it the error states which extra of this package brings it.
"""

from __future__ import annotations

import io
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.loose_tables import suffixed_unit
from fitting.campaign.instruments.recording import (
    MIN_POINTS,
    Channel,
    Head,
    Layout,
    Numbers,
    Recording,
    Selection,
    channel_of,
    of_arrays,
)
from fitting.campaign.instruments.roles import FREQUENCY, TIME, plain_name
from fitting.text.errors import BadInput, SeveralSweeps
from fitting.text.files import read_whole
from fitting.text.notation import how_many
from fitting.text.tables import named_column, read_text
from fitting.text.units import same_kind

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
        written = named_column(self.name.removeprefix(f"{folder}/"), 0)
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


def columns_of(name: str, values: object, unit: str | None = None) -> list[NamedArray]:
    """The columns that an array holds: itself, those of a narrow matrix or of fields, or none.

    Args:
        name: of the array, with the groups that it is in.
        values: of any shape and type; of a group, its arrays by name.
        unit: as the file states it.
    """
    parts: Mapping[str, object] = values if isinstance(values, Mapping) else {}
    if isinstance(values, np.ndarray) and values.dtype.names is not None and values.ndim == 1:
        parts = {field: values[field] for field in values.dtype.names}
    if parts or not isinstance(values, np.ndarray):
        inside = ((f"{name}/{key}".lstrip("/"), part) for key, part in parts.items())
        return [column for each in inside for column in columns_of(*each, unit)]
    if values.dtype.kind not in "iufc" or values.size < MIN_POINTS:
        return []
    numbers = values.astype(complex if values.dtype.kind == "c" else float)
    if max(values.shape) == values.size:
        return [NamedArray(name, numbers.ravel(), unit)]
    if values.ndim != 2 or min(values.shape) > MOST_COLUMNS:
        return []
    table = numbers if values.shape[0] >= values.shape[1] else numbers.T
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
    return of_arrays(
        path,
        (array.channel(axis.folder) for array in once),
        axis.values.size,
        f"{words}, {axis.name}" if "/" in axis.name else words,
        headed=bool(selection.axis) or axis.is_of((*FREQUENCY, *TIME), HERTZ),
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
            raise SeveralSweeps(
                f"{path}: is {words}; it holds {len(axes)} {what}: {names}{more}; wanted one of "
                f'them, by --{key} "{axes[0].name}", or in the campaign, as columns = {{ {key} = '
                f'"{axes[0].name}" }}',
                parts=[{key: a.name} for a in axes],
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


@contextmanager
def understood(path: Path, kind: str, extra: str = "") -> Iterator[None]:
    """Within, a library is imported and reads a file: whatever it raises is an error of the file.

    Libraries have no errors of their own for files that are broken; what comes out is whatever the
    first wrong byte leads to. Their warnings are about the format, not about the data.

    Args:
        path: of the file.
        kind: that it should be, as "a Touchstone file".
        extra: of this package that brings the library; empty: it is always there.

    Raises:
        BadInput: names the file, and the extra that is missing or what the library reports.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except BadInput:
        raise
    except Exception as error:
        if extra and isinstance(error, ImportError):
            raise BadInput(
                f"{path}: is {kind}; to read it: pip install 'fmu-fit[{extra}]' ({error})"
            ) from error
        words = " ".join(str(error).split())[:200]
        name = type(error).__name__
        raise BadInput(
            f"{path}: cannot be read as {kind}: {name}{': ' if words else ''}{words}"
        ) from error


HDF5 = "an HDF5 file"
SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Where the signature may stand: other programs put a text before it.
OFFSETS = (0, 512, 1024, 2048)
_UNIT_NAMES = ("unit", "units", "Unit", "Units", "unit_string")


def _read_hdf5(path: Path, selection: Selection) -> Recording:
    """Datasets of one length; units of their attribute ``unit`` or ``units``, or in their names."""
    result: list[NamedArray] = []
    with understood(path, HDF5, "hdf5"):
        import h5py

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufcV" and item.size:
                result.extend(columns_of(name, item[()], _unit_of_dataset(item)))

        with h5py.File(path, "r") as file:
            file.visititems(visit)
    is_matlab = read_whole(path, head=10).startswith(b"MATLAB")
    return recording_of(path, result, "MATLAB 7.3" if is_matlab else "HDF5", selection)


def _unit_of_dataset(item: Any) -> str | None:
    for name in _UNIT_NAMES:
        value = item.attrs.get(name)
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.item()
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str) and value.strip():
            return value.strip()
    return None


MATLAB = "a MATLAB file"
#: Names in a file of trajectories, and what it is, in words.
TRAJECTORIES = {"Aclass", "name", "description", "dataInfo", "data_1", "data_2"}
RESULTS = "results of a simulation, as Dymola and OpenModelica write them"
_IN_BRACKETS = re.compile(r"\[(?P<unit>[^\[\]|#:]+)[^\[\]]*\]\s*$")


def _read_matlab(path: Path, selection: Selection) -> Recording:
    """Vectors and narrow matrices of one length; fields of structures as "structure/field"."""
    with understood(path, MATLAB):
        from scipy.io import loadmat

        values = loadmat(path, simplify_cells=True)
        if set(values) >= TRAJECTORIES:
            return _trajectories(path, loadmat(path, chars_as_strings=False))
    return recording_of(path, columns_of("", values), "MATLAB", selection)


def _trajectories(path: Path, values: Mapping[str, np.ndarray]) -> Recording:
    """Results of a simulation as Dymola, OpenModelica and OMSimulator write them.

    ``dataInfo`` has for every name the table, 1 or 2, and with its sign the row that holds it;
    the first table has two times for what is constant. Units stand in the descriptions, as "[m/s]".
    """
    rotated = "".join(values["Aclass"][-1]).strip().lower() == "bintrans"

    def rows(key: str) -> np.ndarray:
        """A matrix with a row for each variable."""
        table = np.atleast_2d(np.asarray(values[key], dtype=float))
        return table if rotated else table.T

    def texts(key: str) -> list[str]:
        letters = np.atleast_2d(values[key])
        return ["".join(row).strip("\0 ") for row in (letters.T if rotated else letters)]

    def unit_in(words: str) -> str | None:
        match = _IN_BRACKETS.search(words)
        unit = match["unit"] if match is not None else None
        return unit if unit is not None and same_kind(unit, unit) else None

    tables = {k: rows(f"data_{k}") for k in (1, 2)}
    info, names, about = rows("dataInfo").T.astype(int), texts("name"), texts("description")
    times = tables[2][0]
    channels = [channel_of(names[0], unit_in(about[0]) or "s", times)]
    for name, words, (table, row, *_) in list(zip(names, about, info, strict=False))[1:]:
        column = np.sign(row) * tables[int(table) or 2][abs(row) - 1]
        kept = column if column.size == times.size else np.full(times.size, column[0])
        channels.append(channel_of(name, unit_in(words), kept))
    return of_arrays(path, channels, times.size, RESULTS)


def _of_matlab(head: Head) -> bool:
    # version 4 has no signature, but zeros, as every file has that is no text
    is_old = head.path.suffix.lower() == ".mat" and b"\0" in head.data and not head.text
    return is_old or head.data.startswith(b"MATLAB 5.0")


TDMS = "a TDMS file"


def _read_tdms(path: Path, selection: Selection) -> Recording:
    """Channels of one length; a waveform brings its own axis, over time or over frequency."""
    result: list[NamedArray] = []
    with understood(path, TDMS, "tdms"):
        from nptdms import TdmsFile

        for group in TdmsFile.read(path).groups():
            axes: list[NamedArray] = []
            for channel in group.channels():
                about, count = channel.properties, len(channel)
                unit = about.get("unit_string") or about.get("NI_UnitDescription")
                name = f"{group.name}/{channel.name.replace('/', ' per ')}"
                result += columns_of(name, np.asarray(channel[:]), str(unit or "").strip() or None)
                step = about.get("wf_increment")
                if step and count and not axes:  # the axis of a group's waveforms
                    start = float(about.get("wf_start_offset", 0.0))
                    axis = start + float(step) * np.arange(float(count))
                    over = about.get("wf_xunit_string") or about.get("wf_xunit") or "s"
                    over = str(over).strip()
                    kind = "Frequency" if over == "Hz" else "Time"
                    axes = [NamedArray(f"{group.name}/{kind}", axis, over)]
            result += axes
    return recording_of(path, result, "TDMS", selection)


TOUCHSTONE = "a Touchstone file"
_OPTIONS = re.compile(r"#(\s+([kmg]?hz|[syzgh]|ma|db|ri|r|[\d.e+-]+))+\s*(!.*)?", re.IGNORECASE)
#: Ports by the numbers in a row of frequency and values, where the file's name does not tell.
_PORTS = {3: 1, 9: 2}
MOST_PORTS = 9


def _read_touchstone(path: Path, _: Selection) -> Recording:
    """Touchstone 1.1 and 2.0: S parameters as complex columns "S11", "S21", ... over Hz."""
    with understood(path, TOUCHSTONE, "touchstone"):
        from skrf.io.touchstone import Touchstone

        text = read_text(path)
        file = io.StringIO(text)
        file.name = _touchstone_name(path, text)
        network = Touchstone(file)
        f, s = np.asarray(network.f, dtype=float), np.asarray(network.s, dtype=complex)
    if network.parameter != "s":
        kind = str(network.parameter).upper()
        raise BadInput(f"{path}: is {TOUCHSTONE} of {kind} parameters; wanted S parameters")
    if s.shape[1] > MOST_PORTS:
        raise BadInput(
            f"{path}: is {TOUCHSTONE} of {s.shape[1]} ports; wanted at most {MOST_PORTS}"
        )
    ports = range(s.shape[1])
    values = {f"S{i + 1}{j + 1}": s[:, i, j] for j in ports for i in ports}
    channels = [channel_of("Frequency", "Hz", f)]
    channels += [channel_of(name, "1", each) for name, each in values.items()]
    names = ", ".join(list(values)[:4]) + (", ..." if len(values) > 4 else "")
    words = f"Touchstone, {how_many(len(ports), 'port')}, {names}"
    return of_arrays(path, channels, f.size, words)


def _touchstone_name(path: Path, text: str) -> str:
    """A file name whose ending states the ports, as the library wants it."""
    lines = [line.partition("!")[0].split() for line in text.splitlines()]
    if "[version]" in {line[0].lower() for line in lines if line}:
        return "network.ts"
    if re.fullmatch(r"\.s\d+p", path.suffix.lower()):
        return f"network{path.suffix.lower()}"
    first = next((line for line in lines if line and line[0][0] not in "#["), [])
    return f"network.s{_PORTS.get(len(first), 1)}p"


def _of_touchstone(head: Head) -> bool:
    kept = (line.strip() for line in head.lines if line.strip() and line.strip()[0] != "!")
    first = next(kept, "")
    return first.lower().startswith("[version]") or (
        len(first.split()) > 2 and bool(_OPTIONS.fullmatch(first))
    )


UFF = "a Universal File (UFF)"
#: Quantities of the abscissa, "specific data type": time and frequency.
_TIME, _FREQUENCY = 17, 18
#: Directions of a degree of freedom.
_DIRECTIONS = {1: "x", 2: "y", 3: "z", 4: "rx", 5: "ry", 6: "rz"}
_FUNCTIONS = {
    1: "time response",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response function",
    5: "transmissibility",
    6: "coherence",
    9: "power spectral density",
    12: "spectrum",
}
_UNTOLD = ("", "NONE", "NULL", "?")


def _read_uff(path: Path, _: Selection) -> Recording:
    """Functions over one axis, a column each, named by their degrees of freedom, as "2z/1z"."""
    with understood(path, UFF, "uff"):
        import pyuff

        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        result = [file.read_sets(k) for k, kind in enumerate(types) if kind == 58]
    if not result:
        there = ", ".join(map(str, sorted(set(types)))) or "none"
        raise BadInput(f"{path}: is {UFF} with datasets {there}; wanted one of type 58, functions")
    first, others = result[0], len(result) - 1
    axis = np.asarray(first["x"], dtype=float)
    # what the functions go over: by the file, else time responses over time
    number, over = int(first.get("func_type") or 0), int(first.get("abscissa_spec_data_type") or 0)
    is_time = over == _TIME or (over != _FREQUENCY and number == 1)
    channels = [
        channel_of(
            "Time" if is_time else "Frequency",
            _unit_of_axis(first, "abscissa") or ("s" if is_time else "Hz"),
            axis,
        )
    ]
    names: list[str] = []
    for function in (s for s in result if np.array_equal(np.asarray(s["x"]), axis)):
        name = f"{_freedom(function, 'rsp')}/{_freedom(function, 'ref')}"
        names.append(name if name not in names else f"{name} {len(names) + 1}")
        unit, under = (_unit_of_axis(function, each) for each in ("ordinate", "orddenom"))
        if unit is not None and under is not None and "/" not in unit:
            unit = f"{unit}/{under}"
        channels.append(channel_of(names[-1], unit, np.asarray(function["data"])))
    kind = _FUNCTIONS.get(number, f"function of type {number}")
    words = f"UFF dataset 58, {kind}{f' and {others} more' if others else ''}"
    notes = {"id1": str(first.get("id1", "")).strip()}
    return of_arrays(path, channels, axis.size, words, notes=notes)


def _freedom(function: dict[str, Any], side: str) -> str:
    node, direction = (int(function.get(f"{side}_{key}") or 0) for key in ("node", "dir"))
    sign = "-" if direction < 0 else ""
    return f"{node}{sign}{_DIRECTIONS.get(abs(direction), '')}"


def _unit_of_axis(function: dict[str, Any], axis: str) -> str | None:
    text = str(function.get(f"{axis}_axis_units_lab") or "").strip()
    return None if text.upper() in _UNTOLD else text


def _of_uff(head: Head) -> bool:
    lines = [line.strip() for line in head.data[:4096].splitlines() if line.strip()][:2]
    return len(lines) == 2 and lines[0] == b"-1" and lines[1][:3].rstrip(b"b ").isdigit()


LAYOUTS = (
    Layout(
        "hdf5",
        _read_hdf5,
        lambda head: any(head.data[at:].startswith(SIGNATURE) for at in OFFSETS),
    ),
    Layout("matlab", _read_matlab, _of_matlab),
    Layout("tdms", _read_tdms, lambda head: head.data.startswith(b"TDSm")),
    Layout("touchstone", _read_touchstone, _of_touchstone),
    Layout("uff", _read_uff, _of_uff),
)
