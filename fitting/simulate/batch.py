"""Runs asked of an FMU in one batch: equal ones are simulated once, whoever asked for them.

Two runs are equal if their start values, window and input signal are: outputs that are read of the
same run, and amplitudes that are wanted twice, then cost nothing.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Protocol, TypeVar

import numpy as np

from fitting.fmu.runs import InputSignal, Run, SampledSignal, Segment
from fitting.signal.window import Window
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar

#: What the tool applies to inputs during a run.
Signal = InputSignal | SampledSignal | None
Answer = TypeVar("Answer")


class Workers(Protocol):
    """What is needed of `fitting.fmu.FmuWorkers`."""

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs).

        Args:
            runs: to be simulated.
        """
        ...


def alike(table: FloatArray) -> tuple[IntArray, IntArray]:
    """First index (g,) of every group of equal rows, and the group (k,) of every row.

    Equal means bit for bit; ``table`` (k, n).
    """
    rows = np.ascontiguousarray(table)
    if rows.shape[1] == 0 or rows.shape[0] == 1:
        return np.zeros(1, dtype=np.intp), np.zeros(rows.shape[0], dtype=np.intp)
    keys = rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    _, first, group = np.unique(keys, return_index=True, return_inverse=True)
    return np.asarray(first, dtype=np.intp), np.asarray(group, dtype=np.intp).ravel()


@dataclass(frozen=True, eq=False)
class Variation:
    """What one of several runs has of its own: further start values, its window, its signal.

    `segments` follow the window, with other values of the variable that is ``moved``.
    """

    values: Mapping[str, Scalar]
    window: Window
    signal: Signal = None
    moved: str = ""
    segments: tuple[Segment, ...] = ()

    @cached_property
    def key(self) -> tuple[object, ...]:
        """What distinguishes it from others."""
        w = self.window
        times = (w.settle_s, w.step_s, w.samples, w.longest_s, w.delay_steps)
        return (*self.values.items(), *times, self.signal, self.moved, self.segments)


