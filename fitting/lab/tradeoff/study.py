"""The study itself: every setting of the grid run, timed and held against the reference."""

from __future__ import annotations

import math
import random
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from fitting.fmu import FmuWorkers
from fitting.lab.tradeoff.bench import Bench, Cost, Patience
from fitting.lab.tradeoff.extrapolation import Extrapolation
from fitting.lab.tradeoff.grid import settings_of
from fitting.lab.tradeoff.memory import Memory
from fitting.lab.tradeoff.plan import Planned, plan_scene
from fitting.lab.tradeoff.quantities import RATIOS, error_of, values_of
from fitting.lab.tradeoff.records import (
    AMPLITUDES,
    QUANTITIES,
    WIDTH_PEAKS,
    Measurement,
    Reference,
    Setting,
    Study,
)
from fitting.lab.tradeoff.reference import references_of
from fitting.lab.tradeoff.scenes import Scene
from fitting.simulate.words import plan_in_words
from fitting.text.errors import BadInput, FmuFailure

#: Rounds in which the cheapest settings and the plan's are timed again, in turns; how many for each
#: accuracy; and the longest of them, s.
DUEL_ROUNDS, FINALISTS, DUEL_S = 9, 3, 1.0
QUICK_PATIENCE = Patience(3, 0.02, 0.3)


@dataclass(frozen=True)
class Order:
    """What is asked: accuracies, seed of the order of settings, longest run of a setting in s.

    `quantities` that are measured.
    """

    accuracies: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-6, 1e-9)
    seed: int = 1
    quick: bool = False
    longest_s: float = 20.0
    quantities: tuple[str, ...] = QUANTITIES


def run_study(
    scene: Scene,
    workers: FmuWorkers,
    order: Order,
    memory: Memory,
    tell: Callable[[str], None] = lambda _: None,
) -> Study:
    """Measure the grid of a scene and the plan's choices; what is finished is not run again.

    Settings are taken in an order drawn from the seed, so that a machine that slows down does not
    spoil one kind of them, and an interrupted study has some of each. Ctrl-C ends it as
    "interrupted" with all that is finished.

    Raises:
        FmuFailure: the FMU failed for the reference.
        BadInput: names or values that do not fit the FMU.
        KeyboardInterrupt: interrupted before there was a reference.
    """
    bench = Bench(scene, workers, QUICK_PATIENCE if order.quick else Patience())
    if not memory.references:
        tell("reference")
        memory.keep_references(tuple(references_of(bench, quick=order.quick)))
    ruler = _Ruler(bench, memory.references, order.longest_s)
    wanted = [s for s in settings_of(scene, quick=order.quick) if s.quantity in order.quantities]
    random.Random(order.seed).shuffle(wanted)  # noqa: S311  (an order, no secret)
    found: list[Measurement] = []
    planned: dict[float, Planned] = {}
    notes: list[str] = []
    status, message = "finished", f"{len(wanted)} settings."
    try:
        for number, setting in enumerate(wanted, 1):
            tell(f"{number}/{len(wanted)} {setting.quantity}, {setting.solver}")
            measured = memory.recall(setting.key) or ruler.measure(setting)
            if measured is not None:
                memory.keep(measured)
                found.append(measured)
        if AMPLITUDES in order.quantities:
            for accuracy in order.accuracies:
                tell(f"plan for {accuracy:g}")
                planned[accuracy] = plan_scene(bench, accuracy)
                notes += told_plan(planned[accuracy])
                if planned[accuracy].kept:
                    found.append(ruler.measure_planned(planned[accuracy]))
        tell("the cheapest once more")
        rounds = 3 if order.quick else DUEL_ROUNDS
        found = again(bench, found, planned, order.accuracies, rounds)
    except KeyboardInterrupt:
        memory.write()
        status = "interrupted"
        message = f"{len(found)} of {len(wanted)} settings; --resume goes on."
    return Study(
        scene.name,
        scene.title,
        scene.synthetic,
        scene.description,
        memory.references,
        tuple(found),
        order.accuracies,
        status,
        message,
        tuple(notes),
    )


def told_plan(planned: Planned) -> list[str]:
    """The plan for an accuracy in sentences."""
    if not planned.kept:
        return [f"Accuracy {planned.accuracy:g}: no plan; it could promise {planned.promised:.1e}."]
    said = plan_in_words(planned.plans[0].budget)
    return [f"Accuracy {planned.accuracy:g}: {line}" for line in said]


