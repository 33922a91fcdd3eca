"""Campaigns of `init` for FMUs that it has never seen: whether they run as they are.

    python -m tests.bench.bench_drafts [--only NAME ...] [--folder FMUS]

For each FMU a sweep with 0.1 % of noise is written to a file, of an amplitude in closed form;
`fmu-fit init FMU FILE` makes a campaign, `fmu-fit reconstruct` fits it unedited, without profiles.
A row tells the exit code of each, what was fitted, and how far it is from the truth. FMUs of a
folder get a line in the middle of nowhere: there it counts that each command ends as it should.
FMUs of model exchange are solved here, in Python: each takes half a minute.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fitting.result.result import read_result
from fitting.text.arrays import FloatArray
from tests.bench import bench_quirks as quirks
from tests.support.cfmu_build import (
    build_c_fmu,
    build_exchange_fmu,
    build_lag_fmu,
    build_own_step_fmu,
    reworded,
)
from tests.support.own_step import phasor

NOISE, GAIN = 1e-3, 0.37
#: Exit codes of `reconstruct` that come with a result of a fit that ended.
FITTED = (0, 4)
LOCALS = {'causality="output"': 'causality="local"'}


class Case(NamedTuple):
    """An FMU, the frequencies (Hz) and amplitudes (V) of its sweep, and its true values."""

    name: str
    build: Callable[[Path], Path | str]
    f_hz: FloatArray
    volt: Callable[[float], float]
    truth: Mapping[str, float]


def _mass(k: float, c: float) -> Callable[[float], float]:
    def volt(f: float) -> float:
        w = 2.0 * math.pi * f
        return GAIN / math.hypot(k - 1e-3 * w * w, c * w)

    return volt


def _modes(*lines: tuple[float, float]) -> Callable[[float], float]:
    """Beside each other, each as high as it is."""

    def volt(f: float) -> float:
        return GAIN * abs(sum(f0 * b / complex(f0 * f0 - f * f, -f * b) for f0, b in lines))

    return volt


def _of_locals(folder: Path) -> Path:
    return reworded(build_c_fmu(folder), LOCALS)


def _exchange(fmi: int) -> Callable[[Path], Path]:
    """Damped as the line is: no output tells `init` how wide one of this FMU would be."""
    return lambda folder: reworded(
        build_exchange_fmu(folder, fmi), {'start="2e-2"': 'start="0.15"'}
    )


def _cases() -> list[Case]:
    mass = {"stiffness": 4100.0, "damping": 0.2}
    line = np.linspace(286.0, 358.0, 13)
    slow = np.arange(25.0, 37.1, 1.0)
    stepped = {"eigenfrequency": 31.2, "line_width": 3.0}
    tau = 0.8
    low = np.arange(0.1, 1.55, 0.1).round(1)

    def own(step_s: float) -> Callable[[float], float]:
        return lambda f: GAIN * abs(phasor(f, step_s, 31.2, 3.0))

    def model(name: str) -> Callable[[Path], str]:
        return lambda _: name

    one = np.linspace(990.0, 1010.0, 41)
    two = np.linspace(960.0, 1040.0, 161)
    return [
        Case("a mass on a spring, FMI 2.0", build_c_fmu, line, _mass(4100.0, 0.2), mass),
        Case("FMI 3.0", lambda d: build_c_fmu(d, fmi=3), line, _mass(4100.0, 0.2), mass),
        Case(
            "locals only", lambda d: reworded(build_c_fmu(d), LOCALS), line, _mass(4100, 0.2), mass
        ),
        Case("model exchange alone, FMI 2.0", _exchange(2), line, _mass(4100, 0.2), mass),
        Case(
            "model exchange alone, FMI 3.0",
            _exchange(3),
            line,
            _mass(4100.0, 0.2),
            mass,
        ),
        Case("a step of its own", build_own_step_fmu, slow, own(1e-3), stepped),
        Case(
            "a step of its own, told, FMI 3.0",
            lambda d: build_own_step_fmu(d, told=True, fmi=3),
            slow,
            own(1e-3),
            stepped,
        ),
        Case(
            "refuses other steps",
            lambda d: build_own_step_fmu(d, "REFUSES", told=True),
            slow,
            own(1e-3),
            stepped,
        ),
        Case(
            "a lag",
            build_lag_fmu,
            low,
            lambda f: GAIN / abs(1.0 + 2j * math.pi * f * tau),
            {"tau": tau},
        ),
        Case("CoupledModes1", model("CoupledModes1"), one, _modes((1000.3, 3.0)), {"f1": 1000.3}),
        Case(
            "CoupledModes2",
            model("CoupledModes2"),
            two,
            _modes((990.0, 3.0), (1012.0, 4.0)),
            {"f1": 990.0, "f2": 1012.0},
        ),
        Case("CoupledOscillator", model("CoupledOscillator"), one, _modes((1000.3, 3.0)), {}),
        Case("DuffingOscillator", model("DuffingOscillator"), one, _modes((1000.3, 3.0)), {}),
    ]


def _row(case: Case, folder: Path) -> str:
    rng = np.random.default_rng(1)
    volt = [case.volt(float(f)) * (1.0 + NOISE * rng.standard_normal()) for f in case.f_hz]
    rows = "".join(f"{f},{v}\n" for f, v in zip(case.f_hz.tolist(), volt, strict=True))
    (folder / "sweep.csv").write_text("frequency (Hz),R (V)\n" + rows)
    fmu = case.build(folder)
    given = (str(folder / "sweep.csv"), "--fmu", str(fmu))
    made, said = quirks.quietly("init", *given, "--out", str(folder), "--yes")
    if made:
        return f"{made} | | | {said}"
    out = folder / "out"
    words = ("--out", str(out), "--no-profiles", "--no-report", "--workers", "1")
    ended, said = quirks.quietly("reconstruct", str(folder / "campaign.toml"), *words)
    if not (out / "result.json").exists():
        return f"0 | {ended} | | {said}"
    result = read_result(out / "result.json")
    found = result.parameters
    off = [f"{n} {quirks.off(found[n], case.truth[n])}σ" if n in case.truth else n for n in found]
    return f"0 | {ended} | {', '.join(off)} | {'' if ended in FITTED else result.message}"


def _given(path: Path) -> Callable[[Path], Path]:
    return lambda _: path


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="these alone")
    parser.add_argument("--folder", type=Path, help="further FMUs, whose values nobody knows")
    args = parser.parse_args()
    cases = [case for case in _cases() if not args.only or case.name in args.only]
    for path in sorted(args.folder.glob("*.fmu")) if args.folder else ():
        cases.append(
            Case(path.stem, _given(path), np.linspace(0.5, 1.5, 21), _modes((1.0, 0.1)), {})
        )
    print("| FMU | init | reconstruct | fitted, off by | said |\n|---|---|---|---|---|")
    for case in cases:
        with tempfile.TemporaryDirectory() as folder:
            row = _row(case, Path(folder)).replace(folder, "…")
        print(f"| {case.name} | {row} |", flush=True)


if __name__ == "__main__":
    main()
