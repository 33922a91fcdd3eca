"""How a series of measurements is planned: from its own settings, and with the FMU."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.parameters import Parameter, axis_ends, bounds, planning_points, starts
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import Measurement
from fitting.measurements.plan import Plan
from fitting.measurements.residuals import accuracy_for
from fitting.simulate.batch import Batch, Workers, answered, together
from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, PlanOptions, plan_drives
from fitting.simulate.probe import CHEAPER, Knowledge, Probe, cost_ratio
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

#: Part of the wanted accuracy that a transient planned from a line width may leave.
TRANSIENT = 0.1
#: Seeded points of the box that are tried besides start and reference, where nothing has to settle.
SEEDED = 3
#: A fit may try less damping than there is at start and reference: time to settle, times this.
LESS_DAMPING = 2.0


@dataclass(frozen=True)
class Series:
    """Measurements that are planned together, and the parameters that they are fitted with.

    `alternative` are start values of one discrete alternative; `seed` that of points of the box.
    """

    measurements: tuple[Measurement, ...]
    parameters: tuple[Parameter, ...]
    _: KW_ONLY
    alternative: Mapping[str, Scalar] = field(default_factory=dict)
    seed: int = 1

    @property
    def setup(self) -> Setup:
        """How all of them drive the FMU."""
        return self.measurements[0].setup

    @cached_property
    def noise(self) -> float:
        """Relative standard deviation of the least noisy datum; zero where none is known."""
        return min((n for m in self.measurements if (n := m.datum_noise) > 0.0), default=0.0)

    @property
    def accuracy(self) -> float:
        """Wanted relative accuracy: the campaign's, else that for the noise, else the usual one."""
        of_noise = accuracy_for([self.noise]) if self.setup.usual_accuracy else None
        return self.setup.accuracy if of_noise is None else of_noise

    @property
    def goal(self) -> Budget:
        """The budget of that accuracy, with why it is wanted where none was requested."""
        if not (self.setup.usual_accuracy and self.noise):
            return Budget(self.accuracy)
        numbers = {"given": self.accuracy, "noise": self.noise}
        why = Decision(kind=Kind.ACCURACY, basis=Basis.NOISE, bound=0.0, numbers=numbers)
        return Budget(self.accuracy, (why,))

    @property
    def line_width_hz(self) -> float | None:
        """Line width that the setup states, or that a measurement shows, Hz."""
        if self.setup.line_width_hz is not None:
            return self.setup.line_width_hz
        result = (m.line_width_hz for m in self.measurements)
        return next((width for width in result if width is not None), None)


def plan_series(series: Series) -> Plan:
    """Settling, windows and points of a series from its own settings, unmeasured.

    Args:
        series: measurements of one setup.

    Raises:
        BadInput: no way to know how long the FMU takes to settle, or tones that cannot be
            separated.
    """
    if all(m.is_trace for m in series.measurements):
        return _planned(series, Plan(0.0, budget=series.goal))
    if series.setup.drive.kind == "none":
        raise BadInput(
            f"{series.setup.source}: [drive] names neither frequencies nor an input; wanted what "
            "drives the FMU"
        )
    basis, left, numbers = Basis.DECLARED, 0.0, {"settle_s": 0.0}
    if not series.setup.steady_start:
        width = series.line_width_hz
        if width is None:
            raise BadInput(
                f"{series.setup.source}: [observe] states neither steady_start = true nor a "
                "line_width; wanted one of them, or a sweep, to know how long the FMU takes to "
                "settle"
            )
        basis, left = Basis.LINE_WIDTH, TRANSIENT * series.accuracy
        numbers = {"settle_s": settling_s(width, left), "width_hz": width}
    decision = Decision(kind=Kind.SETTLING, basis=basis, bound=left, numbers=numbers)
    draft = Plan(numbers["settle_s"], budget=series.goal.with_decision(decision))
    return _planned(series, draft)


def _planned(series: Series, plan: Plan) -> Plan:
    for measurement in series.measurements:
        plan = measurement.planned(plan)
    return plan


def settling_s(line_width_hz: float, accuracy: float) -> float:
    """Time after which a transient exp(-pi w t) is below the accuracy, s.

    Planned for half the width that was stated: a fit may try less damping than there is.

    Args:
        line_width_hz: full width of the narrowest line, Hz.
        accuracy: relative error that is wanted.

    Raises:
        ValueError: a width or an accuracy that is not positive.
    """
    if not (line_width_hz > 0.0 and 0.0 < accuracy < 1.0):
        raise ValueError(f"line width {line_width_hz!r} Hz, accuracy {accuracy!r}")
    return math.log(1.0 / accuracy) / (math.pi * 0.5 * line_width_hz)


