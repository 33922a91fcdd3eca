"""Faults in Python: every argument of public names as what it cannot be; sizes beyond computing."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tests.api.test_arguments import RIGHT, WRONG
from tests.faults.case import HERE, Case, drawn
from tests.faults.scene import amplitude_v, csv

ARGUMENTS, SIZES = "Python: arguments", "numbers beyond computing, in files"


def cases(count: int, seed: int) -> Iterator[Case]:
    """So many of them, drawn."""
    every = [
        (name, key, k)
        for name, (called, _) in RIGHT.items()
        for key in inspect.signature(called).parameters
        for k in range(len(WRONG))
    ]
    for name, key, k in drawn(every, count, seed):
        called, right = RIGHT[name]
        yield Case(
            kind=ARGUMENTS,
            name=f"{name}({key}=) {type(WRONG[k]).__name__}, {k}",
            words=(),
            about=(),
            call=_call(called, {**right, key: WRONG[k]}),
        )


def _call(called: Callable[..., object], given: dict[str, object]) -> Callable[[], object]:
    return lambda: called(**given)


#: Powers of ten that frequencies and amplitudes of a sweep are multiplied by.
POWERS = (-330, -310, -250, -163, -100, -71, -40, -20, 0, 20, 40, 71, 100, 163, 250, 300)


def size_cases(count: int, seed: int) -> Iterator[Case]:
    """Sweeps in units of any size: a line, or one sentence."""
    every = itertools.product((0, *POWERS), (0, *POWERS), ("line", "init"))
    pairs = [(f, a, c) for f, a, c in dict.fromkeys(every) if f == 0 or a == 0 or c == "line"]
    for of_f, of_a, command in drawn(pairs, count, seed):
        output = ("--out", f"{HERE}/out", "--yes") if command == "init" else ()
        yield Case(
            kind=SIZES,
            name=f"{command}: frequencies times 1e{of_f}, amplitudes times 1e{of_a}",
            words=(command, f"{HERE}/sweep.csv", *output),
            change=partial(_scaled, of_f, of_a),
            about=("sweep.csv", "--fit"),
            codes=(0, 2),
        )


def _scaled(of_f: int, of_a: int, folder: Path) -> None:
    f = np.linspace(202.0, 442.0, 49)
    a = amplitude_v(f)
    text = csv(f, a)
    if of_f or of_a:
        head, *rows = text.splitlines()
        cells = (row.split(",") for row in rows)
        text = "\n".join([head, *(f"{x}e{of_f},{_times(y, of_a)}" for x, y in cells), ""])
    (folder / "sweep.csv").write_text(text, "utf-8")


def _times(number: str, power: int) -> str:
    digits, _, own = number.partition("e")
    return f"{digits}e{int(own or 0) + power}"
