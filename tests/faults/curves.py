"""Faults of curves, of laws and of phases: each is refused in one sentence.

Unlike the other kinds these are not drawn at random: every fault says what its sentence has to
name, and has to end with exit code 2, whatever else the command would have done.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from tests.faults import control_faults, phase_faults
from tests.faults.campaign_keys import COMMAND
from tests.faults.case import HERE, Case
from tests.faults.curve_scenes import Fault

CURVES = "curves: laws, wiring, phases, maps"


def cases(count: int, seed: int) -> Iterator[Case]:
    """So many of them, at most all, in an order drawn by the seed."""
    every = list(faults())
    random.Random(seed).shuffle(every)
    for fault in every[:count]:
        yield Case(
            kind=CURVES,
            name=fault.name,
            words=COMMAND,
            change=partial(_write, fault.files),
            about=(HERE,),
            codes=(2,),
            says=fault.says,
            complaints=fault.complaints,
        )


def faults() -> Iterator[Fault]:
    """All of them."""
    yield from control_faults.faults()
    yield from phase_faults.faults()


def _write(files: Mapping[str, str], folder: Path) -> None:
    for name, text in files.items():
        (folder / name).write_text(text, "utf-8")
