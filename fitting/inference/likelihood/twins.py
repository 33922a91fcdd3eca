"""Twins of the optimum without a value of some output, and whether one near by has them all.

Where an output has no value the model has no such fit: that takes a twin out. Not so where the
output exists a little beside it, within what the data allow: near the edge of where a coupling is
real, the point estimate alone decides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import to_search
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Exhausted, Request
from fitting.fit.search.box import Box
from fitting.fit.search.minima import SAME
from fitting.fit.search.twins import Twin
from fitting.inference.likelihood.exploration import Exploration, data_covariance
from fitting.inference.likelihood.knowledge import Equivalent
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95


def with_values_nearby(
    evaluator: LikelihoodEvaluator,
    explored: Exploration,
    twins: Sequence[Twin],
    equivalents: Sequence[Equivalent],
) -> tuple[Equivalent, ...]:
    """The equivalents, those counted as possible whose valley has values of every output somewhere.

    Args:
        evaluator: of the likelihood.
        explored: profiles of the optimum.
        twins: exact symmetries of the model.
        equivalents: separate minima of this model.
    """
    parameters, optimum = explored.optimum.likelihood.parameters, explored.optimum
    box, near = Box(parameters), _fitting(explored)
    made = []
    for other in equivalents:
        place = to_search(parameters, np.array([other.parameters[p.name] for p in parameters]))
        mine = [
            twin
            for twin in twins
            if (image := twin.of(parameters, optimum.expansion.x)) is not None
            and box.apart(image, place) <= SAME
        ]
        possible = other.possible or any(_has_values(evaluator, twin, near) for twin in mine)
        made.append(replace(other, possible=possible))
    return tuple(made)


def _fitting(explored: Exploration) -> list[FloatArray]:
    """Search vectors that fit as well: on profiles, and at the ends of the linearised ellipsoid."""
    x = explored.optimum.expansion.x
    points = [point.x for point in explored.points if point.delta <= ROOT_95**2]
    variances, axes = np.linalg.eigh(data_covariance(explored.optimum))
    reach = ROOT_95 * np.sqrt(np.maximum(variances, 0.0)) * axes
    return points + [x + sign * step for step in reach.T for sign in (-1.0, 1.0)]


def _has_values(evaluator: LikelihoodEvaluator, twin: Twin, near: Sequence[FloatArray]) -> bool:
    """Whether every output exists at the image of some point."""
    parameters = evaluator.likelihood.parameters
    images = tuple(image for x in near if (image := twin.of(parameters, x)) is not None)
    if not images:
        return False
    try:
        samples = evaluator([Request(images, rows=False)])[0]
    except Exhausted:
        return False
    return any(bool(np.all(np.isfinite(sample.outputs))) for sample in samples)
