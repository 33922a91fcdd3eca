"""A small campaign of the driven oscillator in C: two experiments with spectra, and a sweep.

Its files are made to be broken, one place at a time. Nothing rests on the values that are fitted,
so little accuracy is asked for: a fit takes a tenth of the runs.
"""

from __future__ import annotations

import numpy as np

MASS, DAMPING, STIFFNESS = 1e-3, 0.2, 4.1e3

CAMPAIGN = """\
title = "Driven oscillator"
[fmu]
file = "oscillator.fmu"
timeout_s = 60
[fmu.start]
mass = "1 g"
[observe]
output = "displacement"
line_width = "3 kHz"
[drive]
kind = "input"
frequencies = ["f"]
input = "force"
level = 1.0
samples_per_period = 8
[accuracy]
amplitude = 1e-2
[experiments]
file = "experiments.csv"
spectra = "{experiment}.csv"
amplitude = "V peak"
[sweep]
file = "sweep.csv"
amplitude = "V peak"
[[parameters]]
name = "damping"
unit = "N.s/m"
lower = 0.05
upper = 0.6
start = 0.25
[[parameters]]
name = "stiffness"
unit = "N/m"
lower = 3500.0
upper = 4500.0
start = 4000.0
[continuation]
iterations = 1
starts = 1
"""


def line(f: np.ndarray) -> np.ndarray:
    """Amplitude in mV at a gain of 100 V/m."""
    w = 2 * np.pi * f
    return np.asarray(1e5 / np.abs(STIFFNESS - MASS * w**2 + 1j * DAMPING * w))


def csv(f: np.ndarray, a: np.ndarray) -> str:
    rows = (f"{x:.10g},{y:.10g}\n" for x, y in zip(f, a, strict=True))
    return "frequency (Hz),amplitude (mV)\n" + "".join(rows)


def spectrum(tone: float) -> str:
    """A line at the tone on a floor of 0.01 mV that alternates a little."""
    f = tone + np.arange(-25.0, 26.0)
    a = 0.01 + 0.001 * (-1.0) ** np.arange(f.size)
    a[25] = line(np.array([tone]))[0]
    return csv(f, a)


def _files() -> dict[str, str]:
    f = np.linspace(292.0, 352.0, 13)
    return {
        "campaign.toml": CAMPAIGN,
        "experiments.csv": "experiment,f (Hz)\none,310\ntwo,330\n",
        "one.csv": spectrum(310.0),
        "two.csv": spectrum(330.0),
        "sweep.csv": csv(f, line(f)),
    }


#: Contents of the files by name, but for the FMU's, which is ``oscillator.fmu``.
FILES = _files()
