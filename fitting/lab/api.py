"""The virtual laboratory: campaigns with known truth, made without any FMU."""

from __future__ import annotations

from fitting.lab.curves import Curve, kind_of
from fitting.lab.instruments.lock_in import LockIns
from fitting.lab.instruments.phase_detector import PhaseDetectors
from fitting.lab.names import CURVES, PUMPED, SERIES, SUBHARMONIC, TRUTH_NAME
from fitting.lab.pumped import PumpedBench, PumpedSweeps
from fitting.lab.subharmonic import SubharmonicBench
from fitting.lab.synthesis import Synthetic, SyntheticFiles, synthesize, synthesize_curves

__all__ = [
    "CURVES",
    "PUMPED",
    "SERIES",
    "SUBHARMONIC",
    "TRUTH_NAME",
    "Curve",
    "LockIns",
    "PhaseDetectors",
    "PumpedBench",
    "PumpedSweeps",
    "SubharmonicBench",
    "Synthetic",
    "SyntheticFiles",
    "kind_of",
    "synthesize",
    "synthesize_curves",
]
