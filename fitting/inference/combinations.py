"""Parameters that the data determine in one combination only: what to measure to part them.

With the covariance C of a fit linearised at its end two parameters have the correlation

    rho = C_ij/sqrt(C_ii C_jj)

and with the other one known an error sqrt(1 - rho^2) times as large. Near one in magnitude the data
know a combination of both, as the product of a gain and the sine of an angle, and neither alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np

from fitting.campaign.laws import in_base
from fitting.fit.outputs import output_means
from fitting.fit.solution import Solution
from fitting.inference.estimates import SEEN
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind
from fitting.text.notation import listed

#: Correlation from which two values are one: with the other known an error is 22 times as small.
ONE = 0.999
#: Standard error over the value, below which nobody minds.
POOR = 0.02
#: Share of a derived value's error that the combination answers for, from which it follows.
FOLLOWS = 0.9
#: Step in x for the slopes of derived values.
STEP = 1e-4

#: What the error of a parameter with the other one known is called among the numbers of a finding.
ALONE = "std_alone_"


def combination_findings(
    solution: Solution, values: Mapping[str, FittedEstimate]
) -> tuple[Finding, ...]:
    """A finding for each pair of parameters of which the data know little but one combination.

    The subject names both, derived values that follow behind them. Numbers are the `correlation`,
    and of each parameter in SI units ``std_NAME`` and ``std_alone_NAME``, with the other one known.

    Args:
        solution: end of the fit, linearised.
        values: parameters and derived values, as they are reported.
    """
    parameters, covariance = solution.parameters, solution.errors.covariance
    deviations = np.sqrt(np.diag(covariance))
    shared = [i for i in range(len(parameters)) if _is_poor(solution, i, values)]
    found = []
    for i, j in combinations(shared, 2):
        rho = float(covariance[i, j] / (deviations[i] * deviations[j]))
        if abs(rho) < ONE:
            continue
        rest = float(np.sqrt(max(1.0 - rho**2, 0.0)))
        numbers = {"correlation": rho}
        for p, deviation in ((parameters[k], deviations[k]) for k in (i, j)):
            std = float(p.scale * deviation) * in_base(p.unit, p.name)[0]
            numbers |= {f"std_{p.name}": std, f"{ALONE}{p.name}": rest * std}
        following = list(_following(solution, covariance[:, i] / deviations[i]))
        subject = listed(parameters[k].name for k in (i, j))
        subject += f", and with them {listed(following)}" if following else ""
        kind = Kind.combination
        found.append(Finding(kind=kind, severity="warning", subject=subject, numbers=numbers))
    return tuple(found)


def _is_poor(solution: Solution, i: int, values: Mapping[str, FittedEstimate]) -> bool:
    """Whether the data know a parameter, but not well."""
    p = solution.parameters[i]
    if p.name not in values or not p.moves_model or p.experiments:
        return False
    gradient = np.zeros(len(solution.parameters))
    gradient[i] = p.scale
    std, shrinkage = solution.errors.of(gradient)
    return shrinkage >= SEEN and std > POOR * abs(float(solution.final.parameters[i]))


def _following(solution: Solution, along: FloatArray) -> Iterator[str]:
    """Derived values whose errors are those of a direction ``along`` (n,), a standard error long.

    Nothing where the model fails nearby.
    """
    x, steps = solution.final.x, STEP * np.eye(along.size)
    try:
        means = output_means(solution.objective.response, solution.parameters, [x, *(x + steps)])
    except FmuFailure:
        return
    for name, (here, *there) in means.items():
        gradient = (np.array(there) - here) / STEP
        std, _ = solution.errors.of(gradient) if np.all(np.isfinite(gradient)) else (0.0, 0.0)
        if std > 0.0 and abs(float(gradient @ along)) >= FOLLOWS * std:
            yield name
