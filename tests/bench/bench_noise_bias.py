"""Whether the fitted width of a noise spectrum lies low: the expectation, and draws about it.

    python -m tests.bench.bench_noise_bias [DRAWS [AVERAGES ...]]

The expected periodogram under a Hann window follows from the exact autocovariance of Langevin's
equation as it was sampled, aliases and all. Fitted as it is it tells what the model leaves out;
draws about it (Gamma, and by Welch's method from traces) tell what the likelihood itself does. The
response is the closed form: no FMU is run, so that thousands of draws cost seconds.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.constants import Boltzmann
from scipy.linalg import expm
from scipy.optimize import least_squares

from fitting.measurements.noise import NoiseSpectrum, best_levels
from fitting.text.arrays import FloatArray
from tests.bench.bench_noise import LABORATORY, LENGTH

TRUTH = np.array([LABORATORY.f_hz, LABORATORY.width_hz])
U = np.arange(LENGTH // 2 + 1) * LABORATORY.rate_hz / LENGTH
NEAR = (U > 60.0) & (U < 140.0)


def expected() -> FloatArray:
    """Expectation of a one-sided periodogram under a Hann window, (LENGTH/2 + 1,), m^2/Hz."""
    w0, damping = 2.0 * np.pi * TRUTH
    turn = expm(np.array([[0.0, 1.0], [-(w0**2), -damping]]) / LABORATORY.rate_hz)
    heat = Boltzmann * LABORATORY.temperature_k / LABORATORY.mass_kg / w0**2
    state, covariance = np.eye(2), []
    for _ in range(LENGTH):
        covariance.append(heat * state[0, 0])
        state = state @ turn
    covariance[0] += LABORATORY.noise_m**2
    taper = np.hanning(LENGTH + 1)[:-1]
    overlap = np.correlate(taper, taper, "full")[LENGTH - 1 :]
    product = np.array(covariance) * overlap
    twice = 2.0 * np.fft.rfft(product, 2 * LENGTH)[::2].real - product[0]
    return np.asarray(2.0 * twice / LABORATORY.rate_hz / np.sum(taper**2))


def deviations(density: FloatArray, averages: float) -> FloatArray:
    """Frequency and width, less the truth, over their errors."""
    record = NoiseSpectrum(U[NEAR], density[NEAR], averages=averages, window="hann")

    def rows(p: FloatArray) -> FloatArray:
        apart = (2.0 * np.pi) ** 2 * (p[0] ** 2 - record.u_hz**2 + 1j * record.u_hz * p[1])
        shape = record.widened(1e12 * p[1] / np.abs(apart) ** 2)
        level, floor = best_levels(shape, record.y, None)
        return record.residuals(level * shape + floor)

    found = least_squares(rows, TRUTH + 0.5, xtol=1e-12, ftol=1e-12)
    errors = record.sigma * np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return np.asarray((found.x - TRUTH) / errors)


def told(name: str, found: FloatArray) -> None:
    """Print the mean deviations of frequency and width."""
    mean, rms = np.mean(found, axis=0), np.sqrt(np.mean(found**2, axis=0))
    print(
        f"{name}: width {mean[1]:+.2f} +- {1.0 / np.sqrt(len(found)):.2f} of its error (rms "
        f"{rms[1]:.2f}), frequency {mean[0]:+.2f} (rms {rms[0]:.2f})",
        flush=True,
    )


def main() -> None:
    """The expectation, then draws."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    exact = expected()
    off = deviations(exact, 10.0)
    print(f"expected spectrum, 10 averages: width {off[1]:+.1e} of its error, f {off[0]:+.1e}")
    for averages in [int(x) for x in sys.argv[2:]] or [1, 10, 100]:
        rng = np.random.default_rng(averages)
        gamma = [
            deviations(exact * rng.gamma(averages, 1.0 / averages, exact.size), averages)
            for _ in range(count)
        ]
        told(f"{averages} averages, Gamma draws", np.array(gamma))
        welch = [
            deviations(LABORATORY.spectrum(averages, LENGTH, rng)[1], averages)
            for _ in range(count)
        ]
        told(f"{averages} averages, traces by Welch", np.array(welch))


if __name__ == "__main__":
    main()
