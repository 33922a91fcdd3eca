"""Fit the parameters of an FMU to driven measurements.

Knows FMI and a campaign file; everything about the model comes from its modelDescription.xml.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING

__version__ = "0.2.0"

if TYPE_CHECKING:
    from fitting.api import plot
    from fitting.api.calibration import calibrate
    from fitting.api.cost import Cost, cost
    from fitting.api.examples import example
    from fitting.api.fitted import Fit, Inference, Tikhonov, Value, fit, profile
    from fitting.api.fmu import Accuracy, Fmu, simulate, sweep
    from fitting.api.jobs import identify, report
    from fitting.api.line import Columns, Line, line, write_line
    from fitting.api.noise_line import NoiseLine, noise_line
    from fitting.api.problem import Problem
    from fitting.api.ringdown import Ringdown, ringdown
    from fitting.campaign.arrays import Parameter, Sweep, Tones
    from fitting.campaign.laws import Laws
    from fitting.campaign.noise import Noise
    from fitting.campaign.setup import Drive, Setup
    from fitting.check.api import check
    from fitting.design.api import Goal, Limits, WaysToMeasure, design, limits, ways
    from fitting.draft.api import init
    from fitting.ensembles.api import (
        Ensemble,
        EnsembleOptions,
        Laboratories,
        ensemble,
        write_ensemble,
    )
    from fitting.fmu.isolation import Isolation
    from fitting.lab.api import synthesize, synthesize_curves
    from fitting.lab.tradeoff.api import StudyOptions, tradeoff, write_tradeoff
    from fitting.measurements.complex.curve import ComplexCurve
    from fitting.measurements.complex.sweep import ComplexSweep
    from fitting.measurements.complex.wiring import Wiring
    from fitting.measurements.control.spectrum import ControlSpectrum
    from fitting.measurements.control.sweep import ControlSweep
    from fitting.measurements.demodulated.traces import DemodulatedTrace
    from fitting.measurements.kinds import read_campaign
    from fitting.measurements.noise.spectra import NoiseSpectrum
    from fitting.measurements.traces.traces import Trace
    from fitting.measurements.traces.waveform import Chirp, Pulse
    from fitting.posterior.api import (
        Posterior,
        PosteriorCost,
        Sampling,
        posterior,
        posterior_cost,
        write_posterior,
    )
    from fitting.text.errors import BadInput, FmuFailure

#: Where each public name is; it is loaded when it is first used, so that importing this costs
#: nothing and a worker process or ``--help`` loads no more than it needs.
_HOMES = {
    "api.calibration": ("calibrate",),
    "check.api": ("check",),
    "api.cost": ("Cost", "cost"),
    "design.api": ("Goal", "Limits", "WaysToMeasure", "design", "limits", "ways"),
    "ensembles.api": (
        "Ensemble",
        "EnsembleOptions",
        "Laboratories",
        "ensemble",
        "write_ensemble",
    ),
    "api.examples": ("example",),
    "api.fitted": ("Fit", "Inference", "Tikhonov", "Value", "fit", "profile"),
    "api.fmu": ("Accuracy", "Fmu", "simulate", "sweep"),
    "draft.api": ("init",),
    "api.jobs": ("identify", "report"),
    "api.line": ("Columns", "Line", "line", "write_line"),
    "posterior.api": (
        "Posterior",
        "PosteriorCost",
        "Sampling",
        "posterior",
        "posterior_cost",
        "write_posterior",
    ),
    "api.problem": ("Problem",),
    "api.noise_line": ("NoiseLine", "noise_line"),
    "api.ringdown": ("Ringdown", "ringdown"),
    "lab.api": ("synthesize", "synthesize_curves"),
    "lab.tradeoff.api": ("StudyOptions", "tradeoff", "write_tradeoff"),
    "campaign.arrays": ("Parameter", "Sweep", "Tones"),
    "campaign.setup": ("Drive", "Setup"),
    "campaign.laws": ("Laws",),
    "fmu.isolation": ("Isolation",),
    "measurements.control.spectrum": ("ControlSpectrum",),
    "measurements.control.sweep": ("ControlSweep",),
    "measurements.demodulated.traces": ("DemodulatedTrace",),
    "measurements.kinds": ("read_campaign",),
    "campaign.noise": ("Noise",),
    "measurements.complex.curve": ("ComplexCurve",),
    "measurements.complex.sweep": ("ComplexSweep",),
    "measurements.noise.spectra": ("NoiseSpectrum",),
    "measurements.traces.traces": ("Trace",),
    "measurements.traces.waveform": ("Chirp", "Pulse"),
    "measurements.complex.wiring": ("Wiring",),
    "text.errors": ("BadInput", "FmuFailure"),
}

__all__ = [
    "Accuracy",
    "BadInput",
    "Chirp",
    "Columns",
    "ComplexCurve",
    "ComplexSweep",
    "ControlSpectrum",
    "ControlSweep",
    "Cost",
    "DemodulatedTrace",
    "Drive",
    "Ensemble",
    "EnsembleOptions",
    "Fit",
    "Fmu",
    "FmuFailure",
    "Goal",
    "Inference",
    "Isolation",
    "Laboratories",
    "Laws",
    "Limits",
    "Line",
    "Noise",
    "NoiseLine",
    "NoiseSpectrum",
    "Parameter",
    "Posterior",
    "PosteriorCost",
    "Problem",
    "Pulse",
    "Ringdown",
    "Sampling",
    "Setup",
    "StudyOptions",
    "Sweep",
    "Tikhonov",
    "Tones",
    "Trace",
    "Value",
    "WaysToMeasure",
    "Wiring",
    "__version__",
    "calibrate",
    "check",
    "cost",
    "design",
    "ensemble",
    "example",
    "fit",
    "identify",
    "init",
    "limits",
    "line",
    "noise_line",
    "plot",
    "posterior",
    "posterior_cost",
    "profile",
    "read_campaign",
    "report",
    "ringdown",
    "simulate",
    "sweep",
    "synthesize",
    "synthesize_curves",
    "tradeoff",
    "ways",
    "write_ensemble",
    "write_line",
    "write_posterior",
    "write_tradeoff",
]


class _FrontDoor(ModuleType):
    """The package, in which `fit`, `report`, `design` and `simulate` are functions.

    They have the names of rooms. Importing a room binds it as an attribute of its package; that is
    not let happen to a public name, so that ``fitting.fit`` does not depend on what was imported
    before. ``from fitting.fit.problem import ...`` does not go by that attribute.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _ROOMS_OF_VERBS and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> object:
        found: object
        if name == "plot":
            found = importlib.import_module("fitting.api.plot")
        else:
            home = next((home for home, names in _HOMES.items() if name in names), None)
            if home is None:
                raise AttributeError(f"module 'fitting' has no attribute '{name}'")
            found = getattr(importlib.import_module(f"fitting.{home}"), name)
        globals()[name] = found
        return found

    def __dir__(self) -> list[str]:
        return sorted({*globals(), *__all__})


_ROOMS_OF_VERBS = ("check", "design", "fit", "posterior", "report", "simulate")
sys.modules[__name__].__class__ = _FrontDoor
