"""The virtual laboratory: campaigns with known truth, made without any FMU."""

from __future__ import annotations

from fitting.api.choices import CURVES, PUMPED, SERIES, TRUTH_NAME
from fitting.lab.instruments.lock_in import LockIns
from fitting.lab.instruments.phase_detector import PhaseDetectors
from fitting.lab.pumped import PumpedBench, PumpedSweeps
from fitting.lab.synthesis import Synthetic, SyntheticFiles, synthesize, synthesize_curves

__all__ = [
    "CURVES",
    "PUMPED",
    "SERIES",
    "TRUTH_NAME",
    "LockIns",
    "PhaseDetectors",
    "PumpedBench",
    "PumpedSweeps",
    "Synthetic",
    "SyntheticFiles",
    "synthesize",
    "synthesize_curves",
]
