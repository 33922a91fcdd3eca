"""The way of a fit as records: levels of nu, starts, discrete alternatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, to_model
from fitting.fit.alternative import Outcome
from fitting.fit.objective import Objective, j_reg
from fitting.fit.outputs import mean
from fitting.fit.solution import Solution
from fitting.fit.solver.continuation import Chain, Level, equal_j
from fitting.text.arrays import FloatArray, Scalar


@dataclass(frozen=True, kw_only=True)
class HistoryRow(Level):
    """One nu of Algorithm 2 from the campaign's start; level -1 is that start, before any solve.

    A level beyond the schedule is the reported end, where another chain than this has it.
    """

    parameters: Mapping[str, float]
    derived: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class StartResult:
    """Where one start led: end values (canonical), J, the start it met, why it ended.

    The first is Algorithm 2 from the campaign's start, the others began where the search did.
    """

    begun: Mapping[str, float]
    parameters: Mapping[str, float]
    j_fit: float
    j_reg: float
    levels: int
    joined: int | None
    ended: str
    equivalent: bool


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """What a search of the box found in one alternative.

    `screened` points of the box were looked at in `screens` rounds (screens, scans along its edges,
    evolutions), `descents` begun from the best of them; `ended` descents came to the lowest minimum
    or a twin of it, `higher` to others, of which `next_chi_square` is the lowest against
    `chi_square` of the lowest of all (NaN without any). `explained` whether noise explains it;
    `twins` number of exact symmetries of the model.
    """

    screened: int
    screens: int
    descents: int
    ended: int
    higher: int
    chi_square: float
    next_chi_square: float
    explained: bool
    twins: int
    evaluations: int
    fmu_runs: int


@dataclass(frozen=True, kw_only=True)
class AlternativeResult:
    """One discrete alternative with its best start; `equal_to_best` within the tolerance of J.

    `search` is None where the box was not searched.
    """

    settings: Mapping[str, Scalar]
    parameters: Mapping[str, float]
    derived: Mapping[str, float]
    j_fit: float
    j_reg: float
    status: str
    message: str
    reported: bool
    equal_to_best: bool
    starts: tuple[StartResult, ...]
    search: SearchResult | None = None


def history_rows(solution: Solution, published: Chain) -> tuple[HistoryRow, ...]:
    """A row per nu, level -1 being the start, with derived means.

    The levels are those of Algorithm 2 from the campaign's start; a further row is the reported
    end, where that is another.

    Args:
        solution: end of the fit.
        published: Algorithm 2 from the campaign's start.
    """
    parameters = solution.parameters
    begun = np.array(published.begun)
    steps = [*published.steps, *(s for s in solution.chain.steps if s not in published.steps)]
    places = [begun, *(np.array(step.x) for step in steps)]
    values = [to_model(parameters, x) for x in places]
    derived = solution.objective.response.derived_many(values)
    rows = []
    for k, (p, outputs) in enumerate(zip(values, derived, strict=True)):
        means = {name: mean(values) for name, values in outputs.items()}
        shown = named(parameters, p)
        if k == 0:
            start = solution.initial
            rows.append(
                HistoryRow(
                    level=-1,
                    nu=float("nan"),
                    parameters=shown,
                    derived=means,
                    j_fit=start.j_fit,
                    j_reg=j_reg(begun, solution.tikhonov_weights),
                    change=float("nan"),
                    optimality=float("nan"),
                    status="start",
                    message="where the search began",
                    iterations=0,
                    evaluations=0,
                    seconds=0.0,
                )
            )
            continue
        level = {each.name: getattr(steps[k - 1], each.name) for each in fields(Level)}
        rows.append(HistoryRow(parameters=shown, derived=means, **level))
    return tuple(rows)


def named(parameters: Sequence[Parameter], p: FloatArray) -> dict[str, float]:
    """Values by name, periodic ones in their first period.

    Args:
        parameters: what the values belong to.
        p: values (n,), each in its parameter's unit.
    """
    shown = canonical(parameters, p)
    return {q.name: float(value) for q, value in zip(parameters, shown, strict=True)}


def alternative_results(
    objectives: Sequence[Objective],
    outcomes: Sequence[Outcome],
    settings: Sequence[Mapping[str, Scalar]],
    reported: int,
) -> tuple[AlternativeResult, ...]:
    """One record per alternative that got anywhere, the reported one marked.

    Args:
        objectives: one per alternative.
        outcomes: what came of each alternative, in the same order.
        settings: of each alternative, by name.
        reported: number of the alternative that is reported.
    """
    least = outcomes[reported].best
    best_j = least.steps[-1].j if least is not None else float("inf")
    results = []
    for k, (objective, outcome) in enumerate(zip(objectives, outcomes, strict=True)):
        chain = outcome.best
        if chain is None:
            continue
        last = chain.steps[-1]
        outputs = objective.response.derived_many([np.array(last.parameters)])[0]
        results.append(
            AlternativeResult(
                settings=dict(settings[k]),
                parameters=named(objective.parameters, np.array(last.parameters)),
                derived={name: mean(values) for name, values in outputs.items()},
                j_fit=last.j_fit,
                j_reg=last.j_reg,
                status=last.status,
                message=f"{last.message}; {chain.ended}" if chain.ended else last.message,
                reported=k == reported,
                equal_to_best=equal_j(last.j, best_j),
                starts=tuple(_start(objective, c, chain) for c in outcome.chains if c.steps),
                search=_search(outcome),
            )
        )
    return tuple(results)


def _start(objective: Objective, chain: Chain, best: Chain) -> StartResult:
    """Where a start led; `equivalent` where J and the simulated rows are those of the best."""
    last, top = chain.steps[-1], best.steps[-1]
    return StartResult(
        begun=named(objective.parameters, to_model(objective.parameters, np.array(chain.begun))),
        parameters=named(objective.parameters, np.array(last.parameters)),
        j_fit=last.j_fit,
        j_reg=last.j_reg,
        levels=len(chain.steps),
        joined=chain.joined,
        ended=chain.ended,
        equivalent=chain is best or chain.joined is not None or equal_j(last.j, top.j),
    )


def _search(outcome: Outcome) -> SearchResult | None:
    search = outcome.search
    if search is None:
        return None
    low, others = search.apart_by_height()
    return SearchResult(
        screened=search.screened,
        screens=search.screens,
        descents=search.descents,
        ended=sum(minimum.descents for minimum in low),
        higher=sum(minimum.descents for minimum in others),
        chi_square=low[0].chi_square if low else math.nan,
        next_chi_square=others[0].chi_square if others else math.nan,
        explained=search.explained,
        twins=len(outcome.twins),
        evaluations=search.evaluations,
        fmu_runs=search.runs,
    )
