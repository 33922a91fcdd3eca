"""Does the advice hold? Laboratories that follow `fmu-fit design`, refitted through the FMU.

    python tests/bench/bench_design.py [--laboratories 100] [--number 6] [--campaign CAMPAIGN.toml]

The design is made from the shipped q1 campaign, knowing nothing of its truth. Every laboratory then
measures a q1 series of its own and the proposed measurements after it (noise, drift and sweep of a
seed of their own), and (theta, d1, d2) are refitted to both by least squares. The table compares
the expected sigma(lambda) with the scatter of the refitted values, for the first 2, 4, ... proposed
measurements; exit code 1 if a promise is not kept: expected sigma ten times less than before, and
scatter within a factor 1.5 of it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fitting.cli.main import main as fmu_fit
from fitting.design.result import Design, read_design
from fitting.fmu.pool import FmuWorkers
from fitting.lab.writer import CAMPAIGN_NAME
from tests.support.design_laboratories import Laboratory
from tests.support.string_benches import read_bench

ROOT = Path(__file__).resolve().parents[2]
TENFOLD, FACTOR = 10.0, 1.5
#: Laboratories from which the scatter of their values is a verdict.
ENOUGH = 20


def starts_of(design: Design, names: Sequence[str]) -> list[np.ndarray]:
    """Parameters of three points of equal fit, in the campaign's first alternative."""
    first = design.places[0].alternative
    places = [place.parameters for place in design.places if place.alternative == first]
    return [np.array([place[name] for name in names]) for place in places[:3]]


def gradient_at(laboratory: Laboratory, p: np.ndarray, target: str) -> np.ndarray:
    """Of the target in x, central differences through the FMU."""
    response = laboratory.series[0].planned.response(laboratory.bound.alternatives[0])
    moves = [(i, s) for i in range(len(p)) for s in (1.0, -1.0)]
    h = 1e-4 * np.array([q.scale for q in laboratory.bound.parameters])
    nodes = [p + sign * h * np.eye(len(p))[i] for i, sign in moves]
    values = np.array([np.mean(d[target]) for d in response.derived_many(nodes)])
    return np.asarray((values[0::2] - values[1::2]) / 2e-4)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--laboratories", type=int, default=100)
    parser.add_argument("--number", type=int, default=6)
    parser.add_argument("--campaign", type=Path, default=ROOT / "data/string_q1/campaign.toml")
    args = parser.parse_args()
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        words = ["design", args.campaign, "--number", args.number, "--out", folder]
        code = fmu_fit([*(str(word) for word in words), "--no-report"])
        if code:
            return code
        design = read_design(folder / "design.json")
        kept = follow(design, args, folder)
    print(f"{time.perf_counter() - begun:.0f} s")
    return 0 if kept or args.laboratories < ENOUGH else 1


def follow(design: Design, args: argparse.Namespace, folder: Path) -> bool:
    """The table of one design; whether the promises are kept."""
    bench = read_bench(args.campaign.parent / "truth.toml")
    truth = np.array([bench.modes.theta_rad, bench.modes.d1_hz, bench.modes.d2_hz])
    errors = setting_errors(folder)
    plan = folder / "campaign" / CAMPAIGN_NAME
    fmu = next((folder / "fmu").glob("*.fmu"))
    values, squares, expected = [], [], float("nan")
    with FmuWorkers(fmu, workers=2) as workers:
        for seed in range(1, args.laboratories + 1):
            laboratory = Laboratory(bench, plan, seed, folder, workers, errors)
            if seed == 1:
                g = gradient_at(laboratory, truth, design.target)
                expected = laboratory.expected(truth, g)
                response = laboratory.series[0].planned.response(laboratory.bound.alternatives[0])
                true = float(np.mean(response.derived_many([truth])[0][design.target]))
            names = [parameter.name for parameter in laboratory.bound.parameters]
            found = laboratory.refit(starts_of(design, names), design.target)
            values.append(found.target)
            squares.append(found.chi_square)
    known = np.array([v for v in values if np.isfinite(v)])
    scatter = float(np.std(known, ddof=1))
    off = float(np.sqrt(np.mean((known - true) ** 2)))
    before = design.spread
    print(f"\n{len(values)} laboratories, {len(design.proposals)} measurements after the q1 series")
    print(f"{'sigma(lambda) so far (spread over points of equal fit)':58} {before / 1e3:9.2f} kHz")
    print(f"{'expected after, at the truth':58} {expected / 1e3:9.2f} kHz")
    print(f"{'scatter of the refitted values':58} {scatter / 1e3:9.2f} kHz")
    print(f"{'root mean square error about the truth':58} {off / 1e3:9.2f} kHz")
    print(f"{'mean error':58} {(np.mean(known) - true) / 1e3:+9.2f} kHz")
    print(f"{'refits without a value':58} {len(values) - len(known):9d}")
    print(f"{'median chi-square':58} {np.median(squares):9.1f}")
    print(
        f"times better than before: {before / expected:.1f}; scatter/expected: "
        f"{scatter / expected:.2f}, error/expected: {off / expected:.2f}"
    )
    return before / expected >= TENFOLD and 1.0 / FACTOR <= scatter / expected <= FACTOR


def setting_errors(folder: Path) -> dict[str, float]:
    """What the design assumed of the errors of what drifts."""
    text = (folder / "campaign" / CAMPAIGN_NAME).read_text()
    table = tomllib.loads(text)["design"].get("setting_sigma", {})
    return {name: float(value) for name, value in table.items()}


if __name__ == "__main__":
    raise SystemExit(main())
