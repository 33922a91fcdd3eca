"""Sweeps in files of their own, one for each value of a control quantity: as one map.

The control is told by whoever drafts, or found in the files' names ("crossing_Vg=-5.0V.txt") or in
the lines above their tables ("% Vg = -5.0 V"), where it is the one number that differs from file to
file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.control_table import FILE
from fitting.campaign.instruments.recording import channel_of
from fitting.draft.document import relative_path
from fitting.draft.files import MapFile
from fitting.draft.noise import BY_SCATTER, noise_look
from fitting.extension.records import Channel, Recording, head_of
from fitting.resonance.control_map import ControlMap
from fitting.resonance.noise_reading import told_density
from fitting.resonance.reading import Columns, Roles, hertz_in, map_in, roles_of
from fitting.text.csv_cells import csv_text
from fitting.text.errors import BadInput, gathered, shown
from fitting.text.loose_tables import COMMENTS
from fitting.text.notation import how_many, listed
from fitting.text.rendering import blocks
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
_REQUESTED = re.compile(
    rf"(?P<name>{_NAME})\s*(?:[(\[](?P<told>[^()\[\]]*)[)\]])?\s*(?:=\s*(?P<values>.+))?"
)
_RANGE = re.compile(rf"(?P<a>{_REAL}):(?P<b>{_REAL}):(?P<step>{_REAL})\s*(?P<unit>{_UNIT})?")
_LIST = re.compile(rf"(?P<list>{_REAL}(?:\s*,\s*{_REAL})*)\s*(?P<unit>{_UNIT})?")


#: Settings of a file by their names, each with its value and its unit.
_Settings = Mapping[str, tuple[float, str]]


@dataclass(frozen=True, kw_only=True)
class Series:
    """The map that several files make, the text of the table that lists them, and its control.

    ``words`` is the sentence on what the control is and where it was found.
    """

    map: MapFile
    text: str
    words: str


def series_of(
    paths: Sequence[Path], columns: Columns, requested: str | None, folder: Path, *, joint: bool
) -> Series | None:
    """Several sweeps as a map over a control; None where they are none, and may be fitted jointly.

    Args:
        paths: of the files, in the order of values that are told.
        columns: what is told of their columns.
        requested: the control by its name, or with its values, as "Vg=-6:6:1"; None: it is found.
        folder: in which the campaign and the list of the files will be.
        joint: whether sweeps with phases are one campaign without a control, too.

    Raises:
        BadInput: several sweeps of amplitudes without a control, or one that does not suit them.
    """
    if len(paths) < 2:
        if requested is not None:
            raise BadInput(
                f"--control: is of several sweeps, a file for each value; found "
                f"{how_many(len(paths), 'file')}"
            )
        return None
    try:
        roles = gathered([partial(roles_of, path, columns) for path in paths])
    except BadInput:
        if requested is not None:
            raise
        return None  # tables of experiments, recordings: their readers complain
    phased = any(each.is_complex for each in roles)
    if requested is None and (
        any(told_density(each) is not None or map_in(each) is not None for each in roles)
        or (phased and (joint or len(paths) < LEAST))
    ):
        return None
    match = None if requested is None else _REQUESTED.fullmatch(requested.strip())
    if requested is not None and match is None:
        raise BadInput(
            f"--control: found {shown(requested)}, wanted a name and values, as Vg=-6:6:1"
        )
    if match is not None and match["values"] is not None:
        where, name = "as asked for", match["name"]
        values, unit = _requested_values(match["values"].strip(), requested or "", name, paths)
        unit = match["told"] or unit or "1"
    else:
        result = _differing_quantity(paths, requested)
        if result is None:
            look = noise_look(roles[0], hertz_in(roles[0]))
            if phased or (look is not None and look.by == BY_SCATTER):
                return None
            names = listed(path.name for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
            raise BadInput(
                f"{how_many(len(paths), 'sweep')} of amplitudes, {names}: neither their names nor "
                "the lines above their tables contain one quantity that differs from file to file; "
                "wanted it by --control, as --control Vg=-6:6:1 in the order of the files, or one "
                "sweep"
            )
        where, name, unit, values = result
    if len(set(values)) < len(values):
        raise BadInput(f"--control: '{name}' has a value twice, {where}; wanted a sweep at each")
    return _joined(paths, roles, (name, unit, values), where, folder)


def _requested_values(
    text: str, requested: str, name: str, paths: Sequence[Path]
) -> tuple[tuple[float, ...], str]:
    """The values of a control that are told, one for each file, and their unit."""
    values, unit = _values(text, requested)
    if len(values) != len(paths):
        raise BadInput(
            f"--control: {how_many(len(values), 'value')} for {how_many(len(paths), 'file')}; "
            "wanted one for each"
        )
    written = _differing([_of_name(path) for path in paths]).get(name)
    if written is not None and written[1] != values:
        raise BadInput(
            f"--control: {name} is {values[0]:g} to {values[-1]:g} in the order of the files, but "
            f"{written[1][0]:g} to {written[1][-1]:g} by their names; wanted the values in the "
            "order of the files, or the name alone"
        )
    return values, unit


def _values(text: str, requested: str) -> tuple[tuple[float, ...], str]:
    steps = _RANGE.fullmatch(text)
    if steps is not None:
        a, b, step = (float(steps[key]) for key in ("a", "b", "step"))
        count = (b - a) / step if step else math.inf
        if not 0.0 < count < MOST_VALUES or abs(count - round(count)) > 1e-6:
            raise BadInput(
                f"--control: found {shown(requested)}, wanted first:last:step, whole steps"
            )
        made = np.linspace(a, b, round(count) + 1)
        return tuple(float(f"{value:.12g}") for value in made), steps["unit"] or ""
    several = _LIST.fullmatch(text)
    if several is None:
        raise BadInput(
            f"--control: found {shown(requested)}, wanted first:last:step, or values with commas"
        )
    return tuple(map(float, several["list"].split(","))), several["unit"] or ""


def _differing_quantity(
    paths: Sequence[Path], wanted: str | None
) -> tuple[str, str, str, tuple[float, ...]] | None:
    """The one quantity that differs from file to file, by their names, else by their heads.

    Where it was found, its name, its unit, and its value in every file.
    """
    ways: dict[str, Callable[[Path], _Settings]] = {
        "by the names of the files": _of_name,
        "by the heads of the files": _of_head,
    }
    for where, read in ways.items():
        result = _differing([read(path) for path in paths])
        if wanted is not None:
            result = {n: v for n, v in result.items() if n.lower() == wanted.strip().lower()}
        if len(result) > 1:
            raise BadInput(
                f"{paths[0]}, ...: {listed(result)} differ from file to file, {where}; wanted one "
                "of them by --control"
            )
        for name, (unit, values) in result.items():
            return where, CONTROL if name.startswith(CONTROL) else name, unit, values
    if wanted is not None:
        raise BadInput(
            f"--control: neither names nor heads of the files contain a value of '{wanted}' "
            "in each; wanted its values, too, as Vg=-6:6:1"
        )
    return None


def _differing(files: Sequence[_Settings]) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Units and values of quantities that every file has, in one unit, with different values."""
    made = {}
    for name, (_, unit) in files[0].items():
        known = [each[name] for each in files if name in each and each[name][1] == unit]
        values = tuple(value for value, _ in known)
        if len(known) == len(files) and len(set(values)) == len(values):
            made[name] = unit or "1", values
    return made


