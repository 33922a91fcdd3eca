"""Sweeps in files of their own, one for each value of a control quantity: as one map.

The control is told by whoever drafts, or found in the files' names ("crossing_Vg=-5.0V.txt") or in
the lines above their tables ("% Vg = -5.0 V"), where it is the one number that differs from file to
file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.control_table import FILE
from fitting.campaign.instruments import Channel, Recording, head_of
from fitting.campaign.instruments.recording import channel_of
from fitting.draft.files import MapFile
from fitting.draft.noise import BY_SCATTER, noise_look
from fitting.draft.source import relative_path
from fitting.resonance.control_map import ControlMap
from fitting.resonance.noise_reading import told_density
from fitting.resonance.reading import Columns, Roles, hertz_in, map_in, roles_of
from fitting.text.csv_cells import csv_text
from fitting.text.errors import BadInput, gathered, shown
from fitting.text.loose_tables import COMMENTS
from fitting.text.notation import how_many, listed
from fitting.text.units import same_kind

#: Name of the table that a drafted map reads: the control, and the file of each spectrum.
LIST = "spectra.csv"
#: Name of a control that no file names.
CONTROL = "control"
#: Lines above a table among which settings are looked for.
HEAD_LINES = 200
#: Sweeps with phases that are a map without being told so, at least.
LEAST = 3
#: Values of a control that may be told.
MOST_VALUES = 10_000

_REAL = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NAME = r"[^\W\d][^\W\d_]*(?:_[^\W\d_]+)*\d*"
_UNIT = r"[^\W\d_]+(?:/[^\W\d_]+)?|%"
#: A number of a file's name, with what stands before and behind it.
_IN_NAME = re.compile(
    rf"(?:(?P<name>{_NAME})\s*=\s*(?P<value>{_REAL})|(?<![\w.-])(?P<bare>{_REAL})|"
    rf"(?<=_)(?P<part>{_REAL}))\s*(?P<unit>{_UNIT})?(?![\w.]*\d)"
)
#: A setting above a table.
_SETTING = re.compile(
    rf"(?P<name>{_NAME})\s*(?:[(\[](?P<told>[^()\[\]]+)[)\]]\s*)?[=:,;\t]\s*(?P<value>{_REAL})"
    rf"[\s,;]*[(\[]?(?P<unit>{_UNIT})?[)\]]?[\s,;]*"
)
#: Control as it is told: its name, its values, their unit.
_TOLD = re.compile(
    rf"(?P<name>{_NAME})\s*(?:[(\[](?P<told>[^()\[\]]*)[)\]])?\s*(?:=\s*(?P<values>.+))?"
)
_RANGE = re.compile(rf"(?P<a>{_REAL}):(?P<b>{_REAL}):(?P<step>{_REAL})\s*(?P<unit>{_UNIT})?")
_LIST = re.compile(rf"(?P<list>{_REAL}(?:\s*,\s*{_REAL})*)\s*(?P<unit>{_UNIT})?")


@dataclass(frozen=True, kw_only=True)
class Control:
    """A quantity that differs from file to file: ``values`` of every file, ``where`` they are."""

    name: str
    unit: str
    values: tuple[float, ...]
    where: str

    @property
    def words(self) -> str:
        """What it is and where that is found."""
        ends = f"{min(self.values):g} to {max(self.values):g} {self.unit}".removesuffix(" 1")
        return f"{self.name}: {how_many(len(self.values), 'value')}, {ends}, {self.where}."


@dataclass(frozen=True, kw_only=True)
class Series:
    """The map that several files make, the text of the table that lists them, and its control."""

    map: MapFile
    text: str
    control: Control


def series_of(
    paths: Sequence[Path], columns: Columns, told: str | None, folder: Path, *, joint: bool
) -> Series | None:
    """Several sweeps as a map over a control; None where they are none, and may be fitted jointly.

    Args:
        paths: of the files, in the order of values that are told.
        columns: what is told of their columns.
        told: the control by its name, or with its values, as "Vg=-6:6:1"; None: it is found.
        folder: in which the campaign and the list of the files will be.
        joint: whether sweeps with phases are one campaign without a control, too.

    Raises:
        BadInput: several sweeps of amplitudes without a control, or one that does not suit them.
    """
    if len(paths) < 2:
        if told is not None:
            raise BadInput(
                f"--control: is of several sweeps, a file for each value; found "
                f"{how_many(len(paths), 'file')}"
            )
        return None
    try:
        roles = gathered([partial(roles_of, path, columns) for path in paths])
    except BadInput:
        if told is not None:
            raise
        return None  # tables of experiments, recordings: their readers complain
    if told is None and not _are_sweeps(roles):
        return None
    phased = any(each.is_complex for each in roles)
    if told is None and phased and (joint or len(paths) < LEAST):
        return None
    control = None if told is None else _told_control(told, paths)
    control = control or _found(paths, told)
    if control is not None:
        return _joined(paths, roles, control, folder)
    if phased or _scatters_like_noise(roles[0]):
        return None
    raise _undecided(paths)


def _are_sweeps(roles: Sequence[Roles]) -> bool:
    """Whether every file is one sweep: neither a map nor a noise spectrum."""
    return all(told_density(each) is None and map_in(each) is None for each in roles)


def _scatters_like_noise(roles: Roles) -> bool:
    """Whether a file without a word about it is a noise spectrum by how its points scatter."""
    look = noise_look(roles, hertz_in(roles))
    return look is not None and look.by == BY_SCATTER


def _undecided(paths: Sequence[Path]) -> BadInput:
    names = listed(path.name for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
    return BadInput(
        f"{how_many(len(paths), 'sweep')} of amplitudes, {names}: neither their names nor the "
        "lines above their tables tell one quantity that differs from file to file; wanted it by "
        "--control, as --control Vg=-6:6:1 in the order of the files, or one sweep"
    )


def _told_control(told: str, paths: Sequence[Path]) -> Control | None:
    """The control with the values that are told; None where its name alone is."""
    match = _TOLD.fullmatch(told.strip())
    if match is None:
        raise BadInput(f"--control: found {shown(told)}, wanted a name and values, as Vg=-6:6:1")
    if match["values"] is None:
        return None
    values, unit = _values(match["values"].strip(), told)
    if len(values) != len(paths):
        raise BadInput(
            f"--control: {how_many(len(values), 'value')} for {how_many(len(paths), 'file')}; "
            "wanted one for each"
        )
    unit = match["told"] or unit or "1"
    made = Control(name=match["name"], unit=unit, values=values, where="as asked for")
    for written in _differing([_of_name(path) for path in paths], ""):
        if written.name == made.name and written.values != made.values:
            raise BadInput(
                f"--control: {made.name} is {made.values[0]:g} to {made.values[-1]:g} in the order "
                f"of the files, but {written.values[0]:g} to {written.values[-1]:g} by their "
                "names; wanted the values in the order of the files, or the name alone"
            )
    return _checked(made)


def _values(text: str, told: str) -> tuple[tuple[float, ...], str]:
    steps = _RANGE.fullmatch(text)
    if steps is not None:
        a, b, step = (float(steps[key]) for key in ("a", "b", "step"))
        count = (b - a) / step if step else math.inf
        if not 0.0 < count < MOST_VALUES or abs(count - round(count)) > 1e-6:
            raise BadInput(
                f"--control: found {shown(told)}, wanted first:last:step, a whole number of steps"
            )
        made = np.linspace(a, b, round(count) + 1)
        return tuple(float(f"{value:.12g}") for value in made), steps["unit"] or ""
    several = _LIST.fullmatch(text)
    if several is None:
        raise BadInput(
            f"--control: found {shown(told)}, wanted first:last:step, or values with commas"
        )
    return tuple(map(float, several["list"].split(","))), several["unit"] or ""


def _found(paths: Sequence[Path], name: str | None) -> Control | None:
    """The one quantity that differs from file to file, by their names, else by their heads."""
    wanted = None if name is None else name.strip().lower()
    for where, read in (
        ("by the names of the files", _of_name),
        ("by the heads of the files", _of_head),
    ):
        found = _differing([read(path) for path in paths], where)
        if wanted is not None:
            found = [each for each in found if each.name.lower() == wanted]
        if len(found) > 1:
            raise BadInput(
                f"{paths[0]}, ...: {listed(each.name for each in found)} differ from file to file, "
                f"{where}; wanted one of them by --control"
            )
        if found:
            named = not found[0].name.startswith(CONTROL)
            return _checked(found[0] if named else replace(found[0], name=CONTROL))
    if name is not None:
        raise BadInput(
            f"--control: neither names nor heads of the files tell a value of '{name}' in each; "
            "wanted its values, too, as Vg=-6:6:1"
        )
    return None


def _checked(control: Control) -> Control:
    if len(set(control.values)) < len(control.values):
        raise BadInput(
            f"--control: '{control.name}' has a value twice, {control.where}; wanted a sweep at "
            "each"
        )
    return control


#: Numbers of a file by their names, each with its unit.
_Told = Mapping[str, tuple[float, str]]


def _differing(files: Sequence[_Told], where: str) -> list[Control]:
    """Quantities that every file tells, in one unit, with different values."""
    made = []
    for name, (_, unit) in files[0].items():
        found = [each.get(name) for each in files]
        known = [each for each in found if each is not None and each[1] == unit]
        values = tuple(value for value, _ in known)
        if len(known) == len(files) and len(set(values)) == len(values):
            made.append(Control(name=name, unit=unit or "1", values=values, where=where))
    return made


def _of_name(path: Path) -> _Told:
    """Numbers in a file's name: behind a name and "=", or before a unit."""
    made: dict[str, tuple[float, str]] = {}
    for k, match in enumerate(_IN_NAME.finditer(path.stem)):
        unit = _unit(match["unit"])
        if match["name"] is not None:
            made[match["name"].rpartition("_")[2] or match["name"]] = float(match["value"]), unit
        elif unit:
            made[f"{CONTROL}{k}"] = float(match["bare"] or match["part"]), unit
    return made


