"""Microseconds per step of every solver, beside an empty pythonfmu slave: a table.

    python tests/bench/bench_fmu.py [--steps 4000] [--rounds 5]

The scene is the 7 MHz string under its two tones, sampled every 10 us; after each step one getReal
fetches both hybridised displacements. Calls go through fmpy, as a user's do, whose share is in both
numbers of a ratio. Medians over all calls, rounds of the contestants interleaved, so that another
program on the machine disturbs all of them alike. The exact solver works when it is asked for a
value, so only the sum of doStep and getReal compares.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter_ns
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import build_fmu
from tests.support.fmus import Instance, Unpacked, unpack

STEP_S = 1e-5
OUTPUTS = ("q1_hybrid", "q2_hybrid")

#: A slave with the same two outputs that does nothing, in pythonfmu's own way.
EMPTY = """\
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Empty(Fmi2Slave):
    description, version, variables, guid_text = "does nothing", "1", (), ""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.guid, self.q1_hybrid, self.q2_hybrid = self.guid_text, 1.0, 2.0
        self.register_variable(Real("q1_hybrid", causality=Fmi2Causality.output))
        self.register_variable(Real("q2_hybrid", causality=Fmi2Causality.output))

    def setup_experiment(self, start_time, *_):
        pass

    def value(self, name):  # of its status: what build_fmu.py asks of a model
        return ""

    def do_step(self, current_time, step_size):
        return True
"""


@dataclass
class Contestant:
    """A slave with its start values, and the nanoseconds that its calls took."""

    name: str
    fmu: Unpacked
    values: dict[str, Any]
    share: float = 1.0  # of the steps that the others do: rk4 would take minutes
    do_step_ns: list[int] = field(default_factory=list)
    get_real_ns: list[int] = field(default_factory=list)

    def round(self, instance: Instance, steps: int) -> None:
        """Reset, initialise and step; the first calls of a round are not counted."""
        instance.slave.reset()
        instance.start(**self.values)
        count, references = max(20, int(steps * self.share)), self.references()
        step, read = instance.slave.doStep, instance.slave.getReal
        for k in range(count):
            t0 = perf_counter_ns()
            step(k * STEP_S, STEP_S)
            t1 = perf_counter_ns()
            read(references)
            t2 = perf_counter_ns()
            if k >= count // 10:
                self.do_step_ns.append(t1 - t0)
                self.get_real_ns.append(t2 - t1)

    def references(self) -> list[int]:
        return [self.fmu.references[name] for name in OUTPUTS]

    @property
    def do_step_us(self) -> float:
        return statistics.median(self.do_step_ns) / 1e3

    @property
    def get_real_us(self) -> float:
        return statistics.median(self.get_real_ns) / 1e3


def empty_slave(folder: Path) -> Unpacked:
    """Build the empty slave as the oscillator is built."""
    source = folder / "source"
    shutil.copytree(build_fmu.SOURCE / "documentation", source / "documentation")
    shutil.copy(build_fmu.SOURCE / "bridge.py", source)
    (source / "__init__.py").write_text('MODELS, FAMILIES = {"Empty": "empty"}, {}\n')
    (source / "empty.py").write_text(EMPTY)
    return unpack(build_fmu.build("Empty", folder, source=source), folder / "empty")


def contestants(folder: Path) -> list[Contestant]:
    """Return the empty slave and every solver, from rest and on the periodic orbit."""
    oscillator = unpack(build_fmu.build("CoupledOscillator", folder), folder / "oscillator")
    found = [Contestant("empty slave", empty_slave(folder), {})]
    for number, solver in enumerate(("exact", "envelope", "rk4")):
        for start, periodic in (("from rest", False), ("periodic start", True)):
            values = {"solver": number, "periodic_start": periodic}
            share = 0.01 if solver == "rk4" else 1.0
            found.append(Contestant(f"{solver}, {start}", oscillator, values, share))
    return found


def measure(found: list[Contestant], steps: int, rounds: int) -> None:
    """Let the contestants run in turns."""
    instances = [Instance(contestant.fmu, contestant.name) for contestant in found]
    for _ in range(rounds):
        for contestant, instance in zip(found, instances, strict=True):
            contestant.round(instance, steps)
    for instance in instances:
        instance.slave.freeInstance()


def restart_us(contestant: Contestant, cycles: int = 200) -> float:
    """Return the microseconds of reset, setting one parameter, initialising and a first value."""
    took = []
    with Instance(contestant.fmu) as instance:
        for k in range(cycles):
            t0 = perf_counter_ns()
            instance.slave.reset()
            changed = {"theta": 1.9 + 1e-4 * k} if contestant.values else {}
            instance.start(**contestant.values, **changed)
            instance.slave.doStep(0.0, STEP_S)
            instance.slave.getReal(contestant.references())
            took.append(perf_counter_ns() - t0)
    return statistics.median(took) / 1e3


def growth_kilobytes(fmu: Unpacked, cycles: int) -> float:
    """Return by how many kB resets grow a process of their own."""
    script = Path(__file__).parents[1] / "support" / "hosts" / "reset_cycles.py"
    done = subprocess.run(
        [sys.executable, str(script), str(fmu.folder), str(cycles)],
        check=True,
        capture_output=True,
        text=True,
    )
    return float(done.stdout) / 1024


def report(found: list[Contestant], write: Callable[[str], None]) -> None:
    """Write the table."""
    base = found[0].do_step_us + found[0].get_real_us
    write(f"{'':26}{'doStep':>9}{'getReal':>9}{'sum':>9}{'ratio':>8}{'restart':>10}   (us)")
    for c in found:
        total = c.do_step_us + c.get_real_us
        write(
            f"{c.name:26}{c.do_step_us:9.2f}{c.get_real_us:9.2f}{total:9.2f}{total / base:8.2f}"
            f"{restart_us(c, 20 if 'rk4' in c.name else 200):10.1f}"
        )
    write("restart: reset, set, initialise, first step and first value")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=4000, help="steps per round (4000)")
    parser.add_argument("--rounds", type=int, default=5, help="rounds (5)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = contestants(Path(folder))
        measure(found, options.steps, options.rounds)
        report(found, print)
        print(f"2,000 resets: {growth_kilobytes(found[1].fmu, 2000):+.0f} kB")


if __name__ == "__main__":
    main()
