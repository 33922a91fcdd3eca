"""Discrete alternatives of a model that fit as well, judged by their likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fitting.campaign.parameters import to_model
from fitting.fit.likelihood.descent import Optimum, most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_with
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.fit.outputs import output_means
from fitting.inference.likelihood.knowledge import Equivalent
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.error_bars import ROOT_95
from fitting.text.notation import settings_words


def equal_fit(
    other: tuple[Objective, Sequence[FloatArray]],
    here: tuple[Objective, Sequence[FloatArray]],
    settings: Mapping[str, Scalar],
    noise: RowNoise,
) -> Equivalent | None:
    """Another alternative at its most likely point; None where the data tell it from this one.

    Args:
        other: objective of the other alternative, and search vectors to begin at.
        here: those of the reported one.
        settings: of the other alternative, by name.
        noise: of the rows.
    """
    found = [
        most_likely(LikelihoodEvaluator(likelihood_with(objective, noise)), begins)
        for objective, begins in (here, other)
    ]
    own, there = found
    delta = _delta(own, there)
    if delta > ROOT_95**2:
        return None
    objective = other[0]
    x = there.likelihood.folded(there.expansion.x)
    outputs = output_means(objective.response, objective.parameters, [x])
    named = zip(objective.parameters, to_model(objective.parameters, x), strict=True)
    return Equivalent(
        parameters={q.name: float(value) for q, value in named},
        derived={name: float(values[0]) for name, values in outputs.items()},
        delta=float(delta),
        origin="alternative",
        where=settings_words(settings),
    )


def _delta(own: Optimum, there: Optimum) -> float:
    """Chi square of another model over that of this one, both in the wider noise of the two."""
    wide = max(own.likelihood.inflation, there.likelihood.inflation)
    mine = own.likelihood.noise.log_determinant
    other = there.likelihood.noise.log_determinant
    if mine == other:
        return own.calibrated((there.chi_square - own.chi_square) / wide**2)
    # noise that residuals tell is another one there: -2 ln of the likelihoods' ratio
    return float(other + there.chi_square - mine - own.chi_square) / wide**2
