"""Workers whose outputs are sums of lines, in closed form, at the times that a run asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.fmu.runs import Run, row_times
from fitting.text.arrays import FloatArray, Scalar

#: An output at times (n,) of a run with these start values.
Output = Callable[[FloatArray, Mapping[str, Scalar]], FloatArray]


def line(f_hz: float, amplitude: float, phase: float = 0.0) -> Output:
    """One line, whatever the start values."""
    return lambda t, _: np.asarray(amplitude * np.cos(2.0 * np.pi * np.mod(f_hz * t, 1.0) + phase))


def together(*outputs: Output) -> Output:
    """Their sum."""
    return lambda t, values: np.asarray(sum(output(t, values) for output in outputs))


@dataclass
class LineWorkers:
    """Answers runs by functions of time, by the output's name; keeps what it was asked."""

    outputs: Mapping[str, Output]
    asked: list[Run] = field(default_factory=list)

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        self.asked += runs
        return [
            np.stack(
                [
                    self.outputs[name](np.array(row_times(run)), run.start_values)
                    for name in run.outputs
                ],
                axis=1,
            )
            for run in runs
        ]


@dataclass
class BranchWorkers:
    """A tone that is moved while it runs: its amplitude by the frequency and the way to it.

    `amplitude(f, rising)` of the one output, frequencies in `unit` (in Hz).
    """

    amplitude: Callable[[float, bool], float]
    unit: float = 1.0
    asked: list[Run] = field(default_factory=list)

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        self.asked += runs
        return [self._samples(run) for run in runs]

    def _samples(self, run: Run) -> FloatArray:
        times, first = np.array(row_times(run)), float(run.start_values[run.moved])
        places = [first, *(segment.value for segment in run.segments)]
        counts = [run.samples, *(segment.samples for segment in run.segments)]
        columns, begin = [], 0
        for k, (place, count) in enumerate(zip(places, counts, strict=True)):
            rising = place >= (places[k - 1] if k else place)
            f = place * self.unit
            turns = np.mod(f * times[begin : begin + count], 1.0)
            columns.append(self.amplitude(f, rising) * np.cos(2.0 * np.pi * turns + 0.7))
            begin += count
        return np.concatenate(columns)[:, np.newaxis]
