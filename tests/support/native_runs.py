"""Runs of native FMUs in a host in C: everything that a host may ask for, model by model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tests.support import reference
from tests.support.c_hosts import Host, Transcript
from tests.support.duffing_scenes import SCENES
from tests.support.fmus import LIVELY, REFUSALS, TIMES, steady_state, worst
from tests.support.modes_scenes import PUMP, THREE

Values = Mapping[str, Any]
DISPLACEMENT = r"q\d(_hybrid)?|readout(_at_u\d)?"
SETTINGS: Sequence[Values] = [
    {},
    {"solver": 1},
    {"solver": 2},
    {"other_mode": 1},
    {"other_mode": 2},
    {"periodic_start": True},
    {"d1": 1.5e5},
    {"eta_minus": 1e5},
]


@dataclass(frozen=True, eq=False)  # a case is itself alone, and a key
class Case:
    """A model and its interface; start values of its runs, and what is changed on their way."""

    model: str
    fmi: int
    step_s: float
    runs: Sequence[tuple[Values, Values]]

    @property
    def name(self) -> str:
        return f"{self.model}, FMI {self.fmi}"


OSCILLATOR_RUNS = [({**LIVELY, **values}, {"theta": 2.2, "u1": 1e5}) for values in SETTINGS]
MODES_RUNS = [
    ({**THREE, **values, **pump}, {"d1": 0.3, "u1": 1.01})
    for values in ({}, {"solver": 1}, {"solver": 2}, {"periodic_start": True})
    for pump in ({}, PUMP)
]
CASES = (
    Case("CoupledOscillator", 2, 1e-4, OSCILLATOR_RUNS),
    Case("CoupledOscillator", 3, 1e-4, OSCILLATOR_RUNS),
    Case("DuffingOscillator", 2, 1e-4, list(SCENES.values())),
    Case("CoupledModes3", 2, 1.7, MODES_RUNS),
)
#: How often each of the runs is looked at.
LOOKS = 4


def script_of(host: Host, case: Case) -> list[str]:
    """Everything that a host may ask for, without a failure: steps, changes, states, packed too."""
    outputs = host.fmu.names("output")
    first, second = f"0 {case.step_s!r}", f"{case.step_s!r} {case.step_s!r}"
    script = ["new 0 a", "new 1 b"]
    for start, change in case.runs:
        script += [
            "reset 0",
            *host.start(0, **start),
            *host.get(*outputs),
            f"step 0 {first}",
            "save 0",
            "pack 0",
            "unpack 1",
            "restore 1",
            "drop 1",
            *host.set(0, change),
            f"step 0 {second}",
            *host.get(*outputs),
            "restore 0",
            f"step 0 {second}",
            *host.get(*outputs),
            "drop 0",
            f"step 1 {second}",
            *host.get(*outputs, slot=1),
            host.message,
        ]
    return [*script, "terminate 0", "free 0", "free 1"]


def refusals(host: Host) -> list[str]:
    """Every failure that the oscillator promises to survive, and what it says of it; slot 0."""
    script = []
    for refusal in REFUSALS:
        script += ["reset 0", *host.start(**refusal.values), "step 0 0 1", host.message]
    return script


@dataclass(frozen=True)
class ClosedForm:
    """Runs of the oscillator beside the closed form: from rest, and on the periodic orbit."""

    transcript: Transcript
    rest_error: float
    orbit_error: float


def closed_form(host: Host) -> ClosedForm:
    """Run the oscillator twice, side by side in one process."""
    orbit = {"phase1": 0.4, "A2": 0.5}
    names = "q1_hybrid", "q2_hybrid"
    script = ["new 0 rest", "new 1 orbit"]
    script += [*host.start(0, **LIVELY), *host.start(1, periodic_start=True, **orbit)]
    script += [*host.steps(TIMES, *names, slot=0), *host.steps(TIMES, *names, slot=1)]
    transcript = host.play([*script, "terminate 0", "free 0", "terminate 1", "free 1"])
    rows, p = transcript.reals(), host.fmu.parameters
    rest = [row[:2] for row in reference.displacements(p(**LIVELY), TIMES)]
    return ClosedForm(
        transcript,
        worst(rows[: len(TIMES)], rest),
        worst(rows[len(TIMES) :], steady_state(p(**orbit), TIMES)),
    )


def rows_of(host: Host, transcript: Transcript) -> list[list[dict[str, float]]]:
    """What was seen in each of the runs, look by look."""
    names = host.fmu.names("output")
    rows = [dict(zip(names, row, strict=True)) for row in transcript.reals()]
    return [rows[k : k + LOOKS] for k in range(0, len(rows), LOOKS)]


def scales(rows: list[dict[str, float]]) -> dict[str, float]:
    """The size of each output: of all displacements together, of a pair of quadratures, its own."""

    displacements = {name for name in rows[0] if re.fullmatch(DISPLACEMENT, name)}

    def size(name: str) -> float:
        alike = displacements
        if name not in alike:
            alike = {name.replace("_Y_", "_X_"), name.replace("_X_", "_Y_")}
        found = [abs(row[other]) for row in rows for other in alike]
        return max((x for x in found if x == x), default=0.0) or 1.0

    return {name: size(name) for name in rows[0]}
