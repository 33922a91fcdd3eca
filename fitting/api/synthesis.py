"""The virtual laboratory: campaigns with known truth, made without any FMU."""

from __future__ import annotations

from fitting.lab.benches import BUILT_IN as SERIES
from fitting.lab.curves import KINDS as CURVES
from fitting.lab.instruments.lock_in import LockIns
from fitting.lab.instruments.phase_detector import PhaseDetectors
from fitting.lab.synthesis import Synthetic, SyntheticFiles, synthesize, synthesize_curves
from fitting.lab.truth import TRUTH_NAME

__all__ = [
    "CURVES",
    "SERIES",
    "TRUTH_NAME",
    "LockIns",
    "PhaseDetectors",
    "Synthetic",
    "SyntheticFiles",
    "synthesize",
    "synthesize_curves",
]
