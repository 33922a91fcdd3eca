"""What the faults are put into: a small campaign of the project's own model, fitted at once.

One mode is driven and observed (theta = 0), so that data can be told in closed form, and the FMU
starts on its periodic orbit: a run takes microseconds.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import build_fmu
from fitting.text.toml import toml_text

CAMPAIGN, EXPERIMENTS, SWEEP, ONE, TWO = (
    "campaign.toml",
    "experiments.csv",
    "sweep.csv",
    "one.csv",
    "two.csv",
)
FMU = "model.fmu"
ETA_HZ, D_HZ = 322.0, 30.0

#: The campaign as tables; every table that a campaign can have is there.
TABLES: Mapping[str, Any] = {
    "title": "One mode of two",
    "synthetic": True,
    "fmu": {
        "file": FMU,
        "timeout_s": 20.0,
        "start": {"theta": 0.0, "d2": "30 Hz", "A2": 0.0, "periodic_start": True},
    },
    "observe": {"output": "q1_hybrid", "steady_start": True},
    "drive": {"kind": "tones", "frequencies": ["u1"], "amplitudes": ["A1"], "level": 1.0},
    "experiments": {
        "file": EXPERIMENTS,
        "spectra": "{experiment}.csv",
        "layout": "csv",
        "amplitude": "V peak",
        "noise_floor": "robust",
        "columns": {"frequency": "frequency", "amplitude": "amplitude"},
    },
    "drift": {"eta_minus": {"before": "500 Hz", "after": "501 Hz"}},
    "noise": {"relative": "1 %", "absolute": "0.1 uV", "outliers": "keep", "threshold": 4.0},
    "sweep": {
        "file": SWEEP,
        "layout": "csv",
        "amplitude": "V peak",
        "set": {"eta_minus": "500 Hz"},
        "use": "scale",
        "scale": "maximum",
        "background": "none",
    },
    "parameters": [
        {"name": "d1", "unit": "Hz", "lower": 1.0, "upper": 100.0, "start": 40.0, "scale": 10.0},
        {"name": "eta_plus", "lower": "310 Hz", "upper": "330 Hz", "start": "320 Hz"},
    ],
    "derived": {"outputs": ["lambda"]},
    "alternatives": {"reflection": [False]},
    "continuation": {
        "nu_start": 0.1,
        "beta": 0.1,
        "iterations": 1,
        "starts": 1,
        "misfit": "squares",
    },
    "accuracy": {"amplitude": 1e-4},
    "design": {"tones": 1, "number": 1, "target": "d1"},
}


def amplitude_v(f: np.ndarray) -> np.ndarray:
    """Of the mode in V at some gain."""
    eta, u = 2 * np.pi * ETA_HZ, 2 * np.pi * f
    return np.asarray(1e3 / np.abs(eta**2 - u**2 + 1j * 2 * np.pi * D_HZ * u))


def csv(f: np.ndarray, a: np.ndarray) -> str:
    """A trace as plain text."""
    rows = (f"{x:.10g},{y:.10g}\n" for x, y in zip(f, a, strict=True))
    return "frequency (Hz),amplitude (V)\n" + "".join(rows)


def spectrum(tone: float) -> str:
    """A line at the tone on a floor that alternates a little."""
    f = tone + np.arange(-12.0, 13.0)
    a = 1e-7 * (1.0 + 0.1 * (-1.0) ** np.arange(f.size))
    a[12] = amplitude_v(np.array([tone]))[0]
    return csv(f, a)


def texts() -> dict[str, str]:
    """Contents of the files by name, but for the FMU's."""
    f = np.linspace(292.0, 352.0, 13)
    return {
        CAMPAIGN: toml_text(TABLES),
        EXPERIMENTS: "experiment,u1 (Hz)\none,310\ntwo,330\n",
        ONE: spectrum(310.0),
        TWO: spectrum(330.0),
        SWEEP: csv(f, amplitude_v(f)),
    }


@dataclass(frozen=True)
class Scene:
    """The files, in a folder that nobody writes into."""

    folder: Path

    def laid_out(self, folder: Path) -> None:
        """The files in another folder."""
        folder.mkdir(parents=True)
        for path in self.folder.iterdir():
            if path.suffix == ".fmu":
                os.link(path, folder / path.name)
            else:
                shutil.copy(path, folder / path.name)


def built(folder: Path, fmu: Path | None = None) -> Scene:
    """The scene in an empty folder.

    Args:
        folder: that is empty.
        fmu: the model, built as a native twin; None: it is built here as a user builds it.
    """
    place = folder / "scene"
    place.mkdir()
    if fmu is None:
        fmu = build_fmu.build("CoupledOscillator", folder / "build")
    shutil.copy(fmu, place / FMU)
    for name, text in texts().items():
        (place / name).write_text(text, "utf-8")
    return Scene(place)
