"""Sweeps in files of their own, one for each value of a control quantity: as one map.

The control is told by whoever drafts, or found in the files' names ("crossing_Vg=-5.0V.txt") or in
the lines above their tables ("% Vg = -5.0 V"), where it is the one number that differs from file to
file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.recording import channel_of
from fitting.draft.document import relative_path
from fitting.draft.files import MapFile
from fitting.draft.noise import BY_SCATTER, noise_look
from fitting.extension.records import Channel, Recording
from fitting.measurements.control.keys import FILE
from fitting.resonance.control_map import ControlMap
from fitting.resonance.file_control import (
    NAME,
    REAL,
    UNIT,
    differing,
    differing_quantity,
    settings_of_name,
)
from fitting.resonance.noise_reading import stated_density
from fitting.resonance.reading import Columns, Roles, hertz_in, map_in, roles_of
from fitting.text.csv_cells import csv_text
from fitting.text.errors import BadInput, gathered, shown
from fitting.text.notation import how_many, listed
from fitting.text.rendering import blocks

#: Name of the table that a drafted map reads: the control, and the file of each spectrum.
LIST = "spectra.csv"
#: Sweeps with phases that are a map without being told so, at least.
LEAST = 3
#: Values of a control that may be told.
MOST_VALUES = 10_000

#: Control as it is told: its name, its values, their unit.
_REQUESTED = re.compile(
    rf"(?P<name>{NAME})\s*(?:[(\[](?P<told>[^()\[\]]*)[)\]])?\s*(?:=\s*(?P<values>.+))?"
)
_RANGE = re.compile(rf"(?P<a>{REAL}):(?P<b>{REAL}):(?P<step>{REAL})\s*(?P<unit>{UNIT})?")
_LIST = re.compile(rf"(?P<list>{REAL}(?:\s*,\s*{REAL})*)\s*(?P<unit>{UNIT})?")


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
        any(stated_density(each) is not None or map_in(each) is not None for each in roles)
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
        result = differing_quantity(paths, requested)
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
    written = differing([settings_of_name(path) for path in paths]).get(name)
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
        layout=own.layout,
        remarks=own.remarks,
    )
    made: dict[str, Any] = {"recording": recording, "left_out": (), **joined}
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
