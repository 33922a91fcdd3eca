"""The task that other programs were given: theta, d1 and d2 of the string from a noise-free trace.

    python -m tests.bench.bench_peers [--estim8 PYTHON] [--modestpy PYTHON] [--seconds 150]

A string at rest is driven by two tones; its first string is seen. The trace comes from the matrix
exponential, not from the FMU. PYTHON is that of an environment of its own with estim8 (`pip install
estim8`) or ModestPy (`pip install modestpy "pandas<2" "numpy<2" "pyDOE==0.3.8"`, which it needs and
does not ask for); they fit through the same native FMU, each by its way to a global minimum, until
it ends by itself or for so many seconds of processor time. Printed are the processor time until the
best fit so far was within 1 %, 1e-6 and 1e-9 of the truth, and the error in the end. Reading,
loading and building the FMU are not counted, our worker's processor time is.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import build_fmu
import fitting as ff
from tests.support.linear_traces import string, toned_response
from tests.support.processes import spent_s

TRUTH = {"theta": 1.95, "d1": 3.0, "d2": 1.2}
START = {"theta": 1.8, "d1": 4.0, "d2": 2.0}
BOUNDS = {"theta": (1.58, 3.1), "d1": (0.3, 20.0), "d2": (0.3, 20.0)}
ETA_HZ, TONES_HZ, LEVEL = (100.0, 106.0), (99.0, 105.0), 100.0
KNOWN = {
    **dict(zip(("eta_plus", "eta_minus"), ETA_HZ, strict=True)),
    **dict(zip(("u1", "u2"), TONES_HZ, strict=True)),
    "A1": LEVEL,
    "A2": LEVEL,
}
STEP_S, SAMPLES = 2.5e-3, 400
ERRORS = (1e-2, 1e-6, 1e-9)
#: Smooth least squares; at the second level the prior weighs 1e-10.
METHOD = ff.Tikhonov(nu=1e-6, beta=1e-4, levels=2, misfit="squares")


def trace() -> tuple[np.ndarray, np.ndarray]:
    """Times, s, and what is seen: 400 samples without noise."""
    theta = TRUTH["theta"]
    seen = (np.cos(theta), np.sin(theta))
    system = string(theta, TRUTH["d1"], TRUTH["d2"], ETA_HZ, seen)
    tones = [(tone_hz, LEVEL) for tone_hz in TONES_HZ]
    return STEP_S * np.arange(SAMPLES), toned_response(system, tones, STEP_S, SAMPLES)


def problem(fmu: ff.Fmu) -> ff.Problem:
    """The trace of a string that its own tones set in motion."""
    t, y = trace()
    setup = ff.Setup(ff.Drive(), "q1", start_values=KNOWN)
    parameters = [ff.Parameter(n, START[n], bounds=BOUNDS[n]) for n in TRUTH]
    return ff.Problem(fmu, parameters, ff.Trace(t, y, setup=setup, unit="m"))


def solved(path: Path, starts: int) -> tuple[float, float]:
    """Largest relative error, and processor time of the fit with its worker, s."""
    begun = spent_s()
    with ff.Fmu(path, workers=1) as fmu:
        fit = ff.fit(problem(fmu), method=METHOD, starts=starts)
    spent = spent_s() - begun
    errors = [abs(fit[name].value / true - 1.0) for name, true in TRUTH.items()]
    return max(errors), spent


def task(folder: Path, fmu: Path, seconds: float) -> Path:
    """The same task for another program, as a file."""
    table, told = folder / "trace.csv", folder / "task.json"
    rows = np.column_stack(trace())
    np.savetxt(table, rows, delimiter=",", header="time,q1", comments="", fmt="%.17g")
    asked = {"fmu": str(fmu), "table": str(table), "output": "q1", "step_s": STEP_S}
    asked |= {"truth": TRUTH, "start": START, "bounds": BOUNDS, "known": KNOWN, "seconds": seconds}
    told.write_text(json.dumps(asked))
    return told


def by_another(name: str, python: str, told: Path) -> dict[str, Any]:
    """What `peers` found by a program, in the environment of that Python."""
    script = Path(__file__).with_name("peers.py")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    ended = subprocess.run(
        [python, str(script), name, str(told)],
        cwd=told.parent,
        env={**environment, "OPENBLAS_NUM_THREADS": "1"},
        check=True,
        capture_output=True,
        text=True,
    )
    found: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return found


def reached(steps: list[tuple[float, float, float]], error: float) -> str:
    """When the best fit so far had come to an error, and came no farther off; in words."""
    last = [at for at, _, off in steps if off > error]
    later = [at for at, _, off in steps if off <= error and (not last or at > last[-1])]
    return f"{later[0]:.2f} s" if later else "not reached"


def row(*cells: str) -> str:
    """A line of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """With the native FMU and the one in Python; the first fit of a process loads libraries."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--estim8", metavar="PYTHON")
    parser.add_argument("--modestpy", metavar="PYTHON")
    parser.add_argument("--seconds", type=float, default=150.0)
    args = parser.parse_args()
    print(row("program", *(f"to {error:g}" for error in ERRORS), "in the end", "processor time"))
    print(row(*["---"] * (len(ERRORS) + 3)))
    with tempfile.TemporaryDirectory() as folder:
        native = build_fmu.build("CoupledOscillator", Path(folder) / "native", native=())
        python = build_fmu.build("CoupledOscillator", Path(folder) / "python")
        for name, path, starts in (
            ("fmu-fit, native FMU, first of its process", native, 1),
            ("fmu-fit, native FMU", native, 1),
            ("fmu-fit, native FMU, box searched", native, 3),
            ("fmu-fit, Python FMU", python, 1),
        ):
            error, spent = solved(path, starts)
            cells = (f"{spent:.2f} s" if error <= e else "not reached" for e in ERRORS)
            print(row(name, *cells, f"{error:.1e}", f"{spent:.2f} s"), flush=True)
        told = task(Path(folder), native, args.seconds)
        for name, interpreter in (("estim8", args.estim8), ("modestpy", args.modestpy)):
            if interpreter:
                found = by_another(name, interpreter, told)
                said = f"{name} {found['version']}, {found['evaluations']} runs, {found['ended']}"
                cells = (reached(found["steps"], error) for error in ERRORS)
                end = f"{found['steps'][-1][2]:.1e}"
                print(row(said, *cells, end, f"{found['processor_s']:.1f} s"), flush=True)


if __name__ == "__main__":
    main()
