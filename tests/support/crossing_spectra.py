"""Two modes that avoid each other over a voltage, in physical coordinates: closed form and laws.

    (C - (2 pi u)^2 + i 2 pi u D) q = (1, 0)        C = (2 pi)^2 [[f1^2, -l^2], [-l^2, f2^2]]

CoupledOscillator has the hybrid coordinates: laws turn f1(V), f2, l into its variables, so that the
program is held against equations that it does not have.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

#: Truth: f1 = A0 + A1 V, f2 = B0, coupling LAMBDA, both full widths D, all Hz; V in volts.
A0, A1, B0, LAMBDA, WIDTH = 1001.0, 4.0, 1000.0, 100.0, 3.0
VOLTS = np.linspace(-3.0, 3.0, 5)
SWEPT_HZ = np.linspace(982.0, 1018.0, 41)

#: f1^2 and the difference of the squares of the hybrid eigenfrequencies, as formulas.
_F1, _APART = "(a0 + a1*V)**2", "sqrt(((a0 + a1*V)**2 - b0**2)**2 + 4*k**4)"
_COSINE = f"(b0**2 - {_F1})/{_APART}"
LAWS = {
    "eta_plus": f"sqrt(({_F1} + b0**2 - {_APART})/2)",
    "eta_minus": f"sqrt(({_F1} + b0**2 + {_APART})/2)",
    "theta": f"pi - acos({_COSINE})/2",
    "g1": f"-sqrt((1 + {_COSINE})/2)",
    "g2": f"sqrt((1 - {_COSINE})/2)",
    "d2": "d1",
}


def response(u_hz: FloatArray, volt: float) -> FloatArray:
    """|q1| at frequencies (n,), Hz."""
    return np.abs(phasor(u_hz, volt))


def phasor(u_hz: FloatArray, volt: float) -> ComplexArray:
    """q1 at frequencies (n,), Hz, the phasor of exp(i 2 pi u t)."""
    f1 = A0 + A1 * volt
    stiff = (2 * np.pi) ** 2 * np.array([[f1**2, -(LAMBDA**2)], [-(LAMBDA**2), B0**2]])
    w = 2 * np.pi * u_hz[:, None, None]
    system = stiff - w**2 * np.eye(2) + 1j * w * 2 * np.pi * WIDTH * np.eye(2)
    force = np.broadcast_to(np.array([[1.0], [0.0]]), (u_hz.size, 2, 1))
    return np.asarray(np.linalg.solve(system, force)[:, 0, 0])


def measured(seed: int, noise: float) -> FloatArray:
    """Amplitudes (voltages, frequencies) with noise, a share of the largest of each spectrum."""
    exact = np.array([response(SWEPT_HZ, v) for v in VOLTS])
    scatter = np.random.default_rng(seed).standard_normal(exact.shape)
    return np.asarray(np.abs(exact + noise * np.max(exact, axis=1, keepdims=True) * scatter))


CAMPAIGN = """
title = "An avoided crossing"
synthetic = true

[fmu]
file = "{fmu}"
start = {{ periodic_start = true, A2 = 0.0 }}

[observe]
output = "q1"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1"]
amplitudes = ["A1"]

[control_sweep]
file = "map.csv"
controls = ["V"]
amplitude = "V rms"
sigma = "{sigma!r} V"

[laws]
{laws}

[[parameters]]
name = "a0"
lower = "990 Hz"
upper = "1010 Hz"
start = "999 Hz"

[[parameters]]
name = "a1"
unit = "Hz/mV"
lower = 0.001
upper = 0.01
start = 0.003

[[parameters]]
name = "b0"
lower = "0.99 kHz"
upper = "1.01 kHz"
start = "1.002 kHz"

[[parameters]]
name = "k"
lower = "10 Hz"
upper = "300 Hz"
start = "80 Hz"

[[parameters]]
name = "d1"
lower = "0.1 Hz"
upper = "30 Hz"
start = "5 Hz"

[derived]
outputs = ["lambda", "f1"]

[continuation]
starts = 1
misfit = "squares"
iterations = 3
"""


def written(folder: Path, fmu: Path, amplitude: FloatArray, campaign: str = CAMPAIGN) -> Path:
    """A map as one long table, voltages in mV, frequencies in kHz, amplitudes rms; the campaign."""
    gain = 1e6  # of the detector, V for each m
    lines = ["V (mV),frequency (kHz),amplitude (mV)"]
    for volt, row in zip(VOLTS, amplitude, strict=True):
        for f, a in zip(SWEPT_HZ, row, strict=True):
            lines.append(f"{1e3 * volt!r},{1e-3 * f!r},{1e3 * gain * a / np.sqrt(2.0)!r}")
    text = "\n".join(lines).replace("np.float64(", "").replace(")", "").replace("(mV", "(mV)")
    (folder / "map.csv").write_text(text.replace("(kHz", "(kHz)"))
    path = folder / "campaign.toml"
    laws = "\n".join(f'{name} = "{formula}"' for name, formula in LAWS.items())
    sigma = 0.01 * gain * float(np.max(amplitude))
    path.write_text(campaign.format(fmu=fmu.as_posix(), laws=laws, sigma=sigma))
    return path