def again(
    bench: Bench,
    found: Sequence[Measurement],
    planned: Mapping[float, Planned],
    accuracies: Sequence[float],
    rounds: int,
) -> list[Measurement]:
    """The measurements, those of the cheapest settings and of the plan's timed again in turns.

    The cheapest of hundreds of timings is a lucky one; and what is compared with each other should
    have met the same machine.
    """
    peaks = [m for m in found if m.setting.quantity == AMPLITUDES and not m.extrapolated]
    chosen = {_place(m): m for m in peaks if m.planned_for in planned}
    for accuracy in accuracies:
        good = sorted((m for m in peaks if m.error <= accuracy), key=lambda m: m.cost_s)
        chosen.update({_place(m): m for m in good[:FINALISTS]})
    chosen = {place: m for place, m in chosen.items() if 0.0 < m.seconds < DUEL_S}
    costs: dict[tuple[str, float | None], list[Cost]] = {place: [] for place in chosen}
    for _ in range(rounds):
        for place, m in chosen.items():
            if m.planned_for is None:
                bench.warm(dict(m.setting.values))
                work = partial(_first, bench, m.setting)
            else:
                work = partial(_first_planned, bench, planned[m.planned_for])
            costs[place].append(bench.timed(work)[1])
    return [_retimed(m, costs.get(_place(m), [])) for m in found]


def _place(measured: Measurement) -> tuple[str, float | None]:
    return measured.setting.key, measured.planned_for


def _first(bench: Bench, setting: Setting) -> float:
    return float(values_of(bench, setting, None)[0])


def _first_planned(bench: Bench, planned: Planned) -> float:
    return float(planned.amplitudes(bench)[0])


def _retimed(measured: Measurement, costs: Sequence[Cost]) -> Measurement:
    if not costs:
        return measured
    return replace(
        measured,
        seconds=statistics.median(c.seconds for c in costs),
        cpu_s=statistics.median(c.cpu_s for c in costs),
        repeats=sum(c.repeats for c in costs),
    )


class _Ruler:
    """Measures settings on a bench against the references."""

    def __init__(self, bench: Bench, references: Sequence[Reference], longest_s: float) -> None:
        self._bench, self._longest_s = bench, longest_s
        self._references = {r.quantity: r for r in references}
        self._extrapolation = Extrapolation(bench)

    def measure(self, setting: Setting) -> Measurement | None:
        """The row of a setting; None for one that takes too long and cannot be extrapolated."""
        reference = self._references[setting.quantity]
        if self._extrapolation.expected_s(setting) > self._longest_s:
            return self._extrapolation.measurement(setting, reference)
        data = self._data(setting)
        try:
            self._bench.warm(dict(setting.values))
            error, cost = self._bench.timed(
                lambda: error_of(values_of(self._bench, setting, data), reference)
            )
        except (FmuFailure, BadInput, ValueError, ArithmeticError) as failure:
            note = " ".join(str(failure).split())
            return Measurement(setting, math.inf, False, 0.0, 0.0, 0, 0, 0, 0, note=note)
        if not math.isfinite(error):
            return Measurement(
                setting,
                math.inf,
                False,
                cost.seconds,
                cost.cpu_s,
                cost.repeats,
                cost.runs,
                cost.steps,
                cost.reads,
                note="no number came out",
            )
        return Measurement(
            setting,
            max(error, reference.error),
            error <= reference.error,
            cost.seconds,
            cost.cpu_s,
            cost.repeats,
            cost.runs,
            cost.steps,
            cost.reads,
            cost.solver_steps if setting.resolution_kind != "tolerance" else None,
        )

    def measure_planned(self, planned: Planned) -> Measurement:
        """The row of the plan's choice for an accuracy."""
        reference = self._references[AMPLITUDES]
        self._bench.warm(dict(planned.plans[0].settings))
        error, cost = self._bench.timed(
            lambda: error_of(planned.amplitudes(self._bench), reference)
        )
        return Measurement(
            planned.setting(self._bench.scene),
            max(error, reference.error),
            error <= reference.error,
            cost.seconds,
            cost.cpu_s,
            cost.repeats,
            cost.runs,
            cost.steps,
            cost.reads,
            planned_for=planned.accuracy,
            note=f"promised {planned.promised:.1e}",
        )

    def _data(self, setting: Setting) -> Reference | None:
        """Amplitudes that a fit of the width is made to."""
        if setting.quantity != WIDTH_PEAKS:
            return None
        return self._references[RATIOS if setting.sweep_points else AMPLITUDES]
