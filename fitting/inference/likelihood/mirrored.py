"""Exact twins of the most likely point beyond the box, of this model and of its alternatives.

A box may be what tells a point from its twin: damping exchanged with damping, a line with a line.
Then values are determined inside the box alone, and that is told as other fits beyond it are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import outside_box
from fitting.fit.likelihood.descent import Optimum
from fitting.fit.likelihood.few_places import of_few_places
from fitting.fit.objective import Objective
from fitting.fit.outputs import output_means_beyond
from fitting.fit.search.twins import find_twins
from fitting.fit.solver.evaluator import Evaluator
from fitting.inference.likelihood.outside import Outside, widened
from fitting.inference.likelihood.profiles import ProfilePoint
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class Model:
    """An alternative of the model: its objective, and what leads to it in words."""

    objective: Objective
    where: str


def mirrored(optimum: Optimum, others: Sequence[Model], seed: int) -> tuple[Outside, ...]:
    """The exact twins of the most likely point that lie beyond the box, in a much wider one.

    Left out are those at which an output is missing that exists at the optimum. Of data at many
    places a few tell what is a twin, of this model alone.

    Args:
        optimum: the most likely point and its likelihood.
        others: alternatives of the model.
        seed: of the points of the box at which twins are tried.
    """
    likelihood, here = optimum.likelihood, optimum.expansion
    few = of_few_places(likelihood)
    own = likelihood.objective if few is None else few.likelihood.objective
    exists = np.isfinite(here.sample.outputs)
    found = []
    for model in (Model(own, ""), *(others if few is None else ())):
        images = _images(own, model.objective, here.x, seed)
        means = output_means_beyond(
            model.objective.response, likelihood.parameters, images, likelihood.names
        )
        for k, x in enumerate(images):
            outputs = np.array([float(means[name][k]) for name in likelihood.names])
            if np.all(np.isfinite(outputs[exists])):
                point = ProfilePoint(value=float("nan"), delta=0.0, x=x, outputs=outputs)
                found.append(Outside(point, model.where))
    return tuple(found)


def _images(own: Objective, other: Objective, x: FloatArray, seed: int) -> list[FloatArray]:
    """Search vectors beyond the box at which another objective says what this one says at x.

    An angle half turns on is the same angle.
    """
    wide = widened(own.parameters)
    target = None if other is own else replace(other, parameters=wide)
    twins = find_twins(Evaluator(replace(own, parameters=wide)), seed, target)
    twins = [twin for twin in twins if not twin.is_turn]
    images = [twin.of(wide, x) for twin in twins]
    return [image for image in images if image is not None and outside_box(own.parameters, image)]
