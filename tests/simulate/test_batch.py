"""Runs that are asked for together: equal ones are simulated once, by counting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from fitting.fmu.runs import Run
from fitting.signal.window import plan_window
from fitting.simulate.batch import Batch, Variation
from fitting.text.arrays import FloatArray


class Tone:
    """Answers every run with a cos(2 pi u t), and keeps what it was asked for."""

    def __init__(self) -> None:
        self.runs: list[Run] = []

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        self.runs += runs
        found = []
        for run in runs:
            a, u = (float(run.start_values[name]) for name in ("a", "u"))
            t = run.settle_s + run.sample_step_s * np.arange(run.samples)
            row = a * np.cos(2.0 * np.pi * u * t)
            found.append(np.stack([row] * len(run.outputs), axis=1))
        return found


def varied(*tones: float) -> list[Variation]:
    return [Variation({"u": u}, plan_window((u,), 0.0)) for u in tones]


def test_runs_of_the_same_values_are_one_and_those_of_others_are_not() -> None:
    batch, tone = Batch(), Tone()
    first = batch.ask_varied({"a": 2.0}, varied(3.0, 5.0), "x")
    again = batch.ask_varied({"a": 2.0}, varied(5.0, 7.0), "y", owner=1)
    other = batch.ask_varied({"a": 1.0}, varied(3.0), "x", owner=1)
    assert again[0] == first[1]
    assert len({*first, *again, *other}) == 4
    batch.simulate(tone)
    assert [(r.start_values["a"], r.start_values["u"]) for r in tone.runs] == [
        (2.0, 3.0),
        (2.0, 5.0),
        (2.0, 7.0),
        (1.0, 3.0),
    ]
    assert [r.outputs for r in tone.runs] == [("x",), ("x", "y"), ("y",), ("x",)]
    assert list(batch.count(2)) == [2, 2]
    for k, output, a, u in ((first[0], "x", 2.0, 3.0), (again[0], "y", 2.0, 5.0)):
        assert np.allclose(batch.phasors(k, plan_window((u,), 0.0), output), a, rtol=1e-12)
    assert np.allclose(batch.phasors(other[0], plan_window((3.0,), 0.0), "x"), 1.0, rtol=1e-12)


def test_what_failed_is_not_asked_for_again() -> None:
    class Failing(Tone):
        def run(self, runs: Sequence[Run]) -> list[FloatArray]:
            if any(run.start_values["u"] == 7.0 for run in runs):
                raise ArithmeticError
            return super().run(runs)

    batch, tone = Batch(), Failing()
    [kept] = batch.ask_varied({"a": 2.0}, varied(3.0), "x")
    batch.simulate(tone)
    batch.ask_varied({"a": 2.0}, varied(7.0, 9.0), "x")
    with pytest.raises(ArithmeticError):
        batch.simulate(tone)
    batch.forget()
    [again, other] = batch.ask_varied({"a": 2.0}, varied(3.0, 5.0), "x", owner=1)
    batch.simulate(tone)
    assert again == kept
    assert [run.start_values["u"] for run in tone.runs] == [3.0, 5.0]
    assert np.allclose(batch.phasors(other, plan_window((5.0,), 0.0), "x"), 2.0, rtol=1e-12)
    assert list(batch.count(2)) == [1, 1]


def test_another_output_of_a_run_that_is_done_is_a_new_run() -> None:
    batch, tone = Batch(), Tone()
    [k] = batch.ask_varied({"a": 2.0}, varied(3.0), "x")
    batch.simulate(tone)
    assert batch.ask_varied({"a": 2.0}, varied(3.0), "x") == [k]
    [other] = batch.ask_varied({"a": 2.0}, varied(3.0), "y")
    assert other != k
    batch.simulate(tone)
    assert [r.outputs for r in tone.runs] == [("x",), ("y",)]
