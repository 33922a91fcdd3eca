"""Where the whole chain holds and where it stops, measured decade by decade.

    python -m tests.bench.bench_extremes            # the table of measurements.md, minutes
    python -m tests.bench.bench_extremes --quick    # without the thousand experiments
    python -m tests.bench.bench_extremes --smoke    # the first two values of every range

Every fit goes through campaign files and the real FMU; the error is that of the line width against
the virtual laboratory's truth. What "holds" in the tests' words is in tests/fit/test_extremes*.py.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import build_fmu
from fitting.fmu.pool import FmuWorkers
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.estimate import Verdict
from tests.support.extreme_scenes import Fitted, Scene, fit

WHOLE = Scene(scale="fit", points=15)
GOOD = 1e-6


@dataclass(frozen=True)
class Outcome:
    """What came of one scene: an error of the width, or a word on why there is none."""

    error: float
    std: float
    word: str
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether the fit is done, says it knows, and is right to its own error and to 1e-6."""
        return self.word == Verdict.DETERMINED and self.error <= 4.0 * self.std + GOOD


class Bench:
    """Fits scenes through one worker; with ``most`` no more than so many of a range."""

    def __init__(self, workers: FmuWorkers, folder: Path, most: int | None = None) -> None:
        self.workers, self.folder, self.most = workers, folder, most

    def __call__(self, scene: Scene) -> Outcome:
        """The outcome of one scene."""
        begun = time.perf_counter()
        try:
            # a verdict rests on profiles
            result = fit(scene, self.workers, self.folder, profiles=True)
        except (BadInput, FmuFailure) as error:
            return Outcome(math.nan, math.nan, f"refused: {_short(error)}", 0.0)
        width = result.derived["width_plus"]
        word = width.status if result.status == "converged" else result.status
        seconds = time.perf_counter() - begun
        off = abs(width.value / scene.width - 1.0)
        return Outcome(off, width.std / scene.width, word, seconds)

    def along(
        self, values: Iterable[float], scene: Callable[[float], Scene]
    ) -> list[tuple[float, Outcome]]:
        """Outcomes along a range, told as they come."""
        found = []
        for value in [*values][: self.most]:
            found.append((value, self(scene(value))))
            print(f"  {value:.3g}: {_told(found[-1][1])}", file=sys.stderr)
        return found


def _short(error: object) -> str:
    return str(error).split("/")[-1].split("; wanted")[0].split(", wanted")[0][:80]


def _told(outcome: Outcome) -> str:
    if outcome.word.startswith("refused"):
        return outcome.word
    return f"{outcome.word}, error {outcome.error:.1e}"


def _split(found: list[tuple[float, Outcome]], unit: str = "") -> tuple[str, str, str]:
    """Range, what holds (worst error), and the first that does not."""
    good = [(v, o) for v, o in found if o.holds]
    bad = [(v, o) for v, o in found if not o.holds]
    tried = f"{found[0][0]:.3g} to {found[-1][0]:.3g}{unit}"
    holds = "nothing"
    if good:
        worst = max(o.error for _, o in good)
        holds = f"{good[0][0]:.3g} to {good[-1][0]:.3g}{unit}: width to {worst:.1e}"
    stops = "; ".join(f"{v:.3g}{unit}: {_told(o)}" for v, o in bad[:2]) or "not reached"
    return tried, holds, stops


def quality(bench: Bench) -> tuple[str, ...]:
    """Q of the observed line at 7 MHz."""
    values = [5.0, 1e2, 1e4, 1e6, 1e8, 1e10, 1e12]
    found = bench.along(
        values,
        lambda q: replace(WHOLE, eta_plus=7e6, eta_minus=10.5e6, d1=7e6 / q, d2=8.4e6 / q),
    )
    return ("Q", *_split(found))


