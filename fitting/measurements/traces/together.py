"""Traces of one kind that are fitted together: what they answer alike, whatever a trace shows."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.linalg import block_diag

from fitting.measurements.complex.gain import Solved
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import Predicting, Prediction
from fitting.measurements.plan import Plan
from fitting.measurements.together import Together
from fitting.measurements.traces.decay_run import ask_decay, read_decay
from fitting.measurements.traces.survey import Asked, Survey
from fitting.measurements.traces.time_record import TimeRecord
from fitting.simulate.batch import Batch, Workers
from fitting.text.arrays import ComplexArray, FloatArray

R = TypeVar("R", bound=TimeRecord)


@dataclass(frozen=True, kw_only=True)
class TracesTogether(Together[R]):
    """One or several traces of one kind."""

    FIELD = "traces"

    traces: tuple[R, ...] = field(default=())

    @property
    def settles(self) -> bool:
        """Its runs begin with the record."""
        return False

    @property
    def is_trace(self) -> bool:
        """Its rows are samples over time."""
        return True

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with the communication step of every trace."""
        plan = model.plan
        for trace in self.traces:
            survey = Survey(self, trace, replace(model, plan=plan), workers)
            plan = survey.planned(points)
        return plan

    def reviewed(self, model: DrivenModel, p: FloatArray, workers: Workers) -> Plan:
        """The plan with what the communication step of every trace leaves there.

        Args:
            model: the FMU as the series drives it.
            p: parameters (n,), each in its own unit.
            workers: of the FMU.
        """
        plan = model.plan
        for trace in self.traces:
            plan = Survey(self, trace, replace(model, plan=plan), workers).reviewed(p)
        return plan

    def key(self, trace: R) -> str:
        """What the plan knows a trace by.

        Args:
            trace: one of them.
        """
        raise NotImplementedError

    def ask(self, model: DrivenModel, trace: R, p: FloatArray, batch: Batch, owner: int) -> Asked:
        """Numbers of the runs that answer for a trace.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        raise NotImplementedError

    def read(
        self, trace: R, runs: Asked, decay: FloatArray | None, batch: Batch
    ) -> tuple[FloatArray | ComplexArray, FloatArray]:
        """Values (n,) of a trace as the model has it, and derivatives (rows, k) of its rows.

        The derivatives are those by what is solved inside.

        Args:
            trace: one of them.
            runs: numbers of its runs.
            decay: after a pulse, whole; None: it wants none.
            batch: that has simulated them.
        """
        raise NotImplementedError

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Values of every trace, with the best of what is solved inside."""
        requested = [
            [self.ask(model, trace, p, batch, k) for trace in self.traces]
            for k, p in enumerate(table)
        ]
        yield
        decays = yield from self.decays(model, table, requested, batch)
        result: list[Prediction] = []
        for each, free in zip(requested, decays, strict=True):
            trios = zip(self.traces, each, free, strict=True)
            values, designs = zip(*(self.read(*trio, batch) for trio in trios), strict=True)
            solved = tuple(Solved(design, np.empty(0)) for design in designs)
            result.append(Prediction(np.concatenate(values), solved=solved))
        return result

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by what is solved inside."""
        return np.asarray(block_diag(*self.solved_blocks(prediction)))

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """A stretch for each trace."""
        return [solved.design for solved in prediction.solved]

    def decays(
        self,
        model: DrivenModel,
        table: FloatArray,
        requested: Sequence[Sequence[Asked]],
        batch: Batch,
    ) -> Generator[None, None, list[list[FloatArray | None]]]:
        """Responses to a pulse, for every parameter vector and trace; None where none was asked.

        Where they do not follow from few samples, the batch is asked for whole runs.

        Args:
            model: the FMU as the series drives it.
            table: parameter vectors (k, n), each in its own unit.
            requested: runs that the batch has simulated.
            batch: that has.
        """
        result: list[list[FloatArray | None]] = [[None] * len(self.traces) for _ in table]
        again: dict[tuple[int, int], int] = {}
        for i, trace in enumerate(self.traces):
            plan, output = model.plan.step_plan(self.key(trace)), self.output_of(trace)
            for k, p in enumerate(table):
                run = requested[k][i].decay
                if run is None:
                    continue
                result[k][i] = whole = (
                    batch.samples(run, output)
                    if plan is None
                    else read_decay(plan, batch, run, output)
                )
                if whole is None:
                    values = model.whole.values(p, trace.label or None, trace.settings)
                    again[k, i] = ask_decay(trace, values, None, batch, output, k)
        if again:
            yield
        for (k, i), run in again.items():
            result[k][i] = batch.samples(run, self.output_of(self.traces[i]))
        return result
