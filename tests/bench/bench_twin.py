"""The native twin beside the Python FMU: processor time of starts, of steps and of whole fits.

    python tests/bench/bench_twin.py [--steps 2000] [--starts 200] [--fit string_q1 ...] [--quick]

The scene is the 7 MHz string under its two tones, from rest, sampled every 10 us; after each step
one getReal fetches both hybridised displacements. ``three modes`` are those of CoupledModes3, with
and without a pump. A start sets one parameter, initialises and
reads all outputs. A derivative is that of one output along one parameter, at the last of seven
samples, beside a whole run of seven, which is what a difference takes instead; the FMU in Python
has none. Calls go through fmpy, whose share is in both columns; ``loop`` is the time of as
many calls of an FMU that does next to nothing, getInteger. A fit is ``fmu-fit reconstruct`` of a
shipped campaign with the one FMU or the other, its worker processes included, without the report;
each value of both follows, and how far they are apart in standard deviations. ``--quick`` takes
the command's option of that name and no profiles, for fits that take the Python FMU too long. Times
are processor times, so that other programs on the machine count for little.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from time import process_time
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import build_fmu
from fitting.result.result import read_result
from tests.support.fmus import Instance, Unpacked, unpack

ROOT = Path(build_fmu.__file__).parent
STEP_S = 1e-5
SAMPLES = 7
OUTPUTS = ("q1_hybrid", "q2_hybrid", "q1", "q2")
PUMP = {"depth_f1": 1e-5, "pump_hz": 3.1e5}
THREE: dict[str, dict[str, Any]] = {
    "three modes": {},
    "three modes, envelope": {"solver": 1},
    "three modes, pumped": PUMP,
}
SOLVERS: dict[str, dict[str, Any]] = {
    "exact": {},
    "envelope": {"solver": 1},
    "far mode left out": {"other_mode": 2},
    "rk4": {"solver": 2},
}
#: Starts from which whole runs and derivatives are timed.
RUNS: dict[str, dict[str, Any]] = {"from rest": {}, "periodic": {"periodic_start": True}}


def microseconds(calls: Callable[[], int]) -> float:
    """Processor time of one of the calls that a function makes and counts."""
    begin = process_time()
    count = calls()
    return 1e6 * (process_time() - begin) / count


def steps(fmu: Instance, values: dict[str, Any], count: int) -> float:
    """Microseconds of a step with its reading."""
    outputs = [name for name in fmu.outputs() if name in OUTPUTS][:2]
    fmu.slave.reset()
    fmu.start(**values)
    fmu.step(0.0, STEP_S)

    def run() -> int:
        for k in range(1, count + 1):
            fmu.step(k * STEP_S, STEP_S)
            fmu.get(*outputs)
        return count

    return microseconds(run)


def starts(fmu: Instance, values: dict[str, Any], count: int) -> float:
    """Microseconds of a reset, a start with another damping, and a reading of all outputs."""

    def run() -> int:
        for k in range(count):
            fmu.slave.reset()
            fmu.start(**values, d1=100.0 + 0.1 * k)
            fmu.outputs()
        return count

    return microseconds(run)


def loop(fmu: Instance, count: int) -> float:
    """Microseconds of two calls through fmpy that do next to nothing."""
    solver = fmu._variables["solver"].valueReference

    def run() -> int:
        for _ in range(count):
            fmu.slave.getInteger([solver])
            fmu.slave.getInteger([solver])
        return count

    return microseconds(run)


def runs(fmu: Instance, values: dict[str, Any], count: int) -> float:
    """Microseconds of a reset, a start with another damping, and as many samples of one output."""
    output = next(name for name in fmu.outputs() if name in OUTPUTS)

    def run() -> int:
        for k in range(count):
            fmu.slave.reset()
            fmu.start(**values, d1=100.0 + 0.1 * k)
            for sample in range(SAMPLES):
                fmu.step(sample * STEP_S, STEP_S)
                fmu.get(output)
        return count

    return microseconds(run)


def derivatives(fmu: Instance, values: dict[str, Any], count: int) -> float:
    """Microseconds of a directional derivative of an output along a parameter."""
    output = next(name for name in fmu.outputs() if name in OUTPUTS)
    unknown, known = (fmu._variables[name].valueReference for name in (output, "d1"))
    runs(fmu, values, 1)

    def run() -> int:
        for _ in range(count):
            fmu.slave.getDirectionalDerivative([unknown], [known], [1.0])
        return count

    return microseconds(run)


Fitted = dict[str, tuple[float, float]]


def fit(
    name: str, folder: Path, native: tuple[str, ...] | None, options: Sequence[str] = ()
) -> tuple[float, Fitted]:
    """Processor seconds of a fit of a shipped campaign with one FMU or the other.

    With it every parameter's value and standard deviation.
    """
    place = folder / f"{name}_{'python' if native is None else 'native'}"
    shutil.copytree(ROOT / "data" / name, place)
    text = (place / "campaign.toml").read_text("utf-8")
    model = tomllib.loads(text)["fmu"]["model"]
    fmu = build_fmu.build(model, place / "fmu", native=native)
    text = text.replace(f'model = "{model}"', f'file = "{fmu.as_posix()}"')
    (place / "campaign.toml").write_text(text, "utf-8")
    before = os.times()
    command = [sys.executable, "-m", "fitting", "reconstruct", str(place / "campaign.toml")]
    command += ["--no-report", "--quiet", "--workers", "1", "--out", str(place / "out")]
    subprocess.run([*command, *options], check=True, cwd=ROOT)
    after = os.times()
    spent = sum(after[2:4]) - sum(before[2:4])
    found = read_result(place / "out" / "result.json")
    return spent, {name: (p.value, p.std) for name, p in found.parameters.items()}


def compare(name: str, folder: Path, options: Sequence[str]) -> None:
    """Print the times of a campaign's fit with both FMUs, and both values of each parameter."""
    kinds: tuple[tuple[str, ...] | None, ...] = (None, ())
    (a, ours), (b, theirs) = (fit(name, folder, kind, options) for kind in kinds)
    print(f"{'fit ' + name + ', s':<28}{a:>10.1f}{b:>10.1f}{a / b:>8.1f}")
    for parameter, (value, std) in ours.items():
        other = theirs[parameter][0]
        known = std > 0.0  # NaN where the data do not determine it
        apart = abs(other - value) / (std if known else abs(value) or 1.0)
        unit = "standard deviations" if known else "of the value, which the data leave open"
        print(f"  {parameter:<26}{value:>22.15g}{other:>22.15g}   apart by {apart:.0e} {unit}")


