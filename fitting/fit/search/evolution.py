"""Differential evolution over a box: the last resort where screens and descents explain nothing."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import differential_evolution

from fitting.fit.likelihood import LikelihoodEvaluator, Request
from fitting.fit.search.box import Box
from fitting.text.arrays import FloatArray

#: Members of a generation per parameter, and generations: enough for two lines in a box that is a
#: hundred widths wide.
MEMBERS, GENERATIONS = 15, 100


def merit(rows: FloatArray) -> float:
    """Sum ln(1 + row^2): where half of the rows fit is worth more than where none is far off.

    Args:
        rows: whitened, shape (m,).
    """
    return float(np.sum(np.log1p(rows**2)))


def evolved(
    evaluator: LikelihoodEvaluator, box: Box, seed: int, wanted: int
) -> tuple[list[FloatArray], int]:
    """The best of the last generation as search vectors, and how many points were looked at.

    Args:
        evaluator: of the likelihood.
        box: that is searched.
        seed: of the evolution.
        wanted: number of points at most.

    Raises:
        FmuFailure: the model failed at more points than can be left out.

    Source: R. Storn and K. Price, J. Global Optim. 11 (1997) 341, as in scipy.
    """
    looked_at = 0

    def merits(cube: FloatArray) -> FloatArray:
        nonlocal looked_at
        points = tuple(box.from_cube(u) for u in np.atleast_2d(cube.T))
        looked_at += len(points)
        [samples] = evaluator([Request(points, outputs=False)])
        found = np.array([merit(sample.rows) for sample in samples])
        return np.where(np.isfinite(found), found, math.inf)

    ended = differential_evolution(
        merits,
        [(0.0, 1.0)] * int(np.count_nonzero(box.free)),
        strategy="rand1bin",
        maxiter=GENERATIONS,
        popsize=MEMBERS,
        init="sobol",
        seed=np.random.default_rng(seed),
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    order = np.argsort(ended.population_energies, kind="stable")[:wanted]
    return [box.from_cube(u) for u in ended.population[order]], looked_at
