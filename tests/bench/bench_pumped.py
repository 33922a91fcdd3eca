"""Pumped sweeps of the string: coverage of theta, lambda, d1, d2 over virtual laboratories.

    python -m tests.bench.bench_pumped                      # 200 laboratories, 4 of them by the FMU
    python -m tests.bench.bench_pumped --laboratories 20 --by-fmu 1 --record pumped.jsonl

Every laboratory (`fmu-fit synthesize --series pumped`) has an angle, damping and drift of its own.
The data come from its sidebands in physical coordinates until nothing changes. In place of the FMU
stands a closed form of its own, two modes and five sidebands in hybrid coordinates, but for some
laboratories, which the FMU fits too. The table has the share of 95 % intervals of the profile
likelihood that hold the truth, the mean deviation in standard deviations, and processor time.
With --record finished laboratories are kept and not done again.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import fitting as ff
from fitting.campaign import bind
from fitting.fit.problem import problem_of
from fitting.lab.pumped import PumpedBench
from fitting.lab.string import STRING
from fitting.lab.synthesis import synthesize
from fitting.text.arrays import FloatArray, Scalar
from tests.bench.records import Records
from tests.support.pumped_line import SidebandLine

METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
NAMES = ("theta", "lambda12", "d1", "d2")
#: The table so far is printed after so many laboratories.
SHOWN = 50


def laboratory(seed: int) -> PumpedBench:
    """A string of its own: angle, damping, drift.

    Args:
        seed: of all three.
    """
    rng = np.random.default_rng(seed)
    d1, d2 = (float(d) for d in rng.uniform(60.0, 160.0, 2))
    string = replace(STRING, theta_rad=float(rng.uniform(1.75, 2.2)), d1_hz=d1, d2_hz=d2)
    return PumpedBench(string=string, drift_hz=float(rng.uniform(-40.0, 40.0)))


def problem(bench: PumpedBench, path: Path, fmu: ff.Fmu, by_fmu: bool) -> ff.Problem:
    """The campaign of a bench, with the FMU or the closed form as its model.

    Args:
        bench: that was measured.
        path: of its campaign.
        fmu: CoupledModes2.
        by_fmu: whether it is the model.
    """
    campaign = ff.read_campaign(path)
    if by_fmu:
        return ff.Problem.of(campaign, fmu)

    def respond(_: Mapping[str, Scalar]) -> SidebandLine:
        return SidebandLine(bench)

    return ff.Problem.answered_by(respond, problem_of([bind(campaign, fmu.variables)]))


def found(bench: PumpedBench, seed: int, fmu: ff.Fmu, by_fmu: bool) -> tuple[FloatArray, float]:
    """(hit, deviation in sigma, determined) of `NAMES`, (4, 3), and seconds of this process.

    Args:
        bench: truth and settings.
        seed: of the noise.
        fmu: CoupledModes2.
        by_fmu: whether it is the model.
    """
    truth = {"theta": bench.string.theta_rad, "d1": bench.string.d1_hz, "d2": bench.string.d2_hz}
    with tempfile.TemporaryDirectory() as folder:
        made = synthesize(bench, seed=seed, out=Path(folder))
        truth["lambda12"] = made.truth["outcome"]["lambda_hz"]
        begun = time.process_time()
        asked = problem(bench, Path(folder) / "campaign.toml", fmu, by_fmu)
        inferred = ff.profile(ff.fit(asked, method=METHOD, starts=1), NAMES)
        spent = time.process_time() - begun
    rows = []
    for name in NAMES:
        low, high = inferred[name].interval(0.95)
        value, sigma = inferred[name].value, 0.25 * (high - low)
        hit = low <= truth[name] <= high
        rows.append((hit, (value - truth[name]) / sigma, np.isfinite(value)))
    return np.array(rows, dtype=float), spent


def table(rows: FloatArray, seconds: Sequence[float], what: str) -> None:
    """Print coverage, bias and verdicts of laboratories.

    Args:
        rows: of `found`, (laboratories, 4, 3).
        seconds: of each.
        what: the model.
    """
    count = len(rows)
    print(f"\n{what}: {count} laboratories, {np.median(seconds):.1f} s of processor time each")
    print("\n| value | inside 95 % | mean deviation, sigma | determined |\n|---|---|---|---|")
    for k, name in enumerate(NAMES):
        hit, off, known = rows[:, k].T
        share = f"{100.0 * np.mean(hit):.1f} %"
        told = f"{np.nanmean(off):+.2f} | {int(np.sum(known))} of {count}"
        print(f"| {name} | {share} | {told} |", flush=True)


def told(seed: int, fmu: ff.Fmu, by_fmu: bool, records: Records) -> tuple[FloatArray, float]:
    """What `found` says of the laboratory of a seed, which is fitted if it is not known yet.

    Args:
        seed: of the laboratory and its noise.
        fmu: CoupledModes2.
        by_fmu: whether it is the model.
        records: of finished laboratories.
    """
    key = (seed, by_fmu)
    if key not in records.known:
        rows, seconds = found(laboratory(seed), seed, fmu, by_fmu)
        records.keep(key, {"rows": rows.tolist(), "seconds": seconds})
    answer = records.known[key]
    return np.array(answer["rows"], dtype=float), float(answer["seconds"])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--laboratories", type=int, default=200)
    parser.add_argument("--by-fmu", type=int, default=4)
    parser.add_argument("--fmu-file", type=Path, help="another CoupledModes2.fmu, as a native one")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    options = parser.parse_args()
    records = Records(options.record)
    with ff.Fmu(options.fmu_file or "CoupledModes2", 1) as fmu:
        for what, count, by_fmu in (
            ("closed form", options.laboratories, False),
            ("FMU (this process alone, not the FMU's)", options.by_fmu, True),
        ):
            each = []
            for k in range(count):
                each.append(told(options.seed + k, fmu, by_fmu, records))
                print(".", end="", flush=True)
                if k + 1 == count or (k + 1) % SHOWN == 0:
                    table(np.array([rows for rows, _ in each]), [s for _, s in each], what)


if __name__ == "__main__":
    main()
