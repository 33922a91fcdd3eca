"""Does the fit find the highest likelihood? Its end beside differential evolution, and the truth.

    python -m tests.bench.bench_minima [--campaigns 50] [--first 0] [--kind pairs] [--workers 2]

Random campaigns of `tests.support.virtual.kinds`, the closed form in place of the FMU. Beside the
fit's reported end -2 ln(posterior) of the same problem in the same box is minimised by scipy's
differential evolution, in logarithms of coefficients whose box is a ratio, and from the truth; both
are polished by scipy's least squares and a simplex. The fit has to end within 0.01 of the lowest of
them, a tenth of a standard error, or below. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution, least_squares, minimize

import fitting as ff
from fitting.text.arrays import FloatArray
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.kinds import KINDS
from tests.support.virtual.laboratory import Laboratory

TRIED = ("pairs", "joint", "crossing", "readings")
#: Of -2 ln(posterior): a tenth of a standard error.
CLOSE = 0.01


@dataclass(frozen=True)
class Compared:
    """-2 ln(posterior) where the fit ended, and the lowest that others found; processor time, s."""

    kind: str
    seed: int
    ended: float
    evolved: float
    from_truth: float
    fit_s: float
    evolution_s: float

    @property
    def lowest(self) -> float:
        """The lowest that another minimiser found."""
        return min(self.evolved, self.from_truth)

    @property
    def found(self) -> bool:
        """Whether the fit is as low."""
        return self.ended <= self.lowest + CLOSE


@cache
def _fmu() -> ff.Fmu:
    return ff.Fmu("CoupledOscillator", workers=1)


@dataclass(frozen=True)
class Landscape:
    """-2 ln(posterior) over the box of a laboratory's problem, in coordinates from 0 to 1."""

    problem: ff.Problem
    laboratory: Laboratory

    @property
    def is_ratio(self) -> FloatArray:
        """Which coordinates are logarithms."""
        return np.array([u.widens == "ratio" for u in self.laboratory.unknowns])

    def parameters(self, y: FloatArray) -> FloatArray:
        """Parameters (..., n) of coordinates (..., n)."""
        lower, upper = self.problem.bounds
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = lower * (upper / lower) ** y
        inside = np.where(self.is_ratio, ratio, lower + (upper - lower) * y)
        return np.asarray(np.clip(inside, lower, upper))

    def coordinates(self, p: FloatArray) -> FloatArray:
        """Coordinates (n,) of parameters (n,)."""
        lower, upper = self.problem.bounds
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(p / lower) / np.log(upper / lower)
        return np.clip(np.where(self.is_ratio, ratio, (p - lower) / (upper - lower)), 0.0, 1.0)

    def of_parameters(self, p: FloatArray) -> FloatArray:
        """-2 ln(posterior) (...) of parameters (..., n)."""
        return np.asarray(-2.0 * self.problem.logp(p))

    def polished(self, y: FloatArray) -> float:
        """The lowest value near coordinates: least squares of whitened rows, then a simplex."""
        lower, upper = self.problem.bounds
        width = upper - lower
        found = least_squares(
            lambda p: self.problem.white_rows(p)[0],
            np.clip(self.parameters(y), lower + 1e-9 * width, upper - 1e-9 * width),
            jac=lambda p: self.problem.white_rows(p)[1],
            bounds=(lower, upper),
            x_scale="jac",
            max_nfev=200,
        )
        y = self.coordinates(found.x)
        value = self.at(y)
        for _ in range(2):
            simplex = minimize(
                self.at,
                y,
                method="Nelder-Mead",
                options={"xatol": 1e-13, "fatol": 1e-9, "maxfev": 1000},
            )
            y, value = np.clip(simplex.x, 0.0, 1.0), min(value, float(simplex.fun))
        return value

    def at(self, y: FloatArray) -> float:
        """The value at coordinates (n,), drawn into the box."""
        return float(self.of_parameters(self.parameters(np.clip(y, 0.0, 1.0))))

    def evolved(self, seed: int) -> float:
        """The lowest value of differential evolution, polished."""
        found = differential_evolution(
            lambda y: self.of_parameters(self.parameters(y.T)),
            [(0.0, 1.0)] * self.is_ratio.size,
            popsize=20,
            maxiter=300,
            tol=1e-10,
            atol=1e-10,
            rng=seed,
            vectorized=True,
            updating="deferred",
            polish=False,
        )
        return min(float(found.fun), self.polished(found.x))


def compared(kind: str, seed: int) -> Compared:
    """One campaign: the fit, the evolution, and the descent from the truth."""
    laboratory = KINDS[kind](seed)
    with tempfile.TemporaryDirectory() as folder:
        record = ff.Problem.of(laboratory.write(Path(folder)), _fmu()).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    begun = time.process_time()
    fit = ff.fit(problem)
    between = time.process_time()
    number = fit.record.reported
    landscape = Landscape(problem.with_alternative(number), laboratory)
    truth = laboratory.truth(bool(fit.record.alternative.get("reflection", False)))
    true = np.array([truth[name] for name in problem.names])
    evolved = landscape.evolved(seed)
    return Compared(
        kind=kind,
        seed=seed,
        ended=float(landscape.of_parameters(fit.x)),
        evolved=evolved,
        from_truth=landscape.polished(landscape.coordinates(true)),
        fit_s=between - begun,
        evolution_s=time.process_time() - between,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--kind", choices=TRIED, action="append")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    kinds = args.kind or TRIED
    numbers = range(args.campaigns)
    wanted = [(kinds[k % len(kinds)], args.first + k // len(kinds)) for k in numbers]
    print("| campaign | end of the fit | evolution | descent from the truth | fit is |")
    print("|---|---|---|---|---|", flush=True)
    done = []
    with ProcessPoolExecutor(args.workers) as pool:
        for one in pool.map(compared, *zip(*wanted, strict=True)):
            done.append(one)
            word = "as low" if one.found else f"HIGHER by {one.ended - one.lowest:.2g}"
            print(
                f"| {one.kind} {one.seed} | {one.ended:.6f} | {one.evolved:.6f} | "
                f"{one.from_truth:.6f} | {word} |",
                flush=True,
            )
    low = sum(one.found for one in done)
    spent = np.median([(one.fit_s, one.evolution_s) for one in done], axis=0)
    print(f"\nAs low or lower in {low} of {len(done)} campaigns; processor time of a fit (median) ")
    print(f"{spent[0]:.1f} s, of both others {spent[1]:.1f} s.")


if __name__ == "__main__":
    main()
