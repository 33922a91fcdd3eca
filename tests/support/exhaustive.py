"""The best of all choices of candidates, for small cases."""

from __future__ import annotations

import itertools

import numpy as np

from fitting.design.weighing import DesignProblem, losses


def exhaustive(problem: DesignProblem, number: int, criterion: str) -> list[int]:
    """The best of all choices of so many candidates, with repetition."""
    every = list(itertools.combinations_with_replacement(range(problem.candidates), number))
    sums = problem.base + np.stack([problem.gains[:, list(s)].sum(axis=1) for s in every])
    return list(every[int(np.argmin(losses(problem, sums, criterion)))])
