"""The oscillator FMU in two co-simulation masters written in C++: libcosim and Ecos.

Each runs in a process of its own, because a master that loads an FMU must not be able to end the
tests, and because both bring caches and loggers that outlive a simulation.
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.support import reference
from tests.support.fmus import LIVELY, REFUSALS, Refusal, Unpacked, steady_state, unpack, worst
from tests.support.processes import MOST_S

HOSTS = Path(__file__).parents[1] / "support" / "hosts"
ORBIT: Mapping[str, Any] = {"phase1": 0.4, "A2": 0.5}
SOME_REFUSALS = [r for r in REFUSALS if r.label in ("eta-negative", "indefinite")]


@pytest.fixture(scope="module", params=["python", "native"])
def master_fmu(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Unpacked:
    """The FMU in Python, and its native twin."""
    fmu: Path = request.getfixturevalue(
        "twin_fmu" if request.param == "native" else "oscillator_fmu"
    )
    return unpack(fmu, tmp_path_factory.mktemp("masters"))


class Row(NamedTuple):
    """What a master saw at one of its communication points."""

    time: str
    values: list[float]
    message: str


@lru_cache
def why_not(module: str) -> str:
    """Return why a master cannot be imported: not installed, or a library that it needs is not."""
    done = subprocess.run(
        [sys.executable, "-c", f"import {module}"], capture_output=True, text=True, timeout=MOST_S
    )
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def rows(module: str, script: str, *arguments: object) -> tuple[list[Row], str]:
    """Run a master and return its rows and its last line; skip if it cannot be loaded here."""
    obstacle = why_not(module)
    if obstacle:
        pytest.skip(f"{module} cannot be loaded here: {obstacle}")
    command = [sys.executable, HOSTS / script, *arguments]
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, timeout=MOST_S
    )
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-500:]
    found, last = [], ""
    for line in done.stdout.splitlines():
        if line.startswith("row "):
            _, time, q1, q2, *message = line.split(" ", 4)
            found.append(Row(time, [float.fromhex(q1), float.fromhex(q2)], "".join(message)))
        elif line.startswith("end"):
            last = line
    assert last, "the master did not come to its end"
    return found, last


def assignments(values: Mapping[str, Any]) -> list[str]:
    return [f"{name}={value!r}" for name, value in values.items()]


class TestLibcosim:
    """libcosim counts whole nanoseconds and hands over the start and the length of a step."""

    def run(
        self, fmu: Path, step_ns: int, steps: int, count: int, values: Mapping[str, Any]
    ) -> tuple[list[Row], str]:
        return rows(
            "libcosimpy.CosimExecution",
            "cosim_run.py",
            fmu,
            step_ns,
            steps,
            count,
            *assignments(values),
        )

    def times(self, found: list[Row], step_ns: int) -> list[float]:
        """Return the ends of the last steps as the FMU was told them: start + (end - start)."""
        ends = ((int(row.time) - step_ns, int(row.time)) for row in found)
        return [start / 1e9 + (end / 1e9 - start / 1e9) for start, end in ends]

    def test_the_string_on_its_orbit(self, master_fmu: Unpacked) -> None:
        """1 us steps to 5 ms, 35,000 periods; the master's time is exact in nanoseconds."""
        found, _ = self.run(master_fmu.path, 1000, 500, 10, {"periodic_start": True, **ORBIT})
        times = self.times(found, 1000)
        assert times == pytest.approx([5e-4 * k for k in range(1, 11)], rel=1e-15)
        truth = steady_state(master_fmu.parameters(**ORBIT), times)
        assert worst([row.values for row in found], truth) < 1e-12
        assert {row.message for row in found} == {""}

    def test_a_run_from_rest(self, master_fmu: Unpacked) -> None:
        found, _ = self.run(master_fmu.path, 700, 10, 40, LIVELY)
        times = self.times(found, 700)
        truth = reference.displacements(master_fmu.parameters(**LIVELY), times)
        assert worst([row.values for row in found], [row[:2] for row in truth]) < 1e-12

    @pytest.mark.parametrize("refusal", SOME_REFUSALS, ids=lambda r: r.label)
    def test_a_failure_ends_the_simulation_not_the_process(
        self, master_fmu: Unpacked, refusal: Refusal
    ) -> None:
        found, last = self.run(master_fmu.path, 1000, 1, 2, refusal.values)
        assert "ERROR" in last.upper()
        assert all(math.isnan(x) for row in found for x in row.values)


class TestEcos:
    """Ecos adds up its time, and the FMU follows the time that it is given."""

    def run(
        self, fmu: Path, step: float, steps: int, count: int, values: Mapping[str, Any]
    ) -> list[Row]:
        found, _ = rows(
            "ecospy.lib", "ecos_run.py", fmu, repr(step), steps, count, *assignments(values)
        )
        return found

    def test_the_string_on_its_orbit(self, master_fmu: Unpacked) -> None:
        """1 us steps to 5 ms; the truth is taken at the sum of the steps, which is not 5 ms."""
        found = self.run(master_fmu.path, 1e-6, 500, 10, {"periodic_start": True, **ORBIT})
        times = [float.fromhex(row.time) for row in found]
        assert times == pytest.approx([5e-4 * k for k in range(1, 11)], rel=1e-11)
        truth = steady_state(master_fmu.parameters(**ORBIT), times)
        assert worst([row.values for row in found], truth) < 1e-12
        assert {row.message for row in found} == {""}

    def test_a_run_from_rest(self, master_fmu: Unpacked) -> None:
        found = self.run(master_fmu.path, 7e-7, 10, 40, LIVELY)
        times = [float.fromhex(row.time) for row in found]
        truth = reference.displacements(master_fmu.parameters(**LIVELY), times)
        assert worst([row.values for row in found], [row[:2] for row in truth]) < 1e-12

    @pytest.mark.parametrize("refusal", SOME_REFUSALS, ids=lambda r: r.label)
    def test_a_failure_is_told_and_no_number_comes_out(
        self, master_fmu: Unpacked, refusal: Refusal
    ) -> None:
        """Ecos looks at no status and carries on: what it reads must not look like a result."""
        for row in self.run(master_fmu.path, 1e-6, 1, 3, refusal.values):
            assert all(map(math.isnan, row.values))
            assert refusal.name in row.message
            assert refusal.value in row.message
