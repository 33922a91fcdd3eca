"""The study itself: every setting of the grid run, timed and held against the reference."""

from __future__ import annotations

import math
import random
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fitting.fmu import FmuWorkers
from fitting.lab.names import AMPLITUDES, QUANTITIES, WIDTH_PEAKS
from fitting.lab.tradeoff.bench import Bench, Patience
from fitting.lab.tradeoff.extrapolation import Extrapolation
from fitting.lab.tradeoff.grid import settings_of
from fitting.lab.tradeoff.plan import Planned, plan_scene
from fitting.lab.tradeoff.quantities import error_of, values_of
from fitting.lab.tradeoff.records import (
    RATIOS,
    TOLERANCE,
    Cost,
    Measurement,
    Reference,
    Setting,
    Study,
)
from fitting.lab.tradeoff.reference import references_of
from fitting.lab.tradeoff.scenes import Scene
from fitting.text.arrays import FloatArray
from fitting.text.checkpoint import Checkpoint
from fitting.text.errors import BadInput, FmuFailure

#: Rounds in which the cheapest settings and the plan's are timed again, in turns; how many for each
#: accuracy; and the longest of them, s.
DUEL_ROUNDS, QUICK_ROUNDS, FINALISTS, DUEL_S = 9, 3, 3, 1.0
QUICK_PATIENCE = Patience(3, 0.02, 0.3)
#: Longest run of a setting, s, of a coarse and of a fine grid.
QUICK_LONGEST_S, LONGEST_S = 2.0, 20.0
CHECKPOINT_NAME = "tradeoff-checkpoint.json"
#: Time between two writings of the checkpoint, s: kill -9 loses no more than that.
EVERY_S = 2.0


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What is asked of a study.

    Args:
        accuracies: Relative errors for which the cheapest setting is told, between 0 and 1.
        seed: Of the order of the settings.
        quick: A coarse grid.
        longest_s: Longest run of a setting, s; None: 20 s, in a quick study 2 s.
        quantities: That are measured, some of `QUANTITIES`.

    Raises:
        BadInput: accuracies or quantities that there are not.
    """

    accuracies: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-6, 1e-9)
    seed: int = 1
    quick: bool = False
    longest_s: float | None = None
    quantities: tuple[str, ...] = QUANTITIES

    def __post_init__(self) -> None:
        for value in self.accuracies:
            if not 0.0 < value < 1.0:
                raise BadInput(f"accuracies: found {value!r}, wanted numbers between 0 and 1")
        for name in self.quantities:
            if name not in QUANTITIES:
                raise BadInput(
                    f"quantities: found {name!r}, wanted some of {', '.join(QUANTITIES)}"
                )

    @property
    def patience_s(self) -> float:
        """Longest run of a setting, s."""
        if self.longest_s is not None:
            return self.longest_s
        return QUICK_LONGEST_S if self.quick else LONGEST_S


@dataclass(frozen=True)
class Part:
    """A finished part of a study: the references, or the measurement of a setting."""

    references: tuple[Reference, ...] = ()
    measurement: Measurement | None = None

    @property
    def key(self) -> str:
        """The setting, "" for the references."""
        return "" if self.measurement is None else self.measurement.setting.key


class Memory(Checkpoint[Part]):
    """Finished parts, in memory and in a file, so that a study goes on where it was stopped."""

    def __init__(self, folder: Path, job: str) -> None:
        super().__init__(folder / CHECKPOINT_NAME, job, Part, lambda part: part.key, EVERY_S)

    def __len__(self) -> int:
        """The number of finished settings."""
        return super().__len__() - (self.find("") is not None)


def run_study(
    scene: Scene,
    workers: FmuWorkers,
    options: StudyOptions,
    memory: Memory,
    tell: Callable[[str], None] = lambda _: None,
) -> Study:
    """Measure the grid of a scene and the plan's choices; what is finished is not run again.

    Settings are taken in an order drawn from the seed, so that a machine that slows down does not
    spoil one kind of them, and an interrupted study has some of each. Ctrl-C ends it as
    "interrupted" with all that is finished.

    Args:
        scene: an FMU with start values, tones and truth.
        workers: processes that run the FMU.
        options: accuracies, quantities, seed.
        memory: what earlier runs have left.
        tell: is called with a line of progress.

    Raises:
        FmuFailure: the FMU failed for the reference.
        BadInput: names or values that do not fit the FMU.
        KeyboardInterrupt: interrupted before there was a reference.
    """
    bench = Bench(scene, workers, QUICK_PATIENCE if options.quick else Patience())
    known = memory.find("")
    if known is None:
        tell("reference")
        known = Part(references=tuple(references_of(bench)))
        memory.record(known)
    ruler = _Ruler(bench, known.references, options.patience_s)
    wanted = [
        s for s in settings_of(scene, quick=options.quick) if s.quantity in options.quantities
    ]
    random.Random(options.seed).shuffle(wanted)  # noqa: S311  (an order, no secret)
    found: list[Measurement] = []
    notes: list[str] = []
    status, message = "finished", f"{len(wanted)} settings."
    try:
        for number, setting in enumerate(wanted, 1):
            tell(f"{number}/{len(wanted)} {setting.quantity}, {setting.solver}")
            part = memory.find(setting.key) or Part(measurement=ruler.measure(setting))
            if part.measurement is not None:
                memory.record(part)
                found.append(part.measurement)
        planned = {}
        for accuracy in options.accuracies if AMPLITUDES in options.quantities else ():
            tell(f"plan for {accuracy:g}")
            planned[accuracy] = plan_scene(bench, accuracy)
            notes += planned[accuracy].notes
            if planned[accuracy].kept:
                found.append(ruler.measure_planned(planned[accuracy]))
        tell("the cheapest once more")
        rounds = QUICK_ROUNDS if options.quick else DUEL_ROUNDS
        found = again(bench, found, planned, options.accuracies, rounds)
    except KeyboardInterrupt:
        memory.write()
        status = "interrupted"
        message = f"{len(found)} of {len(wanted)} settings; --resume goes on."
    return Study(
        scene=scene.name,
        title=scene.title,
        synthetic=scene.synthetic,
        description=scene.description,
        references=known.references,
        measurements=tuple(found),
        accuracies=options.accuracies,
        status=status,
        message=message,
        notes=tuple(notes),
    )


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

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        found: measurements so far.
        planned: plan for each accuracy.
        accuracies: relative errors that are wanted.
        rounds: how often each is measured again.
    """
    peaks = [m for m in found if m.setting.quantity == AMPLITUDES and not m.extrapolated]
    finalists = [m for m in peaks if m.planned_for in planned]
    for accuracy in accuracies:
        good = sorted((m for m in peaks if m.error <= accuracy), key=lambda m: m.cost_s)
        finalists += good[:FINALISTS]
    costs: dict[int, list[Cost]] = {id(m): [] for m in finalists if 0.0 < m.cost.seconds < DUEL_S}
    for _ in range(rounds):
        for m in {id(m): m for m in finalists if id(m) in costs}.values():
            work = _work(bench, m.setting, planned.get(m.planned_for or 0.0))
            costs[id(m)].append(bench.timed(work)[1])
    return [_retimed(m, costs.get(id(m), [])) for m in found]


