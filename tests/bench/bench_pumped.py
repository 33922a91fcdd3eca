"""Pumped sweeps of the string: coverage of theta, lambda, d1, d2 over virtual laboratories.

    python -m tests.bench.bench_pumped                      # 200 laboratories, 4 of them by the FMU
    python -m tests.bench.bench_pumped --laboratories 20 --by-fmu 1

Every laboratory (`fmu-fit synthesize --series pumped`) has an angle, damping and drift of its own.
The data come from its sidebands in physical coordinates until nothing changes. In place of the FMU
stands a closed form of its own, two modes and five sidebands in hybrid coordinates, but for some
laboratories, which the FMU fits too. The table has the share of 95 % intervals of the profile
likelihood that hold the truth, the mean deviation in standard deviations, and processor time.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import fitting as ff
from fitting.campaign import bind
from fitting.fit.problem import problem_of
from fitting.lab.pumped import STRING, PumpedBench
from fitting.lab.synthesis import synthesize
from fitting.measurements.measurement import Evaluation, Prediction
from fitting.text.arrays import FloatArray, Scalar

METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
NAMES = ("theta", "lambda12", "d1", "d2")
REACH = 2


@dataclass(frozen=True)
class SidebandLine:
    """The observed line of a bench's sweeps, p = theta, d1, d2, at_plus, at_minus, rate.

    sum over k of A(u + k u_p) X_k + (p~/2)(X_(k-1) + X_(k+1)) = g, k = -2 to 2, over (2 pi)^2, in
    the coordinates in which the string is diagonal: p~ = f1^2 depth T e1 e1^T T^T.
    """

    bench: PumpedBench

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [Evaluation((Prediction(self.swept(p)),), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{"lambda12": np.array([self.coupling_hz(p)])} for p in ps]

    def eta_hz(self, p: FloatArray, time_h: float) -> FloatArray:
        string = self.bench.string
        shift = p[5] * time_h
        return np.array([string.eta_plus_hz + p[3] + shift, string.eta_minus_hz + p[4] + shift])

    def coupling_hz(self, p: FloatArray) -> float:
        plus, minus = self.eta_hz(p, 0.0)
        square = -0.5 * np.sin(2.0 * p[0]) * (minus - plus) * (minus + plus)
        return float(np.sqrt(square)) if square >= 0.0 else float("nan")

    def swept(self, p: FloatArray) -> FloatArray:
        return np.concatenate([self._sweep(p, k) for k in range(len(self.bench.settings))])

    def _sweep(self, p: FloatArray, k: int) -> FloatArray:
        depth, detuning = self.bench.settings[k]
        eta, u = self.eta_hz(p, self.bench.time_h(k)), self.bench.frequency_hz
        c, s = np.cos(p[0]), np.sin(p[0])
        turn = np.array([[c, -s], [s, c]])
        damping = turn @ np.diag(p[1:3]) @ turn.T
        square = (c * eta[0]) ** 2 + (s * eta[1]) ** 2
        pump = 0.5 * depth * square * np.outer(turn[:, 0], turn[:, 0])
        blocks = 2 * REACH + 1 if depth else 1
        system = np.zeros((u.size, blocks, 2, blocks, 2), dtype=complex)
        for i in range(blocks):
            v = u + (i - blocks // 2) * (self.bench.apart_hz + detuning)
            system[:, i, :, i, :] = 1j * v[:, None, None] * damping
            for mode in (0, 1):
                system[:, i, mode, i, mode] += (eta[mode] - v) * (eta[mode] + v)
            for j in (i - 1, i + 1):
                if 0 <= j < blocks:
                    system[:, i, :, j, :] = pump
        force = np.zeros((u.size, blocks, 2, 1), dtype=complex)
        force[:, blocks // 2] = 1.0
        shape = (u.size, 2 * blocks)
        found = np.linalg.solve(system.reshape(*shape, 2 * blocks), force.reshape(*shape, 1))
        return np.asarray(np.abs(found[:, 2 * (blocks // 2), 0]) / (2.0 * np.pi) ** 2)


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
        print(f"| {name} | {share} | {np.nanmean(off):+.2f} | {int(np.sum(known))} of {count} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--laboratories", type=int, default=200)
    parser.add_argument("--by-fmu", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1000)
    options = parser.parse_args()
    with ff.Fmu("CoupledModes2", 1) as fmu:
        for what, count, by_fmu in (
            ("closed form", options.laboratories, False),
            ("FMU (this process alone, not the FMU's)", options.by_fmu, True),
        ):
            each = []
            for k in range(count):
                each.append(found(laboratory(options.seed + k), options.seed + k, fmu, by_fmu))
                print(".", end="", flush=True)
            if each:
                table(np.array([rows for rows, _ in each]), [s for _, s in each], what)


if __name__ == "__main__":
    main()
