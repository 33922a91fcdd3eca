"""The plan of drives: settling, window, solver and model for a wanted accuracy, each measured.

Nothing is assumed of the FMU. Each error is the change that a better setting makes, times a safety
factor that its decision names, so the promise holds as far as a change shows what is left. What
runs cost is counted (`fitting.simulate.probe`), so that a plan is the same on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

from fitting.fmu.accuracy import Reduction
from fitting.fmu.runs import Run
from fitting.signal.grid import ANY_TIME, Grid
from fitting.signal.window import Window
from fitting.simulate.batch import Workers
from fitting.simulate.budget import SHARES, Basis, Budget, Decision, Kind, PlanRecord
from fitting.simulate.drive import Drive
from fitting.simulate.probe import CHEAPER, ORDERS, Knowledge, Probe, Reading, attempt
from fitting.simulate.settling import QUIET, SAFETY, Settled, settle, settle_as_prescribed
from fitting.simulate.solver import (
    accepted_grid,
    coarsest_value,
    depends_on_steps,
    first_steps,
    grid_decision,
    grids,
    limits,
    part_of,
    solver_error,
    step_decision,
)
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer
from fitting.text.notation import hertz
from fitting.text.units import checked_accuracy

#: A tolerance is tried from so many times its share on, where it is the very run that is planned.
COARSE = 400.0
#: Held steps of an input in a period, at most.
MOST_STEPS_PER_PERIOD = 640
#: Communication steps and substeps of a run, at most: some twenty seconds of an FMU in Python.
MOST_WORK = 2e6
#: A run that costs so many times that is not made at all.
REFUSED_FROM = 20.0
#: Periods after which a step is looked at by which an FMU may be integrated.
FIRST_PERIODS = 10.0
#: Of what a run may cost, the part that is spent on an accuracy that was not requested.
BEARABLE = 0.05
#: How much longer they may settle at such steps than they were seen to without these.
LONGER = 64.0
#: Substeps in a period of the fastest tone, to begin with; halvings from there at most; and the
#: change of an amplitude by the next one that a search for the time to settle can bear.
PER_PERIOD, HALVINGS, COARSE_SUBSTEP = 40.0, 20, 0.01
#: Amplitudes repeat better at an FMU's own steps where they do so by this factor.
BETTER = 0.1
#: Decisions and bounds that no other setting of a plan makes smaller.
LIMITED_KINDS = (Kind.SETTLING, Kind.STEP, Kind.INPUT)
LIMITED_BY_FMU = (Basis.REPEATED, Basis.COMPARED, Basis.ORDER)


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """What a plan is for.

    `examples`: the drives are examples of many that are to come, as a fit tries them; else they are
    the very runs that are planned, and then what a run shows may replace a bound that holds
    beyond it. `of_largest`: errors are relative to the largest amplitude of all drives, else to
    each. `settle_s`: the user's own time to settle. `work`: most that a run may cost. `fixed`:
    parameters that the user has set, which the plan leaves as they are. `usual`: the accuracy was
    not requested; then it is what the FMU can give, where that is less.
    """

    examples: bool = False
    of_largest: bool = False
    settle_s: float | None = None
    work: float = MOST_WORK
    fixed: frozenset[str] = frozenset()
    usual: bool = False


@dataclass(frozen=True, kw_only=True)
class DrivePlan:
    """What to simulate for some drives.

    `settings` are the start values that the plan chose, `windows` when each drive is sampled;
    `readings` what the plan saw with them, one per drive; `budget` holds the decisions. Samples
    keep combinations of tones up to `order` off the tones, and common periods beyond `longest_s`
    are given up for a tone fit.
    """

    drives: tuple[Drive, ...]
    settings: Mapping[str, Scalar]
    windows: tuple[Window, ...]
    readings: tuple[Reading, ...]
    budget: Budget
    settle_s: float
    order: int
    longest_s: float

    @property
    def runs(self) -> tuple[Run, ...]:
        """The runs that were planned, one per drive."""
        pairs = zip(self.drives, self.windows, strict=True)
        return tuple(drive.run(window, self.settings) for drive, window in pairs)

    @property
    def amplitudes(self) -> tuple[FloatArray, ...]:
        """What the plan read, (lines, outputs) per drive; NaN where nothing oscillates."""
        return tuple(reading.amplitudes for reading in self.readings)

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Every choice with its bound."""
        return self.budget.decisions

    @property
    def promised(self) -> float:
        """Sum of the bounds."""
        return self.budget.promised

    @property
    def settles(self) -> bool:
        """Whether what is left of the transient alone keeps to what was wanted."""
        return self.budget.of(Kind.SETTLING)[0].bound <= self.budget.wanted

    @property
    def record(self) -> PlanRecord:
        """The plan for a result."""
        return self.budget.record(self.settings)

    def read(self, values: FloatArray, drive: int = 0) -> FloatArray:
        """Amplitudes (lines, outputs) in the samples (rows, outputs) of a drive's run.

        Args:
            values: samples (samples, outputs).
            drive: which of the drives.
        """
        window = self.windows[drive]
        return self.drives[drive].fit(window)(values[-window.samples :]).amplitudes


