"""The plan of drives: settling, window, solver and model for a wanted accuracy, each measured.

Nothing is assumed of the FMU. Each error is the change that a better setting makes, times a safety
factor that its decision names, so the promise holds as far as a change tells of what is left. What
runs cost is counted (`fitting.simulate.probe`), so that a plan is the same on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from fitting.fmu.accuracy import Reduction
from fitting.signal.grid import ANY_TIME, Grid
from fitting.simulate.batch import Workers
from fitting.simulate.budget import SHARES, Basis, Budget, Decision, Kind
from fitting.simulate.cost import CHEAPER
from fitting.simulate.drive import Drive
from fitting.simulate.drive_plan import DrivePlan, window_decision
from fitting.simulate.knowledge import Knowledge
from fitting.simulate.own_step import (
    accepted_grid,
    first_steps,
    grid_decision,
    grids,
    refined_steps,
    rests_on_steps,
    steps_decision,
)
from fitting.simulate.probe import Probe, Reading
from fitting.simulate.reductions import (
    forbidden,
    model_decision,
    no_cheaper,
    not_taken,
    refused,
    roughly,
    with_numbers,
)
from fitting.simulate.settling import (
    QUIET,
    SAFETY,
    Settled,
    settle,
    settle_as_prescribed,
    settling_decision,
)
from fitting.simulate.solver_parameter import SolverParameter
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer
from fitting.text.notation import hertz
from fitting.text.units import checked_accuracy

#: Combinations of the tones that do not fold onto a tone, tried in this order.
ORDERS = (1, 5, 11, 21, 41)
#: A tolerance is tried from so many times its share on, where the very run that is planned tells.
COARSE = 400.0
#: Held steps of an input in a period, at most.
MOST_HELD = 640
#: Communication steps and substeps of a run, at most: some twenty seconds of an FMU in Python.
MOST_WORK = 2e6
#: A run that costs so many times that is not made at all.
HOPELESS = 20.0
#: Periods after which a step is looked at by which an FMU may be integrated.
FIRST_PERIODS = 10.0
#: Of what a run may cost, the part that is spent on an accuracy that nobody has asked for.
BEARABLE = 0.05
#: How much longer they may settle at such steps than they were seen to without these.
SOON = 64.0
#: Substeps in a period of the fastest tone, to begin with; halvings from there at most; and the
#: change of an amplitude by the next one that a search for the time to settle can bear.
PER_PERIOD, HALVINGS, COARSE_SUBSTEP = 40.0, 20, 0.01
#: Amplitudes repeat better at an FMU's own steps where they do so by this factor.
BETTER = 0.1
#: What bounds rest on that no other setting of a plan makes smaller.
LIMITED_BY_FMU = (Basis.REPEATED, Basis.COMPARED, Basis.ORDER)


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """What a plan is for.

    `examples`: the drives are examples of many that are to come, as a fit tries them; else they are
    the very runs that are planned, and then what a run shows may stand for a bound that holds
    beyond it. `of_largest`: errors are relative to the largest amplitude of all drives, else to
    each. `settle_s`: the user's own time to settle. `work`, `longest_settle_s`: most that a run may
    cost, and longest time to settle that is looked for. `fixed`: parameters that the user has set,
    which the plan leaves as they are. `usual`: nobody has asked for the accuracy; then it is what
    the FMU can give, where that is less.
    """

    examples: bool = False
    of_largest: bool = False
    settle_s: float | None = None
    work: float = MOST_WORK
    longest_settle_s: float = math.inf
    fixed: frozenset[str] = frozenset()
    usual: bool = False


def plan_drives(
    drives: Sequence[Drive],
    accuracy: float,
    workers: Workers,
    known: Knowledge,
    options: PlanOptions | None = None,
) -> DrivePlan:
    """Plan drives of an FMU for amplitudes with a wanted relative accuracy, by measuring.

    One time to settle, one setting of solver and model for all `drives`. No run that costs more
    than the options allow is planned: where the accuracy would need one, the budget promises less
    than was wanted. No clock is read: the same arguments give the same plan.

    Args:
        drives: each with tones and amplitudes.
        accuracy: relative error that is wanted.
        workers: processes that run the FMU.
        known: what is known of the FMU beforehand.
        options: what is fixed beforehand.

    Raises:
        BadInput: an accuracy out of range, tones that cannot be told apart, outputs that do not
            oscillate, names that the FMU does not have, a drive whose shortest run costs too much.
        FmuFailure: the FMU failed.
    """
    checked_accuracy(accuracy, "accuracy")
    return _Planner(tuple(drives), accuracy, workers, known, options or PlanOptions()).plan()


class _Planner:
    """Decides for some drives what keeps an accuracy at the least work that was seen."""

    def __init__(
        self,
        drives: tuple[Drive, ...],
        accuracy: float,
        workers: Workers,
        known: Knowledge,
        options: PlanOptions,
    ) -> None:
        self.annotation, self.variables = known.annotation, known.variables
        self.accuracy, self.options = accuracy, options
        self.probe = Probe(
            drives=drives,
            workers=workers,
            substep=self.annotation.substep,
            tolerance=self.annotation.tolerance,
            of_largest=options.of_largest,
            exchange=known.exchange,
        )
        self.budget = Budget(accuracy)
        self.known = known
        self.longest_settle_s = options.longest_settle_s
        self._settled: dict[object, Settled] = {}
        self._substeps: dict[object, float | None] = {}

    def plan(self) -> DrivePlan:
        """All decisions, one after the other."""
        fixed = self.options.fixed
        settings = {k: v for k, v in self.annotation.full.items() if k not in fixed}
        self._ask_where_it_may_be_asked(settings)
        settings = self._reductions(settings)
        self.probe.shorten_windows(settings)
        settled = self._aligned(settings, self._settle(settings))
        forced = [d.subject for d in self.budget.of(Kind.MODEL) if d.taken and d.forced]
        _require_oscillation(self.probe.drives, settled.last, forced)
        self._add(settling_decision(settled))
        place = len(self.budget.decisions)
        settings = self._solver(settings, settled.settle_s)
        self._steps(settings, settled.settle_s)
        self._input(settings, settled.settle_s)
        order, readings = self._samples(settings, settled.settle_s)
        rounding = max(reading.rounding for reading in readings)
        self._add(Decision(kind=Kind.ROUNDING, basis=Basis.DOUBLE, bound=rounding))
        longest_s = self.probe.longest_s
        windows = tuple(d.window(settled.settle_s, order, longest_s) for d in self.probe.drives)
        decisions = list(self.budget.decisions)
        decisions.insert(place, window_decision(windows))
        return DrivePlan(
            drives=self.probe.drives,
            settings=settings,
            windows=windows,
            readings=tuple(readings),
            budget=self._agreed(Budget(self.accuracy, tuple(decisions))),
            settle_s=settled.settle_s,
            order=order,
            longest_s=longest_s,
        )

    def _add(self, decision: Decision) -> None:
        self.budget = self.budget.with_decision(decision)

    def _share(self, kind: Kind) -> float:
        return self.accuracy * SHARES[kind]

    # -- settling -------------------------------------------------------------------------------

    def _settle(self, settings: Mapping[str, Scalar]) -> Settled:
        key = tuple(sorted(settings.items()))
        if key not in self._settled:
            work = self.probe.work(settings, 0.0)
            if work > HOPELESS * self.options.work:
                raise BadInput(
                    f"tones {hertz(*self.probe.drives[0].tones_hz)}: a run over one window takes "
                    f"{work:.1e} steps of the FMU, wanted at most {self.options.work:.1e}; "
                    "wanted a longer substep or tones with a shorter common period"
                )
            fine = {**settings, **self._fine(settings)}
            result = settle(
                self.probe,
                fine,
                self._share(Kind.SETTLING),
                self.options.work,
                self.longest_settle_s,
            )
            if self.options.settle_s is not None:
                result = settle_as_prescribed(self.probe, fine, self.options.settle_s, result)
            self._settled[key] = result
        return self._settled[key]

    def _fine(self, settings: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """A solver fine enough that its own error is not taken for a transient."""
        result: dict[str, Scalar] = {}
        name = self.annotation.tolerance
        if name is not None and name not in settings and name not in self.options.fixed:
            low, high = self._range(name)
            result[name] = min(max(0.1 * self._share(Kind.SETTLING), low), high)
        name = self.annotation.substep
        if name is not None and name not in settings and name not in self.options.fixed:
            value = self._fine_substep(name, {**settings, **result})
            if value is not None:
                result[name] = value
        return result

    def _fine_substep(self, name: str, settings: Mapping[str, Scalar]) -> float | None:
        """The longest substep by which the FMU is integrated at all; None: it does not act.

        Halved from a fortieth of a period, or from the FMU's own where that is shorter, until half
        of it changes a short run little: what it starts with, 0 for one, may be none at all.
        """
        key = tuple(sorted(settings.items()))
        if key not in self._substeps:
            acts = self.probe.acts_as_substep(settings)
            value = self._first_substep(name)
            for _ in range(HALVINGS if acts else 0):
                if self.probe.substep_error(settings, value) <= COARSE_SUBSTEP:
                    break
                value *= 0.5
            self._substeps[key] = value if acts else None
        return self._substeps[key]

    def _first_substep(self, name: str) -> float:
        """A fortieth of a period of the fastest tone, or the FMU's own start where that is less."""
        variable, first = self.variables.get(name), 1.0 / (PER_PERIOD * self.probe.fastest_hz)
        own = float(self.probe.drives[0].start_values.get(name, 0.0))
        own = own or float(getattr(variable, "start", None) or 0.0)
        return min(own, first) if own > 0.0 else first

    # -- steps of the FMU's own -----------------------------------------------------------------

    def _ask_where_it_may_be_asked(self, settings: Mapping[str, Scalar]) -> None:
        """Go by a fixed step that is declared, and by steps that the FMU takes and integrates by.

        An FMU that names what sets its accuracy, or what it may leave out, is taken to bear any.
        """
        step_s = self.known.step_s
        if self.known.fixed_step and step_s is not None:
            self._go_by(Grid(step_s=step_s), Basis.FIXED_STEP)
            return
        if not self.probe.foreign or self.annotation.reductions:
            return
        try:
            self.probe.read(settings, 0.0)
        except NoAnswer:
            raise
        except FmuFailure:
            grid = accepted_grid(step_s, self.probe, settings)
            if grid is None:
                raise
            self._go_by(grid, Basis.OTHER_STEPS, is_declared=grid.step_s == step_s)
            return
        if rests_on_steps(self.probe, settings, QUIET * self._share(Kind.SOLVER)):
            first_s = FIRST_PERIODS / self.probe.fastest_hz
            first = first_steps(self.probe, settings, first_s, self.options.work)
            if first is not None:
                self.probe = self.probe.on(first)

    def _go_by(self, grid: Grid, basis: Basis, **numbers: Scalar) -> None:
        self.probe = self.probe.on(grid)
        self._settled.clear()
        self._add(grid_decision(grid, basis, numbers))

    def _aligned(self, settings: Mapping[str, Scalar], settled: Settled) -> Settled:
        """What settles, asked at steps of the FMU's own where amplitudes repeat only at these."""
        if not settled.repeats or self.probe.drives[0].grid != ANY_TIME:
            return settled
        free, step_s, most_s = self.probe, self.known.step_s, self.longest_settle_s
        # where samples are at the right times, amplitudes stand still soon
        soon_s = SOON * max(settled.settle_s, FIRST_PERIODS / free.fastest_hz)
        self.longest_settle_s = min(most_s, soon_s)
        for grid in grids(step_s, free, settings):
            self.probe = free.on(grid)
            self._settled.clear()
            try:
                result = self._settle(settings)
            except (BadInput, FmuFailure):  # no samples on this grid tell the tones apart
                continue
            if result.steady and result.repeats < BETTER * settled.repeats:
                is_declared = grid.step_s == step_s
                numbers = {"repeats": settled.repeats, "is_declared": is_declared}
                self._add(grid_decision(grid, Basis.OWN_STEP, numbers))
                self.longest_settle_s = most_s
                return result
        self.probe, self.longest_settle_s = free, most_s
        self._settled.clear()
        return settled

    def _steps(self, settings: Mapping[str, Scalar], settle_s: float) -> None:
        """How long the communication steps may be of an FMU that integrates by them."""
        if not self.probe.drives[0].grid.longest_s:
            return
        work = self.options.work * (BEARABLE if self.options.usual else 1.0)
        limits = self._share(Kind.SOLVER), work
        steps = refined_steps(self.probe, settings, settle_s, limits)
        self.probe = self.probe.on(steps.grid)
        self._add(steps_decision(steps, [drive.fastest_hz for drive in self.probe.drives]))

    def _agreed(self, budget: Budget) -> Budget:
        """The budget, with what this FMU can give where nobody has asked for an accuracy."""
        own = (Kind.SETTLING, Kind.STEP, Kind.INPUT)
        limits = [d for d in budget.decisions if d.kind in own and d.basis in LIMITED_BY_FMU]
        if not self.options.usual or budget.kept or sum(d.bound for d in limits) <= budget.wanted:
            return budget
        given = float(f"{1.05 * budget.promised:.1e}")
        if given >= 1.0:
            return budget
        limit = max(limits, key=lambda d: d.bound)
        usual = Decision(
            kind=Kind.ACCURACY,
            basis=Basis.USUAL,
            bound=0.0,
            numbers={"usual": budget.wanted, "given": given, "by": str(limit.kind)},
        )
        return Budget(given, (usual, *budget.decisions))

    # -- the solver's own accuracy --------------------------------------------------------------

    def _solver(self, settings: dict[str, Scalar], settle_s: float) -> dict[str, Scalar]:
        for name, first in self._solver_parameters(settings):
            settings = self._refined(settings, settle_s, name, first)
        return settings

    def _solver_parameters(self, settings: Mapping[str, Scalar]) -> list[tuple[str, float]]:
        """Parameters that set the solver's accuracy, with a first value for each."""
        result: list[tuple[str, float]] = []
        if self.annotation.tolerance is not None:
            coarse = 1.0 if self.options.examples else COARSE
            result.append((self.annotation.tolerance, coarse * self._share(Kind.SOLVER)))
        if self.annotation.substep is not None:
            result.append((self.annotation.substep, self._first_substep(self.annotation.substep)))
        return [(name, value) for name, value in result if name not in settings]

    def _range(self, name: str) -> tuple[float, float]:
        variable = self.variables.get(name)
        low = variable.min if variable is not None else None
        high = variable.max if variable is not None else None
        return max(low or 0.0, 1e-300), math.inf if high is None else high

    def _solver_parameter(self, name: str) -> SolverParameter:
        low, high = self._range(name)
        tolerance = name == self.annotation.tolerance
        return SolverParameter(
            name=name,
            low=low,
            high=high,
            part=0.01 if tolerance else 0.5,
            order=1.0 if tolerance else 4.0,
            probe=self.probe,
            work=self.options.work,
        )

    def _refined(
        self, settings: dict[str, Scalar], settle_s: float, name: str, first: float
    ) -> dict[str, Scalar]:
        """The coarsest value whose measured error fits into the share; or the user's own value."""
        parameter = self._solver_parameter(name)
        if name in self.options.fixed:
            own = float(self.probe.drives[0].start_values.get(name, 0.0)) or first
            bound, value = parameter.error_at(settings, settle_s, own), own
        else:
            bound, value = parameter.coarsest(settings, settle_s, first, self._share(Kind.SOLVER))
        if bound < 0.0:
            return settings
        forced = name in self.options.fixed
        chosen: dict[str, Scalar] = {} if forced else {name: value}
        self._add(
            Decision(
                kind=Kind.SOLVER,
                basis=Basis.PRESCRIBED if forced else Basis.COMPARED,
                bound=bound,
                subject=name,
                numbers={"safety": SAFETY, "part": parameter.part},
                settings={name: value},
                forced=forced,
            )
        )
        return {**settings, **chosen}

    def _input(self, settings: Mapping[str, Scalar], settle_s: float) -> None:
        """How long a generated input is held: images of the staircase fold onto the tones."""
        if self.known.exchange or all(drive.input is None for drive in self.probe.drives):
            return  # in model exchange it is no staircase
        share, chosen, bound = self._share(Kind.INPUT), self.probe.drives, math.inf
        here = self.probe.read(settings, settle_s)
        while bound > share and self.probe.finer_input(MOST_HELD):
            better = self.probe.read(settings, settle_s)
            bound = SAFETY * self.probe.errors(here, better)
            if bound <= share or self.options.examples:
                break
            chosen, here = self.probe.drives, better
        self.probe.go_on(chosen)
        steps = self.probe.held_per_period(settle_s)
        if steps is None:  # over steps of the FMU's own, between which it sees no input
            return
        self._add(
            Decision(
                kind=Kind.INPUT,
                basis=Basis.COMPARED,
                bound=bound,
                numbers={"steps_per_period": steps, "safety": SAFETY},
            )
        )

    # -- samples --------------------------------------------------------------------------------

    def _samples(
        self, settings: Mapping[str, Scalar], settle_s: float
    ) -> tuple[int, list[Reading]]:
        """The least order of combinations kept off the tones at which more change nothing."""
        share = self._share(Kind.SAMPLES)
        result = ORDERS[0], ORDERS[0], math.inf
        for order, finer in pairwise(ORDERS):
            try:
                here = self.probe.read(settings, settle_s, order)
                better = self.probe.read(settings, settle_s, finer)
            except BadInput:  # no sampling keeps so many lines off the tones
                break
            result = order, finer, SAFETY * self.probe.errors(here, better)
            if result[2] <= share:
                break
        order, finer, bound = result
        longest_s = self.probe.longest_s
        counts = [d.window(settle_s, order, longest_s).samples for d in self.probe.drives]
        self._add(
            Decision(
                kind=Kind.SAMPLES,
                basis=Basis.COMPARED,
                bound=bound,
                numbers={
                    "least": min(counts),
                    "most": max(counts),
                    "order": order,
                    "finer": finer,
                    "safety": SAFETY,
                },
            )
        )
        return order, self.probe.read(settings, settle_s, order)

    # -- reductions of the model ----------------------------------------------------------------

    def _reductions(self, settings: dict[str, Scalar]) -> dict[str, Scalar]:
        spent, chosen = 0.0, set(self.options.fixed)
        for reduction in self.annotation.reductions:
            if not chosen.isdisjoint(reduction.set) or not self._changes(settings, reduction):
                continue
            decision = self._reduction(settings, reduction, self._share(Kind.MODEL) - spent)
            self._add(decision)
            if decision.taken:
                settings = {**settings, **reduction.set}
                chosen |= set(reduction.set)
                spent += decision.bound
        return settings

    def _reduction(
        self, settings: dict[str, Scalar], reduction: Reduction[Scalar], left: float
    ) -> Decision:
        """Whether a reduction is taken: an evaluation gets cheaper by it, and its error fits."""
        if reduction.name in self.annotation.forbid:
            return forbidden(reduction)
        forced = reduction.name in self.annotation.force
        reduced = {**settings, **reduction.set}
        try:
            self.probe.shorten_windows(reduced)
            after = self._settle(reduced)
            part = 0.0 if forced else self._part(settings, reduced, reduction, after)
            # what does not pay is not examined; an exact start has no price but time
            if part > (1.0 if self._closes(reduction, after) else CHEAPER):
                return no_cheaper(reduction)
            decision = with_numbers(self._effect(settings, reduction, after), left=left)
        except FmuFailure as error:
            if forced or isinstance(error, NoAnswer):
                raise
            return refused(reduction, error.message)
        if forced:
            return replace(decision, forced=True)
        if decision.bound > left and not self._too_long(settings):
            return not_taken(decision)
        return with_numbers(decision, times_cheaper=roughly(1.0 / part))

    @staticmethod
    def _closes(reduction: Reduction[Scalar], after: Settled) -> bool:
        """Whether a reduction is an exact start: of the state alone, and its orbit closes."""
        return reduction.start and after.steady and after.settle_s == 0.0

    def _part(
        self,
        settings: Mapping[str, Scalar],
        reduced: Mapping[str, Scalar],
        reduction: Reduction[Scalar],
        after: Settled,
    ) -> float:
        """Processor time of an evaluation with a reduction, over that without it.

        Without it runs settle as long as they are known to need; where that is not known, it is
        asked only if the reduction has no bound of the FMU's: what else would it be compared with?
        """
        if not (self._too_long(settings) or self._bound_outputs(reduction)):
            self._settle(settings)
        key = tuple(sorted(settings.items()))
        known = self._settled.get(key, after)
        work = self.probe.work(reduced, after.settle_s)
        counted = reduction.cost * work / self.probe.work(settings, known.settle_s)
        if reduction.cost >= 1.0 and counted > CHEAPER:  # stated to save nothing at equal steps
            return counted
        ratio = self.probe.cost_ratio((reduced, after.settle_s), (settings, known.settle_s))
        return counted if ratio is None else ratio

    def _effect(
        self, settings: dict[str, Scalar], reduction: Reduction[Scalar], after: Settled
    ) -> Decision:
        """A reduction with its bound: what the FMU states, else the change that it makes.

        One that sets the start state alone leaves the model whole: where the orbit closes, that is
        the response, and a comparison from rest, which keeps a transient of its own, shows only
        whether it is the same one of several.
        """
        reduced = {**settings, **reduction.set}
        names = self._bound_outputs(reduction)
        if names:
            fine = {**reduced, **self._fine(reduced)}
            bound = max(self.probe.largest(fine, after.settle_s, name) for name in names)
            # relative to the strongest line of an output, while a promise holds for the weakest
            bound *= max(reading.spread for reading in after.last)
            decision = model_decision(reduction, Basis.STATED, bound)
            return with_numbers(decision, outputs=" and ".join(names))
        closes = self._closes(reduction, after)
        whole = None if self._too_long(settings) else self._settle(settings)
        if whole is None or (closes and not whole.steady):
            basis, bound = (Basis.CLOSED, 0.0) if closes else (Basis.UNMEASURED, math.inf)
            return model_decision(reduction, basis, bound)
        bound = SAFETY * self.probe.errors(after.last, whole.last) + whole.bound
        if closes and bound <= SAFETY * (SAFETY * whole.bound + self._share(Kind.MODEL)):
            return model_decision(reduction, Basis.CLOSED, 0.0)
        return with_numbers(model_decision(reduction, Basis.COMPARED, bound), safety=SAFETY)

    def _too_long(self, settings: Mapping[str, Scalar]) -> bool:
        """Whether a settled run costs more than allowed."""
        return self._work(settings) > self.options.work

    def _bound_outputs(self, reduction: Reduction[Scalar]) -> list[str]:
        """Outputs that bound a reduction, for what is read; none where the FMU has not all."""
        if reduction.bound is None:
            return []
        outputs = {name for drive in self.probe.drives for name in drive.outputs}
        names = sorted({reduction.bound.replace("{output}", name) for name in outputs})
        return names if all(name in self.variables for name in names) else []

    def _changes(self, settings: Mapping[str, Scalar], reduction: Reduction[Scalar]) -> bool:
        """Whether a reduction sets anything that is not so already."""
        return any(
            {**drive.start_values, **settings}.get(name) != value
            for drive in self.probe.drives
            for name, value in reduction.set.items()
        )

    def _work(self, settings: Mapping[str, Scalar]) -> float:
        """Work of a settled run; by the time that another setting needs, where none is known."""
        key = tuple(sorted(settings.items()))
        if key in self._settled:
            return self.probe.work(settings, self._settled[key].settle_s)
        others = [settled.settle_s for settled in self._settled.values()]
        return self.probe.work(settings, max(others, default=0.0))


def _require_oscillation(
    drives: Sequence[Drive], readings: Sequence[Reading], forced: Sequence[str]
) -> None:
    for drive, reading in zip(drives, readings, strict=True):
        if all(reading.constant):
            pairs = zip(drive.outputs, reading.mean, strict=True)
            stated = ", ".join(f"{name} is constant at {float(v):.9g}" for name, v in pairs)
            cause = "does the drive reach the observed output?"
            if forced:
                cause = f"forced: {', '.join(forced)}, which may leave out what is observed"
            raise BadInput(
                f"outputs: {stated}; wanted one that oscillates under the drive ({cause})"
            )