def _work(
    bench: Bench, setting: Setting, planned: Planned | None, data: Reference | None = None
) -> Callable[[], FloatArray]:
    """What is timed: the plan's runs, or those of a setting; the workers know their layout."""
    if planned is not None:
        bench.warm(dict(planned.plans[0].settings))
        return lambda: planned.amplitudes(bench)
    bench.warm(dict(setting.values))
    return lambda: values_of(bench, setting, data)


def _retimed(measured: Measurement, costs: Sequence[Cost]) -> Measurement:
    if not costs:
        return measured
    cost = replace(
        measured.cost,
        seconds=statistics.median(c.seconds for c in costs),
        cpu_s=statistics.median(c.cpu_s for c in costs),
        repeats=sum(c.repeats for c in costs),
    )
    return replace(measured, cost=cost)


class _Ruler:
    """Measures settings on a bench against the references."""

    def __init__(self, bench: Bench, references: Sequence[Reference], longest_s: float) -> None:
        self._bench, self._longest_s = bench, longest_s
        self._references = {r.quantity: r for r in references}
        self._extrapolation = Extrapolation(bench)

    def measure(self, setting: Setting) -> Measurement | None:
        """The row of a setting; None for one that takes too long and cannot be extrapolated."""
        if self._extrapolation.expected_s(setting) > self._longest_s:
            return self._extrapolation.measurement(setting, self._references[setting.quantity])
        data = None  # amplitudes that a fit of the width is made to
        if setting.quantity == WIDTH_PEAKS:
            data = self._references[RATIOS if setting.sweep_points else AMPLITUDES]
        try:
            measured = self._measured(setting, _work(self._bench, setting, None, data))
        except (FmuFailure, BadInput, ValueError, ArithmeticError) as failure:
            note = " ".join(str(failure).split())
            return Measurement(setting=setting, error=math.inf, cost=Cost(), note=note)
        if setting.resolution_kind != TOLERANCE:
            return measured
        return replace(measured, cost=replace(measured.cost, solver_steps=None))

    def measure_planned(self, planned: Planned) -> Measurement:
        """The row of the plan's choice for an accuracy."""
        setting = planned.setting(self._bench.scene)
        found = self._measured(setting, _work(self._bench, setting, planned))
        return replace(
            found,
            cost=replace(found.cost, solver_steps=None),
            planned_for=planned.accuracy,
            note=f"promised {planned.promised:.1e}",
        )

    def _measured(self, setting: Setting, work: Callable[[], FloatArray]) -> Measurement:
        reference = self._references[setting.quantity]
        values, cost = self._bench.timed(work)
        error = error_of(values, reference)
        if not math.isfinite(error):
            return Measurement(
                setting=setting, error=math.inf, cost=cost, note="no number came out"
            )
        return Measurement(
            setting=setting,
            error=max(error, reference.error),
            bounded=error <= reference.error,
            cost=cost,
        )