def frequency(bench: Bench) -> tuple[str, ...]:
    """Eigenfrequency at Q = 1e4."""
    values = [1e-3, 1.0, 1e3, 1e6, 1e9, 1e10, 1e13]
    found = bench.along(
        values,
        lambda f: replace(WHOLE, eta_plus=f, eta_minus=1.5 * f, d1=1e-4 * f, d2=1.2e-4 * f),
    )
    return ("eigenfrequency, Q = 1e4", *_split(found, " Hz"))


def spacing(bench: Bench) -> tuple[str, ...]:
    """Distance of the two tones, line width 117 Hz at 7 MHz."""
    width = Scene().width
    found = bench.along(
        [1e3, 1e2, 1.0, 1e-2, 1e-3, 1e-5, 1e-7],
        lambda gap: Scene(tones=((0.0, gap / width), (0.5, 0.5 + gap / width))),
    )
    return ("distance of the tones (line 117 Hz)", *_split(found, " Hz"))


def drift(bench: Bench) -> tuple[str, ...]:
    """Drift over the series, told by the campaign; and untold."""
    found = bench.along([0.5, 5.0, 50.0, 500.0, 5000.0], lambda d: Scene(drift=d))
    tried, holds, _ = _split(found, " line widths")
    lost = bench.along([0.5, 5.0], lambda d: Scene(drift=d, drift_known=False))
    stops = "; ".join(f"not told, {d:g}: {o.word}" for d, o in lost)
    return "drift over the series", tried, holds, stops


def noise(bench: Bench) -> tuple[str, ...]:
    """Signal to noise of the highest peak, spectra."""
    values = [1e6, 1e5, 1e4, 1e3, 1e2, 10.0, 5.0, 3.0, 1.0]
    found = bench.along(values, lambda r: Scene(noise=1.0 / r, peaks=False))
    good = [(r, o) for r, o in found if o.holds]
    holds = "nothing"
    if good:
        pulls = max(o.error / o.std for _, o in good)
        holds = (
            f"{good[0][0]:.3g} to {good[-1][0]:.3g}: claimed errors {good[0][1].std:.1e} to "
            f"{good[-1][1].std:.1e}, true ones up to {pulls:.1f} of them"
        )
    stops = "; ".join(f"{r:.3g}: {o.word}" for r, o in found if not o.holds)
    return "signal to noise", "1e6 to 1", holds, stops


def amplitude(bench: Bench) -> tuple[str, ...]:
    """Height of the peaks in volts."""
    values = [1e-310, 1e-307, 1e-300, 1e-150, 1.0, 1e150, 1e290, 1e297, 1e300]
    found = bench.along(values, lambda v: Scene(crest=v))
    return ("amplitude", *_split(found, " V"))


def experiments(bench: Bench, counts: list[int]) -> tuple[str, ...]:
    """Number of experiments; time and memory."""
    told = []
    for n in counts:
        tones = tuple((-0.5 - 0.6 * k / n, 0.4 + 1.2 * k / n) for k in range(n))
        one = bench(Scene(tones=tones, drift=20.0 if n > 1 else 0.0, noise=1e-3))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        told.append(f"{n}: {one.seconds:.1f} s, {memory:.0f} MB, width to {one.error:.1e}")
        print(f"  {told[-1]} ({one.word}, std {one.std:.1e})", file=sys.stderr)
        assert one.holds
    return "experiments, SNR 1000", f"{counts[0]} to {counts[-1]}", "; ".join(told), "not reached"


def starts(bench: Bench) -> tuple[str, ...]:
    """Line widths between the start and the line, frequency and damping free."""

    def scene(off: float) -> Scene:
        centre = 6.94e6
        free = {
            "eta_plus": Fitted(centre - 2e6, centre + 2e6, centre + off * 116.5, 100.0),
            "d1": Fitted(10.0, 1000.0, 150.0, 100.0),
        }
        return replace(WHOLE, tones=(), use="fit", fitted=free)

    found = bench.along([0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 100.0, 1000.0], scene)
    return ("start off the line", *_split(found, " line widths"))