def window_decision(windows: Sequence[Window]) -> Decision:
    """The decision on windows, which cost nothing that was not measured.

    Args:
        windows: of the drives.
    """
    lengths = [float(f"{window.length_s:.6g}") for window in windows]
    counts = [window.samples for window in windows]
    tones = {window.tones_hz for window in windows}
    return Decision(
        kind=Kind.WINDOW,
        basis=Basis.COHERENT if all(w.coherent for w in windows) else Basis.FITTED,
        bound=0.0,
        subject=hertz(*windows[0].tones_hz) if len(tones) == 1 else "",
        numbers={
            "shortest_s": min(lengths),
            "longest_s": max(lengths),
            "least": min(counts),
            "most": max(counts),
            "mixtures": max(window.mixtures for window in windows),
        },
    )


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
        BadInput: an accuracy out of range, tones that cannot be distinguished, outputs that do not
            oscillate, names that the FMU does not have, a drive whose shortest run costs too much.
        FmuFailure: the FMU failed.
    """
    checked_accuracy(accuracy, "accuracy")
    options = options or PlanOptions()
    probe = Probe(tuple(drives), workers, known, of_largest=options.of_largest)
    return _Planner(probe, accuracy, options).plan()


class _Planner:
    """Decides for some drives what keeps an accuracy at the least work that was seen."""

    def __init__(self, probe: Probe, accuracy: float, options: PlanOptions) -> None:
        self.probe, self.known, self.options = probe, probe.known, options
        self.budget = Budget(accuracy)
        self._settled: dict[object, Settled] = {}

    def plan(self) -> DrivePlan:
        """All decisions, one after the other."""
        full, fixed = self.known.annotation.full, self.options.fixed
        settings = {name: value for name, value in full.items() if name not in fixed}
        # what may be sampled when, and what may be left out, decide how long the rest takes
        self._grid(settings)
        settings = self._reductions(settings)
        self.probe.shorten_windows(settings)
        settled = self._aligned(settings, self._settle(settings))
        self._require_oscillation(settled.last)
        settle_s = settled.settle_s
        self._add(settled.decision)
        place = len(self.budget.decisions)
        settings = self._solver(settings, settle_s)
        if self.probe.drives[0].grid.longest_s:
            self._steps(settings, settle_s)
        self._input(settings, settle_s)
        order, readings = self._samples(settings, settle_s)
        self._add(Decision(Kind.ROUNDING, Basis.DOUBLE, max(each.rounding for each in readings)))
        # windows are known last, and are printed after the settling
        windows = tuple(self.probe.windows(settle_s, order))
        decisions = list(self.budget.decisions)
        decisions.insert(place, window_decision(windows))
        return DrivePlan(
            drives=self.probe.drives,
            settings=settings,
            windows=windows,
            readings=tuple(readings),
            budget=self._attainable(replace(self.budget, decisions=tuple(decisions))),
            settle_s=settle_s,
            order=order,
            longest_s=self.probe.longest_s,
        )

    def _add(self, decision: Decision) -> None:
        self.budget = self.budget.with_decision(decision)

    def _share(self, kind: Kind) -> float:
        return self.budget.wanted * SHARES[kind]

    def _require_oscillation(self, readings: Sequence[Reading]) -> None:
        """BadInput for a drive of which no output oscillates, with what may be the cause."""
        forced = [d.subject for d in self.budget.of(Kind.MODEL) if d.taken and d.forced]
        cause = "does the drive reach the observed output?"
        if forced:
            cause = f"forced: {', '.join(forced)}, which may leave out what is observed"
        for drive, reading in zip(self.probe.drives, readings, strict=True):
            if all(reading.constant):
                pairs = zip(drive.outputs, reading.mean, strict=True)
                stated = ", ".join(f"{name} is constant at {float(v):.9g}" for name, v in pairs)
                raise BadInput(
                    f"outputs: {stated}; wanted one that oscillates under the drive ({cause})"
                )

    def _attainable(self, budget: Budget) -> Budget:
        """The budget, with what this FMU can give where no accuracy was requested."""
        by_fmu = [
            d for d in budget.decisions if d.kind in LIMITED_KINDS and d.basis in LIMITED_BY_FMU
        ]
        limited = sum(d.bound for d in by_fmu) > budget.wanted
        if not self.options.usual or budget.kept or not limited:
            return budget
        given = float(f"{1.05 * budget.promised:.1e}")
        if given >= 1.0:
            return budget
        limit = max(by_fmu, key=lambda d: d.bound)
        numbers: dict[str, Scalar] = {"usual": budget.wanted, "given": given, "by": str(limit.kind)}
        why = Decision(Kind.ACCURACY, Basis.USUAL, 0.0, numbers=numbers)
        return Budget(given, (why, *budget.decisions))

    # -- settling -------------------------------------------------------------------------------

    def _settle(self, settings: Mapping[str, Scalar], longest_s: float = math.inf) -> Settled:
        """How long the response settles with some settings, known from then on."""
        key = tuple(sorted(settings.items()))
        if key not in self._settled:
            work, most = self.probe.work(settings, 0.0), self.options.work
            if work > REFUSED_FROM * most:
                raise BadInput(
                    f"tones {hertz(*self.probe.drives[0].tones_hz)}: a run over one window takes "
                    f"{work:.1e} steps of the FMU, wanted at most {most:.1e}; "
                    "wanted a longer substep or tones with a shorter common period"
                )
            fine, share = {**settings, **self._fine(settings)}, self._share(Kind.SETTLING)
            result = settle(self.probe, fine, share, most, longest_s)
            if self.options.settle_s is not None:
                result = settle_as_prescribed(self.probe, fine, self.options.settle_s, result)
            self._settled[key] = result
        return self._settled[key]

    def _fine(self, settings: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """A solver fine enough that its own error is not taken for a transient.

        The substep is the longest by which the FMU is integrated at all: halved until half of it
        changes a short run little, as what it starts with, 0 for one, may be none at all.
        """
        result: dict[str, Scalar] = {}
        tolerance, substep = self.known.annotation.tolerance, self.known.annotation.substep
        chosen = self.options.fixed | set(settings)
        if tolerance is not None and tolerance not in chosen:
            low, high = limits(self.known, tolerance)
            result[tolerance] = min(max(0.1 * self._share(Kind.SETTLING), low), high)
        if substep is None or substep in chosen:
            return result
        whole, value = {**settings, **result}, self._first_substep(substep)
        if not self.probe.acts_as_substep(whole):
            return result
        for _ in range(HALVINGS):
            if self.probe.substep_error(whole, value) <= COARSE_SUBSTEP:
                break
            value *= 0.5
        return {**result, substep: value}

    def _first_substep(self, name: str) -> float:
        """A fortieth of a period of the fastest tone, or the FMU's own start where that is less."""
        variable, first = self.known.variables.get(name), 1.0 / (PER_PERIOD * self.probe.fastest_hz)
        own = float(self.probe.drives[0].start_values.get(name, 0.0))
        own = own or float(getattr(variable, "start", None) or 0.0)
        return min(own, first) if own > 0.0 else first

    # -- steps of the FMU's own -----------------------------------------------------------------

    def _grid(self, settings: Mapping[str, Scalar]) -> None:
        """Go by a fixed step that is declared, and by steps that the FMU takes and integrates by.

        An FMU that names what sets its accuracy, or what it may leave out, is taken to bear any.
        """
        step_s, numbers = self.known.step_s, dict[str, Scalar]()
        if self.known.fixed_step and step_s is not None:
            grid, basis = Grid(step_s=step_s), Basis.FIXED_STEP
        elif not self.known.is_foreign or self.known.annotation.reductions:
            return
        elif attempt(partial(self.probe.read, settings, 0.0)) is None:
            accepted = accepted_grid(self.probe, settings)
            if accepted is None:
                self.probe.read(settings, 0.0)  # fails as before: it is not the steps
                return
            grid, basis = accepted, Basis.OTHER_STEPS
            numbers["is_declared"] = grid.step_s == step_s
        else:
            if depends_on_steps(self.probe, settings, QUIET * self._share(Kind.SOLVER)):
                first_s = FIRST_PERIODS / self.probe.fastest_hz
                first = first_steps(self.probe, settings, first_s, self.options.work)
                self.probe = self.probe if first is None else self.probe.on(first)
            return
        self.probe = self.probe.on(grid)
        self._add(grid_decision(grid, basis, **numbers))

    def _aligned(self, settings: Mapping[str, Scalar], settled: Settled) -> Settled:
        """What settles, sampled at steps of the FMU's own where amplitudes repeat only at these."""
        if not settled.repeats or self.probe.drives[0].grid != ANY_TIME:
            return settled
        free = self.probe
        # where samples are at the right times, amplitudes stand still soon
        short_s = LONGER * max(settled.settle_s, FIRST_PERIODS / free.fastest_hz)
        for grid in grids(free, settings):
            self.probe = free.on(grid)
            self._settled.clear()
            try:
                result = attempt(partial(self._settle, settings, short_s))
            except BadInput:  # no samples on this grid keep the tones apart
                continue
            if result and result.steady and result.repeats < BETTER * settled.repeats:
                is_declared = grid.step_s == self.known.step_s
                self._add(
                    grid_decision(
                        grid, Basis.OWN_STEP, repeats=settled.repeats, is_declared=is_declared
                    )
                )
                return result
        self.probe = free
        self._settled.clear()
        return settled

    def _steps(self, settings: Mapping[str, Scalar], settle_s: float) -> None:
        """How long the communication steps may be of an FMU that integrates by them."""
        work = self.options.work * (BEARABLE if self.options.usual else 1.0)
        share = self._share(Kind.SOLVER)
        grid, decision = step_decision(self.probe, settings, settle_s, share, work)
        self.probe = self.probe.on(grid)
        self._add(decision)

    # -- the solver's own accuracy --------------------------------------------------------------

    def _solver(self, settings: dict[str, Scalar], settle_s: float) -> dict[str, Scalar]:
        """The coarsest tolerance and substep whose measured errors fit, or the user's values."""
        tolerance, substep = self.known.annotation.tolerance, self.known.annotation.substep
        share, firsts = self._share(Kind.SOLVER), dict[str, float]()
        if tolerance is not None:
            firsts[tolerance] = (1.0 if self.options.examples else COARSE) * share
        if substep is not None:
            firsts[substep] = self._first_substep(substep)
        for name in [name for name in firsts if name not in settings]:
            first, forced = firsts[name], name in self.options.fixed
            if forced:
                value = float(self.probe.drives[0].start_values.get(name, 0.0)) or first
                bound = solver_error(self.probe, name, settings, settle_s, value)
            else:
                bound, value = coarsest_value(
                    self.probe,
                    name,
                    settings,
                    settle_s,
                    first=first,
                    share=share,
                    work=self.options.work,
                )
            if bound < 0.0:
                continue
            decision = Decision(
                Kind.SOLVER,
                Basis.PRESCRIBED if forced else Basis.COMPARED,
                bound,
                subject=name,
                numbers={"safety": SAFETY, "part": part_of(self.known, name)},
                settings={name: value},
                forced=forced,
            )
            self._add(decision)
            settings = settings if forced else {**settings, **decision.settings}
        return settings

    def _input(self, settings: Mapping[str, Scalar], settle_s: float) -> None:
        """How long a generated input is held: images of the staircase fold onto the tones."""
        if self.known.exchange or all(drive.input is None for drive in self.probe.drives):
            return  # in model exchange it is no staircase
        share, bound, finer = self._share(Kind.INPUT), math.inf, self.probe
        here = finer.read(settings, settle_s)
        while bound > share:
            per_period = max(d.steps_per_period for d in finer.drives if d.input is not None)
            if 2 * per_period > MOST_STEPS_PER_PERIOD:
                break
            drives = (replace(d, steps_per_period=2 * d.steps_per_period) for d in finer.drives)
            finer = finer.with_drives(tuple(drives))
            better = finer.read(settings, settle_s)
            bound = SAFETY * finer.errors(here, better)
            if bound <= share or self.options.examples:
                break
            self.probe, here = finer, better
        steps = max(drive.steps_per_period for drive in self.probe.drives)
        if own_s := self.probe.drives[0].grid.step_s:
            windows = self.probe.windows(settle_s)
            if all(window.input_step_s <= own_s for window in windows):
                return  # over steps of the FMU's own, between which it sees no input
            steps = max(int(1.0 / (w.input_step_s * max(w.tones_hz))) for w in windows)
        numbers: dict[str, Scalar] = {"steps_per_period": steps, "safety": SAFETY}
        self._add(Decision(Kind.INPUT, Basis.COMPARED, bound, numbers=numbers))

    def _samples(
        self, settings: Mapping[str, Scalar], settle_s: float
    ) -> tuple[int, list[Reading]]:
        """The least order of combinations kept off the tones at which more change nothing.

        Two orders that have the same samples prove nothing: an order is compared with the next one
        that changes them. Where no other can be sampled, what the tones leave in the samples bounds
        what combinations add to the tones.
        """
        order = finer = ORDERS[0]
        bound = SAFETY * self.probe.unexplained(self.probe.read(settings, settle_s))
        for (lower, here), (higher, better) in pairwise(self.probe.by_order(settings, settle_s)):
            order, finer = lower, higher
            bound = SAFETY * self.probe.errors(here, better)
            if bound <= self._share(Kind.SAMPLES):
                break
        counts = [window.samples for window in self.probe.windows(settle_s, order)]
        numbers: dict[str, Scalar] = {"least": min(counts), "most": max(counts)}
        numbers |= {"order": order, "finer": finer, "safety": SAFETY}
        self._add(Decision(Kind.SAMPLES, Basis.COMPARED, bound, numbers=numbers))
        return order, self.probe.read(settings, settle_s, order)

    # -- reductions of the model ----------------------------------------------------------------

    def _reductions(self, settings: dict[str, Scalar]) -> dict[str, Scalar]:
        """The settings with every reduction that is taken, in the order of their declaration."""
        spent, chosen = 0.0, set(self.options.fixed)
        for reduction in self.known.annotation.reductions:
            starts = [{**drive.start_values, **settings} for drive in self.probe.drives]
            set_already = all(
                values.get(name) == value
                for values in starts
                for name, value in reduction.set.items()
            )
            if set_already or not chosen.isdisjoint(reduction.set):
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
        decision = Decision(
            Kind.MODEL,
            Basis.NO_CHEAPER,
            math.nan,
            subject=reduction.name,
            settings=dict(reduction.set),
            taken=False,
        )
        if reduction.name in self.known.annotation.forbid:
            return replace(decision, basis=Basis.FORBIDDEN, forced=True)
        forced = reduction.name in self.known.annotation.force
        reduced = {**settings, **reduction.set}
        try:
            self.probe.shorten_windows(reduced)
            after = self._settle(reduced)
            # of the state alone, and its orbit closes: an exact start, which has no price but time
            closes = reduction.start and after.steady and after.settle_s == 0.0
            # an error that the FMU states comes first: no clock decides what is too far off
            stated = self._bound_outputs(reduction)
            effect = self._effect(settings, reduction, after, closes) if stated else None
            is_off = effect is not None and effect[1] > left and not self._is_too_long(settings)
            part = 0.0 if forced or is_off else self._part(settings, reduced, reduction, after)
            # what does not pay is not examined; an exact start is taken unless it is dearer, which
            # is asked by the same margin: equal costs would be decided by chance
            if part > (1.0 / CHEAPER if closes else CHEAPER):
                return decision
            basis, bound, numbers = effect or self._effect(settings, reduction, after, closes)
        except FmuFailure as error:
            if forced or isinstance(error, NoAnswer):
                raise
            return replace(decision, basis=Basis.REFUSED, numbers={"message": error.message})
        numbers = {**numbers, "left": left}
        taken = forced or bound <= left or self._is_too_long(settings)
        if taken and not forced:
            # how many times cheaper, as 2 or a power of ten: what a clock reproduces
            times = (2.0, *(10.0**k for k in range(1, 13)))
            numbers["times_cheaper"] = min(times, key=lambda x: abs(math.log(x * part)))
        return replace(
            decision, basis=basis, bound=bound, numbers=numbers, forced=forced, taken=taken
        )

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
        if not (self._is_too_long(settings) or self._bound_outputs(reduction)):
            self._settle(settings)
        known = self._settled.get(tuple(sorted(settings.items())), after)
        work = self.probe.work(reduced, after.settle_s)
        counted = reduction.cost * work / self.probe.work(settings, known.settle_s)
        if reduction.cost >= 1.0 and counted > CHEAPER:  # stated to save nothing at equal steps
            return counted
        ratio = self.probe.cost_ratio((reduced, after.settle_s), (settings, known.settle_s))
        return counted if ratio is None else ratio

    def _effect(
        self,
        settings: dict[str, Scalar],
        reduction: Reduction[Scalar],
        after: Settled,
        closes: bool,
    ) -> tuple[Basis, float, dict[str, Scalar]]:
        """What a reduction may cost in error: what the FMU states, else the change that it makes.

        One that sets the start state alone leaves the model whole: where the orbit closes, that is
        the response, and a comparison from rest, which keeps a transient of its own, shows only
        whether it is the same one of several.
        """
        names = self._bound_outputs(reduction)
        if names:
            bound = max(self.probe.largest(after.settings, after.settle_s, n) for n in names)
            # relative to the strongest line of an output, while a promise holds for the weakest
            bound *= max(reading.spread for reading in after.last)
            return Basis.STATED, bound, {"outputs": " and ".join(names)}
        whole = None if self._is_too_long(settings) else self._settle(settings)
        if whole is None or (closes and not whole.steady):
            return (Basis.CLOSED, 0.0, {}) if closes else (Basis.UNMEASURED, math.inf, {})
        bound = SAFETY * self.probe.errors(after.last, whole.last) + whole.bound
        if closes and bound <= SAFETY * (SAFETY * whole.bound + self._share(Kind.MODEL)):
            return Basis.CLOSED, 0.0, {}
        return Basis.COMPARED, bound, {"safety": SAFETY}

    def _bound_outputs(self, reduction: Reduction[Scalar]) -> list[str]:
        """Outputs that bound a reduction, for what is read; none where the FMU has not all."""
        if reduction.bound is None:
            return []
        outputs = {name for drive in self.probe.drives for name in drive.outputs}
        names = sorted({reduction.bound.replace("{output}", name) for name in outputs})
        return names if all(name in self.known.variables for name in names) else []

    def _is_too_long(self, settings: Mapping[str, Scalar]) -> bool:
        """Whether a settled run costs more than allowed.

        By the longest time that another setting needs, where that of these is not known.
        """
        known = self._settled.get(tuple(sorted(settings.items())))
        others = (settled.settle_s for settled in self._settled.values())
        settle_s = max(others, default=0.0) if known is None else known.settle_s
        return self.probe.work(settings, settle_s) > self.options.work
