"""The string at theta = 0, where d1 is the first mode's alone and the second one is far away."""

from __future__ import annotations

import fitting as ff
from fitting.text.arrays import Scalar

START: dict[str, Scalar] = {
    "periodic_start": True,
    "theta": 0.0,
    "d2": 10.0,
    "eta_minus": 2000.0,
    "u2": 1500.0,
}
DRIVE = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
SETUP = ff.Setup(DRIVE, "q1_hybrid", start_values=START, steady_start=True)
