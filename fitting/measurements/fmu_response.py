"""The FMU as a `Response`: parameter vectors become batches of simulations.

One batch holds every run of every parameter vector and measurement that was asked for, so that
the workers are busy together and one message each way is enough. Answers depend on the parameters
alone.

What the runs of a failed batch did give is not simulated again (`KnownAnswers`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fmu.runs import Run
from fitting.measurements.dataset import places_of_outputs
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import Evaluation, Measurement
from fitting.measurements.time_record import Traces
from fitting.signal.window import tone_misfit
from fitting.simulate.batch import Batch, Workers, answered, together
from fitting.simulate.budget import Kind
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.errors import FmuFailure, NoAnswer

#: Numbers that are kept, 8 bytes each; and failures.
MOST_KEPT, MOST_FAILURES = 2_000_000, 1_000


class KnownAnswers:
    """What the runs of failed batches gave, and their failures: neither is simulated again.

    Who evaluates several points at once, one of which cannot be simulated, evaluates the others
    again. A run of an FMU depends on nothing but what it is asked with, and so does its failure.

    Args:
        workers: that simulate everything else.
    """

    def __init__(self, workers: Workers) -> None:
        self.workers = workers
        self.results: dict[object, FloatArray] = {}
        self.failures: dict[object, FmuFailure] = {}

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs).

        Args:
            runs: to be simulated, or known.

        Raises:
            FmuFailure: one of them failed, now or before.
        """
        results, failures = self.results, self.failures
        if not results and not failures:  # most evaluations: no key costs time
            return self._simulate(runs)
        keys = [_run_key(run) for run in runs]
        for key in keys:
            if key in failures:
                raise _copy(failures[key])
        result = {key: results[key] for key in keys if key in results}
        missing = [run for run, key in zip(runs, keys, strict=True) if key not in result]
        new = iter(self._simulate(missing) if missing else ())
        return [result[key] if key in result else next(new) for key in keys]

    def _simulate(self, runs: Sequence[Run]) -> list[FloatArray]:
        try:
            return self.workers.run(runs)
        except NoAnswer:  # nobody asks again
            raise
        except FmuFailure as failure:
            if failure.at is not None:
                self.failures[_run_key(runs[failure.at])] = _copy(failure)
            self.results.update((_run_key(runs[k]), each) for k, each in failure.answers.items())
            failure.answers = {}
            # the oldest go where that is too much
            size = sum(answer.size for answer in self.results.values())
            while size > MOST_KEPT:
                size -= self.results.pop(next(iter(self.results))).size
            while len(self.failures) > MOST_FAILURES:
                self.failures.pop(next(iter(self.failures)))
            raise


def _copy(failure: FmuFailure) -> FmuFailure:
    """The same failure, without the calls that it came through."""
    return FmuFailure(failure.message, failure.parameters, failure.fmu)


def _run_key(run: Run) -> object:
    """What distinguishes a run from others."""
    times = (run.start_time_s, run.settle_s, run.sample_step_s, run.samples, run.longest_step_s)
    rest = (run.outputs, run.initial, run.input_signal, run.allow_nan, run.moved, run.segments)
    return frozenset(run.start_values.items()), times, rest


#: Values of derived outputs that are kept, 8 bytes each.
MOST_VALUES = 500_000
#: Names of outputs at one place, the run for each vector (k,), and start values of these runs.
_Reading = tuple[tuple[str, ...], IntArray, list[dict[str, Scalar]]]


def _by_name(
    readings: Sequence[_Reading], answers: Iterator[FloatArray], count: int
) -> list[dict[str, FloatArray]]:
    """Outputs by name, (places,) each, for `count` vectors; the answers come run by run."""
    result: list[dict[str, list[float]]] = [{} for _ in range(count)]
    for names, group, starts in readings:
        values = np.array([next(answers) for _ in starts])[group]
        for outputs, row in zip(result, values, strict=True):
            for name, value in zip(names, row, strict=True):
                outputs.setdefault(name, []).append(value)
    return [{name: np.array(values) for name, values in each.items()} for each in result]


