"""Traces of one kind that are fitted together: what they answer alike, whatever a trace shows."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

from fitting.campaign import Setup
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import MeasurementKind, Prediction, Values
from fitting.measurements.plan import Plan
from fitting.measurements.traces.decay_run import ask_decay, read_decay
from fitting.measurements.traces.survey import Asked, Begun, Survey
from fitting.simulate.batch import Batch, Workers
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput


class Recorded(Begun, Protocol):
    """A trace as it was measured, a record."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def output(self) -> str:
        """The FMU's output that is seen; empty: the setup's."""

    @property
    def setting_sigma(self) -> Mapping[str, float]:
        """Standard deviations of settings."""

    @property
    def solved_inside(self) -> int:
        """How many numbers are solved for inside its rows."""


R = TypeVar("R", bound=Recorded)


@dataclass(frozen=True, kw_only=True)
class TracesTogether(MeasurementKind, Generic[R]):
    """One or several traces of one kind.

    Raises:
        BadInput: no trace, or two of one name.
    """

    #: What they are called in complaints.
    NOUN: ClassVar[str]

    setup: Setup
    traces: tuple[R, ...]
    series: str = ""

    def __post_init__(self) -> None:
        labels = [trace.label for trace in self.traces]
        if not labels or len(set(labels)) < len(labels):
            raise BadInput(
                f"{self.NOUN}: labels {', '.join(labels) or 'of no trace'}; wanted one trace at "
                "least, each with a name of its own"
            )

    @property
    def settles(self) -> bool:
        """Its runs begin with the record."""
        return False

    @property
    def is_curve(self) -> bool:
        """Its values follow each other."""
        return True

    @property
    def is_trace(self) -> bool:
        """Its rows are samples over time."""
        return True

    @property
    def solved_inside(self) -> int:
        """What is solved for inside the rows of all traces."""
        return sum(trace.solved_inside for trace in self.traces)

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every trace."""
        return tuple((trace.label, trace.settings) for trace in self.traces)

    @property
    def setting_sigmas(self) -> Mapping[str, Mapping[str, float]]:
        """Declared standard deviations of settings, by label."""
        return {trace.label: trace.setting_sigma for trace in self.traces}

    def named(self, label: str) -> Self:
        """The same with a label for the trace that has none.

        Args:
            label: of the trace.
        """
        traces = tuple(x if x.label else replace(x, label=label) for x in self.traces)
        return replace(self, traces=traces)

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

    def followed(
        self, trace: R, runs: Asked, decay: FloatArray | None, batch: Batch
    ) -> FloatArray | ComplexArray:
        """Values (n,) of a trace as simulated runs and a decay have it.

        Args:
            trace: one of them.
            runs: numbers of its runs.
            decay: after a pulse, whole; None: it wants none.
            batch: that has simulated them.
        """
        raise NotImplementedError

    def decays(
        self,
        model: DrivenModel,
        table: FloatArray,
        asked: Sequence[Sequence[Asked]],
        batch: Batch,
    ) -> Generator[None, None, list[list[FloatArray | None]]]:
        """Responses to a pulse, for every parameter vector and trace; None where none was asked.

        Where they do not follow from few samples, the batch is asked for whole runs.

        Args:
            model: the FMU as the series drives it.
            table: parameter vectors (k, n), each in its own unit.
            asked: runs that the batch has simulated.
            batch: that has.
        """
        found: list[list[FloatArray | None]] = [[None] * len(self.traces) for _ in table]
        again: dict[tuple[int, int], int] = {}
        for i, trace in enumerate(self.traces):
            plan, output = model.plan.step_plan(self.key(trace)), self.output(trace)
            for k, p in enumerate(table):
                run = asked[k][i].decay
                if run is None:
                    continue
                found[k][i] = whole = (
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
            found[k][i] = batch.samples(run, self.output(self.traces[i]))
        return found

    def output(self, trace: R) -> str:
        """The FMU's output that a trace shows.

        Args:
            trace: one of them.
        """
        return trace.output or self.setup.output

    def scaled(self, prediction: Prediction, chi: float) -> Values:
        """S itself: what multiplies it is solved inside."""
        return prediction.values

    def within(self, setup: Setup, series: str) -> Self:
        """The same as part of a series, whose name its labels carry."""
        traces = self.traces
        if series and series != self.series:
            traces = tuple(
                replace(x, label=f"{series}/{x.label}") if x.label else x for x in traces
            )
        return replace(self, setup=setup, series=series, traces=traces)