def _of_head(path: Path) -> _Told:
    """Settings in the lines above a file's table, each with its value and unit."""
    made: dict[str, tuple[float, str]] = {}
    for line in head_of(path).lines[:HEAD_LINES]:
        text = line.strip().lstrip("".join(COMMENTS)).strip()
        match = _SETTING.fullmatch(text)
        if match is not None:
            made.setdefault(
                match["name"], (float(match["value"]), _unit(match["told"] or match["unit"]))
            )
    return made


def _unit(text: str | None) -> str:
    return text if text and same_kind(text, text) else ""


def _joined(
    paths: Sequence[Path], roles: Sequence[Roles], control: Control, folder: Path
) -> Series:
    """One recording of all points, the files in the order of the control."""
    order = np.argsort(control.values, kind="stable")
    control = replace(control, values=tuple(control.values[k] for k in order))
    paths, roles = [paths[k] for k in order], [roles[k] for k in order]
    for path, each in zip(paths, roles, strict=True):
        if _kinds(each) != _kinds(roles[0]):
            raise BadInput(
                f"{path}: its columns are not those of {paths[0]}; wanted sweeps alike in one map"
            )
    counts = [len(each.recording.places) for each in roles]
    rows = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    values = np.repeat(control.values, counts)
    quantity = channel_of(control.name, control.unit, values)
    joined: dict[str, Any] = {name: _column(roles, name) for name in _FIELDS}
    table = folder / LIST
    taken = [channel for channel in joined.values() if channel is not None]
    recording = Recording(
        path=table,
        channels=(quantity, *(_as_in_file(channel, roles[0]) for channel in taken)),
        places=tuple(
            f"{p.name}, {x}" for p, e in zip(paths, roles, strict=True) for x in e.recording.places
        ),
        words=f"{how_many(len(paths), 'sweep')}, a file for each value of '{control.name}'",
    )
    known = replace(roles[0].recognised, path=table, words=recording.words)
    found = ControlMap(
        path=table,
        controls=(quantity,),
        settings=np.array(control.values)[:, None],
        rows=tuple(rows),
    )
    made = replace(roles[0], recording=recording, recognised=known, left_out="", **joined)
    listing = MapFile(path=table, roles=made, found=found)
    return Series(map=listing, text=_text(control, paths, folder), control=control)


