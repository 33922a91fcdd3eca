"""Answers of evaluations that failed: what their runs did give is not simulated again.

Who evaluates several points at once, one of which cannot be simulated, evaluates the others again.
A run of an FMU depends on nothing but what it is asked with, and so does its failure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeAlias

from fitting.fmu import Run
from fitting.simulate.batch import Workers
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer

#: Numbers that are kept, 8 bytes each; and failures.
MOST_KEPT, MOST_FAILURES = 2_000_000, 1_000

_Key: TypeAlias = tuple[object, ...]


@dataclass(frozen=True, eq=False)
class KnownAnswers:
    """What the runs of evaluations gave that came to no end.

    ``workers`` simulate everything else.
    """

    workers: Workers
    results: dict[_Key, FloatArray] = field(default_factory=dict)
    failures: dict[_Key, FmuFailure] = field(default_factory=dict)

    @contextmanager
    def evaluation(self) -> Iterator[_Evaluation]:
        """Workers for one evaluation: what they give is kept if the context ends in an error.

        Several evaluations may be under way, each in a context of its own.
        """
        workers = _Evaluation(self)
        try:
            yield workers
        except NoAnswer:  # nobody asks again
            raise
        except Exception:
            self._keep(workers.latest)
            raise

    def _keep(self, latest: Sequence[tuple[Run, FloatArray]]) -> None:
        """Keep answers, in place of the oldest where that is too much."""
        self.results.update((_key(run), answer) for run, answer in latest)
        size = sum(answer.size for answer in self.results.values())
        while size > MOST_KEPT:
            size -= self.results.pop(next(iter(self.results))).size
        while len(self.failures) > MOST_FAILURES:
            self.failures.pop(next(iter(self.failures)))


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """Workers of one evaluation: what is known, and what it has simulated so far."""

    known: KnownAnswers
    latest: list[tuple[Run, FloatArray]] = field(default_factory=list)

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs).

        Args:
            runs: to be simulated, or known.

        Raises:
            FmuFailure: one of them failed, now or before.
        """
        results, failures = self.known.results, self.known.failures
        if not results and not failures:
            return self._simulated(runs)
        keys = [_key(run) for run in runs]
        for key in keys:
            if key in failures:
                raise _again(failures[key])
        result = {key: results[key] for key in keys if key in results}
        missing = [run for run, key in zip(runs, keys, strict=True) if key not in result]
        new = iter(self._simulated(missing) if missing else ())
        return [result[key] if key in result else next(new) for key in keys]

    def _simulated(self, runs: Sequence[Run]) -> list[FloatArray]:
        try:
            answers = self.known.workers.run(runs)
        except NoAnswer:
            raise
        except FmuFailure as failure:
            if failure.at is not None:
                self.known.failures[_key(runs[failure.at])] = _again(failure)
            self.latest.extend((runs[k], answer) for k, answer in failure.answers.items())
            failure.answers = {}
            raise
        self.latest.extend(zip(runs, answers, strict=True))
        return answers


def _again(failure: FmuFailure) -> FmuFailure:
    """The same words, without the calls that a failure came through."""
    return FmuFailure(failure.message, failure.parameters, failure.fmu)


def _key(run: Run) -> _Key:
    """What tells a run from others."""
    times = (run.start_time_s, run.settle_s, run.sample_step_s, run.samples, run.longest_step_s)
    rest = (run.outputs, run.input_signal, run.allow_nan, run.moved, run.segments)
    return frozenset(run.start_values.items()), times, rest
