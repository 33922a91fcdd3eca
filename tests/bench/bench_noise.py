"""Coverage of the intervals of noise spectra: Langevin's equation, Welch's averages, the fit.

    python -m tests.bench.bench_noise [LABORATORIES [AVERAGES ...]]

Truth comes from the exact discretisation in `tests.support.langevin`; temperature, frequency and
width are fitted, the floor too.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import build_fmu
import fitting as ff
from tests.support.langevin import Langevin

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
LABORATORY = Langevin(noise_m=1e-8)
#: Samples of a segment: 16 points in a line width.
LENGTH = 1600
SETUP = ff.Setup(
    ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
    "q1_hybrid",
    steady_start=True,
    start_values={
        "periodic_start": True,
        "theta": 0.0,
        "g2": 0.0,
        "d2": 8.0,
        "eta_minus": 200.0,
        "u2": 150.0,
    },
)
PARAMETERS = (
    ff.Parameter("eta_plus", 101.0, bounds=(90.0, 110.0), unit="Hz"),
    ff.Parameter("d1", 10.0, bounds=(1.0, 60.0), unit="Hz"),
)
TRUTH = {
    "eta_plus": LABORATORY.f_hz,
    "d1": LABORATORY.width_hz,
    "temperature in K": LABORATORY.temperature_k,
}


def one(fmu: ff.Fmu, averages: int, seed: int) -> dict[str, tuple[float, float, float]]:
    """Deviation over its error, and the interval, of frequency, width and temperature."""
    u, y = LABORATORY.spectrum(averages, LENGTH, np.random.default_rng(seed))
    near = (u > 60.0) & (u < 140.0)
    spectrum = ff.NoiseSpectrum(
        u[near],
        y[near],
        averages=averages,
        force="thermal",
        mass_kg=LABORATORY.mass_kg,
        unit="m",
        window="hann",
        setup=SETUP,
    )
    fit = ff.fit(ff.Problem(fmu, PARAMETERS, spectrum), method=QUICK, starts=1)
    found = {
        name: ((fit[name].value - TRUTH[name]) / fit[name].std, *fit[name].interval())
        for name in ("eta_plus", "d1")
    }
    [heat] = fit.result.quadratures.qualities
    found[heat.name] = ((heat.value - TRUTH[heat.name]) / heat.std, *heat.ci95)
    return found


def coverage(fmu: ff.Fmu, averages: int, count: int) -> None:
    """Print how often 95 % intervals hold the truth, and the spread of the deviations."""
    found = [one(fmu, averages, seed) for seed in range(count)]
    for name, true in TRUTH.items():
        held = sum(each[name][1] <= true <= each[name][2] for each in found)
        deviations = np.array([each[name][0] for each in found])
        print(
            f"{averages} averages: {name}: {held} of {count} intervals hold the truth "
            f"({100.0 * held / count:.1f} %); mean {np.mean(deviations):+.2f}, "
            f"rms {np.sqrt(np.mean(deviations**2)):.2f} of the error",
            flush=True,
        )


def main() -> None:
    """From one periodogram to the average of ten thousand."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    averages = [int(x) for x in sys.argv[2:]] or [1, 10, 100, 10_000]
    with tempfile.TemporaryDirectory() as folder:
        path = build_fmu.build("CoupledOscillator", Path(folder))
        with ff.Fmu(path, workers=1) as fmu:
            for each in averages:
                coverage(fmu, each, count)


if __name__ == "__main__":
    main()
