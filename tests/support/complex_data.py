"""Complex responses of one damped mode by the closed form, and files of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray


def mode(u_hz: FloatArray, eta_hz: float, width_hz: float) -> ComplexArray:
    """X(u) of q'' + 2 pi w q' + (2 pi eta)^2 q = cos 2 pi u t, the phasor of exp(i 2 pi u t).

    Args:
        u_hz: frequencies (n,), Hz.
        eta_hz: eigenfrequency, Hz.
        width_hz: full width, Hz.
    """
    gap = (eta_hz - u_hz) * (eta_hz + u_hz)
    return np.asarray(1.0 / ((2 * np.pi) ** 2 * (gap + 1j * u_hz * width_hz)))


def notch(u_hz: FloatArray, eta_hz: float, loaded_q: float, coupling: complex) -> ComplexArray:
    """1 - (Q/Qc) H(u)/H(eta), complex Qc = `coupling`, of a mode of quality Q beside a feed line.

    Args:
        u_hz: frequencies (n,), Hz.
        eta_hz: eigenfrequency, Hz.
        loaded_q: quality of the loaded resonance.
        coupling: complex coupling quality |Qc| exp(-i phi).
    """
    h, top = (mode(np.atleast_1d(f), eta_hz, eta_hz / loaded_q) for f in (u_hz, eta_hz))
    return np.asarray(1.0 - loaded_q / coupling * h / top)


def with_noise(values: ComplexArray, sigma: float, seed: int) -> ComplexArray:
    """Values with Gaussian noise on each quadrature.

    Args:
        values: exact, (n,).
        sigma: standard deviation of each quadrature.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    return np.asarray(values + sigma * (rng.standard_normal((2, values.size)).T @ [1.0, 1.0j]))


def write_xy(path: Path, u_hz: FloatArray, values: ComplexArray) -> Path:
    """A file of X and Y in V.

    Args:
        path: of the file.
        u_hz: frequencies (n,), Hz.
        values: X + i Y, V.
    """
    rows = [
        f"{u!r},{v.real!r},{v.imag!r}" for u, v in zip(u_hz.tolist(), values.tolist(), strict=True)
    ]
    path.write_text("\n".join(["frequency (Hz),X (V),Y (V)", *rows]))
    return path