def table(
    model: str, scenes: dict[str, dict[str, Any]], folder: Path, options: argparse.Namespace
) -> None:
    """Print the times of steps and starts of a model with both FMUs."""
    python = build_fmu.build(model, folder / f"python_{model}")
    native = build_fmu.build(model, folder / f"native_{model}", native=())
    unpacked: list[Unpacked] = [unpack(f, f.parent / "unpacked") for f in (python, native)]
    with Instance(unpacked[0]) as slow, Instance(unpacked[1]) as quick:
        measures = (("step", steps, options.steps), ("start", starts, options.starts))
        for title, measure, count in measures:
            for label, values in scenes.items():
                few = max(1, count // 50) if label == "rk4" and title == "step" else count
                a, b = (measure(fmu, values, few) for fmu in (slow, quick))
                print(f"{title + ', ' + label:<28}{a:>10.1f}{b:>10.1f}{a / b:>8.1f}")
        for label, values in RUNS.items():
            a, b = (runs(fmu, values, options.starts) for fmu in (slow, quick))
            print(f"{'run of 7, ' + label:<28}{a:>10.1f}{b:>10.1f}{a / b:>8.1f}")
            b = derivatives(quick, values, options.starts)
            print(f"{'derivative, ' + label:<28}{'-':>10}{b:>10.1f}{'-':>8}")
        a, b = (loop(fmu, options.steps) for fmu in (slow, quick))
        print(f"{'loop, ' + model:<28}{a:>10.1f}{b:>10.1f}{a / b:>8.1f}")


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--fit", nargs="*", default=["string_q1"], help="shipped campaigns")
    parser.add_argument("--quick", action="store_true", help="fits by --quick --no-profiles")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"{'processor time, us':<28}{'Python':>10}{'native':>10}{'ratio':>8}")
        table("CoupledOscillator", SOLVERS, folder, options)
        table("CoupledModes3", THREE, folder, options)
        quick = ["--quick", "--no-profiles"] if options.quick else []
        for campaign in options.fit:
            compare(campaign, folder, quick)
    return 0


if __name__ == "__main__":
    sys.exit(main())
