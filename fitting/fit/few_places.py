"""The likelihood of a few places: what it excludes by far, all of the data exclude.

For rows in two parts, a few places and the rest, chi^2 = chi_f^2 + chi_r^2, and over all x that
keep to a constraint,

    min chi^2 - chi^2(b) >= [min chi_f^2 - chi_f^2(b)] - [chi_r^2(b) - min chi_r^2]

b is the most likely point of all. The last bracket is what the rest gains where it is fitted by
itself: where noise explains the data and rows are about straight, no more than a variable chi^2 of
as many degrees of freedom as there are parameters. So a few spectra of a map tell where none of it
fits, at a part of the simulations, and where its minima are about.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from fitting.fit.covariance import BoundedErrors
from fitting.fit.likelihood import Likelihood
from fitting.measurements.measurement import DivisibleResponse
from fitting.text.arrays import BoolArray

#: Probability that the rest gains more by itself than is allowed for.
SELDOM_P = 1e-6


@dataclass(frozen=True)
class FewPlaces:
    """The likelihood of a few places, and which of all rows it has, priors last (m + n,)."""

    likelihood: Likelihood
    kept: BoolArray


def of_few_places(likelihood: Likelihood) -> FewPlaces | None:
    """The likelihood of a few places of the measurements that have many, without outputs.

    None where there are no such measurements, where the model answers for all of them alone, or
    where parameters belong to single places.

    Args:
        likelihood: of all rows.
    """
    objective = likelihood.objective
    data, response = objective.data, objective.response
    if not isinstance(response, DivisibleResponse):
        return None
    if any(p.experiments for p in likelihood.parameters):
        return None
    parts = [m.few_places() for m in data.measurements]
    if all(part is None for part in parts):
        return None
    kept = np.concatenate(
        [
            np.ones(m.rows, dtype=bool) if part is None else part[1]
            for m, part in zip(data.measurements, parts, strict=True)
        ]
    )
    few = tuple(
        m if part is None else part[0] for m, part in zip(data.measurements, parts, strict=True)
    )
    found = replace(
        likelihood,
        objective=replace(
            objective,
            response=response.answering(few),
            data=replace(data, measurements=few),
        ),
        noise=likelihood.noise.restricted(kept),
        shift=likelihood.shift[kept],
        scatter=likelihood.scatter[kept] if likelihood.scatter.size else likelihood.scatter,
        bounded=BoundedErrors.none(),
        names=(),
    )
    return FewPlaces(found, np.append(kept, np.ones(len(likelihood.parameters), dtype=bool)))


def own_gain(likelihood: Likelihood) -> float:
    """Chi square that the rest of the rows gains by itself less often than `SELDOM_P`.

    Args:
        likelihood: of all rows.
    """
    return float(chdtri(len(likelihood.parameters), SELDOM_P))