class Batch:
    """Collects runs, simulates the different ones together, and reads amplitudes of them."""

    def __init__(self) -> None:
        self._index: dict[frozenset[tuple[str, Scalar]], dict[tuple[object, ...], int]] = {}
        self._runs: list[tuple[Mapping[str, Scalar], Variation]] = []
        self._outputs: list[tuple[str, ...]] = []
        self._initial: dict[int, tuple[str, ...]] = {}
        self.owners: list[int] = []
        self._answers: list[FloatArray] = []
        self._phasors: dict[tuple[int, str, tuple[float, ...]], ComplexArray] = {}

    def ask(
        self,
        values: Mapping[str, Scalar],
        window: Window,
        signal: Signal,
        output: str,
        owner: int = 0,
    ) -> int:
        """Number of the run that answers this; ``owner`` is noted for the first that asks.

        Args:
            values: start values, by name.
            window: settling and samples of a run.
            signal: that the tool applies to an input, None for none.
            output: name of the output.
            owner: which evaluation pays for the run.
        """
        [k] = self.ask_varied(values, [Variation({}, window, signal)], output, owner)
        return k

    def ask_varied(
        self,
        values: Mapping[str, Scalar],
        variations: Sequence[Variation],
        output: str,
        owner: int = 0,
    ) -> list[int]:
        """Numbers of the runs that answer this, one for each variation; see `ask`.

        What they share is looked at once. A run asked for in this way equals those that were asked
        for with the same names varied.

        Args:
            values: start values that all share, by name; not to be changed afterwards.
            variations: what each has besides.
            output: name of the output.
            owner: which evaluation pays for the runs.
        """
        index = self._index.setdefault(frozenset(values.items()), {})
        result = []
        for own in variations:
            k = index.setdefault(own.key, len(self._runs))
            if k < len(self._answers) and output not in self._outputs[k]:
                k = index[own.key] = len(self._runs)  # simulated already, without this output
            if k == len(self._runs):
                self._runs.append((values, own))
                self._outputs.append((output,))
                self.owners.append(owner)
            elif output not in self._outputs[k]:
                self._outputs[k] = (*self._outputs[k], output)
            result.append(k)
        return result

    def read_initial(self, values: Mapping[str, Scalar], outputs: tuple[str, ...]) -> int | None:
        """Number of a run that begins so, in which outputs are read after initialisation, too.

        None where there is none to be simulated: an input would be among what it begins with.

        Args:
            values: all of its start values, by name.
            outputs: their names.
        """
        for k in self._index.get(frozenset(values.items()), {}).values():
            own = self._runs[k][1]
            if k >= len(self._answers) and not own.values and own.signal is None:
                self._initial[k] = outputs
                return k
        return None

    def initial(self, k: int) -> FloatArray:
        """Outputs of a simulated run after initialisation, shape (outputs,).

        Args:
            k: number of the run that `read_initial` gave.
        """
        return np.asarray(self._answers[k][0, len(self._outputs[k]) :])

    def simulate(self, workers: Workers) -> None:
        """Run all that was asked for since the last call, in one batch.

        Args:
            workers: processes that run the FMU.
        """
        runs = [
            Run(
                start_values={**shared, **own.values},
                settle_s=own.window.settle_s,
                sample_step_s=own.window.step_s,
                samples=own.window.samples,
                outputs=outputs,
                initial=self._initial.get(k, ()),
                input_signal=own.signal,
                longest_step_s=own.window.longest_s,
                delay_steps=own.window.delay_steps,
                moved=own.moved,
                segments=own.segments,
            )
            for k, ((shared, own), outputs) in islice(
                enumerate(zip(self._runs, self._outputs, strict=True)), len(self._answers), None
            )
        ]
        self._answers += workers.run(runs) if runs else []

    def forget(self) -> None:
        """Ask no more for what has no answer, as after a failure; what was simulated stays."""
        known = len(self._answers)
        del self._runs[known:], self._outputs[known:], self.owners[known:]
        for index in self._index.values():
            for key in [key for key, k in index.items() if k >= known]:
                del index[key]

    def samples(self, k: int, output: str) -> FloatArray:
        """One output of a simulated run, shape (samples,).

        Args:
            k: number of the run that `ask` gave.
            output: name of the output.
        """
        return np.asarray(self._answers[k][:, self._outputs[k].index(output)])

    def amplitudes(self, k: int, window: Window, output: str) -> FloatArray:
        """Amplitudes at the window's tones of one output of a simulated run, shape (tones,).

        Args:
            k: number of the run that `ask` gave.
            window: settling and samples of a run.
            output: name of the output.
        """
        return np.abs(self.phasors(k, window, output))

    def phasors(self, k: int, window: Window, output: str) -> ComplexArray:
        """Phasors P at the window's tones of one output of a simulated run, shape (tones,).

        output(t) = mean + sum of Re[P exp(i 2 pi f t)], with the FMU's time t: a drive
        A cos(2 pi f t + phase) of a linear FMU gives P = X(f) A exp(i phase).

        Args:
            k: number of the run that `ask` gave.
            window: settling and samples of a run.
            output: name of the output.
        """
        key = (k, output, window.tones_hz)
        if key not in self._phasors:
            self._phasors[key] = window.phasors(self.samples(k, output))
        return self._phasors[key]

    def count(self, owners: int) -> IntArray:
        """Number of simulated runs by who asked first, shape (owners,).

        Args:
            owners: how many evaluations there are.
        """
        return np.bincount(np.array(self.owners, dtype=np.intp), minlength=owners)


def answered(task: Generator[None, None, Answer], batch: Batch, workers: Workers) -> Answer:
    """What a task returns that asks a batch for runs and yields until they are simulated.

    Args:
        task: not yet begun.
        batch: that it asks.
        workers: that simulate.
    """
    while True:
        try:
            next(task)
        except StopIteration as ended:
            return ended.value  # type: ignore[no-any-return]
        batch.simulate(workers)


def together(tasks: Sequence[Generator[None, None, Answer]]) -> Generator[None, None, list[Answer]]:
    """Step several predictions of one batch side by side, so that they share its rounds.

        phasors = yield from together([c.predict(table, f, batch) for c, f in curves])

    Args:
        tasks: predictions of one kind of answer, not yet begun.

    Returns:
        What each of them returns, in their order.
    """
    result: dict[int, Answer] = {}
    while True:
        for k, task in enumerate(tasks):
            if k not in result:
                try:
                    next(task)
                except StopIteration as ended:
                    result[k] = ended.value
        if len(result) == len(tasks):
            return [result[k] for k in range(len(tasks))]
        yield