def ratios(bench: Bench) -> tuple[str, ...]:
    """Ratio of the two peaks of an experiment, exact data."""
    found = bench.along(
        [10.0, 1e2, 1e3, 1e4],
        lambda r: Scene(tones=((0.0, 0.5 * r), (0.2, -0.5 * r), (-0.1, 0.4 * r))),
    )
    return ("ratio of the two peaks", *_split(found))


def priors(bench: Bench) -> tuple[str, ...]:
    """Weight of the Tikhonov term."""
    values = [1e6, 1e3, 1.0, 1e-3, 1e-8, 1e-16]
    return ("nu", *_split(bench.along(values, lambda nu: Scene(nu=(nu, 0.1, 2)))))


def sweeps(bench: Bench) -> tuple[str, ...]:
    """Sweeps without a whole peak: Algorithm 1, and least squares over the sweep."""
    cases = {
        "misses the peak": Scene(sweep=(2.0, 8.0)),
        "half a peak": Scene(sweep=(0.3, 6.0)),
        "two peaks": Scene(eta_minus=6.9404e6, sweep=(-4.0, 8.0)),
        "8 points over 100 line widths": Scene(sweep=(-50.3, 50.1), points=8),
    }
    stops, worst = [], 0.0
    for name, scene in [*cases.items()][: bench.most]:
        one, other = bench(scene), bench(replace(scene, scale="fit"))
        assert other.holds, name
        worst = max(worst, other.error)
        stops.append(f"{name}: {one.word}, error {one.error:.1e}")
        print(f"  {stops[-1]}; with scale = fit {_told(other)}", file=sys.stderr)
    return (
        "sweep",
        ", ".join(cases),
        f'scale = "fit": width to {worst:.1e}',
        f'scale = "maximum", each with a warning: {"; ".join(stops)}',
    )


def degenerate(bench: Bench) -> tuple[str, ...]:
    """Equal modes, the exceptional point, angles of symmetry."""
    point = replace(WHOLE, theta=0.75 * math.pi, d1=150.0, d2=50.0)
    scenes = [
        replace(WHOLE, eta_minus=6.94e6),
        replace(WHOLE, eta_minus=6.94e6, d2=100.0),
        replace(WHOLE, eta_minus=6.94e6 * (1.0 + 1e-12)),
        replace(point, eta_minus=6.94005e6),
        replace(point, eta_minus=6.940050001e6),
        *(replace(WHOLE, theta=k * math.pi / 4.0) for k in (0, 1, 3, 4)),
    ]
    outcomes = [bench(scene) for scene in scenes[: bench.most]]
    assert all(o.holds for o in outcomes)
    blind = bench(Scene(theta=math.pi / 2.0))
    return (
        "degenerate modes, exceptional point, theta at 0, π/4, 3π/4, π",
        f"{len(scenes)} scenes",
        f"width to {max(o.error for o in outcomes):.1e}",
        f"theta = π/2: d1 does not act, width {_told(blind)}; d1 not determined",
    )


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="up to 100 experiments")
    parser.add_argument("--smoke", action="store_true", help="two values of every range alone")
    args = parser.parse_args()
    counts = [1, 10, 100] if args.quick else [1, 10, 100, 1000]
    with tempfile.TemporaryDirectory() as name:
        fmu = build_fmu.build("CoupledOscillator", Path(name))
        with FmuWorkers(fmu, workers=1) as workers:
            bench = Bench(workers, Path(name) / "campaign", 2 if args.smoke else None)
            rows = []
            parts = (quality, frequency, spacing, drift, noise, amplitude, ratios, degenerate)
            for part in (*parts, sweeps, priors, starts):
                print(part.__doc__, file=sys.stderr)
                rows.append(part(bench))
            rows.append(experiments(bench, counts[: bench.most]))
    print("| tried | range | what holds | where it stops |\n|---|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
