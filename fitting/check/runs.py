"""The runs of a doctor: some steps with every value set, and every input moved from its start."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fitting.extension.fmu import (
    USUAL_ACCURACY,
    FmuDescription,
    FmuVariable,
    FmuWorkers,
    Handling,
    Run,
    SampledSignal,
)
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

STEPS = 16  # in which a value shows what it does
VARIED = 1e-3  # of a value, to see what it does
#: Shares of an output below which rounding differs, on another machine in another way.
ROUNDING = 1e-12
#: The trial step of an FMU that declares no step and shows no response, s.
USUAL_STEP_S = 1e-3
#: Trial steps among which one is looked for, from and to, s, and their ratio; and the largest
#: second difference of a response over its range from which 16 steps cover a period of it or four
#: of its time constants: some 20 steps in a period, four in a time constant.
SHORTEST_S, LONGEST_S, LONGER, BENDS = 1e-12, 1e4, 4.0, 0.05
#: Processor time of a run after which no longer steps are tried, s.
MOST_S = 1.0
#: Own steps in a trial step: halves and quarters of it are whole ones, too.
OWN_STEPS = 4
#: Share of the budget after which a run is stopped: one that hangs leaves time for the others.
PROBE_SHARE = 1.0 / 6.0
#: Share of it in which own start values are found that the FMU does not take.
STARTS_SHARE = 1.0 / 3.0


class NotTried(Exception):
    """A probe that failed, or had no time left; `Probes` keeps which."""


@dataclass(frozen=True)
class FailedProbe:
    """What was tried when the FMU ended its process, gave no answer, or failed after it had run."""

    what: str
    message: str


class Probes:
    """Runs of a check: what fails is kept, and the next probe goes on.

    Every run starts at ``values`` and at the FMU's own start values, ``starts``, as far as it takes
    these: ``refused`` are those that it does not. ``failed`` are probes that failed otherwise than
    by a status of the FMU, ``skipped`` those that the budget left no time for.

    Args:
        workers: one process that runs the FMU; a failed one is replaced.
        values: start values by name, next to the FMU's own.
        budget_s: time that all probes may take, s.
        show: is called with what is tried.
    """

    def __init__(
        self,
        workers: FmuWorkers,
        values: Mapping[str, Scalar] | None = None,
        budget_s: float = math.inf,
        show: Callable[[str], None] = lambda _what: None,
    ) -> None:
        self.workers, self.description = workers, workers.description
        self.values = dict(values or {})
        self.failed: list[FailedProbe] = []
        self.skipped: dict[str, None] = {}
        self.refused: tuple[str, ...] = ()
        self._show, self._budget_s = show, budget_s
        self._until = time.monotonic() + budget_s
        # variables of one reference are one: of these the first is set, or one that is given
        variables = self.description.variables
        taken = {variables[n].place_of_value for n in self.values if n in variables}
        self.starts: dict[str, Scalar] = {}
        for v in variables.values():
            is_varied = v.kind == "Real" or moved(v, v.start, VARIED) is not None
            if not v.can_be_started or v.start is None or not is_varied:
                continue
            if v.place_of_value not in taken:
                taken.add(v.place_of_value)
                self.starts[v.name] = v.start

    def run(self, what: str, runs: Sequence[Run]) -> list[FloatArray]:
        """Results of runs that went well before.

        Args:
            what: is tried, with its value.
            runs: to be simulated.

        Raises:
            NotTried: one failed, or there was no time.
        """
        try:
            return self._run(what, runs)
        except FmuFailure as error:
            self.failed.append(FailedProbe(what, error.message))
            raise NotTried from error

    def tried(self, what: str, runs: Sequence[Run]) -> list[FloatArray] | None:
        """Results of runs; None where the FMU refuses or fails one of them.

        Args:
            what: is tried, with its value.
            runs: to be simulated.

        Raises:
            NotTried: the FMU ended its process or gave no answer, or there was no time.
        """
        try:
            return self._run(what, runs)
        except FmuFailure as error:
            if self.workers.pids and not isinstance(error, NoAnswer):
                return None  # a status of the FMU
            self.failed.append(FailedProbe(what, error.message))
            raise NotTried from error

    def _run(self, what: str, runs: Sequence[Run]) -> list[FloatArray]:
        if time.monotonic() > self._until:
            self.skipped[what] = None
            raise NotTried
        self._show(what)
        try:
            return self.workers.run(runs)
        except NoAnswer:
            raise
        except FmuFailure:
            if not self.workers.pids:
                raise
            self.workers.renew()  # what went before in the process may be to blame
            return self.workers.run(runs)

    def drop_refused(self, step_s: float) -> None:
        """Find own start values that the FMU does not take, by halves; no run sets them.

        Args:
            step_s: of a step, s, that goes well with nothing set.
        """
        bare = replace(self.trial_run(step_s), handling=Handling())
        taken: dict[str, Scalar] = {}
        refused: list[str] = []
        until, self._until = self._until, time.monotonic() + STARTS_SHARE * self._budget_s

        def take(names: Sequence[str]) -> None:
            given = {**taken, **{name: self.starts[name] for name in names}, **self.values}
            try:
                self._run("own start values", [replace(bare, start_values=given)])
            except FmuFailure:
                half = len(names) // 2
                for part in (names[:half], names[half:]) if half else ():
                    take(part)
                refused.extend(() if half else names)
            else:
                taken.update({name: self.starts[name] for name in names})

        with suppress(NotTried):  # those that are left are not set either
            take(tuple(self.starts))
        self._until, self.refused, self.starts = until, tuple(refused), taken

    def trial_run(self, step_s: float, steps: int = 1) -> Run:
        """Some steps from rest, with every value that the FMU can be given.

        Args:
            step_s: length of a step, s.
            steps: their number.

        Raises:
            BadInput: neither an output nor a local variable is a number.
        """
        outputs = tuple(v.name for v in self.description.observable)
        if not outputs:
            raise BadInput(
                f"{self.description.path}: has neither an output nor a local variable that is a "
                "number, wanted one at least"
            )
        return Run(
            start_values={**self.starts, **self.values},
            settle_s=0.0,
            sample_step_s=step_s,
            samples=steps + 1,
            outputs=outputs,
            allow_nan=True,
        )

    def others(self, run: Run) -> dict[str, Scalar]:
        """Another value of every variable that a run sets and that has one.

        Args:
            run: some steps.
        """
        given, variables = run.start_values, self.description.variables.values()
        answers = {v.name: moved(v, given[v.name], VARIED) for v in variables if v.name in given}
        return {name: other for name, other in answers.items() if other is not None}


def trial_step_s(description: FmuDescription) -> float | None:
    """Length of a trial step that suits what an FMU declares, s; None: it declares no step.

    Args:
        description: of the FMU.
    """
    if description.internal_step_s is not None:
        return OWN_STEPS * description.internal_step_s
    return description.usual_step_s


def response_step_s(probes: Probes) -> float:
    """Length of a step that resolves the response to pushed inputs, s; `USUAL_STEP_S`: none shows.

    Longer and longer steps are tried. Over short ones a response is straight or a low power of the
    time; the first that bend it more show its time constant, or its period. What is rough already
    over the shortest ones is noise, what stands still between them moves in steps of its own.

    Args:
        probes: of the FMU.

    Raises:
        NotTried: a run did not end in its time, or ended the process.
    """
    run = _pushed(probes, probes.trial_run(SHORTEST_S, STEPS))
    smooth: npt.NDArray[np.bool_] | None = None
    while run.sample_step_s < LONGEST_S:
        before = probes.workers.counts.processor_s
        what = f"steps of {run.sample_step_s:g} s"
        if (results := probes.tried(what, [run])) is not None:
            # some FMUs have their outputs from the first step on, or one later
            y = results[0][2:]
            ranges, steps = np.ptp(y, axis=0), np.diff(y, axis=0)
            moving = ranges > USUAL_ACCURACY * np.max(np.abs(y), axis=0)
            moving &= np.all(steps != 0.0, axis=0)
            most = np.max(np.abs(np.diff(steps, axis=0)), axis=0)
            bends = np.divide(most, ranges, out=np.zeros_like(most), where=moving)
            smooth = bends < BENDS if smooth is None else smooth
            bend = float(np.max(bends[smooth], initial=0.0))
            if bend >= BENDS:  # it grows with the square of the step
                return run.sample_step_s * math.sqrt(BENDS / bend)
        if probes.workers.counts.processor_s - before > MOST_S:
            break
        run = replace(run, sample_step_s=LONGER * run.sample_step_s)
    return USUAL_STEP_S


def pushed_run(probes: Probes, step_s: float) -> Run:
    """Some steps with every input moved from its start, if the FMU bears that: what rests is blind.

    An input that is given a value stays as it is. There are fewer steps where the FMU ends earlier.

    Args:
        probes: of the FMU, with values with which a trial step went well.
        step_s: length of a step, s.

    Raises:
        NotTried: the run did not end in its time, or ended the process.
    """
    run = probes.trial_run(step_s, STEPS)
    while (
        run.samples > 2 and probes.tried(f"{run.samples - 1} steps of {step_s:g} s", [run]) is None
    ):
        run = replace(run, samples=1 + (run.samples - 1) // 4)
    other = _pushed(probes, run)
    return run if probes.tried("all inputs moved", [other]) is None else other


def _pushed(probes: Probes, run: Run) -> Run:
    """The run with every input that it sets moved from its start but for those of given values."""
    variables = probes.description.variables
    pushed = {
        name: other
        for name in probes.starts
        if variables[name].causality == "input"
        if (other := moved(variables[name], variables[name].start, 1.0)) is not None
    }
    return replace(run, start_values={**run.start_values, **pushed})


def in_parts(run: Run, parts: int) -> Run:
    """The same samples, with every step taken in some equal ones.

    Args:
        run: some steps without a signal.
        parts: of each step.
    """
    n = run.samples - 1
    steps = SampledSignal(
        (), run.sample_step_s / parts, np.empty((parts * n, 0)), np.empty((n + 1, 0))
    )
    return replace(run, input_signal=steps)


def moved(variable: FmuVariable, value: Scalar | None, share: float) -> Scalar | None:
    """Another value: moved by a share of itself, or of one, up or else down, inside its limits.

    A Boolean is the other one, an enumeration's the next item, a whole number with both limits the
    next one; None: there is none.

    Args:
        variable: of the FMU.
        value: that it has.
        share: of the value.
    """
    if value is None or not variable.can_be_started:
        return None
    if variable.kind == "Boolean":
        return not value
    if variable.items:
        items = [item for item in variable.items.values() if item != value]
        return items[0] if items else None
    limited = variable.min is not None and variable.max is not None
    if variable.kind == "Integer" and limited and variable.min != variable.max:
        return int(value) + (1 if int(value) < float(variable.max or 0.0) else -1)
    if variable.kind != "Real":
        return None
    number = float(value)
    other = number * (1.0 + share) if number else share
    if variable.max is not None and other > variable.max:
        other = number * (1.0 - share) if number else -share
    return other if variable.min is None or other >= variable.min else None


def moves(values: FloatArray) -> bool:
    """Whether an output moves by more than rounding after the first step, and not as a clock does.

    Args:
        values: by sample and output.
    """
    bends = np.abs(np.diff(values[1:], 2, axis=0))
    sizes = np.max(np.abs(values), axis=0, initial=0.0)
    return bool(np.any(bends > ROUNDING * sizes))


def shares(difference: FloatArray, values: FloatArray) -> FloatArray:
    """Largest differences over largest values, by column; zero where nothing differs.

    Args:
        difference: by sample and output.
        values: by sample and output.
    """
    most, size = np.max(np.abs(difference), axis=0), np.max(np.abs(values), axis=0)
    return np.asarray(
        np.divide(most, size, out=np.where(most > 0.0, np.inf, 0.0), where=size > 0.0)
    )
