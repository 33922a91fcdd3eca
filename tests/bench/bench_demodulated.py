"""Coverage of the intervals of demodulated ringdowns, noise from seeds.

    python -m tests.bench.bench_demodulated [LABORATORIES [SCENE ...]] [--profiles]

One mode, and two that beat, of qualities 1e3 and 1e8, over 1, 3 and 10 decay times: X and Y with
2 % noise in each and an offset, or the amplitudes of one mode with the noise below them. Start and
gain are unknown; truth comes from eigenvalues of the equations of motion; the noise is told by the
residuals alone. SCENE is part of a scene's name. Intervals are those of the linearised errors, with
`--profiles` those of the profile likelihood, which a report gives.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import build_fmu
import fitting as ff
from tests.support.demodulated import demodulated
from tests.support.linear_traces import string

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
SAMPLES, NOISE, F_HZ = 400, 0.02, 1e6
PROFILES = "--profiles"


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A ringdown of ``modes`` modes of one ``quality`` over ``decays`` decay times."""

    quality: float
    decays: float
    modes: int
    amplitudes: bool = False

    @property
    def name(self) -> str:
        """What the answer is called."""
        seen = "amplitudes" if self.amplitudes else "X and Y"
        return f"{seen}, {self.modes} modes, Q = {self.quality:.0e}, {self.decays:g} decay times"

    def made(self, fmu: ff.Fmu, rng: np.random.Generator) -> tuple[ff.Problem, dict[str, float]]:
        """One laboratory, and what it was made of."""
        width = F_HZ / self.quality
        t = np.linspace(0.0, self.decays / (np.pi * width), SAMPLES)
        theta = 1.2 if self.modes == 2 else 0.0
        known = {
            "eta_plus": F_HZ,
            "d1": width,
            "eta_minus": F_HZ + 3.0 * width,
            "d2": 1.3 * width,
        }
        seen = (np.cos(theta), np.sin(theta))
        equations = string(theta, width, 1.3 * width, (F_HZ, known["eta_minus"]), seen)
        start = (*rng.standard_normal(2), *(2.0 * np.pi * F_HZ * rng.standard_normal(2)))
        f = F_HZ + 0.7 * width
        z = 1e-3 * demodulated(equations, start, f, t)
        sigma = NOISE * float(np.max(np.abs(z)))
        z = z + sigma * (rng.standard_normal(SAMPLES) + 1j * rng.standard_normal(SAMPLES))
        names = list(known) if self.modes == 2 else ["d1"] if self.amplitudes else list(known)[:2]
        still = {"A1": 0.0, "A2": 0.0, "theta": theta}
        still |= {name: value for name, value in known.items() if name not in names}
        trace = ff.DemodulatedTrace(
            t,
            np.abs(z) if self.amplitudes else z + 2.0 * sigma,
            setup=ff.Setup(ff.Drive(), "q1", start_values=still),
            frequency_hz=f,
            input="b",
            modes=self.modes,
            offset=not self.amplitudes,
        )
        parameters = [
            ff.Parameter(name, x + 0.1 * width, bounds=(x - width, x + width), unit="Hz")
            if name.startswith("eta")
            else ff.Parameter(name, 1.2 * x, bounds=(0.1 * x, 6.0 * x), unit="Hz")
            for name, x in known.items()
            if name in names
        ]
        return ff.Problem(fmu, parameters, trace), {name: known[name] for name in names}


def coverage(fmu: ff.Fmu, scene: Scene, count: int, *, profiles: bool) -> None:
    """Print how often 95 % intervals hold the truth, and the spread of the deviations."""
    inside: dict[str, list[bool]] = {}
    deviations: dict[str, list[float]] = {}
    begun = time.process_time()
    for seed in range(count):
        problem, truth = scene.made(fmu, np.random.default_rng(seed))
        fit = ff.fit(problem, method=QUICK, starts=1)
        found = ff.profile(fit) if profiles else fit
        for name, true in truth.items():
            low, high = found[name].interval()
            inside.setdefault(name, []).append(low <= true <= high)
            deviations.setdefault(name, []).append((found[name].value - true) / found[name].std)
    for name, held in inside.items():
        spread = float(np.sqrt(np.nanmean(np.square(deviations[name]))))  # not all have an error
        print(
            f"{scene.name}: {name}: {sum(held)} of {count} intervals hold the truth; mean of "
            f"deviation over error {np.nanmean(deviations[name]):+.2f}, rms {spread:.2f}",
            flush=True,
        )
    print(f"{scene.name}: {(time.process_time() - begun) / count:.2f} s of processor time each")


def main() -> None:
    """All scenes, or those that are named."""
    words = [word for word in sys.argv[1:] if word != PROFILES]
    count = int(words[0]) if words else 100
    kinds = ((1, False), (2, False), (1, True))
    scenes = [
        Scene(quality=quality, decays=decays, modes=modes, amplitudes=amplitudes)
        for quality, decays, (modes, amplitudes) in itertools.product(
            (1e3, 1e8), (1.0, 3.0, 10.0), kinds
        )
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = build_fmu.build("CoupledOscillator", Path(folder), native=())
        with ff.Fmu(path, workers=1) as fmu:
            for scene in scenes:
                if all(word in scene.name for word in words[1:]):
                    coverage(fmu, scene, count, profiles=PROFILES in sys.argv)


if __name__ == "__main__":
    main()