#: Columns of a sweep by the fields of `Roles`.
_FIELDS = ("frequency", "sizes", "phase", "real", "imaginary")


def _kinds(roles: Roles) -> list[tuple[str, str | None] | None]:
    """Names and units of the columns that are taken."""
    columns = [getattr(roles, name) for name in _FIELDS]
    return [None if c is None else (c.name.lower(), c.unit) for c in columns]


def _column(roles: Sequence[Roles], name: str) -> Channel | None:
    """A column of all files, one below the other."""
    columns: list[Channel | None] = [getattr(each, name) for each in roles]
    found = [column for column in columns if column is not None]
    if not found:
        return None
    values = np.concatenate([column.read() for column in found])
    return replace(found[0], read=lambda: values)


def _as_in_file(channel: Channel, roles: Roles) -> Channel:
    """A column in the unit that its file tells, not in the one that is told beside it."""
    return replace(channel, unit=roles.recording.column(channel.name).unit)


def _text(control: Control, paths: Sequence[Path], folder: Path) -> str:
    """The table that lists the files: the control and, relative to itself, each file."""
    rows = [[f"{control.name} ({control.unit})", FILE]]
    for value, path in zip(control.values, paths, strict=True):
        rows.append([f"{value:.12g}", relative_path(path, folder)])
    return csv_text(rows)
