"""What CoupledModes costs: a start with its quadratures, and a step, pumped or not: a table.

    python -m tests.bench.bench_modes [--modes 2 3 5] [--steps 200]

The modes are those that the FMU starts with, near 7 MHz with lines of 100 Hz, the pump at the
distance of the two lowest. A step takes 10 us and is followed by one getReal of the read-out; calls
go through fmpy. Processor time; medians, and for the first step its own column: there propagators
are made. Starts take turns at two phases, so that no response is in store.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import build_fmu
from tests.support.fmus import OK, Instance, unpack

STEP_S = 1e-5
RK4 = 2


def milliseconds(call: Callable[[], Any]) -> float:
    begun = process_time()
    call()
    return 1e3 * (process_time() - begun)


def row(fmu: Instance, values: dict[str, Any], steps: int) -> tuple[float, float, float]:
    """Return milliseconds of a start with quadratures, of the first step, of a later one."""

    def start(k: int) -> None:
        fmu.slave.reset()
        fmu.start(**values, phase1=0.1 * (k % 2))
        fmu.get("readout_X_u1", "readout_Y_u1")

    def step(k: int) -> None:
        if fmu.step(k * STEP_S, STEP_S) != OK:
            raise SystemExit(fmu.status_message())
        fmu.get("readout")

    starts = [milliseconds(partial(start, k)) for k in range(9)]
    times = [milliseconds(partial(step, k)) for k in range(steps)]
    return statistics.median(starts), times[0], statistics.median(times[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--modes", type=int, nargs="+", default=[2, 3, 5])
    parser.add_argument("--steps", type=int, default=200)
    options = parser.parse_args()
    print("| modes | pump | start | sidebands | start, ms | first step, ms | step, ms |")
    print("|---|---|---|---|---|---|---|")
    for n in options.modes:
        with tempfile.TemporaryDirectory() as folder:
            path = build_fmu.build(f"CoupledModes{n}", Path(folder))
            with Instance(unpack(path, Path(folder) / "unpacked")) as fmu:
                pump = {"depth_f1": 2.3e-4}  # opens both lines by some four widths
                to_millionth = pump | {"tolerance": 1e-6}
                for name, more in (("off", {}), ("on", pump), ("to 1e-6", to_millionth)):
                    for start, settings, steps in (
                        ("rest", {}, options.steps),
                        ("orbit", {"periodic_start": True}, options.steps),
                        ("rest, rk4", {"solver": RK4}, 4),
                    ):
                        found = row(fmu, more | settings, steps)
                        told = fmu.get("pump_sidebands")[0]
                        cells = " | ".join(f"{x:.2g}" for x in found)
                        print(f"| {n} | {name} | {start} | {told:g} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
