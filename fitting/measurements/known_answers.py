"""Answers of evaluations that failed: what their runs did give is not simulated again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fitting.fmu.runs import Run
from fitting.simulate.batch import Workers
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer

#: Numbers that are kept, 8 bytes each; and failures.
MOST_KEPT, MOST_FAILURES = 2_000_000, 1_000


class KnownAnswers:
    """What the runs of failed evaluations gave, and their failures: neither is simulated again.

    Who evaluates several points at once, one of which cannot be simulated, evaluates the others
    again. A run of an FMU depends on nothing but what it is asked with, and so does its failure.

    Args:
        workers: that simulate everything else.
    """

    def __init__(self, workers: Workers) -> None:
        self.workers = workers
        self.results: dict[object, FloatArray] = {}
        self.failures: dict[object, FmuFailure] = {}

    @contextmanager
    def evaluation(self) -> Iterator[Workers]:
        """Workers for one evaluation: what they give is kept if the context ends in an error.

        Several evaluations may be under way, each in a context of its own.
        """
        evaluation = _Evaluation(self)
        try:
            yield evaluation
        except NoAnswer:  # nobody asks again
            raise
        except Exception:
            self.results.update((_run_key(run), answer) for run, answer in evaluation.latest)
            # the oldest go where that is too much
            size = sum(answer.size for answer in self.results.values())
            while size > MOST_KEPT:
                size -= self.results.pop(next(iter(self.results))).size
            while len(self.failures) > MOST_FAILURES:
                self.failures.pop(next(iter(self.failures)))
            raise


class _Evaluation:
    """Workers of one evaluation: what is known, and what it has simulated so far."""

    def __init__(self, known: KnownAnswers) -> None:
        self.known = known
        self.latest: list[tuple[Run, FloatArray]] = []

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs).

        Args:
            runs: to be simulated, or known.

        Raises:
            FmuFailure: one of them failed, now or before.
        """
        results, failures = self.known.results, self.known.failures
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
            answers = self.known.workers.run(runs)
        except NoAnswer:
            raise
        except FmuFailure as failure:
            if failure.at is not None:
                self.known.failures[_run_key(runs[failure.at])] = _copy(failure)
            self.latest.extend((runs[k], answer) for k, answer in failure.answers.items())
            failure.answers = {}
            raise
        self.latest.extend(zip(runs, answers, strict=True))
        return answers


def _copy(failure: FmuFailure) -> FmuFailure:
    """The same failure, without the calls that it came through."""
    return FmuFailure(failure.message, failure.parameters, failure.fmu)


def _run_key(run: Run) -> object:
    """What distinguishes a run from others."""
    times = (run.start_time_s, run.settle_s, run.sample_step_s, run.samples, run.longest_step_s)
    rest = (run.outputs, run.input_signal, run.allow_nan, run.moved, run.segments)
    return frozenset(run.start_values.items()), times, rest
