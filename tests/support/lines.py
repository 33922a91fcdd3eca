"""Responses of one damped mode in closed form, and files as a lock-in amplifier writes them.

S(f) = a g(f) + b,   g = w eta/(eta^2 - f^2 + i w f)         Re[S exp(i 2 pi f t)] is seen
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray


def mode(f: FloatArray, eta: float, width: float) -> ComplexArray:
    """g: of modulus one at eta, |g|^2 of full width w there."""
    return np.asarray(width * eta / (eta**2 - f**2 + 1j * width * f))


def noise(count: int, sigma: float, seed: int) -> ComplexArray:
    """Independent Gaussian quadratures of standard deviation sigma."""
    draw = np.random.default_rng(seed)
    return np.asarray(sigma * (draw.standard_normal(count) + 1j * draw.standard_normal(count)))


def write_csv(path: Path, head: str, *columns: FloatArray) -> Path:
    """A table with a header line."""
    rows = zip(*(c.tolist() for c in columns), strict=True)
    lines = [head, *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path
