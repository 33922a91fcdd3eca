"""The plan of a campaign with the FMU at hand: what it says of itself, measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fitting.budget import Budget, Decision, Hints
from fitting.driving import FmuResponse
from fitting.errors import FmuFailure
from fitting.labdata import BoundCampaign, Experiment
from fitting.parameters import references, starts
from fitting.plan_probe import Probe, Shot, Workers
from fitting.plan_search import Found, Search
from fitting.planning import Plan, known_width_hz, plan_campaign, with_windows
from fitting.variables import VariableLike

FloatArray = npt.NDArray[np.float64]

#: Seeded points of the box that are tried beside start and reference, where nothing has to settle.
SEEDED = 3
#: A fit may try less damping than there is at start and reference: time to settle, times this.
LESS_DAMPING = 2.0
#: A run that would take longer than this is not planned, s.
LIMIT_S = 20.0


def measured_plan(
    bound: BoundCampaign,
    workers: Workers,
    variables: Mapping[str, VariableLike],
    own: Hints | None = None,
) -> Plan:
    """Plan of a campaign with settling, solver and reductions measured at start and reference.

    Where the campaign declares a steady start, that is looked at as well, at seeded points of the
    box too; where it states a line width, the time to settle is at least the one for half of it.
    `own` is what the FMU says of its accuracy where the campaign says nothing.

    Raises:
        BadInput: the campaign cannot be planned.
        FmuFailure: the FMU failed at the start.
    """
    draft = plan_campaign(bound)
    response = FmuResponse(bound, workers, draft, bound.alternatives[0])
    shots = _shots(response, workers)
    if not shots:
        return draft
    hints = bound.hints.over(own or Hints())
    search = Search(Probe(shots, workers), bound.accuracy, hints, variables, LIMIT_S)
    found = search.found()
    settle_s = _settle_s(bound, found, draft)
    drive = bound.drive
    bound = replace(bound, drive=replace(drive, order=max(drive.order, found.order)))
    return with_windows(bound, settle_s, _told_anew(found, settle_s), found.settings)


def _settle_s(bound: BoundCampaign, found: Found, draft: Plan) -> float:
    if bound.steady_start or found.settle_s == 0.0:
        return found.settle_s
    stated = draft.settle_s if known_width_hz(bound) is not None else 0.0
    return max(stated, LESS_DAMPING * found.settle_s)


def _told_anew(found: Found, settle_s: float) -> Budget:
    """The budget with the settling that is planned, which is longer than what was measured."""
    if settle_s == found.settle_s:
        return found.budget
    decisions = tuple(_longer(d, settle_s) for d in found.budget.decisions)
    return Budget(found.budget.wanted, decisions)


def _longer(decision: Decision, settle_s: float) -> Decision:
    if decision.subject != "settling":
        return decision
    why = f"{decision.choice} were seen to do: {decision.sentence}; longer for less damping"
    return replace(decision, choice=f"{settle_s:.4g} s", sentence=why)


def _shots(response: FmuResponse, workers: Workers) -> tuple[Shot, ...]:
    """Drives to measure with: first and last experiment and the sweep's top, at some points."""
    bound = response.bound
    parameters = bound.parameters
    lower = np.array([p.lower for p in parameters])
    upper = np.array([p.upper for p in parameters])
    points = [starts(parameters), np.clip(references(parameters), lower, upper)]
    if bound.steady_start:
        rng = np.random.default_rng(bound.continuation.seed)
        points += list(rng.uniform(lower, upper, (SEEDED, len(parameters))))
    shots: list[Shot] = []
    for k, point in enumerate(points):
        these = [_shot(response, point, e) for e in _ends(bound.experiments)]
        if k > 0 and not _runs(these, workers):
            continue  # the FMU may refuse a part of the box
        shots += these
    return tuple(shots)


def _ends(experiments: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
    return experiments[:1] if len(experiments) < 2 else (experiments[0], experiments[-1])


def _shot(response: FmuResponse, p: FloatArray, experiment: Experiment) -> Shot:
    drive = response.bound.drive
    held = drive.kind == "input"
    return Shot(
        response.values(p, experiment.label, experiment.settings),
        tuple(experiment.read_hz),
        (experiment.output or response.bound.output,),
        drive.input if held else None,
        drive.level,
        drive.samples_per_period if held else 0,
        tuple(experiment.tones_hz),
        drive.order,
    )


def _runs(shots: list[Shot], workers: Workers) -> bool:
    try:
        workers.run([shot.run(shot.window(0.0), {}) for shot in shots])
    except FmuFailure:
        return False
    return True