def _of_name(path: Path) -> _Settings:
    """Numbers in a file's name: behind a name and "=", or before a unit."""
    made: dict[str, tuple[float, str]] = {}
    for k, match in enumerate(_IN_NAME.finditer(path.stem)):
        unit = _unit(match["unit"])
        if match["name"] is not None:
            made[match["name"].rpartition("_")[2] or match["name"]] = float(match["value"]), unit
        elif unit:
            made[f"{CONTROL}{k}"] = float(match["bare"] or match["part"]), unit
    return made


def _of_head(path: Path) -> _Settings:
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


#: Columns of a sweep by the fields of `Roles`.
_FIELDS = ("frequency", "sizes", "phase", "real", "imaginary")


def _joined(
    paths: Sequence[Path],
    roles: Sequence[Roles],
    control: tuple[str, str, tuple[float, ...]],
    where: str,
    folder: Path,
) -> Series:
    """One recording of all points, the files in the order of the control."""
    name, unit, values = control
    order = np.argsort(values, kind="stable")
    settings = np.array([values[k] for k in order])
    paths, roles = [paths[k] for k in order], [roles[k] for k in order]
    columns = [[getattr(each, key) for key in _FIELDS] for each in roles]
    kinds = [[c and (c.name.lower(), c.unit) for c in own] for own in columns]
    for path, kind in zip(paths, kinds, strict=True):
        if kind != kinds[0]:
            raise BadInput(
                f"{path}: its columns are not those of {paths[0]}; wanted sweeps alike in one map"
            )
    counts = [len(each.recording.places) for each in roles]
    quantity = channel_of(name, unit, np.repeat(settings, counts))
    joined = {
        key: _column(each) for key, each in zip(_FIELDS, zip(*columns, strict=True), strict=True)
    }
    table, own = folder / LIST, roles[0].recording
    recording = Recording(
        path=table,
        channels=(
            quantity,
            # in the units of the file, not in those that are told of its columns
            *(replace(c, unit=own.column(c.name).unit) for c in joined.values() if c is not None),
        ),
        places=tuple(
            f"{p.name}, {x}" for p, e in zip(paths, roles, strict=True) for x in e.recording.places
        ),
        words=f"{how_many(len(paths), 'sweep')}, a file for each value of '{name}'",
    )
    known = replace(roles[0].recognised, path=table, words=recording.words)
    made: dict[str, Any] = {"recording": recording, "recognised": known, "left_out": (), **joined}
    rows = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    result = ControlMap(
        path=table, controls=(quantity,), settings=settings[:, None], rows=tuple(rows)
    )
    cells = [[f"{name} ({unit})", FILE]]
    for value, path in zip(settings, paths, strict=True):
        cells.append([f"{value:.12g}", relative_path(path, folder)])
    return Series(
        map=MapFile(path=table, roles=replace(roles[0], **made), found=result),
        text=csv_text(cells),
        words=str(blocks("draft/text").control(quantity, settings.tolist(), where)),
    )


def _column(columns: Sequence[Channel | None]) -> Channel | None:
    """A column of all files, one below the other."""
    result = [column for column in columns if column is not None]
    if not result:
        return None
    values = np.concatenate([column.read() for column in result])
    return replace(result[0], read=lambda: values)
