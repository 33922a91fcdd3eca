"""Parameters that the data determine in one combination only.

With the covariance C of the linearised fit two parameters have the correlation

    rho = C_ij/sqrt(C_ii C_jj)

and, with the other one known, an error sqrt(1 - rho^2) times as large. Near one in magnitude the
data determine a combination of both, as the product of a gain and the sine of an angle, and neither
alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from fitting.campaign.laws import in_base
from fitting.inference.estimates import DETERMINED
from fitting.inference.solved import Solved
from fitting.text.finding import Finding, Kind, warning
from fitting.text.notation import listed

#: Correlation from which two values are one: with the other known an error is 22 times as small.
ONE = 0.999
#: Standard error over the value, below which a value is good enough.
POOR = 0.02
#: Share of a derived value's error by the combination, from which it follows.
FOLLOWS = 0.9
#: Prefix of the error of a parameter with the other one known, among the numbers of a finding.
ALONE = "std_alone_"


def check_combinations(solved: Solved) -> Iterator[Finding]:
    """Pairs of parameters of which the data determine little but one combination.

    The subject names both, and derived values that follow. Numbers are the `correlation`, and of
    each parameter in SI units ``std_NAME`` and ``std_alone_NAME``, with the other one known.
    """
    if not solved.describes:
        return
    solution, errors = solved.solution, solved.solution.errors
    parameters, deviations = solution.parameters, np.sqrt(np.diag(errors.covariance))
    poor = []  # determined, but not well
    for i, p in enumerate(parameters):
        if p.name not in solved.parameters or not p.moves_model or p.experiments:
            continue
        std, shrinkage = errors.of(p.scale * np.eye(len(parameters))[i])
        if shrinkage >= DETERMINED and std > POOR * abs(float(solution.final.parameters[i])):
            poor.append(i)
    for i, j in combinations(poor, 2):
        rho = float(errors.covariance[i, j] / (deviations[i] * deviations[j]))
        if abs(rho) < ONE:
            continue
        numbers = {"correlation": rho}
        for p, deviation in ((parameters[k], deviations[k]) for k in (i, j)):
            std = float(p.scale * deviation) * in_base(p.unit, p.name)[0]
            alone = float(np.sqrt(max(1.0 - rho**2, 0.0))) * std
            numbers |= {f"std_{p.name}": std, f"{ALONE}{p.name}": alone}
        # derived values whose errors are those of this direction, a standard error long
        along, following = errors.covariance[:, i] / deviations[i], []
        for name in solved.outputs.values[0] if solved.outputs else ():
            gradient = solved.outputs.gradient(name)
            std = errors.of(gradient)[0] if np.all(np.isfinite(gradient)) else 0.0
            if std > 0.0 and abs(float(gradient @ along)) >= FOLLOWS * std:
                following.append(name)
        subject = listed(parameters[k].name for k in (i, j))
        subject += f", and with them {listed(following)}" if following else ""
        yield warning(Kind.combination, subject, None, **numbers)