@dataclass(frozen=True, kw_only=True)
class FmuResponse:
    """`Response` of some measurements through FMU workers, for one discrete alternative.

    `models` drive the FMU, by series; `derived` names the outputs that are read, by series. Of one
    batch equal runs are simulated once: a parameter of one experiment costs a run, not a series,
    and two outputs under the same drive share one. Outputs are read at about ``most_places`` at
    most, evenly between all; None: at every place.
    """

    workers: Workers
    parameters: tuple[Parameter, ...]
    measurements: tuple[Measurement, ...]
    models: Mapping[str, DrivenModel]
    derived: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    most_places: int | None = None

    def with_settings(self, settings: Mapping[str, Scalar]) -> FmuResponse:
        """The same response of the FMU with other start values.

        Args:
            settings: start values, by name.
        """
        models = {
            series: replace(model, alternative={**model.alternative, **settings})
            for series, model in self.models.items()
        }
        return replace(self, models=models)

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        """Predictions of every measurement for every parameter vector, in one batch.

        A run that several vectors share counts for the first of them.

        Args:
            ps: parameter vectors (n,), each in its own unit.
            whole: whether everything is wanted that reports show, not residuals only.
        """
        return self._answered(ps, (), whole=whole)

    def evaluate_and_read(
        self, ps: Sequence[FloatArray], places: Collection[int]
    ) -> list[Evaluation]:
        """The same, and derived outputs at some vectors in those runs, where runs begin as they do.

        `derived_many` knows them then.

        Args:
            ps: parameter vectors (n,), each in its own unit.
            places: numbers of those at which derived outputs are read, too.
        """
        return self._answered(ps, places)

    def _answered(
        self, ps: Sequence[FloatArray], places: Collection[int], *, whole: bool = False
    ) -> list[Evaluation]:
        table = np.array([np.asarray(p, dtype=float) for p in ps])
        read = [k for k in places if table[k].tobytes() not in self._read_already]
        try:
            return self._evaluated(self.models, table, read, whole)
        except NoAnswer:
            raise
        except FmuFailure:
            plans = [model.plan for model in self.models.values()]
            if not any(steps.few is not None for plan in plans for steps in plan.steps):
                raise
        # it may have been the long steps between few samples
        models = {
            name: replace(model, plan=model.plan.of_whole_runs)
            for name, model in self.models.items()
        }
        return self._evaluated(models, table, read, whole)

    def _evaluated(
        self, models: Mapping[str, DrivenModel], table: FloatArray, read: Sequence[int], whole: bool
    ) -> list[Evaluation]:
        batch = Batch()
        tasks = [m.predict(models[m.series], table, batch, whole=whole) for m in self.measurements]
        outputs_read = self._read_along(table[read], batch)
        both: list[Generator[None, None, Any]] = [together(tasks), outputs_read]
        columns, outputs = answered(together(both), batch, self._known)
        self._read_already.update(zip((table[k].tobytes() for k in read), outputs, strict=False))
        runs = batch.count(len(table))
        return [
            Evaluation(tuple(c[k] for c in columns), int(runs[k]), self._promised, self._shift)
            for k in range(len(table))
        ]

    @cached_property
    def _promised(self) -> tuple[float, ...]:
        """What the plans promise, by measurement; nothing where nothing was decided."""
        result = []
        for m, shift in zip(self.measurements, self._shifts, strict=True):
            plan = self.models[m.series].plan
            known = plan.budget.of(Kind.STEP) if plan.budget and shift is not None else ()
            promised = plan.promised - sum(decision.cost for decision in known)
            result.append(0.0 if np.isnan(promised) else max(0.0, promised))
        return tuple(result)

    @cached_property
    def _shifts(self) -> list[FloatArray | None]:
        """What every measurement's rows are off by, measured with its sign; None: not measured."""
        return [
            m.shift(self.models[m.series].plan) if isinstance(m, Traces) else None
            for m in self.measurements
        ]

    @cached_property
    def _shift(self) -> FloatArray:
        """The same of all rows, (m,), zero where it is not measured; empty where nothing is."""
        if all(shift is None for shift in self._shifts):
            return np.empty(0)
        pairs = zip(self.measurements, self._shifts, strict=True)
        return np.concatenate([np.zeros(m.rows) if s is None else s for m, s in pairs])

    @cached_property
    def _known(self) -> KnownAnswers:
        return KnownAnswers(self.workers)

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        """Derived outputs after initialisation, per experiment (the sweep, if there is none).

        Args:
            ps: parameter vectors (n,), each in its own unit.
        """
        known = self._read_already
        keys = [np.asarray(p, dtype=float).tobytes() for p in ps]
        result = {key: known[key] for key in keys if key in known}  # others may drop it meanwhile
        new = {key: p for key, p in zip(keys, ps, strict=True) if key not in result}
        read = dict(zip(new, self._derived(list(new.values())) if new else (), strict=True))
        result.update(read)
        answers = [result[key] for key in keys]
        known.update(read)
        each = sum(values.size for values in answers[0].values()) if answers else 0
        while len(known) * each > MOST_VALUES:
            known.pop(next(iter(known)))
        return [dict(answer) for answer in answers]

    @cached_property
    def _read_already(self) -> dict[bytes, dict[str, FloatArray]]:
        """Derived outputs by the bytes of parameter vectors: ranges and walks ask for many again.

        Outputs after initialisation depend on the parameters alone, and they are few numbers.
        """
        return {}

    @property
    def output_runs(self) -> int:
        """Runs in which derived outputs were read so far."""
        return self._output_runs[0]

    @cached_property
    def _output_runs(self) -> list[int]:
        return [0]

    def _derived(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        readings = self._readings(np.array([np.asarray(p, dtype=float) for p in ps]))
        runs = [
            Run(
                start_values=start,
                settle_s=0.0,
                sample_step_s=1.0,
                samples=1,
                outputs=names,
                allow_nan=True,
            )
            for names, _, starts in readings
            for start in starts
        ]
        answers = self.workers.run(runs)
        self._output_runs[0] += len(runs)
        return _by_name(readings, iter([answer[0] for answer in answers]), len(ps))

    def _read_along(
        self, table: FloatArray, batch: Batch
    ) -> Generator[None, None, list[dict[str, FloatArray]]]:
        """Derived outputs at some vectors, of runs that measurements ask for; none if one is not.

        Args:
            table: the vectors, (k, n).
            batch: that the measurements have asked.
        """
        readings = self._readings(table) if table.size else []
        runs = [batch.read_initial(at, names) for names, _, starts in readings for at in starts]
        known = [k for k in runs if k is not None]
        if len(known) < len(runs) or not runs:
            return []
        yield
        return _by_name(readings, map(batch.initial, known), len(table))

    def _readings(self, table: FloatArray) -> list[_Reading]:
        """What derived outputs are read of, place by place.

        Args:
            table: parameter vectors, (k, n).
        """
        readings = []
        for series, places in self._places.items():
            names, model = self.derived.get(series, ()), self.models[series]
            for label, settings in places if names else ():
                first, group = model.groups(table, label)
                starts = [model.values(table[k], label, settings) for k in first]
                readings.append((names, group, starts))
        return readings

    @cached_property
    def _places(self) -> dict[str, list[tuple[str, Mapping[str, Scalar]]]]:
        """Labels and settings at which derived outputs are read, by series."""
        places = places_of_outputs(self.measurements)
        if self.most_places is None:
            return places
        share = min(1.0, self.most_places / max(1, sum(map(len, places.values()))))
        kept = {}
        for series, every in places.items():
            index = np.linspace(0, len(every) - 1, math.ceil(share * len(every)))
            kept[series] = [every[round(k)] for k in index]
        return kept

    def answering(self, measurements: tuple[Measurement, ...]) -> FmuResponse:
        """The same model, asked for these measurements.

        Args:
            measurements: parts of those that it answers for.
        """
        return replace(self, measurements=measurements)

    def read_at(self, most: int) -> FmuResponse:
        """The same model, whose outputs are read at about so many places at most.

        Args:
            most: places, of all series together.
        """
        if sum(map(len, self._places.values())) <= most:
            return self  # which knows what it has read
        return replace(self, most_places=most)

    def misfit(self, p: FloatArray) -> float:
        """Largest relative deviation of any sampled run from mean plus tones.

        Args:
            p: parameters (n,), each in its own unit.
        """
        batch = Batch()
        sampled = [
            run
            for m in self.measurements
            for run in m.sampled(self.models[m.series], np.asarray(p, dtype=float), batch)
        ]
        batch.simulate(self.workers)
        return max(
            (tone_misfit(s.window, batch.samples(s.run, s.output)) for s in sampled), default=0.0
        )
