"""The line that a pump splits: harmonic balance beside rk4, which knows nothing of sidebands."""

from __future__ import annotations

import math

import numpy as np

from tests.support.fmus import OK, Instance
from tests.support.modes_fmus import Models

RK4 = 2
#: Two modes, 300 Hz apart, the first split by some four of its widths; all lines in steps of 10 Hz.
MODES = {"f1": 1000.0, "f2": 1300.0, "lambda12": 50.0, "d1": 20.0, "d2": 25.0}
PUMP = {"pump_hz": 300.0, "pump_phase": 0.4, "depth_lambda12": 73.0, "A2": 0.0, "u2": 1e3}
WINDOW_S, SETTLE_S, SAMPLES = 0.1, 0.25, 300


def integrated(fmu: Instance, u: float) -> complex:
    """The line of the read-out at u, from rest by rk4, a transform of the window at the end."""
    fmu.slave.reset()
    fmu.start(**MODES, **PUMP, u1=u, solver=RK4)
    assert fmu.step(0.0, SETTLE_S) == OK
    seen = []
    for k in range(SAMPLES):
        seen.append(fmu.get("readout")[0])
        assert fmu.step(SETTLE_S + k * WINDOW_S / SAMPLES, WINDOW_S / SAMPLES) == OK
    turned = complex(np.fft.fft(seen)[round(u * WINDOW_S)] * 2.0 / SAMPLES)
    return turned * complex(np.exp(-2j * math.pi * u * SETTLE_S))


def balanced(fmu: Instance, u: float) -> complex:
    fmu.slave.reset()
    fmu.start(**MODES, **PUMP, u1=u)
    return complex(*fmu.get("readout_X_u1", "readout_Y_u1"))


def test_the_split_line_is_that_of_rk4(models: Models) -> None:
    """What is left, 3e-4, is that of 40 substeps a period: (2 pi/40)^4/120 of f, in widths."""
    fmu = models(2)
    u_hz = np.array([960.0, 1030.0])
    wanted = np.array([integrated(fmu, u) for u in u_hz])
    found = np.array([balanced(fmu, u) for u in u_hz])
    assert np.abs(found - wanted).max() <= 5e-4 * np.abs(wanted).max()
    fine_hz = np.arange(930.0, 1070.0, 2.0)
    sizes = np.array([abs(balanced(fmu, u)) for u in fine_hz])
    tops = fine_hz[1:-1][(sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] > sizes[2:])]
    apart = MODES["lambda12"] ** 2 * PUMP["depth_lambda12"] / (2.0 * math.sqrt(1e3 * 1.3e3))
    assert tops.size == 2
    assert abs(tops[1] - tops[0] - apart) <= 6.0
