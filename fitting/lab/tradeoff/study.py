"""The study itself: every setting of the grid run, timed and held against the reference."""

from __future__ import annotations

import random
import statistics
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from fitting.extension.fmu import Ended, FmuWorkers, Where
from fitting.lab.names import AMPLITUDES, QUANTITIES
from fitting.lab.tradeoff.bench import Bench, Patience
from fitting.lab.tradeoff.grid import settings_of
from fitting.lab.tradeoff.item import Terms, ended
from fitting.lab.tradeoff.plan import Planned, plan_scene
from fitting.lab.tradeoff.records import Cost, Measurement, Reference, Setting, Study
from fitting.lab.tradeoff.reference import references_of
from fitting.lab.tradeoff.ruler import Ruler, without_number, work_of
from fitting.lab.tradeoff.scenes import Scene
from fitting.text.arguments import checked
from fitting.text.checkpoint import Checkpoint
from fitting.text.errors import BadInput

#: Rounds in which the cheapest settings and the plan's are timed again, in turns; how many for each
#: accuracy; and the longest of them, s.
DUEL_ROUNDS, QUICK_ROUNDS, FINALISTS, DUEL_S = 9, 3, 3, 1.0
QUICK_PATIENCE = Patience(3, 0.02, 0.3)
#: Longest run of a setting, s, of a coarse and of a fine grid.
QUICK_LONGEST_S, LONGEST_S = 2.0, 20.0
CHECKPOINT_NAME = "tradeoff-checkpoint.json"
#: Time between two writings of the checkpoint, s: kill -9 loses no more than that.
EVERY_S = 2.0


@checked
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
    where: Where | None = None,
) -> Study:
    """Measure the grid of a scene and the plan's choices; what is finished is not run again.

    Settings are taken in an order drawn from the seed, so that a machine that slows down does not
    spoil one kind of them, and an interrupted study has some of each. Ctrl-C ends it as
    "interrupted" with all that is finished. Errors of what is run do not depend on where it is.

    Args:
        scene: an FMU with start values, tones and truth.
        workers: processes that run the FMU.
        options: accuracies, quantities, seed.
        memory: what earlier runs have left.
        tell: is called with a line of progress.
        where: settings of the grid are measured, as `fitting.engine.place.opened` takes it; None:
            one after the other by ``workers``, as references, plans and the cheapest always are.

    Raises:
        FmuFailure: the FMU failed for the reference.
        BadInput: names or values that do not fit the FMU, or no such place.
        KeyboardInterrupt: interrupted before there was a reference.
    """
    bench = Bench(scene, workers, QUICK_PATIENCE if options.quick else Patience())
    known = memory.find("")
    if known is None:
        tell("reference")
        known = Part(references=tuple(references_of(bench)))
        memory.record(known)
    course = _Course(Ruler(bench, known.references, options.patience_s), options, memory, tell)
    status, message = "finished", f"{len(course.wanted)} settings."
    try:
        course.take_grid(where)
        course.take_plans()
        course.take_again()
    except (KeyboardInterrupt, BrokenExecutor) as end:
        memory.write()
        status, message = "interrupted", course.how_far
        if isinstance(end, BrokenExecutor):
            message = f"the executor takes no more: {end}; {message}"
    return Study(
        scene=scene.name,
        title=scene.title,
        synthetic=scene.synthetic,
        description=scene.description,
        references=known.references,
        measurements=tuple(course.found),
        accuracies=options.accuracies,
        status=status,
        message=message,
        notes=tuple(course.notes),
    )


class _Course:
    """The way of a study, and what has been found on it."""

    def __init__(
        self, ruler: Ruler, options: StudyOptions, memory: Memory, tell: Callable[[str], None]
    ) -> None:
        self._ruler, self._options, self._memory, self._tell = ruler, options, memory, tell
        scene = ruler.bench.scene
        self.wanted = [
            s for s in settings_of(scene, quick=options.quick) if s.quantity in options.quantities
        ]
        random.Random(options.seed).shuffle(self.wanted)  # noqa: S311  (an order, no secret)
        kept = {s.key: memory.find(s.key) for s in self.wanted}
        self._grid = {key: part.measurement for key, part in kept.items() if part is not None}
        self._planned: dict[float, Planned] = {}
        self._plans: list[Measurement] = []
        self._retimed: list[Measurement] | None = None
        self.notes: list[str] = []

    @property
    def found(self) -> list[Measurement]:
        """All measurements: of settings in their order, whatever the order of ending was."""
        if self._retimed is not None:
            return self._retimed
        grid = (self._grid.get(setting.key) for setting in self.wanted)
        return [*(m for m in grid if m is not None), *self._plans]

    @property
    def how_far(self) -> str:
        """How many settings have ended, a sentence."""
        return f"{len(self._grid)} of {len(self.wanted)} settings; --resume goes on."

    def take_grid(self, where: Where | None) -> None:
        """Measure the settings that no earlier run has measured.

        Args:
            where: they are measured; None: here.
        """
        waiting = [setting for setting in self.wanted if setting.key not in self._grid]
        if not waiting:
            return
        whole = len(self.wanted)
        with closing(self._coming(waiting, where)) as coming:
            for number, setting in enumerate(waiting, whole - len(waiting) + 1):
                what = f"{setting.quantity}, {setting.solver}" if where is None else "settings"
                self._tell(f"{number}/{whole} {what}")
                self._keep(next(coming))

    def take_plans(self) -> None:
        """Measure what the plan chooses for each accuracy."""
        options = self._options
        for accuracy in options.accuracies if AMPLITUDES in options.quantities else ():
            self._tell(f"plan for {accuracy:g}")
            planned = self._planned[accuracy] = plan_scene(self._ruler.bench, accuracy)
            self.notes += planned.notes
            if planned.kept:
                self._plans.append(self._ruler.measure_planned(planned))

    def take_again(self) -> None:
        """Time the cheapest settings and the plan's once more, in turns."""
        self._tell("the cheapest once more")
        options = self._options
        rounds = QUICK_ROUNDS if options.quick else DUEL_ROUNDS
        bench = self._ruler.bench
        self._retimed = again(bench, self.found, self._planned, options.accuracies, rounds)

    def _coming(
        self, waiting: Sequence[Setting], where: Where | None
    ) -> Generator[Ended[Setting, Measurement], None, None]:
        if where is not None:
            yield from ended(Terms.of(self._ruler), waiting, where)
            return
        for setting in waiting:
            yield Ended(setting, self._ruler.measure(setting))

    def _keep(self, one: Ended[Setting, Measurement]) -> None:
        if one.lost:  # not kept for later: another run may have it
            self._grid[one.item.key] = without_number(one.item, one.how_lost)
        elif one.result is not None:
            self._grid[one.item.key] = one.result
            self._memory.record(Part(measurement=one.result))


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
            work = work_of(bench, m.setting, planned.get(m.planned_for or 0.0))
            costs[id(m)].append(bench.timed(work)[1])
    return [_retimed(m, costs.get(id(m), [])) for m in found]


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
