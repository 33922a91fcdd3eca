"""The virtual laboratory: campaigns with known truth, made without any FMU."""

from __future__ import annotations

from fitting.lab.benches import BUILT_IN
from fitting.lab.curves import KINDS as CURVES
from fitting.lab.instruments.lock_in import LockIns
from fitting.lab.instruments.phase_detector import PhaseDetectors
from fitting.lab.pumped import PumpedBench, PumpedSweeps
from fitting.lab.pumped_files import PUMPED
from fitting.lab.synthesis import Synthetic, SyntheticFiles, synthesize, synthesize_curves
from fitting.lab.truth import TRUTH_NAME

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

SERIES = (*BUILT_IN, PUMPED)