def measured_plan(
    series: Series, workers: Workers, known: Knowledge, *, any_steps: bool = True
) -> Plan:
    """Plan of a series with settling, solver and reductions measured at start and reference.

    Where a steady start is declared, that is looked at as well, at seeded points of the box too;
    where a line width is known, the time to settle is at least the one for half of it.

    Args:
        series: measurements of one setup.
        workers: of the FMU.
        known: of the FMU; what it declares of its accuracy, where the setup has nothing.
        any_steps: whether its communication steps may differ from each other.

    Raises:
        BadInput: the series cannot be planned.
        FmuFailure: the FMU failed at the start.
    """
    draft, setup = plan_series(series), series.setup
    model = DrivenModel(
        setup=setup,
        parameters=series.parameters,
        plan=draft,
        alternative=series.alternative,
        own_step_s=known.step_s,
        any_steps=any_steps,
        integrated=known.exchange,
    )
    drives = _drives(series, model, workers)
    if not drives:
        return _refined(series, model, workers)
    annotation = _applicable(series, setup.annotation.over(known.annotation))
    known = replace(known, annotation=annotation)
    ends = [_drives_at(series, model, point) for point in axis_ends(series.parameters)]

    def planned(known: Knowledge) -> Plan:
        options = PlanOptions(examples=True, usual=setup.usual_accuracy)
        result = plan_drives(drives, series.accuracy, workers, known, options)
        while lost := _lost(result, ends, workers, known):
            known = _without(known, lost)
            result = plan_drives(drives, series.accuracy, workers, known, options)
        settle_s, budget = _with_settling(series, result, draft)
        measured = Plan(
            settle_s=settle_s,
            budget=budget,
            order=result.order,
            settings=result.settings,
            grid=result.drives[0].grid,
        )
        return _refined(series, replace(model, plan=_planned(series, measured)), workers)

    # a reduction is judged by the runs of its drives; what it makes of an evaluation of the whole
    # campaign, whose curves may then need other runs, is seen only when that is planned
    plan = planned(known)
    while plan.curves and (taken := _taken(plan)):
        known = _without(known, {taken[-1].subject})
        whole = planned(known)
        if _part(series, replace(model, plan=plan), replace(model, plan=whole), workers) < CHEAPER:
            return plan
        no_cheaper = replace(taken[-1], taken=False, basis=Basis.NO_CHEAPER, bound=math.nan)
        plan = whole.with_decision(no_cheaper)
    return plan


def _taken(plan: Plan) -> list[Decision]:
    """Reductions of the model that a plan has taken; an exact start leaves nothing out."""
    return [d for d in plan.decisions if d.is_reduction and d.basis != Basis.CLOSED]


def _without(known: Knowledge, names: Collection[str]) -> Knowledge:
    """The same of an FMU that does not declare some reductions."""
    kept = tuple(r for r in known.annotation.reductions if r.name not in names)
    return replace(known, annotation=replace(known.annotation, reductions=kept))


def _part(series: Series, reduced: DrivenModel, whole: DrivenModel, workers: Workers) -> float:
    """Processor time of an evaluation of a series at the start by one model over that by another.

    By runs where processor time is not reported.
    """
    start = starts(series.parameters)[np.newaxis]
    runs: dict[int, int] = {}

    def evaluate(model: DrivenModel) -> None:
        batch = Batch()
        tasks = [
            m.predict(replace(model, setup=m.setup), start, batch) for m in series.measurements
        ]
        answered(together(tasks), batch, workers)
        runs[id(model)] = int(batch.count(1)[0])

    try:
        ratio = cost_ratio(workers, partial(evaluate, reduced), partial(evaluate, whole))
        if ratio is not None:
            return ratio
        for model in (reduced, whole):
            evaluate(model)
    except NoAnswer:
        raise
    except FmuFailure:  # the evaluation has its own way to tell
        return 0.0
    return runs[id(reduced)] / runs[id(whole)]


def _refined(series: Series, model: DrivenModel, workers: Workers) -> Plan:
    """The model's plan with what its measurements find with the FMU at start and reference."""
    points = planning_points(series.parameters)
    plan = model.plan
    for measurement in series.measurements:
        plan = measurement.refined(replace(model, plan=plan), points, workers)
    return plan


