"""The control of a sweep of sweeps: the one number that differs from file to file.

Settings are looked for in the names of the files, as "Vg=-6" or "20mK", else in the lines above
their tables.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from fitting.campaign.instruments.loose_tables import COMMENTS
from fitting.campaign.instruments.recording import head_of
from fitting.text.errors import BadInput
from fitting.text.notation import listed
from fitting.text.units import same_kind

#: Lines above a table among which settings are looked for.
HEAD_LINES = 200
#: A number, a name and a unit as they are written there.
REAL = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
NAME = r"[^\W\d][^\W\d_]*(?:_[^\W\d_]+)*\d*"
UNIT = r"[^\W\d_]+(?:/[^\W\d_]+)?|%"
#: A number of a file's name, with what stands before and behind it.
_IN_NAME = re.compile(
    rf"(?:(?P<name>{NAME})\s*=\s*(?P<value>{REAL})|(?<![\w.-])(?P<bare>{REAL})|"
    rf"(?<=_)(?P<part>{REAL}))\s*(?P<unit>{UNIT})?(?![\w.]*\d)"
)
#: A setting above a table.
_SETTING = re.compile(
    rf"(?P<name>{NAME})\s*(?:[(\[](?P<stated>[^()\[\]]+)[)\]]\s*)?[=:,;\t]\s*(?P<value>{REAL})"
    rf"[\s,;]*[(\[]?(?P<unit>{UNIT})?[)\]]?[\s,;]*"
)
#: Name of a control that no file names.
CONTROL = "control"
#: Settings of a file by their names, each with its value and its unit.
Settings = Mapping[str, tuple[float, str]]


def differing_quantity(
    paths: Sequence[Path], wanted: str | None
) -> tuple[str, str, str, tuple[float, ...]] | None:
    """The one quantity that differs from file to file, by their names, else by their heads.

    Where it was found, its name, its unit, and its value in every file.
    """
    ways: dict[str, Callable[[Path], Settings]] = {
        "by the names of the files": settings_of_name,
        "by the heads of the files": settings_of_head,
    }
    for where, read in ways.items():
        result = differing([read(path) for path in paths])
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


def differing(files: Sequence[Settings]) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Units and values of quantities that every file has, in one unit, with different values."""
    made = {}
    for name, (_, unit) in files[0].items():
        known = [each[name] for each in files if name in each and each[name][1] == unit]
        values = tuple(value for value, _ in known)
        if len(known) == len(files) and len(set(values)) == len(values):
            made[name] = unit or "1", values
    return made


def settings_of_name(path: Path) -> Settings:
    """Numbers in a file's name: behind a name and "=", or before a unit."""
    made: dict[str, tuple[float, str]] = {}
    for k, match in enumerate(_IN_NAME.finditer(path.stem)):
        unit = _unit(match["unit"])
        if match["name"] is not None:
            made[match["name"].rpartition("_")[2] or match["name"]] = float(match["value"]), unit
        elif unit:
            made[f"{CONTROL}{k}"] = float(match["bare"] or match["part"]), unit
    return made


def settings_of_head(path: Path) -> Settings:
    """Settings in the lines above a file's table, each with its value and unit."""
    made: dict[str, tuple[float, str]] = {}
    for line in head_of(path).lines[:HEAD_LINES]:
        text = line.strip().lstrip("".join(COMMENTS)).strip()
        match = _SETTING.fullmatch(text)
        if match is not None:
            made.setdefault(
                match["name"], (float(match["value"]), _unit(match["stated"] or match["unit"]))
            )
    return made


def _unit(text: str | None) -> str:
    return text if text and same_kind(text, text) else ""
