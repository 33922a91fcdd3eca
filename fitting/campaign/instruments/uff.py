"""Universal File Format, dataset 58: functions of modal analysis programs (pyuff)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.library import needed, understood
from fitting.campaign.instruments.recording import Recording, channel_of
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput

KIND = "a Universal File (UFF)"
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
    with needed(path, KIND, "uff"):
        import pyuff
    with understood(path, KIND):
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        found = [file.read_sets(k) for k, kind in enumerate(types) if kind == 58]
    if not found:
        there = ", ".join(map(str, sorted(set(types)))) or "none"
        raise BadInput(f"{path}: is {KIND} with datasets {there}; wanted one of type 58, functions")
    first = found[0]
    axis = np.asarray(first["x"], dtype=float)
    over = _over(first, axis)
    alike = [s for s in found if np.array_equal(np.asarray(s["x"]), axis)]
    names, others = _names(alike), len(found) - 1
    unit = _unit(first, "abscissa") or ("s" if over == "Time" else "Hz")
    return Recording(
        path=path,
        channels=(
            channel_of(over, unit, axis),
            *(
                channel_of(name, _ordinate(s), np.asarray(s["data"]))
                for name, s in zip(names, alike, strict=True)
            ),
        ),
        places=tuple(f"point {k + 1}" for k in range(axis.size)),
        words=f"UFF dataset 58, {_kind_of(first)}{f' and {others} more' if others else ''}",
        notes={"id1": str(first.get("id1", "")).strip()},
    )


def _kind_of(function: dict[str, Any]) -> str:
    number = int(function.get("func_type") or 0)
    return _FUNCTIONS.get(number, f"function of type {number}")


def _over(function: dict[str, Any], axis: np.ndarray) -> str:
    """What the function goes over, by the file; function types 1 and 2 and up tell it as well."""
    kind = int(function.get("abscissa_spec_data_type") or 0)
    if kind in (_TIME, _FREQUENCY):
        return "Time" if kind == _TIME else "Frequency"
    return "Time" if int(function.get("func_type") or 0) == 1 else "Frequency"


def _names(functions: list[dict[str, Any]]) -> list[str]:
    made: list[str] = []
    for function in functions:
        name = f"{_freedom(function, 'rsp')}/{_freedom(function, 'ref')}"
        made.append(name if name not in made else f"{name} {len(made) + 1}")
    return made


def _freedom(function: dict[str, Any], side: str) -> str:
    node, direction = (int(function.get(f"{side}_{key}") or 0) for key in ("node", "dir"))
    sign = "-" if direction < 0 else ""
    return f"{node}{sign}{_DIRECTIONS.get(abs(direction), '')}"


def _unit(function: dict[str, Any], axis: str) -> str | None:
    text = str(function.get(f"{axis}_axis_units_lab") or "").strip()
    return None if text.upper() in _UNTOLD else text


def _ordinate(function: dict[str, Any]) -> str | None:
    over, under = _unit(function, "ordinate"), _unit(function, "orddenom")
    if over is None:
        return None
    return over if under is None or "/" in over else f"{over}/{under}"


def _recognises(head: Head) -> bool:
    lines = [line.strip() for line in head.data[:4096].splitlines() if line.strip()][:2]
    return len(lines) == 2 and lines[0] == b"-1" and lines[1][:3].rstrip(b"b ").isdigit()


LAYOUT = Layout(name="uff", read=_read_uff, recognises=_recognises)
