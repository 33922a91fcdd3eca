"""Measured decisions: settling, solver, samples and what may be left out of a model.

Nothing is assumed of the FMU. Each error is the change that a better setting makes, times a safety
factor that its sentence names, so the promise holds as far as a change tells of what is left.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from fitting.fmu.accuracy import Hints, Reduction
from fitting.fmu.variables import VariableLike
from fitting.simulate.budget import SHARES, Budget, Decision
from fitting.simulate.probe import Probe, Reading, apart, off
from fitting.simulate.refined import Refined, measured_error
from fitting.simulate.settling import SAFETY, Settled, settling, watch
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import number

#: Combinations of the tones that do not fold onto a tone, tried in this order.
ORDERS = (1, 5, 11, 21, 41)
#: A reduction is taken if it makes a run take less than this part of the time.
CHEAPER = 0.8
#: A refinement stops when its bound lies within its share and above this part of it.
WASTED = 0.02
ROUNDS = 10
#: Of the accuracy, what a reduction that was measured may use; the other shares then shrink.
MEASURED = 0.6
#: A tolerance is tried from so many times its share on, where the very run that is planned tells.
COARSE = 400.0
#: Held steps of an input in a period, at most.
MOST_HELD = 640


@dataclass(frozen=True)
class Found:
    """What a search came to: start values for the FMU, time to settle, order of the samples.

    `readings` are those of the plan, one per shot; `run_s` seconds of one of its runs.
    """

    budget: Budget
    settings: Mapping[str, Scalar]
    settle_s: float
    order: int
    longest_s: float
    readings: tuple[Reading, ...]
    run_s: float


class Search:
    """Decides for some shots what keeps an accuracy at the least cost that was seen.

    `one_drive`: the runs that are measured are those that are planned, not examples of many that a
    fit tries; then an input may be held over shorter steps than asked for, and what a run shows
    may stand for a bound that holds beyond it.
    """

    def __init__(
        self,
        probe: Probe,
        accuracy: float,
        hints: Hints,
        variables: Mapping[str, VariableLike],
        limit_s: float,
        *,
        one_drive: bool = False,
    ) -> None:
        self.probe, self.accuracy, self.hints = probe, accuracy, hints
        self.variables, self.limit_s, self.one_drive = variables, limit_s, one_drive
        self.budget = Budget(accuracy)
        self._room = 1.0  # part of their shares that a reduction leaves to other decisions
        self._settled: dict[object, Settled] = {}

    def found(self) -> Found:
        """All decisions, one after the other."""
        settings = dict(self.hints.full)
        settings = self._reductions(settings)
        self.probe.settle_on_windows(settings)
        settled = self._settle(settings)
        self._add(settling(settled))
        settings = self._solver(settings, settled.settle_s)
        self._held(settings, settled.settle_s)
        order, readings, seconds = self._samples(settings, settled.settle_s)
        rounding = max(reading.rounding for reading in readings)
        self._add(
            Decision(
                "rounding",
                "double precision",
                rounding,
                "samples of the weakest tone beside the strongest value",
            )
        )
        return Found(
            self.budget,
            settings,
            settled.settle_s,
            order,
            self.probe.longest_s,
            tuple(readings),
            seconds,
        )

    def _add(self, decision: Decision) -> None:
        self.budget = self.budget.with_decision(decision)

    def _share(self, kind: str) -> float:
        return self.accuracy * SHARES[kind] * self._room

    # -- settling -------------------------------------------------------------------------------

    def _settle(self, settings: Mapping[str, Scalar]) -> Settled:
        key = tuple(sorted(settings.items()))
        if key not in self._settled:
            self._settled[key] = watch(
                self.probe,
                {**settings, **self._fine(settings)},
                self._share("settling"),
                self.limit_s,
            )
        return self._settled[key]

    def _fine(self, settings: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """A solver fine enough that its own noise is not taken for a transient."""
        name = self.hints.tolerance
        if name is None or name in settings:
            return {}
        low, high = self._range(name)
        return {name: min(max(0.1 * self._share("settling"), low), high)}

    # -- the solver's own accuracy --------------------------------------------------------------

    def _solver(self, settings: dict[str, Scalar], settle_s: float) -> dict[str, Scalar]:
        for name, first in self._knobs(settings):
            settings = self._refine(settings, settle_s, name, first)
        return settings

    def _knobs(self, settings: Mapping[str, Scalar]) -> list[tuple[str, float]]:
        """Parameters that set the solver's accuracy, with a first value for each."""
        found: list[tuple[str, float]] = []
        if self.hints.tolerance is not None:
            coarse = COARSE if self.one_drive else 1.0
            found.append((self.hints.tolerance, coarse * self._share("solver")))
        if self.hints.substep is not None:
            fastest = max(max(shot.tones_hz) for shot in self.probe.shots)
            found.append((self.hints.substep, 1.0 / (40.0 * fastest)))
        return [(name, value) for name, value in found if name not in settings]

    def _range(self, name: str) -> tuple[float, float]:
        variable = self.variables.get(name)
        low = variable.min if variable is not None else None
        high = variable.max if variable is not None else None
        return max(low or 0.0, 1e-300), math.inf if high is None else high

    def _error_at(
        self, settings: dict[str, Scalar], settle_s: float, name: str, value: float, finer: float
    ) -> float:
        """Change of the amplitudes by a finer value; infinite where the coarse one fails."""
        try:
            here = self.probe.read({**settings, name: value}, settle_s)[0]
            better = self.probe.read({**settings, name: finer}, settle_s)[0]
        except FmuFailure:
            return math.inf
        if all((a.tones == b.tones).all() for a, b in zip(here, better, strict=True)):
            return -1.0  # it is not this parameter that sets the accuracy
        return max(SAFETY * off(here, better), apart(better, here))

    def _refine(
        self, settings: dict[str, Scalar], settle_s: float, name: str, value: float
    ) -> dict[str, Scalar]:
        """The coarsest value whose measured error fits into the share."""
        low, high = self._range(name)
        by = 100.0 if name == self.hints.tolerance else 2.0
        share, best = self._share("solver"), (math.inf, value)
        value = min(max(value, low), high)
        for _ in range(ROUNDS):
            bound = self._error_at(settings, settle_s, name, value, max(value / by, low))
            if bound < 0.0:
                return settings
            if _better(bound, value, best, share):
                best = bound, value
            if WASTED * share <= bound <= share:
                break
            # an order of four is the guess for substeps, of one for a tolerance
            power = 0.25 if by == 2.0 else 1.0
            factor = min(max((0.3 * share / max(bound, 1e-300)) ** power, 0.05), 10.0)
            # no finer than runs may take: the cost is taken to go as one over the value
            factor = max(factor, self._spent({**settings, name: value}, settle_s))
            there = min(max(value * factor, low), high)
            if there == value or (bound > share and there > 0.9 * value):
                break
            value = there
        bound, value = best
        finer = "a hundredth" if by == 100.0 else "half"
        self._add(
            Decision(
                "solver",
                f"{name} = {value:.3g}",
                min(bound, 1.0),
                f"{SAFETY:g} times the change of the amplitudes at {finer} of it",
            )
        )
        return {**settings, name: value}

    def _spent(self, settings: dict[str, Scalar], settle_s: float) -> float:
        """Part of the longest run that one with these settings takes, at most 1."""
        try:
            return min(1.0, self.probe.read(settings, settle_s)[1] / self.limit_s)
        except FmuFailure:
            return 0.0

    def _held(self, settings: Mapping[str, Scalar], settle_s: float) -> None:
        """How long a generated input is held: images of the staircase fold onto the tones."""
        if all(shot.input is None for shot in self.probe.shots):
            return
        share, chosen, bound = self._share("input"), self.probe.shots, math.inf
        here = self.probe.read(settings, settle_s)[0]
        while bound > share and self.probe.finer_input(MOST_HELD):
            better = self.probe.read(settings, settle_s)[0]
            bound = SAFETY * off(here, better)
            if bound <= share or not self.one_drive:
                break
            chosen, here = self.probe.shots, better
        self.probe.hold(chosen)
        held = max(shot.steps_per_period for shot in chosen)
        self._add(
            Decision(
                "input",
                f"held over {held} steps per period",
                min(bound, 1.0),
                f"{SAFETY:g} times the change with twice as many",
            )
        )

    # -- samples --------------------------------------------------------------------------------

    def _samples(
        self, settings: Mapping[str, Scalar], settle_s: float
    ) -> tuple[int, list[Reading], float]:
        """The least order of combinations kept off the tones at which more change nothing."""
        share = self._share("samples")
        order, finer, bound = self._order(settings, settle_s, share)
        here, seconds = self.probe.read(settings, settle_s, order)
        windows = [s.window(settle_s, order, self.probe.longest_s) for s in self.probe.shots]
        counts = sorted({w.samples for w in windows})
        how = f"{' to '.join(str(n) for n in {counts[0]: 0, counts[-1]: 0})} per run"
        if order > 1:
            how += f", no combination of tones up to order {order} folded onto a tone"
        self._add(
            Decision(
                "samples",
                how,
                bound,
                f"{SAFETY:g} times the change with combinations up to order {finer} kept off",
            )
        )
        return order, here, seconds

    def _order(
        self, settings: Mapping[str, Scalar], settle_s: float, share: float
    ) -> tuple[int, int, float]:
        """Order of combinations kept off the tones, the finer one tried, the error between."""
        found = ORDERS[0], ORDERS[0], math.inf
        for order, finer in pairwise(ORDERS):
            try:
                here = self.probe.read(settings, settle_s, order)[0]
                bound = SAFETY * off(here, self.probe.read(settings, settle_s, finer)[0])
            except BadInput:  # no sampling keeps so many lines off the tones
                break
            found = order, finer, bound
            if bound <= share:
                break
        return found[0], found[1], min(found[2], 1.0)

    # -- reductions of the model ----------------------------------------------------------------

    def _reductions(self, settings: dict[str, Scalar]) -> dict[str, Scalar]:
        spent = 0.0
        for reduction in self.hints.reductions:
            if not self._changes(settings, reduction):
                continue
            decision = self._reduction(settings, reduction, self._share("model") - spent)
            self._add(decision)
            if decision.taken:
                settings = {**settings, **reduction.set}
                spent += decision.bound
        self._leave(spent / self.accuracy)
        return settings

    def _leave(self, spent: float) -> None:
        """Shrink all further shares but the maximum's where reductions took more than theirs."""
        model, free = SHARES["model"], 1.0 - SHARES["maximum"]
        if model < spent <= MEASURED:
            self._room = (free - spent) / (free - model)
            self._settled.clear()

    def _reduction(
        self, settings: dict[str, Scalar], reduction: Reduction, left: float
    ) -> Decision:
        """Whether a reduction is taken: it fits into what is left and makes runs cheaper."""
        name = reduction.name
        choice = ", ".join(f"{key} = {_word(value)}" for key, value in reduction.set.items())
        if name in self.hints.forbid:
            return Decision(name, choice, math.nan, "not taken: forbidden", True, False)
        forced = name in self.hints.force
        try:
            bound, how = self._effect(settings, reduction)
            if bound > left and self.one_drive and reduction.bound is not None:
                bound, how, left = self._measured(settings, reduction, (bound, how, left))
        except FmuFailure as error:
            if forced:
                raise
            why = f"not taken: the FMU refuses ({error.message})"
            return Decision(name, choice, math.nan, why, False, False)
        if forced:
            beyond = "" if bound <= left else f", beyond the {left:.1e} that is left for it"
            return Decision(name, choice, min(bound, 1.0), f"{how}{beyond}", True)
        if bound > left and not self._too_long(settings):
            why = f"not taken: {how}, and {left:.1e} is left for it"
            return Decision(name, choice, bound, why, False, False)
        part = self._cost_s({**settings, **reduction.set}) / self._cost_s(settings)
        saved = f"a run takes {number(part, 2)} of the time"
        if part > CHEAPER:
            return Decision(name, choice, bound, f"not taken: no cheaper ({saved})", False, False)
        if bound <= left:
            return Decision(name, choice, bound, f"{how}; {saved}")
        why = f"{how}, more than is left for it, but a run without it would take too long"
        return Decision(name, choice, min(bound, 1.0), why)

    def _effect(self, settings: dict[str, Scalar], reduction: Reduction) -> tuple[float, str]:
        """Bound of a reduction, and where it is from."""
        reduced = {**settings, **reduction.set}
        self.probe.settle_on_windows(reduced)
        after = self._settle(reduced)
        names = self._bound_names(reduction)
        if names:
            fine = {**reduced, **self._fine(reduced)}
            bound = max(self.probe.largest(fine, after.settle_s, name) for name in names)
            # relative to the strongest line of an output, while a promise holds for the weakest
            bound *= max(reading.spread for reading in after.last)
            return bound, f"by the FMU's {' and '.join(names)}"
        if self._too_long(settings):
            return 1.0, "its error cannot be measured, a run without it would take too long"
        whole = self._settle(settings)
        return SAFETY * off(after.last, whole.last) + whole.bound, f"{SAFETY:g} times the change"

    def _measured(
        self, settings: dict[str, Scalar], reduction: Reduction, stated: tuple[float, str, float]
    ) -> tuple[float, str, float]:
        """The stated bound, what it is by and what is left for it, or those that were measured."""
        bound, how, left = stated
        knobs, substep = dict(self._knobs(settings)), self.hints.substep
        most = left + self.accuracy * (MEASURED - SHARES["model"])
        if most <= 0.0 or substep is None or substep not in knobs or self._too_long(settings):
            return stated
        reduced = {**settings, **reduction.set}
        full = Refined({**settings, **self._fine(settings)}, substep, knobs[substep], ORDERS[2])
        try:
            found = measured_error(
                self.probe, {**reduced, **self._fine(reduced)}, full, (left, most), self.limit_s
            )
        except (BadInput, FmuFailure):  # then what is stated has to do
            return stated
        if found is None or found[0] >= bound:
            return stated
        return found[0], f"{found[1]}; {how} it would be {bound:.1e}", most

    def _too_long(self, settings: Mapping[str, Scalar]) -> bool:
        """Whether a settled run takes longer than allowed, or would by the pace of short ones."""
        key = tuple(sorted(settings.items()))
        if key in self._settled:
            return self._settled[key].seconds > self.limit_s
        return self._cost_s(settings) > self.limit_s

    def _bound_names(self, reduction: Reduction) -> list[str]:
        """Outputs that bound a reduction, for what is read; none where the FMU has not all."""
        if reduction.bound is None:
            return []
        outputs = {name for shot in self.probe.shots for name in shot.outputs}
        names = sorted({reduction.bound.replace("{output}", name) for name in outputs})
        return names if all(name in self.variables for name in names) else []

    def _changes(self, settings: Mapping[str, Scalar], reduction: Reduction) -> bool:
        """Whether a reduction sets anything that is not so already."""
        return any(
            {**shot.values, **settings}.get(name) != value
            for shot in self.probe.shots
            for name, value in reduction.set.items()
        )

    def _cost_s(self, settings: Mapping[str, Scalar]) -> float:
        """Seconds of a settled run; by the time that another setting needs, where none is known."""
        key = tuple(sorted(settings.items()))
        if key in self._settled:
            return self.probe.cost_s(settings, self._settled[key].settle_s)
        others = [settled.settle_s for settled in self._settled.values()]
        return self.probe.cost_s(settings, max(others, default=0.0))


def _word(value: Scalar) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _better(bound: float, value: float, best: tuple[float, float], share: float) -> bool:
    """A value that keeps the share beats a finer one that does; else the smaller error."""
    if bound <= share:
        return best[0] > share or value > best[1]
    return bound < best[0]
