"""The plan of a campaign with the FMU at hand: what it says of itself, measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitting.campaign import BoundCampaign, Experiment
from fitting.campaign.parameters import references, starts
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.variables import VariableLike
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.planning import Plan, known_width_hz, plan_campaign, with_windows
from fitting.measurements.sweep import swept_amplitudes
from fitting.signal.scale import FINE_POINTS, Maximum, bend_of, refine_maximum
from fitting.simulate.batch import Workers
from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, Knowledge, PlanOptions, plan_drives
from fitting.simulate.settling import SAFETY
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure

#: Seeded points of the box that are tried beside start and reference, where nothing has to settle.
SEEDED = 3
#: A fit may try less damping than there is at start and reference: time to settle, times this.
LESS_DAMPING = 2.0
#: Spacings of three sweep points that are tried, in those of five.
SPACINGS = (0.5, 0.25, 0.12)


def measured_plan(
    bound: BoundCampaign,
    workers: Workers,
    variables: Mapping[str, VariableLike],
    own: AccuracyAnnotation | None = None,
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
    model = DrivenModel(bound.setup, bound.parameters, draft, bound.alternatives[0])
    drives = _drives(bound, model, workers)
    if not drives:
        return draft
    annotation = _applicable(bound, bound.setup.annotation.over(own or AccuracyAnnotation()))
    found = plan_drives(
        drives,
        bound.setup.accuracy,
        workers,
        Knowledge(annotation, variables),
        PlanOptions(examples=True),
    )
    settle_s = _settle_s(bound, found, draft)
    drive = bound.setup.drive
    drive = replace(drive, order=max(drive.order, found.order))
    bound = replace(bound, setup=replace(bound.setup, drive=drive))
    plan = with_windows(bound, settle_s, _with_settling(found, settle_s), found.settings)
    return _few_nodes(bound, replace(model, setup=bound.setup, plan=plan), workers)


def _applicable(bound: BoundCampaign, annotation: AccuracyAnnotation) -> AccuracyAnnotation:
    """The annotation without what the campaign itself fits, tries or sets per experiment."""
    own = {p.target for p in bound.parameters} | {n for p in bound.parameters for n in p.adds_to}
    own |= set(bound.alternatives[0]) | {n for e in bound.experiments for n in e.settings}
    kept = tuple(r for r in annotation.reductions if own.isdisjoint(r.set))
    names = {r.name for r in kept}
    return replace(
        annotation,
        reductions=kept,
        force=tuple(n for n in annotation.force if n in names),
        forbid=tuple(n for n in annotation.forbid if n in names),
    )


def _settle_s(bound: BoundCampaign, found: DrivePlan, draft: Plan) -> float:
    if bound.setup.steady_start or found.settle_s == 0.0:
        return found.settle_s
    stated = draft.settle_s if known_width_hz(bound) is not None else 0.0
    return max(stated, LESS_DAMPING * found.settle_s)


def _with_settling(found: DrivePlan, settle_s: float) -> Budget:
    """The budget with the settling that is planned, which is longer than what was measured.

    The windows are those of the campaign's experiments, which are decided on by themselves.
    """
    kept = (d for d in found.budget.decisions if d.kind != Kind.WINDOW)
    decisions = tuple(_longer(d, settle_s) for d in kept)
    return Budget(found.budget.wanted, decisions)


def _longer(decision: Decision, settle_s: float) -> Decision:
    seen_s = decision.numbers.get("settle_s")
    if decision.kind != Kind.SETTLING or seen_s is None or seen_s == settle_s:
        return decision
    basis = Basis.UNSTEADY if decision.basis == Basis.UNSTEADY else Basis.LESS_DAMPING
    numbers = {"settle_s": settle_s, "seen_s": seen_s}
    return replace(decision, basis=basis, numbers=numbers)


def _few_nodes(bound: BoundCampaign, model: DrivenModel, workers: Workers) -> Plan:
    """The plan with three sweep points instead of five, where they are proven to do.

    1/A^2 is a quartic through the five points at start and reference; its third derivative over
    its second, times a safety factor, bounds what a parabola through three points may be off by.
    """
    plan = model.plan
    if (
        bound.sweep is None
        or len(plan.nodes_hz) != FINE_POINTS
        or plan.maximum_bias is None
        or plan.budget is None
    ):
        return plan
    nodes = np.array(plan.nodes_hz)
    points = [starts(bound.parameters), _reference(bound)]
    settings = bound.sweep.settings
    found = [bend_of(nodes, swept_amplitudes(model, settings, p, nodes, workers)) for p in points]
    bend = SAFETY * max(bend for bend, _ in found)
    if not np.isfinite(bend):
        return plan
    for part in SPACINGS:
        three = nodes[2] + part * (nodes[3] - nodes[2]) * np.array([-1.0, 0.0, 1.0])
        tops = [_top(three, nodes[2], c, bend) for _, c in found]
        if all(top.bracketed and top.bias <= 0.5 * plan.maximum_bias for top in tops):
            return _with_three(plan, three, bend)
    return plan


def _top(three: FloatArray, centre: float, quartic: FloatArray, bend: float) -> Maximum:
    y = np.polynomial.Polynomial(quartic)(three - centre)
    return refine_maximum(three, 1.0 / np.sqrt(np.maximum(y, np.finfo(float).tiny)), bend)


def _with_three(plan: Plan, three: FloatArray, bend: float) -> Plan:
    """The plan with these sweep points, and the decision with them."""
    if plan.budget is None or plan.maximum_bias is None:
        return plan
    (before,) = plan.budget.of(Kind.MAXIMUM)
    numbers = {
        "points": three.size,
        "spacing_hz": float(three[1] - three[0]),
        "centre_hz": float(three[1]),
        "bend": bend,
        "safety": SAFETY,
    }
    decision = replace(before, numbers=numbers)
    others = [d for d in plan.budget.decisions if d.kind != Kind.MAXIMUM]
    return replace(
        plan,
        nodes_hz=tuple(map(float, three)),
        maximum_bend=bend,
        budget=Budget(plan.budget.wanted, (*others, decision)),
    )


def _reference(bound: BoundCampaign) -> FloatArray:
    lower = np.array([p.lower for p in bound.parameters])
    upper = np.array([p.upper for p in bound.parameters])
    return np.clip(references(bound.parameters), lower, upper)


def _drives(bound: BoundCampaign, model: DrivenModel, workers: Workers) -> tuple[Drive, ...]:
    """Drives to measure with: first and last experiment (or sweep point), at some points."""
    parameters = bound.parameters
    lower = np.array([p.lower for p in parameters])
    upper = np.array([p.upper for p in parameters])
    points = [starts(parameters), _reference(bound)]
    if bound.setup.steady_start:
        rng = np.random.default_rng(bound.continuation.seed)
        points += list(rng.uniform(lower, upper, (SEEDED, len(parameters))))
    drives: list[Drive] = []
    for k, point in enumerate(points):
        these = [_drive(model, point, e) for e in _ends(bound.experiments)]
        these = these or _swept_drives(bound, model, point)
        if k > 0 and not _runs(these, workers):
            continue  # the FMU may refuse a part of the box
        drives += these
    return tuple(drives)


def _ends(experiments: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
    return experiments[:1] if len(experiments) < 2 else (experiments[0], experiments[-1])


def _drive(model: DrivenModel, p: FloatArray, experiment: Experiment) -> Drive:
    drive = model.setup.drive
    return Drive(
        start_values=model.values(p, experiment.label, experiment.settings),
        tones_hz=tuple(experiment.tones_hz),
        outputs=(experiment.output or model.setup.output,),
        input=drive.input if drive.kind == "input" else None,
        level=drive.level,
        steps_per_period=drive.samples_per_period,
        read_hz=tuple(experiment.read_hz),
        order=drive.order,
    )


def _swept_drives(bound: BoundCampaign, model: DrivenModel, p: FloatArray) -> list[Drive]:
    """First, largest and last point of a sweep that is fitted by itself."""
    sweep, drive = bound.sweep, model.setup.drive
    if sweep is None:
        return []
    top = sweep.frequency_hz[int(np.argmax(sweep.amplitude_v))]
    return [
        Drive(
            start_values=model.single_tone_values(p, sweep.settings, tone),
            tones_hz=(tone,),
            outputs=(model.setup.output,),
            input=drive.input if drive.kind == "input" else None,
            level=drive.level,
            steps_per_period=drive.samples_per_period,
            order=drive.order,
        )
        for tone in map(float, dict.fromkeys((sweep.frequency_hz[0], top, sweep.frequency_hz[-1])))
    ]


def _runs(drives: list[Drive], workers: Workers) -> bool:
    try:
        workers.run([drive.run(drive.window(0.0), {}) for drive in drives])
    except FmuFailure:
        return False
    return True