def _applicable(series: Series, annotation: AccuracyAnnotation) -> AccuracyAnnotation:
    """The annotation without what the campaign itself fits, tries or sets."""
    own = {p.target for p in series.parameters} | {n for p in series.parameters for n in p.adds_to}
    own |= set(series.alternative)
    own |= {n for m in series.measurements for _, settings in m.places for n in settings}
    kept = tuple(r for r in annotation.reductions if own.isdisjoint(r.set))
    names = {r.name for r in kept}
    return replace(
        annotation,
        reductions=kept,
        force=tuple(n for n in annotation.force if n in names),
        forbid=tuple(n for n in annotation.forbid if n in names),
    )


def _with_settling(series: Series, result: DrivePlan, draft: Plan) -> tuple[float, Budget]:
    """The time to settle, which is longer than what was measured, and the budget with it.

    What was wanted, and why, comes first, unless it is what the FMU can give. The windows are
    those of the campaign's experiments, which are decided on by themselves.
    """
    settle_s = result.settle_s
    if not series.setup.steady_start and settle_s != 0.0:
        stated_s = draft.settle_s if series.line_width_hz is not None else 0.0
        settle_s = max(stated_s, LESS_DAMPING * settle_s)
    decisions = []
    for decision in result.budget.decisions:
        watched_s = decision.numbers.get("settle_s")
        if decision.kind == Kind.SETTLING and watched_s is not None and watched_s != settle_s:
            unsteady = decision.basis == Basis.UNSTEADY
            basis = Basis.UNSTEADY if unsteady else Basis.LESS_DAMPING
            numbers = {"settle_s": settle_s, "seen_s": watched_s}
            decision = replace(decision, basis=basis, numbers=numbers)
        decisions += [] if decision.kind == Kind.WINDOW else [decision]
    is_goal = result.budget.wanted == series.accuracy
    why = series.goal.decisions if is_goal else ()
    return settle_s, Budget(result.budget.wanted, (*why, *decisions))


def _drives(series: Series, model: DrivenModel, workers: Workers) -> tuple[Drive, ...]:
    """Drives to measure with: those of the first measurement that has any, at some points."""
    parameters = series.parameters
    points = planning_points(parameters)
    if series.setup.steady_start:
        rng = np.random.default_rng(series.seed)
        points += list(rng.uniform(*bounds(parameters), (SEEDED, len(parameters))))
    drives: list[Drive] = []
    for k, point in enumerate(points):
        these = _drives_at(series, model, point)
        if k > 0 and not _runs(these, workers):
            continue  # the FMU may refuse a part of the box
        drives += these
    phases = any(m.has_phases for m in series.measurements)
    return tuple(replace(drive, phases=phases) for drive in drives)


def _drives_at(series: Series, model: DrivenModel, point: FloatArray) -> list[Drive]:
    """Drives at a point of the first measurement that has any."""
    each = (m.drives(model, point) for m in series.measurements)
    return next((drives for drives in each if drives), [])


def _lost(
    result: DrivePlan, ends: Sequence[Sequence[Drive]], workers: Workers, known: Knowledge
) -> set[str]:
    """Reductions that leave out more elsewhere in the box than they may of what is observed.

    Which mode is next to the tones changes with the parameters: one that contributes to the output
    that is read is never left out, whatever its distance is.

    Args:
        result: a plan with its reductions.
        ends: drives at points of the box.
        workers: of the FMU.
        known: of the FMU.
    """
    lost: set[str] = set()
    for decision in result.budget.decisions:
        bounds = [r.bound for r in known.annotation.reductions if r.name == decision.subject]
        if not decision.is_reduction or decision.basis != Basis.STATED or bounds == [None]:
            continue
        most = max(decision.bound, float(decision.numbers["left"]))
        for drives in ends:
            names = {
                b.replace("{output}", n) for b in bounds if b for d in drives for n in d.outputs
            }
            probe = Probe(tuple(drives), workers, known)
            try:
                left_out = [probe.largest(result.settings, result.settle_s, n) for n in names]
            except NoAnswer:
                raise
            except FmuFailure:  # the FMU may refuse a part of the box
                continue
            if max(left_out, default=0.0) > most:
                lost.add(decision.subject)
                break
    return lost


def _runs(drives: list[Drive], workers: Workers) -> bool:
    try:
        workers.run([drive.run(drive.window(0.0), {}) for drive in drives])
    except NoAnswer:
        raise
    except FmuFailure:
        return False
    return True
