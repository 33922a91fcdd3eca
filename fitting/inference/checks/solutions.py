"""Other solutions, values at bounds, and errors that are strongly correlated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitting.fit.alternative import Outcome
from fitting.fit.path import named
from fitting.fit.solver.continuation import distance, equal_j
from fitting.inference.solved import Solved
from fitting.text.finding import Finding, Kind, note, warning
from fitting.text.notation import settings_words

#: Starts of equal J whose parameters differ by more than this (units of x) are distinct.
APART = 0.1
#: Correlation of two errors from which it is strong.
CORRELATED = 0.95
#: Shares of the bounds' distance: within them a value lies on a bound, to the rounding of solvers,
#: or next to it.
ON_BOUND, NEAR_BOUND = 1e-6, 1e-3


def check_bounds(solved: Solved) -> Iterator[Finding]:
    """Parameters of Algorithm 2's end on a bound, or next to one."""
    solution = solved.solution
    for parameter, value in zip(solution.parameters, solution.final.parameters, strict=True):
        p = float(value)
        bound = min(parameter.lower, parameter.upper, key=lambda end: abs(p - end))
        if abs(p - bound) >= parameter.near(bound, NEAR_BOUND):
            continue
        at_bound = abs(p - bound) <= parameter.near(bound, ON_BOUND)
        names = {"unit": (parameter.unit,)}
        numbers = {"value": p, "bound": bound, "at_bound": float(at_bound)}
        yield note(Kind.at_bound, parameter.name, names, **numbers)


def check_correlation(solved: Solved) -> Iterator[Finding]:
    """Pairs of parameters of the whole campaign whose errors are strongly correlated."""
    if not solved.describes:
        return
    solution = solved.fit.solution
    parameters, covariance = solution.parameters, solution.errors.covariance
    shared = [k for k, p in enumerate(parameters) if not p.experiments]
    for k, i in enumerate(shared):
        for j in shared[:k]:
            rho = float(covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j]))
            if abs(rho) >= CORRELATED:
                pair = (parameters[j].name, parameters[i].name)
                names = {"pair": pair}
                yield note(Kind.correlated_values, ", ".join(pair), names, correlation=rho)


def check_minima(solved: Solved) -> Iterator[Finding]:
    """Starts that converged elsewhere, with the same objective or another one."""
    outcome, parameters = solved.fit.outcome, solved.solution.parameters
    best, shared = outcome.best, [p for p in parameters if not p.experiments]
    about = {"values": tuple(p.name for p in shared), "units": tuple(p.unit for p in shared)}
    for chain in outcome.chains:
        if best is None or chain is best or chain.joined is not None or not chain.steps:
            continue
        end, lowest = chain.steps[-1], best.steps[-1]
        values = named(parameters, np.array(end.parameters))
        apart = distance(parameters, np.array(end.x), np.array(lowest.x))
        equal = equal_j(end.j, lowest.j) and apart > APART
        if equal or chain.nu == best.nu:
            kind = Kind.equal_objective if equal else Kind.other_minimum
            numbers = {"start": chain.start + 1.0, "objective": end.j}
            numbers |= {p.name: values[p.name] for p in shared}
            yield note(kind, f"start {chain.start + 1}", about, **numbers)
    yield from search_findings(outcome)


def search_findings(outcome: Outcome) -> Iterator[Finding]:
    """That a search within the bounds found no minimum that noise would explain.

    Args:
        outcome: of one alternative, with its search.
    """
    search = outcome.search
    if search is None or search.explained:
        return
    low, others = search.apart_by_height()
    numbers = {
        "points": float(search.screened),
        "lowest": float(sum(minimum.descents for minimum in low)),
        "descents": float(search.descents),
        "chi_square": low[0].chi_square,
    }
    if others:
        numbers["next_chi_square"] = others[0].chi_square
    yield warning(Kind.search_unexplained, "search", None, **numbers)


def check_alternatives(solved: Solved) -> Iterator[Finding]:
    """Equivalent solutions with their values, else alternatives that reach the same objective."""
    yield from solved.equivalents
    for a in () if solved.equivalents else solved.fit.alternatives:
        if a.equal_to_best and not a.reported:
            yield note(Kind.equal_alternative, settings_words(a.settings))


def check_profiles(solved: Solved) -> Iterator[Finding]:
    """What the profiles met, of a model that describes the data."""
    if solved.describes:
        yield from solved.profiles
