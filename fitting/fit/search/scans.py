"""Scans along the edges of a box: one parameter at a time through a minimum, the others held.

A valley too narrow for a few thousand points that fill the box is wide along some edge of it: where
two lines of a sweep are exchanged, or one of them stands in the noise, one parameter alone leads
from the wrong minimum to the side of the right one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.fit.likelihood import LikelihoodEvaluator, Request
from fitting.fit.search.box import Box
from fitting.fit.search.evolution import merit
from fitting.text.arrays import FloatArray


def scanned(
    evaluator: LikelihoodEvaluator,
    box: Box,
    through: Sequence[FloatArray],
    number: int,
    wanted: int,
) -> tuple[list[FloatArray], int]:
    """Where scans have minima of their own, the best first, and how many points were looked at.

    Args:
        evaluator: of the likelihood.
        box: that is searched.
        through: search vectors, (n,) each, through which every edge of the box is gone along.
        number: of points along an edge.
        wanted: number of search vectors at most.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    lines = [line for x in through for line in _lines(box, x, number)]
    if not lines:
        return [], 0
    answers = evaluator([Request(tuple(line.points), outputs=False) for line in lines])
    found = []
    for line, samples in zip(lines, answers, strict=True):
        merits = np.array([merit(sample.rows) for sample in samples])
        found += [(merits[k], line.points[k]) for k in _lowest(merits) if abs(k - line.own) > 1]
    found.sort(key=lambda each: each[0])
    return [point for _, point in found[:wanted]], sum(len(line.points) for line in lines)


@dataclass(frozen=True)
class _Line:
    """Search vectors along one edge of the box; `own`: which of them it was laid through.

    Its neighbours may be lower where they are ranked otherwise than by chi square.
    """

    points: list[FloatArray]
    own: int


def _lines(box: Box, x: FloatArray, number: int) -> list[_Line]:
    """A line along every edge through x, evenly in the cube."""
    cube = box.to_cube(x)[box.free]
    places = (np.arange(number) + 0.5) / number
    lines = []
    for edge, here in enumerate(cube):
        own = int(np.searchsorted(places, here))
        along = np.repeat(cube[None, :], number + 1, axis=0)
        along[:, edge] = np.insert(places, own, here)
        lines.append(_Line([box.from_cube(u) for u in along], own))
    return lines


def _lowest(merits: FloatArray) -> list[int]:
    """Which points are below both neighbours; of equal ones the first, at an end with one."""
    here = np.where(np.isfinite(merits), merits, math.inf)
    beyond = np.concatenate([[math.inf], here, [math.inf]])
    return [int(k) for k in np.flatnonzero((here < beyond[:-2]) & (here <= beyond[2:]))]
