"""Laboratories that follow an advice: a series, the planned measurements after it, and a refit.

Shared by the benchmark and its small version among the tests. The laboratories share no code with
the FMU, through which the refit goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.parameters import search_bounds, to_model, to_search
from fitting.design.information import DataSoFar, Place, prior_sigmas_in_box
from fitting.fit.linearisation import information
from fitting.fit.objective import evaluate_many, jacobian_of, stencil
from fitting.fit.problem import plan_problem, problem_of
from fitting.fmu.pool import FmuWorkers
from fitting.lab.bench import Bench, measure
from fitting.lab.synthesis import synthesize
from fitting.lab.writer import campaign_files
from fitting.text.arrays import FloatArray
from fitting.text.results_folder import write_all
from tests.support.datasets import linear

STEPS = 30
#: Chi-squares closer than this are one fit.
ALIKE = 0.1


def so_far(bound: BoundCampaign, workers: FmuWorkers, step: float = 1e-4) -> DataSoFar:
    """What a campaign measured, with steps in x."""
    problem = problem_of([bound])
    steps = np.full(len(problem.parameters), step)
    return DataSoFar(problem, plan_problem(problem, workers), steps)


@dataclass(frozen=True)
class Refit:
    """Where a fit of both campaigns ended: parameters, chi-square, target."""

    parameters: FloatArray
    chi_square: float
    target: float


class Laboratory:
    """One laboratory: its own first series and the plan, both measured with a seed of their own."""

    def __init__(
        self,
        bench: Bench,
        plan: Path,
        seed: int,
        folder: Path,
        workers: FmuWorkers,
        errors: dict[str, float],
    ) -> None:
        first, second = folder / f"first{seed}", folder / f"second{seed}"
        write_all(first, campaign_files(measure(bench, seed), "a benchmark"))
        synthesize(bench, seed=10_000 + seed, plan=plan, out=second)
        sweep = (first / "sweep.csv").read_bytes()  # the gain is that laboratory's
        (second / "sweep.csv").write_bytes(sweep)
        variables = workers.description.variables
        campaigns = [read_campaign(f / "campaign.toml") for f in (first, second)]
        bounds = [linear(bind(campaign, variables)) for campaign in campaigns]
        self.bound: BoundCampaign = bounds[0]
        # references come from a series' own sweep: one search vector for both
        bounds = [replace(bound, parameters=self.bound.parameters) for bound in bounds]
        self.series = [so_far(bound, workers, 1e-5) for bound in bounds]
        self.prior, self.errors = prior_sigmas_in_box(self.bound.parameters), errors

    def covariance(self, place: Place) -> FloatArray:
        """V of all rows: peaks, drift of every experiment, and the scale that both series share."""
        sizes = [s.problem.data.sigma.size for s in self.series]
        whole, begin = np.full((sum(sizes), sum(sizes)), self.series[0].scale_sigma ** 2), 0
        for series, size in zip(self.series, sizes, strict=True):
            data = series.problem.data
            _, around, nodes = series.moved(place, data, self.errors)
            moved = around.quotients([node.residuals for node in nodes])[:, place.x.size :]
            [tones] = data.tones
            lines = [len(e.read_hz) for e in tones.experiments]
            owner = np.repeat(np.arange(len(lines)), lines)
            alike = owner[:, None] == owner
            mine = slice(begin, begin + size)
            whole[mine, mine] += np.diag(data.sigma**2) + alike * (moved @ moved.T)
            begin += size
        return whole

    def rows(self, place: Place) -> tuple[FloatArray, FloatArray]:
        """Residuals and their Jacobian in x of both series."""
        found = []
        for series in self.series:
            objective = series.objective(place.alternative)
            around = stencil(objective, place.x)
            here, *nodes = evaluate_many(objective, [place.x, *around.nodes])
            found.append((here.residuals, jacobian_of(around, nodes)))
        return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])

    def expected(self, p: FloatArray, gradient: FloatArray) -> float:
        """sqrt(g^T (F + P)^-1 g) at parameters p for a gradient in x."""
        place = Place(self.bound.alternatives[0], to_search(self.bound.parameters, p))
        found = information(self.rows(place)[1], self.covariance(place))
        whole = found + np.diag(self.prior**-2.0)
        return float(np.sqrt(gradient @ np.linalg.solve(whole, gradient)))

    def refit(self, starts: Sequence[FloatArray], target: str) -> Refit:
        """Least squares over both series from several parameters, the best end of them.

        Of ends that fit alike (theta and theta + pi/2 with d1 and d2 swapped are one damping
        matrix) that one where the target has a value.
        """
        lower, upper = search_bounds(self.bound.parameters)
        ends = []
        for p in starts:
            x = np.clip(to_search(self.bound.parameters, p), lower, upper)
            square, place = self._descend(x)
            found = to_model(self.bound.parameters, place.x)
            derived = self.series[0].planned.response(place.alternative).derived_many([found])[0]
            ends.append(Refit(found, square, float(np.mean(derived[target]))))
        least = min(end.chi_square for end in ends)
        alike = [end for end in ends if end.chi_square <= least + ALIKE]
        return min(alike, key=lambda end: (np.isnan(end.target), end.chi_square))

    def _descend(self, x: FloatArray) -> tuple[float, Place]:
        """Levenberg-Marquardt in units of the prior, V at the start and again at the first end."""
        place, square = Place(self.bound.alternatives[0], np.array(x)), np.inf
        for _ in range(2):
            factor = np.asarray(np.linalg.cholesky(self.covariance(place)), dtype=float)
            square, place = self._levenberg(place, factor)
        return square, place

    def _levenberg(self, place: Place, factor: FloatArray) -> tuple[float, Place]:
        lower, upper = search_bounds(self.bound.parameters)
        damping, here, matrix = 1e-2, *self._white(place, factor)
        for _ in range(STEPS):
            normal = matrix.T @ matrix
            scaled = normal + damping * np.diag(np.diag(normal) + 1e-6)
            move = -self.prior * np.linalg.solve(scaled, matrix.T @ here)
            there = Place(place.alternative, np.clip(place.x + move, lower, upper))
            rows, slopes = self._white(there, factor)
            gain = float(here @ here - rows @ rows)
            if gain > 0.0:
                place, here, matrix, damping = there, rows, slopes, damping / 10.0
                if gain < 1e-6:
                    break
            else:
                damping *= 10.0
                if damping > 1e6:
                    break
        return float(here @ here), place

    def _white(self, place: Place, factor: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows, slopes = self.rows(place)
        white = np.linalg.solve(factor, np.column_stack([rows, slopes * self.prior]))
        return np.asarray(white[:, 0], dtype=float), np.asarray(white[:, 1:], dtype=float)
