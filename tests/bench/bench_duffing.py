"""Solvers of ``DuffingOscillator``: processor time of a two-tone run, error of its lines.

    python tests/bench/bench_duffing.py

The truth is the laboratory's harmonic balance, whose own error is below 1e-5 of the smallest line
shown. Errors are relative to each of the lines u1, u2, 2 u1 - u2, 2 u2 - u1; the largest is shown.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import build_fmu
from fitting.lab.benches import DUFFING_STRING, duffing_bench
from fitting.lab.duffing import CubicModes, steady_lines
from fitting.lab.instruments import READ
from fitting.lab.string import Drive, TwoModes
from fitting.signal.combinations import mixed_hz
from fitting.signal.window import Window, plan_window
from tests.support.fmus import Instance, unpack

ENVELOPE, RK4 = 1, 2


class Scene(NamedTuple):
    """Two modes with their cubic terms, a drive."""

    name: str
    sample: CubicModes
    drive: Drive

    def values(self) -> dict[str, Any]:
        """Parameters of the FMU."""
        m = self.sample.modes
        return {
            "theta": m.theta_rad,
            "d1": m.d1_hz,
            "d2": m.d2_hz,
            "eta_plus": m.eta_plus_hz,
            "eta_minus": m.eta_minus_hz,
            "u1": self.drive.tones_hz[0],
            "u2": self.drive.tones_hz[1],
            "A1": self.drive.amplitudes[0],
            "A2": self.drive.amplitudes[0],
            "periodic_start": True,
            "alpha1": self.sample.alpha1,
            "alpha2": self.sample.alpha2,
            "kappa": self.sample.kappa,
        }


class Row(NamedTuple):
    """One way to simulate a scene."""

    solver: int
    setting: str
    settings: dict[str, float]
    settle_s: float


def scenes() -> Iterator[Scene]:
    """A kilohertz oscillator of Q = 200, and the string of the shipped campaign."""
    eta, width = 1000.0, 5.0
    force = (2 * math.pi) ** 2 * eta * width
    alpha = width / eta * (2 * math.pi * eta) ** 2 * 8.0 / 3.0
    yield Scene(
        "1 kHz, Q 200",
        CubicModes(
            TwoModes(
                theta_rad=0.0, d1_hz=width, d2_hz=width, eta_plus_hz=eta, eta_minus_hz=1.0126 * eta
            ),
            alpha,
        ),
        Drive.equal((eta - 1.0, eta + 2.0), 0.3 * force),
    )
    lab = duffing_bench()
    alone = TwoModes(
        theta_rad=0.0,
        d1_hz=lab.modes.widths_hz()[0],
        d2_hz=100.0,
        eta_plus_hz=6940260.0,
        eta_minus_hz=7027600.0,
    )
    yield Scene(
        "string, 6.94 MHz, Q 73,700",
        CubicModes(alone, DUFFING_STRING.alpha1),
        Drive.equal(lab.pairs_hz[1], lab.levels[1]),
    )


def rows(scene: Scene) -> Iterator[Row]:
    """Ways to simulate; rk4 starts where the envelope stands and settles from there."""
    for exponent in (-2, -3, -4, -6, -8):
        yield Row(ENVELOPE, f"tolerance 1e{exponent}", {"tolerance": 10.0**exponent}, 0.0)
    if scene.sample.modes.eta_plus_hz < 1e6:
        for count in (10, 20, 40, 80):
            step = 1.0 / (count * scene.sample.modes.eta_plus_hz)
            settle = round(2.0 / scene.sample.modes.d1_hz, 6)
            yield Row(RK4, f"{count} substeps a period", {"rk4_substep": step}, settle)


def measure(fmu: Instance, scene: Scene, row: Row, window: Window) -> tuple[float, np.ndarray]:
    """Processor seconds of a run, amplitudes of its lines."""
    fmu.slave.reset()
    begun = time.process_time()
    fmu.start(solver=row.solver, **scene.values(), **row.settings)
    times = row.settle_s + window.step_s * np.arange(window.samples)
    first = [] if row.settle_s else fmu.get("q1_hybrid")
    samples = [*first, *(q for (q,) in fmu.run(list(times[len(first) :]), "q1_hybrid"))]
    return time.process_time() - begun, window.read(np.array(samples)).amplitudes


def main() -> None:
    """Print the table."""
    folder = Path(tempfile.mkdtemp())
    unpacked = unpack(build_fmu.build("DuffingOscillator", folder), folder / "unpacked")
    print("| scene | solver | setting | processor time of a run | largest error of a line |")
    print("|---|---|---|---|---|")
    with Instance(unpacked) as fmu:
        for scene in scenes():
            lines = steady_lines(scene.sample, scene.drive)
            truth = np.array([abs(lines[k][0]) for k in READ])
            u1, u2 = scene.drive.tones_hz
            read = (u1, u2, 2 * u1 - u2, 2 * u2 - u1)
            window = plan_window(read, 0.0, mixtures_hz=mixed_hz((u1, u2), 15))
            for row in rows(scene):
                seconds, found = measure(fmu, scene, row, window)
                error = float(np.max(np.abs(found / truth - 1.0)))
                kind = {ENVELOPE: "envelope", RK4: "rk4"}[row.solver]
                print(
                    f"| {scene.name} | {kind} | {row.setting} | {1e3 * seconds:.3g} ms | "
                    f"{error:.1e} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
