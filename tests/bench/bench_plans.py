"""FMUs of others with their quirks: whether plans keep what they promise, and fits hold the truth.

    python -m tests.bench.bench_plans [--laboratories N] [--seed N] [--profiles] [--only KIND]

A table over the C FMUs of `tests/support/cfmus`, against their own difference equation (matrices of
scipy) or transfer function; then fits of synthetic sweeps with 1 % of noise through three of them:
at its own steps, with steps of many lengths, and by communication steps.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import fitting as ff
from fitting.simulate.budget import Kind
from fitting.simulate.words import decision_in_words
from tests.support.cfmu_build import (
    build_c_fmu,
    build_exchange_fmu,
    build_lag_fmu,
    build_own_step_fmu,
)
from tests.support.own_step import phasor

NOISE = 0.01
FREQUENCIES = np.arange(25.0, 37.1, 1.5)
METHOD = ff.Tikhonov(nu=1e-3, levels=2)


@dataclass(frozen=True)
class Case:
    """An FMU, how it is driven, and the true amplitude of a tone (Hz); `held` is off the truth."""

    name: str
    build: Callable[[Path], Path]
    truth: Callable[[float], float]
    input: str = ""
    values: dict[str, float] = field(default_factory=dict)
    output: str = "displacement"
    tone_hz: float = 30.3
    held: float = 0.0


def own(kind: str, step_s: float, *, told: bool, fmi: int = 2) -> Case:
    """The oscillator with steps of its own."""
    told_so = ", told" if told else ""
    late = (math.pi * 30.3 * 1.5e-3) ** 2 / 6.0 if kind == "UNEVEN" else 0.0
    return Case(
        f"{kind.lower().replace('_', ' ')}{told_so}, FMI {fmi}",
        lambda folder: build_own_step_fmu(folder, kind, told=told, fmi=fmi),
        lambda f: abs(phasor(f, step_s)),
        held=late,
    )


def _mass(f: float) -> float:
    w = 2.0 * math.pi * f
    return 1.0 / math.hypot(4e3 - 1e-3 * w * w, 2e-2 * w)


CASES = (
    own("STANDS_BETWEEN", 1e-3, told=False),
    own("STANDS_BETWEEN", 1e-3, told=True, fmi=3),
    own("LOSES_TIME", 1e-3, told=True),
    own("LOSES_TIME", 1e-3, told=False),
    own("REFUSES", 1e-3, told=True),
    own("REFUSES", 1e-3, told=False),
    own("REFUSES", 1e-3, told=True, fmi=3),
    own("LATE_CLOCK", 1.001e-3, told=True),
    own("UNEVEN", 0.0, told=False),
    own("FOLLOWS", 0.0, told=False),
    Case("steps of any length", build_c_fmu, _mass, input="force", tone_hz=320.0),
    Case(
        "output noise of 1e-4",
        lambda folder: build_c_fmu(folder, marks={"NOISE": 1e-4}),
        _mass,
        input="force",
        tone_hz=320.0,
    ),
    Case(
        "feed-through alone",
        build_lag_fmu,
        lambda f: 1.0,
        input="u",
        values={"gain": 0.0, "through": 1.0},
        output="y",
    ),
    Case(
        "feed-through beside a lag",
        build_lag_fmu,
        lambda f: abs(1.0 / (1.0 + 2j * math.pi * f * 2e-3) + 0.7),
        input="u",
        values={"tau": 2e-3, "through": 0.7},
        output="y",
    ),
    Case(
        "model exchange alone",
        build_exchange_fmu,
        lambda f: 1.0 / abs(4e3 - 1e-3 * (2.0 * math.pi * f) ** 2 + 4j * math.pi * f),
        input="force",
        values={"damping": 2.0},
        tone_hz=300.0,
    ),
    Case(
        "a lag by Euler's method",
        build_lag_fmu,
        lambda f: abs(1.0 / (1.0 + 2j * math.pi * f * 2e-3)),
        input="u",
        values={"tau": 2e-3, "euler": 1.0},
        output="y",
    ),
)


def plan_of(case: Case, fmu: ff.Fmu) -> tuple[float, float, str]:
    """Promise, error, and what the plan says of this FMU, without an accuracy that is asked for."""
    if case.input:
        drive = ff.Drive(input=case.input)
        plan = fmu.plan(case.values, tones=[case.tone_hz], drive=drive, outputs=case.output)
    else:
        plan = fmu.plan({"tone": case.tone_hz}, tones=("tone",), outputs=case.output)
    error = abs(float(plan.amplitudes[0][0, 0]) / case.truth(case.tone_hz) - 1.0)
    told = [d for k in (Kind.ACCURACY, Kind.GRID, Kind.STEP) for d in plan.budget.of(k)]
    return plan.promised, error, "; ".join(decision_in_words(d).split(";")[0] for d in told)


def table() -> None:
    """Print a row for each FMU."""
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder, ff.Fmu(case.build(Path(folder))) as fmu:
            promised, error, said = plan_of(case, fmu)
        verdict = "kept" if error <= promised + case.held else "BROKEN"
        print(f"{case.name:32} {promised:8.1e} {error:8.1e} {verdict:6} {said}", flush=True)


LABORATORIES = {"STANDS_BETWEEN": (1e-3, None), "UNEVEN": (0.0, None), "FOLLOWS": (0.0, 0.1)}


def laboratory(
    fmu: ff.Fmu, kind: str, seed: int, profiles: bool
) -> dict[str, tuple[float, tuple[float, float], float]]:
    """Truth, interval and error of each value, in one laboratory."""
    step_s, accuracy = LABORATORIES[kind]
    rng = np.random.default_rng(seed)
    f0, width = 31.0 + rng.uniform(-0.5, 0.5), 4.0 + rng.uniform(-1.0, 1.0)
    true = np.array([abs(phasor(f, step_s, f0, width)) for f in FREQUENCIES])
    measured = true * (1.0 + NOISE * rng.standard_normal(true.size))
    drive = ff.Drive(frequency_names=("tone",), amplitude_names=("level",))
    asked: dict[str, Any] = {} if accuracy is None else {"accuracy": accuracy}
    setup = ff.Setup(drive, "displacement", line_width_hz=4.0, **asked)
    wanted = (
        ff.Parameter("eigenfrequency", 31.0, bounds=(29.0, 33.0), unit="Hz"),
        ff.Parameter("line_width", 4.0, bounds=(1.0, 12.0), unit="Hz"),
    )
    sweep = ff.Sweep(setup, FREQUENCIES, measured)
    problem = ff.Problem(fmu, wanted, [sweep], noise=ff.Noise(relative=NOISE))
    fit = ff.fit(problem, METHOD, starts=1)
    values = {"eigenfrequency": f0, "line_width": width}
    known = ff.profile(fit, list(values)) if profiles else fit
    return {n: (v, known[n].interval(0.95), fit[n].std) for n, v in values.items()}


def coverage(kind: str, count: int, first: int, profiles: bool) -> None:
    """Print how often intervals of 95 % hold the truth."""
    with (
        tempfile.TemporaryDirectory() as folder,
        ff.Fmu(build_own_step_fmu(Path(folder), kind)) as fmu,
    ):
        found = [laboratory(fmu, kind, first + k, profiles) for k in range(count)]
    for name in found[0]:
        held = sum(low <= true <= high for true, (low, high), _ in (f[name] for f in found))
        width = float(np.nanmedian([f[name][2] for f in found]))
        print(f"{kind}: {name}: {held} of {count} intervals hold the truth, error {width:.2g} Hz")


def main() -> None:
    """The table, then the laboratories."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laboratories", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--profiles", action="store_true", help="intervals by profiles")
    parser.add_argument(
        "--only", choices=tuple(LABORATORIES), help="laboratories of this FMU alone"
    )
    args = parser.parse_args()
    if args.only is None:
        table()
    for kind in LABORATORIES:
        if args.laboratories and args.only in (None, kind):
            coverage(kind, args.laboratories, args.seed, args.profiles)


if __name__ == "__main__":
    main()
